"""Process point targets in closed form: a path of length L has the signal exp(+j 2 pi (f0 + slope n/fs) L/c) at sample n."""

import dataclasses

import numpy as np
import pytest
from physics_helpers import noisy, point_echo

from radartwin.errors import InputError
from radartwin.radar.angles import azimuth_spectrum
from radartwin.radar.chirp import Radar
from radartwin.radar.detection import detect
from radartwin.radar.power_maps import power_maps
from radartwin.radar.processing import doppler_fft, range_fft

RADAR = Radar.iwr1843(element="isotropic")
RAISED = dataclasses.replace(RADAR, tx_positions_m=((0.0, -0.004, 0.0), (0.0, 0.0, 0.002), (0.0, 0.004, 0.0)))
REAL = dataclasses.replace(RADAR, real_sampling=True)


def echo(range_m: float, velocity_mps: float = 0.0, azimuth_deg: float = 0.0, radar: Radar = RADAR, **values) -> np.ndarray:
    angle = np.radians(azimuth_deg)
    return point_echo(radar, range_m * np.array([np.cos(angle), np.sin(angle), 0.0]), velocity_mps, **values)


@pytest.mark.parametrize(
    ("range_m", "velocity", "azimuth", "radar"),
    [(0.5, 0.2, 0.0, RADAR), (2.013, -6.5, 0.0, RADAR), (11.0, 0.0, 0.0, RADAR), (5.0, 0.0, 35.0, RADAR), (5.0, -2.9, -55.0, RADAR),
     (5.0, 0.3, 25.0, RAISED), (40 * RADAR.range_resolution_m, 0.0, 0.0, REAL)],
)  # fmt: skip
def test_detected_point_has_its_range_speed_azimuth_and_power(range_m, velocity, azimuth, radar):
    """Positive azimuth is to the left."""
    peaks = detect(echo(range_m, velocity, azimuth, radar), radar)
    assert len(peaks) == 1
    # within a frame, a moving point crosses a part of its cell
    assert peaks.range_m[0] == pytest.approx(range_m, abs=0.05 * RADAR.range_resolution_m + 3e-3 * abs(velocity))
    assert peaks.velocity_mps[0] == pytest.approx(velocity, rel=0.01, abs=1e-3)
    assert np.degrees(peaks.azimuth_rad[0]) == pytest.approx(azimuth, abs=0.5 if radar is RAISED else 0.3)
    assert 10 * np.log10(peaks.power[0]) == pytest.approx(0.0, abs=0.1 + 0.05 * abs(velocity))


def test_ranges_and_speeds_beyond_the_unambiguous_ones_fold():
    assert detect(echo(13.0), RADAR).range_m[0] == pytest.approx(13.0 - 11.1566, abs=0.005)
    assert detect(echo(2.0, 2 * RADAR.max_velocity_mps), RADAR).velocity_mps[0] == pytest.approx(0.0, abs=0.02)


def test_uncompensated_motion_shifts_the_angle():
    """A TDM phase of a fifth of a cycle between the two transmitters would steer the beam if the processing did not compensate it."""
    profiles, _ = range_fft(echo(5.0, 6.0), RADAR)
    cell = np.argmax(np.abs(profiles[0, 0, 0, 0]))
    angles = np.radians(np.arange(-90, 91))
    raw = azimuth_spectrum(profiles[0, :1, :, :, cell], RADAR, angles)
    # 2 v f Tc / c = 0.2 turns over the 4 half wavelengths between the two groups: asin(0.2 / 2), less for Bartlett.
    assert np.degrees(angles[np.argmax(raw)]) == pytest.approx(-4.5, abs=1.5)
    spectra, velocity_mps = doppler_fft(profiles, RADAR, bins=512)
    bin_of_target = np.argmin(np.abs(velocity_mps - 6.0))
    compensated = azimuth_spectrum(spectra[:, bin_of_target, :, :, cell], RADAR, angles)
    assert np.degrees(angles[np.argmax(compensated)]) == pytest.approx(0.0, abs=1.0)


