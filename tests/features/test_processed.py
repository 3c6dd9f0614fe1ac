"""Processed recordings show the level, range, direction and speed of point echoes, and are stored and loaded unchanged."""

from dataclasses import replace

import numpy as np
import pytest
from echoes import BIN_M, RADAR, echoes

from radartwin.constants import SPEED_OF_LIGHT
from radartwin.errors import MissingError, RecordingError
from radartwin.features.processed import MAX_RANGE_M, Processed, process
from radartwin.radar.processing import azimuth_row


def test_echo_on_a_bin_has_its_power_in_every_product():
    made = process(echoes(3, [(2e-3, 30 * BIN_M)]))
    assert made.power.shape == (3, 138)
    assert made.range_m[-1] <= MAX_RANGE_M < made.range_m[-1] + BIN_M
    assert made.power[:, 30] == pytest.approx(4e-6, rel=1e-4)
    assert np.abs(made.channels[:, :, 30]) == pytest.approx(2e-3, rel=1e-4)
    assert made.doppler is not None
    assert made.doppler[:, 8, 30] == pytest.approx(4e-6, rel=1e-4)
    assert made.velocity_mps[8] == 0


def test_phase_across_the_azimuth_row_follows_the_sine_of_the_direction():
    made = process(echoes(1, [(1.0, 20 * BIN_M, 30.0)]), doppler=False)
    y = RADAR.virtual_positions[azimuth_row(RADAR), 1]
    phase = np.unwrap(np.angle(made.channels[0, np.argsort(y), 20]))
    step = np.diff(np.sort(y))[0]
    assert made.power[0, 20] == pytest.approx(1.0, rel=0.01)  # channels are averaged in power, not in amplitude
    assert np.diff(phase) == pytest.approx(-2 * np.pi * RADAR.center_frequency_hz * step * 0.5 / SPEED_OF_LIGHT, abs=0.01)
    assert made.doppler is None


def test_receding_echo_is_in_its_velocity_bin():
    speed = 2 * RADAR.velocity_resolution_mps
    made = process(echoes(1, [(1.0, lambda t: 1.5 + speed * t)]))
    assert made.doppler is not None
    velocity, _ = np.unravel_index(made.doppler[0].argmax(), made.doppler[0].shape)
    assert made.velocity_mps[velocity] == pytest.approx(speed)


@pytest.mark.parametrize("doppler", [True, False])
def test_noise_estimate_excludes_echoes_at_rest_and_slow_echoes(doppler):
    sigma = 1e-3
    # The noise bandwidth of the Hann window is 1.5 bins; the chirps are averaged coherently.
    expected = 1.5 * sigma**2 / RADAR.num_samples / RADAR.num_chirps
    made = process(echoes(40, [(3e-3, 1.0), (3e-3, lambda t: 2.0 - 0.2 * t)], noise=sigma), doppler)
    assert made.noise_floor.mean() == pytest.approx(expected, rel=0.03)
    assert made.noise_floor == pytest.approx(expected, rel=0.35)  # 320 exponential samples per bin: 6 sigma
    assert made.power[:, made.range_m > 3].mean() == pytest.approx(expected, rel=0.03)
    strong = process(echoes(3, [(1.0, 1.0), (1.0, lambda t: 2.0 - 0.2 * t)]), doppler)
    assert strong.noise_floor.max() < 1e-6 * strong.power.max()


LONG = replace(RADAR, num_chirps=64, chirp_interval=270e-6)  # the frame of the cascade: 64 loops of 0.54 ms


@pytest.mark.parametrize("speed_mps", [0.0, 0.2, 0.5])
def test_moving_echo_keeps_its_power_in_a_long_frame(speed_mps):
    """Three chirps last 1.62 ms and four exceed 2.1 ms, so that a frame has 20 blocks of three chirps and two of two chirps."""
    middle = 30 * BIN_M - speed_mps * LONG.frame_duration_s / 2
    made = process(echoes(1, [(2e-3, lambda t: middle + speed_mps * t)], radar=LONG), doppler=False)
    step = 4 * np.pi * speed_mps * LONG.center_frequency_hz / SPEED_OF_LIGHT * 2 * 270e-6
    kept = {count: np.abs(np.exp(1j * step * np.arange(count)).mean()) ** 2 for count in (2, 3)}
    # At 0.5 m/s, the echo drifts by a fifth of a range bin to each side, where the Hann window loses up to 2 %.
    assert made.power[0, 30] == pytest.approx(4e-6 * (60 * kept[3] + 4 * kept[2]) / 64, rel=0.02)
    assert np.abs(made.channels[0, :, 30]) == pytest.approx(2e-3 * np.sqrt(kept[3]), rel=0.01)


def test_noise_estimate_of_a_long_frame_is_the_power_of_its_blocks():
    sigma = 1e-3
    made = process(echoes(2, [(3e-3, 1.0)], noise=sigma, radar=LONG), doppler=False)
    expected = 1.5 * sigma**2 / LONG.num_samples * 22 / 64
    assert made.noise_floor.mean() == pytest.approx(expected, rel=0.15)  # 16 exponential samples in each of 138 bins: 5 sigma
    assert made.power[:, made.range_m > 3].mean() == pytest.approx(expected, rel=0.03)


def test_save_and_load_round_trip(tmp_path):
    made = process(echoes(5, [(1e-3, lambda t: 1.0 + 0.1 * t), (1e-4, 3.0)], noise=1e-5))
    made.save(tmp_path / "kept")
    again = Processed.load(tmp_path / "kept")
    assert again.radar == made.radar
    for name in ("range_m", "power", "channels", "doppler", "velocity_mps", "noise"):
        assert np.array_equal(getattr(again, name), getattr(made, name))
    first = (tmp_path / "kept" / "processed.npz").read_bytes()
    made.save(tmp_path / "again")
    assert (tmp_path / "again" / "processed.npz").read_bytes() == first


def test_damaged_and_missing_files_are_named(tmp_path):
    with pytest.raises(MissingError, match=r"processed\.json"):
        Processed.load(tmp_path)
    made = process(echoes(2, [(1.0, 1.0)]), doppler=False)
    made.save(tmp_path)
    assert Processed.load(tmp_path).doppler is None
    (tmp_path / "processed.npz").write_bytes((tmp_path / "processed.npz").read_bytes()[:200])
    with pytest.raises(RecordingError, match=str(tmp_path)):
        Processed.load(tmp_path)
