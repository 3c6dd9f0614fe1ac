"""Energy in the target gate, the multipath share and start offsets, on signals whose values are known."""

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


def test_multipath_share_counts_what_is_outside_the_gate_within_the_window() -> None:
    # Target in bin 40 (2.0 m); 43 is the gate's last bin, 44 outside; 5 (0.25 m) and 111 (5.55 m) lie outside the window.
    power = spikes(b40=4.0, b43=1.0, b44=2.0, b20=3.0, b5=100.0, b111=100.0)
    assert multipath_share(power, AXIS, 2.0) == pytest.approx(5 / 10)
    assert multipath_share(power, AXIS, 2.0, bins=4) == pytest.approx(3 / 10)
    # The share beyond the target leaves out what is before it.
    assert beyond_target_share(power, AXIS, 2.0) == pytest.approx(2 / 10)


def test_a_gate_that_moves_with_the_target_keeps_its_energy_inside() -> None:
    target = np.linspace(3.0, 1.0, 21)
    power = np.stack([spikes(**{f"b{round(r / 0.05)}": 1.0, "b100": 0.25}) for r in target])
    inside, total = gate_energies(power, AXIS, target)
    np.testing.assert_allclose(inside, 1.0)
    np.testing.assert_allclose(total, 1.25)
    assert multipath_share(power, AXIS, target) == pytest.approx(0.2)
    assert multipath_share(power, AXIS, 3.0) > 0.8  # a gate that stays behind loses it


def test_the_share_of_a_recording_is_that_of_its_mean_profile() -> None:
    rng = np.random.default_rng(0)
    power = rng.exponential(size=(30, len(AXIS)))
    assert multipath_share(power, AXIS, 1.5) == pytest.approx(multipath_share(power.mean(axis=0), AXIS, 1.5), rel=1e-12)


def test_a_target_or_shapes_that_cannot_be_are_named() -> None:
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
    """Gate energy of a pass: the target crosses a gate of 0.15 m at 0.2 m/s around t = 2.5 s, with a glint; thermal noise added."""
    signal = np.exp(-(((times - 2.5) / 0.5) ** 2)) + 0.3 * np.exp(-(((times - 3.4) / 0.1) ** 2))
    noise = 10 ** (-snr_db / 20) * (rng.normal(size=len(times)) + 1j * rng.normal(size=len(times))) / np.sqrt(2)
    return np.abs(np.sqrt(signal) + noise) ** 2


@pytest.mark.parametrize("late", [-12, -3, 0, 1, 9])
def test_a_sweep_that_was_set_off_late_is_found_by_its_energy(late: int) -> None:
    rng = np.random.default_rng(abs(late))
    times = np.arange(50) / 10
    found = start_offset(drive(times, rng), 7e3 * drive(times - late / 10, rng), max_frames=20)
    assert found.frames == late
    assert found.correlation > 0.8


@pytest.mark.parametrize(("snr_db", "limit"), [(20, 0.25), (30, 0.08)])
def test_offsets_between_frames_are_found_to_a_fraction_of_a_frame(snr_db: float, limit: float) -> None:
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
def test_a_turntable_is_aligned_around_its_revolution(late: int) -> None:
    rng = np.random.default_rng(late + 1000)
    angle = 2 * np.pi * np.arange(3000) / 250  # twelve revolutions of 25 s at 10 Hz
    shape = 1 + 0.5 * np.cos(angle) + 0.3 * np.cos(2 * angle + 1) + 0.2 * np.sin(5 * angle)
    noisy = [(np.roll(shape, n) + 0.05 * rng.normal(size=3000)).clip(1e-3) for n in (0, late)]
    found = start_offset(noisy[0], noisy[1], period=250)
    assert found.frames == late
    assert found.correlation > 0.95


def test_overlap_gives_the_frames_in_which_the_same_happens() -> None:
    rng = np.random.default_rng(0)
    power = rng.normal(size=(30, 4))
    for late in (-6, 0, 6):
        other = power[6 - late : 24 - late]  # the same world, seen from `late` frames earlier: it happens later in it
        first, second = overlap(power[6:24], other, late)
        np.testing.assert_array_equal(first, second)
        assert len(first) == 18 - abs(late)


@pytest.mark.parametrize("energy", [np.ones(20), np.zeros(20), -np.ones(20), np.full(20, np.nan), np.ones((4, 5)), np.ones(2)], ids=str)
def test_energies_that_cannot_be_aligned_are_refused(energy: np.ndarray) -> None:
    with pytest.raises(InputError, match="start offset"):
        start_offset(energy, energy)


def test_a_revolution_longer_than_the_recording_is_refused() -> None:
    with pytest.raises(InputError, match="revolution of 300 frames"):
        start_offset(np.arange(250.0), np.arange(250.0), period=300)


def test_no_offset_is_better_than_a_perfect_one_at_the_edge() -> None:
    ramp = np.exp(np.linspace(0, 3, 40))  # correlates perfectly at every offset; the smallest must be taken
    assert start_offset(ramp, ramp).frames == 0
