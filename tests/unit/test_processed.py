"""A processed recording against the echoes it was built from: level, range, phase across the array, speed, and what goes wrong."""

from dataclasses import replace

import numpy as np
import pytest

from radartwin.constants import SPEED_OF_LIGHT
from radartwin.errors import InputError, MissingError, RecordingError
from radartwin.features.processed import MAX_RANGE_M, Processed, process
from radartwin.radar.chirp import Radar
from radartwin.radar.processing import azimuth_row
from radartwin.radar.recording import Recording

RADAR = Radar.iwr1843("isotropic")


def echoes(frames: int, points: list[tuple[float, float, float]], azimuth_deg: float = 0.0) -> Recording:
    """Point echoes (amplitude, range at the start in m, speed in m/s) in one far-field direction, frame by frame and chirp by chirp."""
    time = np.arange(frames)[:, None, None] / RADAR.frame_rate_hz + RADAR.chirp_times()[None]
    frequency = RADAR.start_frequency_hz + RADAR.slope_hz_per_s * np.arange(RADAR.num_samples) / RADAR.sample_rate_hz
    towards = np.array([np.cos(np.deg2rad(azimuth_deg)), np.sin(np.deg2rad(azimuth_deg)), 0.0])
    iq = np.zeros((frames, RADAR.num_chirps, RADAR.num_tx, RADAR.num_rx, RADAR.num_samples), complex)
    for amplitude, start_m, speed in points:
        length = 2 * (start_m + speed * time)[..., None] - (RADAR.tx_positions @ towards)[:, None] - RADAR.rx_positions @ towards
        iq += amplitude * np.exp(2j * np.pi * frequency * length[..., None] / SPEED_OF_LIGHT)
    return Recording(iq, RADAR)


def test_an_echo_on_a_bin_reads_its_power_in_every_product():
    bin_m = RADAR.range_resolution_m
    made = process(echoes(3, [(2e-3, 30 * bin_m, 0.0)]))
    assert made.power.shape == (3, 138)
    assert made.range_m[-1] <= MAX_RANGE_M < made.range_m[-1] + bin_m
    assert made.power[:, 30] == pytest.approx(4e-6, rel=1e-4)
    assert np.abs(made.channels[:, :, 30]) == pytest.approx(2e-3, rel=1e-4)
    assert made.doppler is not None
    assert made.doppler[:, 8, 30] == pytest.approx(4e-6, rel=1e-4)
    assert made.velocity_mps[8] == 0


def test_the_azimuth_row_turns_by_the_sine_of_the_direction():
    made = process(echoes(1, [(1.0, 20 * RADAR.range_resolution_m, 0.0)], azimuth_deg=30.0), doppler=False)
    y = RADAR.virtual_positions[azimuth_row(RADAR), 1]
    phase = np.unwrap(np.angle(made.channels[0, np.argsort(y), 20]))
    step = np.diff(np.sort(y))[0]
    assert np.diff(phase) == pytest.approx(-2 * np.pi * RADAR.center_frequency_hz * step * 0.5 / SPEED_OF_LIGHT, abs=0.01)
    assert made.doppler is None


def test_a_receding_echo_lies_in_its_velocity_bin():
    speed = 2 * RADAR.velocity_resolution_mps
    made = process(echoes(1, [(1.0, 1.5, speed)]))
    assert made.doppler is not None
    velocity, _ = np.unravel_index(made.doppler[0].argmax(), made.doppler[0].shape)
    assert made.velocity_mps[velocity] == pytest.approx(speed)


def test_saved_and_loaded_and_cut_in_parts_it_is_the_same(tmp_path):
    made = process(echoes(5, [(1e-3, 1.0, 0.1), (1e-4, 3.0, 0.0)]))
    made.save(tmp_path / "kept")
    again = Processed.load(tmp_path / "kept")
    joined = Processed.concatenate([made.frames(slice(0, 2)), made.frames(np.array([2, 3, 4]))])
    for other in (again, joined):
        assert other.radar == made.radar
        for name in ("range_m", "power", "channels", "doppler", "velocity_mps"):
            assert np.array_equal(getattr(other, name), getattr(made, name))
    first = (tmp_path / "kept" / "processed.npz").read_bytes()
    made.save(tmp_path / "again")
    assert (tmp_path / "again" / "processed.npz").read_bytes() == first


def test_damaged_or_missing_files_are_named(tmp_path):
    with pytest.raises(MissingError, match=r"processed\.json"):
        Processed.load(tmp_path)
    made = process(echoes(2, [(1.0, 1.0, 0.0)]), doppler=False)
    made.save(tmp_path)
    assert Processed.load(tmp_path).doppler is None
    (tmp_path / "processed.npz").write_bytes((tmp_path / "processed.npz").read_bytes()[:200])
    with pytest.raises(RecordingError, match=str(tmp_path)):
        Processed.load(tmp_path)


def test_parts_of_different_radars_or_shapes_are_refused():
    made = process(echoes(1, [(1.0, 1.0, 0.0)]))
    other = Processed(replace(RADAR, name="other"), made.range_m, made.power, made.channels, made.doppler, made.velocity_mps)
    with pytest.raises(InputError, match="different"):
        Processed.concatenate([made, other])
    with pytest.raises(InputError, match="no parts"):
        Processed.concatenate([])
    with pytest.raises(InputError, match="channels"):
        Processed(RADAR, made.range_m, made.power, made.channels[:, :4], None, made.velocity_mps)


def test_samples_that_are_not_numbers_are_refused():
    recording = echoes(2, [(1.0, 1.0, 0.0)])
    recording.iq[1, 0, 0, 0, 0] = np.nan
    with pytest.raises(RecordingError, match="NaN"):
        process(recording)
