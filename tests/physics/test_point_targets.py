"""Process point targets in closed form: a path of length L has the signal exp(+j 2 pi (f0 + slope n/fs) L/c) at sample n."""

import dataclasses

import numpy as np
import pytest

from radartwin.errors import InputError
from radartwin.radar.angles import azimuth_spectrum
from radartwin.radar.chirp import Radar
from radartwin.radar.detection import detect
from radartwin.radar.power_maps import power_maps
from radartwin.radar.processing import doppler_fft, range_fft
from radartwin.simulation.paths import Paths
from radartwin.simulation.signal.synthesis import synthesize

C = 299_792_458.0
RADAR = Radar.iwr1843(element="isotropic")


def echo(
    range_m: float,
    velocity_mps: float = 0.0,
    azimuth_deg: float = 0.0,
    amplitude: float = 1.0,
    *,
    frames: int = 1,
    radar: Radar = RADAR,
) -> np.ndarray:
    """Return the signal of a moving point from the exact two-way paths between every transmitter and every receiver."""
    direction = np.array([np.cos(np.radians(azimuth_deg)), np.sin(np.radians(azimuth_deg)), 0.0])
    frame, chirp, tx = np.ogrid[:frames, : radar.num_chirps, : radar.num_tx]
    start = frame / radar.frame_rate_hz + (radar.num_tx * chirp + tx) * radar.chirp_interval
    target = (range_m + velocity_mps * start)[..., None] * direction
    to_tx = np.linalg.norm(target - radar.tx_positions, axis=-1)
    to_rx = np.linalg.norm(target[..., None, :] - radar.rx_positions, axis=-1)
    length = to_tx[..., None] + to_rx
    frequency = radar.start_frequency_hz + radar.slope_hz_per_s * np.arange(radar.num_samples) / radar.sample_rate_hz
    signal = amplitude * np.exp(2j * np.pi * frequency * length[..., None] / C)
    return (signal.real + 0j if radar.real_sampling else signal).astype(np.complex64)


@pytest.mark.parametrize("velocity", [0.2, -6.5])
def test_radial_velocity_is_exact_to_one_per_cent_with_its_sign(velocity):
    peaks = detect(echo(2.0, velocity), RADAR)
    assert len(peaks) == 1
    assert peaks.velocity_mps[0] == pytest.approx(velocity, rel=0.01)


def test_twice_the_unambiguous_speed_folds_to_zero():
    folded = detect(echo(2.0, 2 * RADAR.max_velocity_mps), RADAR)
    assert folded.velocity_mps[0] == pytest.approx(0.0, abs=0.02)


@pytest.mark.parametrize("range_m", [0.5, 2.013, 11.0])
def test_range_is_exact_to_a_twentieth_of_a_bin(range_m):
    peaks = detect(echo(range_m), RADAR)
    assert len(peaks) == 1
    assert peaks.range_m[0] == pytest.approx(range_m, abs=0.05 * RADAR.range_resolution_m)


def test_echoes_fold_beyond_the_unambiguous_range():
    assert detect(echo(13.0), RADAR).range_m[0] == pytest.approx(13.0 - 11.1566, abs=0.005)


@pytest.mark.parametrize("azimuth", [-55.0, 0.0, 35.0])
@pytest.mark.parametrize("velocity", [0.0, -2.9])
def test_azimuth_is_positive_to_the_left_at_any_speed(azimuth, velocity):
    peaks = detect(echo(5.0, velocity, azimuth), RADAR)
    # At 5 m the near field of the array changes the phase by 0.2 degrees only.
    assert np.degrees(peaks.azimuth_rad[0]) == pytest.approx(azimuth, abs=0.3)


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


def test_peak_power_between_bins_is_exact_to_a_tenth_of_a_decibel():
    for shift in (0.0, 0.17, 0.25, 0.5):
        peaks = detect(echo((40 + shift) * RADAR.range_resolution_m, 0.3, amplitude=1e-3), RADAR)
        assert 10 * np.log10(peaks.power[0]) == pytest.approx(-60.0, abs=0.1)


def test_two_targets_of_different_strength_are_detected_strongest_first():
    iq = echo(3.0, -1.0, -20.0, 0.1) + echo(1.5, 3.1, 30.0)
    peaks = detect(iq, RADAR)
    assert len(peaks) == 2
    np.testing.assert_allclose(peaks.range_m, [1.5, 3.0], atol=0.005)
    np.testing.assert_allclose(peaks.velocity_mps, [3.1, -1.0], atol=0.03)
    np.testing.assert_allclose(np.degrees(peaks.azimuth_rad), [30.0, -20.0], atol=0.5)


def test_sidelobes_and_noise_are_not_detected():
    rng = np.random.default_rng(11)
    iq = echo(4.0)
    noise = 0.003 * (rng.normal(size=iq.shape) + 1j * rng.normal(size=iq.shape))
    peaks = detect(iq + noise.astype(np.complex64), RADAR)
    np.testing.assert_allclose(peaks.range_m, [4.0], atol=0.003)


def test_weak_target_beside_a_strong_target_is_detected():
    iq = echo(4.0) + echo(4.6, amplitude=0.01)
    np.testing.assert_allclose(detect(iq, RADAR).range_m, [4.0, 4.6], atol=0.01)


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


