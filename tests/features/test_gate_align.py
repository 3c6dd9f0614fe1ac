"""Energy in the target gate, the multipath share and start offsets, on signals with known values."""

from __future__ import annotations

import numpy as np
import pytest

from radartwin.errors import InputError
from radartwin.features.align import overlap, start_offset
from radartwin.features.gate import gate_energies, multipath_share
from radartwin.features.profile import beyond_target_share

AXIS = np.arange(200) * 0.05  # 0 to 9.95 m


def spikes(**energy_by_bin: float) -> np.ndarray:
    power = np.zeros(len(AXIS))
    for name, energy in energy_by_bin.items():
        power[int(name[1:])] = energy
    return power


def test_multipath_share_is_the_energy_outside_the_gate() -> None:
    # The target is in bin 40 (2.0 m), 43 is the last bin of the gate, and 5 (0.25 m) and 111 (5.55 m) are outside the range window.
    power = spikes(b40=4.0, b43=1.0, b44=2.0, b20=3.0, b5=100.0, b111=100.0)
    assert multipath_share(power, AXIS, 2.0) == pytest.approx(5 / 10)
    assert multipath_share(power, AXIS, 2.0, bins=4) == pytest.approx(3 / 10)
    # The share beyond the target excludes the energy in front of the target.
    assert beyond_target_share(power, AXIS, 2.0) == pytest.approx(2 / 10)


def test_moving_gate_contains_the_energy_of_a_moving_target() -> None:
    target = np.linspace(3.0, 1.0, 21)
    power = np.stack([spikes(**{f"b{round(r / 0.05)}": 1.0, "b100": 0.25}) for r in target])
    inside, total = gate_energies(power, AXIS, target)
    np.testing.assert_allclose(inside, 1.0)
    np.testing.assert_allclose(total, 1.25)
    assert multipath_share(power, AXIS, target) == pytest.approx(0.2)
    assert multipath_share(power, AXIS, 3.0) > 0.8  # a fixed gate misses it


def test_share_of_a_recording_equals_the_share_of_its_mean_profile() -> None:
    rng = np.random.default_rng(0)
    power = rng.exponential(size=(30, len(AXIS)))
    assert multipath_share(power, AXIS, 1.5) == pytest.approx(multipath_share(power.mean(axis=0), AXIS, 1.5), rel=1e-12)


def test_invalid_targets_and_shapes_are_named() -> None:
    power = np.ones((3, len(AXIS)))
    for target in (0.2, 5.6, np.nan, [1.0, 1.0, 6.0]):
        with pytest.raises(InputError, match=r"0\.3 and 5\.5 m"):
            gate_energies(power, AXIS, target)
    with pytest.raises(InputError, match="do not fit"):
        gate_energies(power, AXIS, [1.0, 1.0])
    with pytest.raises(InputError, match="do not fit"):
        gate_energies(power, AXIS[1:], 1.0)
    with pytest.raises(InputError, match="no energy"):
        multipath_share(np.zeros((3, len(AXIS))), AXIS, 1.0)


def drive(times: np.ndarray, rng: np.random.Generator, snr_db: float = 30.0) -> np.ndarray:
    """Gate energy of a pass with a glint and noise: the target crosses a gate of 0.15 m at 0.2 m/s around t = 2.5 s."""
    signal = np.exp(-(((times - 2.5) / 0.5) ** 2)) + 0.3 * np.exp(-(((times - 3.4) / 0.1) ** 2))
    noise = 10 ** (-snr_db / 20) * (rng.normal(size=len(times)) + 1j * rng.normal(size=len(times))) / np.sqrt(2)
    return np.abs(np.sqrt(signal) + noise) ** 2


@pytest.mark.parametrize("late", [-12, -3, 0, 1, 9])
def test_late_start_is_found_from_the_energy(late: int) -> None:
    rng = np.random.default_rng(abs(late))
    times = np.arange(50) / 10
    found = start_offset(drive(times, rng), 7e3 * drive(times - late / 10, rng), max_frames=20)
    assert found.frames == late
    assert found.correlation > 0.8


@pytest.mark.parametrize(("snr_db", "limit"), [(20, 0.25), (30, 0.08)])
def test_start_offset_is_exact_to_a_fraction_of_a_frame(snr_db: float, limit: float) -> None:
    times, errors = np.arange(50) / 10, []
    for seed in range(200):
        rng = np.random.default_rng(seed)
        late = rng.uniform(-5, 5)
        found = start_offset(drive(times, rng, snr_db), drive(times - late / 10, rng, snr_db), max_frames=10)
        errors.append(found.exact - late)
        assert abs(found.frames - found.exact) <= 0.5
    assert np.sqrt(np.mean(np.square(errors))) < limit
    assert abs(np.mean(errors)) < 3 * limit / np.sqrt(200)


def test_recordings_of_different_length_are_aligned() -> None:
    rng = np.random.default_rng(1)
    long = drive(np.arange(80) / 10 - 1.7, rng)
    assert start_offset(drive(np.arange(50) / 10, rng), long).frames == 17
    assert start_offset(long, drive(np.arange(50) / 10, rng)).frames == -17


@pytest.mark.parametrize("late", [-100, -7, 0, 33, 124])
def test_turntable_is_aligned_over_its_revolution(late: int) -> None:
    rng = np.random.default_rng(late + 1000)
    angle = 2 * np.pi * np.arange(3000) / 250  # twelve revolutions of 25 s at 10 Hz
    shape = 1 + 0.5 * np.cos(angle) + 0.3 * np.cos(2 * angle + 1) + 0.2 * np.sin(5 * angle)
    noisy = [(np.roll(shape, n) + 0.05 * rng.normal(size=3000)).clip(1e-3) for n in (0, late)]
    found = start_offset(noisy[0], noisy[1], period=250)
    assert found.frames == late
    assert found.correlation > 0.95


def test_overlap_returns_the_common_frames() -> None:
    rng = np.random.default_rng(0)
    power = rng.normal(size=(30, 4))
    for late in (-6, 0, 6):
        other = power[6 - late : 24 - late]  # starts `late` frames earlier, so the same events are `late` frames later in it
        first, second = overlap(power[6:24], other, late)
        np.testing.assert_array_equal(first, second)
        assert len(first) == 18 - abs(late)


@pytest.mark.parametrize("energy", [np.ones(20), np.zeros(20), -np.ones(20), np.full(20, np.nan), np.ones((4, 5)), np.ones(2)], ids=str)
def test_invalid_energies_are_refused(energy: np.ndarray) -> None:
    with pytest.raises(InputError, match="start offset"):
        start_offset(energy, energy)


def test_revolution_longer_than_the_recording_is_refused() -> None:
    with pytest.raises(InputError, match="revolution of 300 frames"):
        start_offset(np.arange(250.0), np.arange(250.0), period=300)


def test_smallest_of_equally_good_offsets_is_taken() -> None:
    ramp = np.exp(np.linspace(0, 3, 40))  # correlates perfectly at every offset
    assert start_offset(ramp, ramp).frames == 0