def test_power_is_the_square_of_the_amplitude_in_every_map():
    # 40 range resolutions away, on the centre of a bin, so there is no scalloping loss.
    maps = power_maps(echo(40 * RADAR.range_resolution_m, amplitude=3e-4), RADAR)
    for power in (maps.range_time, maps.range_doppler, maps.range_azimuth):
        assert 10 * np.log10(power.max()) == pytest.approx(20 * np.log10(3e-4), abs=0.05)


@pytest.mark.parametrize(
    ("points", "noise"),
    [
        ([(4.0, 0.0, 0.0, 1.0)], 0.003 * np.sqrt(2)),  # no sidelobe and no noise
        ([(4.0, 0.0, 0.0, 1.0), (4.6, 0.0, 0.0, 0.01)], 0.0),  # a weak target beside a strong one
        ([(1.5, 3.1, 30.0, 1.0), (3.0, -1.0, -20.0, 0.1)], 0.0),
    ],
)
def test_exactly_the_targets_are_detected_strongest_first(points, noise):
    peaks = detect(noisy(sum(echo(*where, amplitude=amplitude) for *where, amplitude in points), noise, seed=11), RADAR)
    range_m, velocity, azimuth, _ = np.transpose(points)
    np.testing.assert_allclose(peaks.range_m, range_m, atol=0.003 if noise else 0.005 if velocity.any() else 0.01)
    np.testing.assert_allclose(peaks.velocity_mps, velocity, atol=0.03)
    np.testing.assert_allclose(np.degrees(peaks.azimuth_rad), azimuth, atol=0.5)


def test_static_removal_leaves_the_moving_target():
    iq = echo(1.2, frames=6) + echo(3.0, 0.5, amplitude=0.003, frames=6)
    peaks = detect(iq, RADAR, static_removed=True)
    assert np.all(np.abs(peaks.velocity_mps) > 0.2)
    assert peaks.range_m[0] == pytest.approx(3.0 + 0.5 * 0.25, abs=0.15)
    assert power_maps(iq, RADAR, static_removed=True).range_time.max() < 1e-4


def test_block_size_does_not_change_the_maps(monkeypatch):
    iq = echo(2.0, 0.3, 10.0, frames=5)
    whole, peaks = power_maps(iq, RADAR), detect(iq, RADAR)
    monkeypatch.setattr("radartwin.radar.power_maps._BLOCK_BYTES", 1)
    blocked = power_maps(iq, RADAR)
    for name in ("range_time", "range_doppler", "range_azimuth"):
        # The rounding of single-precision transforms depends on the batch size.
        np.testing.assert_allclose(getattr(blocked, name), getattr(whole, name), rtol=1e-5, atol=2e-7)
    np.testing.assert_allclose(detect(iq, RADAR).azimuth_rad, peaks.azimuth_rad, atol=1e-5)


def test_invalid_shapes_are_refused():
    with pytest.raises(InputError, match="256 sample"):
        range_fft(np.zeros((4, 255), complex), RADAR)
    with pytest.raises(InputError, match="cut off"):
        range_fft(np.zeros((4, 256), complex), RADAR, bins=128)
    with pytest.raises(InputError, match="16 chirp"):
        doppler_fft(np.zeros((1, 15, 2, 4, 256), complex), RADAR)


@pytest.mark.parametrize("frames", [1, 3])
def test_one_chirp_per_frame_gives_range_and_azimuth_without_a_speed(frames):
    radar = dataclasses.replace(RADAR, num_chirps=1)
    peaks = detect(echo(3.0, 0.0, 25.0, frames=frames, radar=radar), radar)
    assert len(peaks) == 1
    assert peaks.range_m[0] == pytest.approx(3.0, abs=0.005)
    assert np.degrees(peaks.azimuth_rad[0]) == pytest.approx(25.0, abs=0.5)
    assert np.isnan(peaks.velocity_mps).all()