def test_range_time_map_follows_a_moving_target():
    maps = power_maps(echo(2.0, 0.4, frames=8), RADAR)
    assert maps.range_time.shape[0] == 8
    np.testing.assert_allclose(maps.time_s, np.arange(8) / 10)
    track = maps.range_m[np.argmax(maps.range_time, axis=1)]
    np.testing.assert_allclose(track, 2.0 + 0.4 * maps.time_s, atol=RADAR.range_resolution_m / 2)


def test_real_samples_give_range_and_amplitude():
    radar = dataclasses.replace(RADAR, real_sampling=True)
    peaks = detect(echo(40 * RADAR.range_resolution_m, radar=radar), radar)
    assert peaks.range_m[0] == pytest.approx(40 * RADAR.range_resolution_m, abs=0.002)
    assert 10 * np.log10(peaks.power[0]) == pytest.approx(0.0, abs=0.1)


def test_raised_transmitter_does_not_change_azimuth():
    raised = ((0.0, -0.004, 0.0), (0.0, 0.0, 0.002), (0.0, 0.004, 0.0))
    radar = dataclasses.replace(RADAR, tx_positions_m=raised)
    peaks = detect(echo(5.0, 0.3, 25.0, radar=radar), radar)
    assert np.degrees(peaks.azimuth_rad[0]) == pytest.approx(25.0, abs=0.5)


def test_zeros_have_no_peaks():
    assert len(detect(np.zeros((2, 16, 2, 4, 256), np.complex64), RADAR)) == 0


def test_invalid_shapes_are_refused():
    with pytest.raises(InputError, match="256 sample"):
        range_fft(np.zeros((4, 255), complex), RADAR)
    with pytest.raises(InputError, match="cut off"):
        range_fft(np.zeros((4, 256), complex), RADAR, bins=128)
    with pytest.raises(InputError, match="16 chirp"):
        doppler_fft(np.zeros((1, 15, 2, 4, 256), complex), RADAR)


def synthesized(range_m: float, velocity_mps: float = 0.0, azimuth_deg: float = 0.0, elements: str = "exact") -> np.ndarray:
    """Return the same point target through the synthesis, which receives the single path that a ray tracer would return."""
    direction = np.array([[np.cos(np.radians(azimuth_deg)), np.sin(np.radians(azimuth_deg)), 0.0]])
    length, rate = np.array([range_m]), np.array([2 * velocity_mps])
    amplitude, frequency = np.ones((1, 1), complex), np.array([RADAR.center_frequency_hz])
    path = Paths(1, np.zeros(1, int), np.ones(1, int), amplitude, frequency, length, length, direction, direction, rate)
    return synthesize(path, RADAR, elements=elements)


@pytest.mark.parametrize("velocity", [0.2, -5.0])
@pytest.mark.parametrize("elements", ["exact", "planar"])
def test_synthesis_of_a_moving_point_matches_its_exact_signal(velocity, elements):
    """The point on the boresight also moves within the chirps, by at most 1 cm per frame, so that one range rate is valid for all antenna
    elements.
    """
    t = np.arange(256) / RADAR.sample_rate_hz
    place = np.zeros((16, 2, 1, 256, 3))
    place[..., 0] = 4.0 + velocity * (64e-6 * np.arange(32).reshape(16, 2, 1, 1) + t)
    to_tx = np.linalg.norm(place - RADAR.tx_positions[:, None, None], axis=-1)
    to_rx = np.linalg.norm(place - RADAR.rx_positions[:, None], axis=-1)
    expected = np.exp(2j * np.pi * (77e9 + 70e12 * t) * (to_tx + to_rx) / C)[None]
    error = np.linalg.norm(synthesized(4.0, velocity, elements=elements) - expected) / np.linalg.norm(expected)
    assert error < (1e-4 if elements == "exact" else 4.8e-3)  # the planar array is at most 0.27 degrees off at 4 m


@pytest.mark.parametrize(("velocity", "azimuth"), [(0.2, -40.0), (-0.2, 15.0)])
def test_synthesized_target_has_its_speed_angle_and_range(velocity, azimuth):
    peaks = detect(synthesized(3.0, velocity, azimuth), RADAR)
    assert len(peaks) == 1
    assert peaks.velocity_mps[0] == pytest.approx(velocity, rel=0.01)
    assert np.degrees(peaks.azimuth_rad[0]) == pytest.approx(azimuth, abs=0.3)
    assert peaks.range_m[0] == pytest.approx(3.0, abs=0.005)


@pytest.mark.parametrize("frames", [1, 3])
def test_one_chirp_per_frame_gives_range_and_azimuth_without_a_speed(frames):
    radar = dataclasses.replace(RADAR, num_chirps=1)
    peaks = detect(echo(3.0, 0.0, 25.0, frames=frames, radar=radar), radar)
    assert len(peaks) == 1
    assert peaks.range_m[0] == pytest.approx(3.0, abs=0.005)
    assert np.degrees(peaks.azimuth_rad[0]) == pytest.approx(25.0, abs=0.5)
    assert np.isnan(peaks.velocity_mps).all()
