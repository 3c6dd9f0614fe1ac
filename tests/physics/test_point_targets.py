"""Processing against point targets in closed form: a path of length L turns as exp(+j 2 pi (f0 + slope n/fs) L/c)."""

import dataclasses

import numpy as np
import pytest

from radartwin.errors import InputError
from radartwin.radar.chirp import Radar
from radartwin.radar.detection import Detector, detect
from radartwin.radar.maps import Chain, survey
from radartwin.radar.processing import azimuth_spectrum, doppler_fft, range_fft, window
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
    """Exact two-way paths from every transmitter over the moving point to every receiver."""
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


@pytest.mark.parametrize("velocity", [0.2, -0.2, 3.0, -6.5])
def test_radial_speed_is_read_within_one_per_cent_with_its_sign(velocity):
    peaks = detect(echo(2.0, velocity), RADAR)
    assert len(peaks) == 1
    assert peaks.velocity_mps[0] == pytest.approx(velocity, rel=0.01)


def test_twice_the_unambiguous_speed_reads_as_none():
    folded = detect(echo(2.0, 2 * RADAR.max_velocity_mps), RADAR)
    assert folded.velocity_mps[0] == pytest.approx(0.0, abs=0.02)


@pytest.mark.parametrize("range_m", [0.5, 1.0, 2.013, 5.55, 8.4, 11.0])
def test_range_is_read_within_a_twentieth_of_a_bin(range_m):
    peaks = detect(echo(range_m), RADAR)
    assert len(peaks) == 1
    assert peaks.range_m[0] == pytest.approx(range_m, abs=0.05 * RADAR.range_resolution_m)


def test_beyond_the_unambiguous_range_echoes_fold():
    assert detect(echo(13.0), RADAR).range_m[0] == pytest.approx(13.0 - 11.1566, abs=0.005)


@pytest.mark.parametrize("azimuth", [-55.0, -20.0, 0.0, 10.0, 35.0, 60.0])
@pytest.mark.parametrize("velocity", [0.0, 0.35, -2.9])
def test_azimuth_is_positive_to_the_left_whatever_the_speed(azimuth, velocity):
    peaks = detect(echo(5.0, velocity, azimuth), RADAR)
    # At 5 m the array's near field (0.2 degrees of phase) is far below this.
    assert np.degrees(peaks.azimuth_rad[0]) == pytest.approx(azimuth, abs=0.3)


def test_without_compensation_motion_would_read_as_angle():
    """The premise of the compensation: a fifth of a turn between the transmitters steers the beam."""
    profiles, _ = range_fft(echo(5.0, 6.0), RADAR)
    cell = np.argmax(np.abs(profiles[0, 0, 0, 0]))
    angles = np.radians(np.arange(-90, 91))
    raw = azimuth_spectrum(profiles[0, 0, :, :, cell], RADAR, angles)
    # 2 v f Tc / c = 0.2 turns over the 4 half wavelengths between the two groups: asin(0.2 / 2), less for Bartlett.
    assert np.degrees(angles[np.argmax(raw)]) == pytest.approx(-4.5, abs=1.5)
    spectra, velocity_mps = doppler_fft(profiles, RADAR, bins=512)
    bin_of_target = np.argmin(np.abs(velocity_mps - 6.0))
    compensated = azimuth_spectrum(spectra[0, bin_of_target, :, :, cell], RADAR, angles)
    assert np.degrees(angles[np.argmax(compensated)]) == pytest.approx(0.0, abs=1.0)


def test_power_is_the_square_of_the_amplitude_in_every_map():
    # On a bin's centre in range, so no scalloping: 40 resolutions away.
    maps = survey(echo(40 * RADAR.range_resolution_m, amplitude=3e-4), RADAR)
    for power in (maps.range_time, maps.range_doppler, maps.range_azimuth):
        assert 10 * np.log10(power.max()) == pytest.approx(20 * np.log10(3e-4), abs=0.05)


def test_peak_power_is_within_a_tenth_of_a_decibel_between_bins():
    for shift in (0.0, 0.17, 0.25, 0.5):
        peaks = detect(echo((40 + shift) * RADAR.range_resolution_m, 0.3, amplitude=1e-3), RADAR)
        assert 10 * np.log10(peaks.power[0]) == pytest.approx(-60.0, abs=0.1)


def test_two_targets_of_unlike_strength_and_motion_are_both_seen_strongest_first():
    iq = echo(3.0, -1.0, -20.0, 0.1) + echo(1.5, 3.1, 30.0)
    peaks = detect(iq, RADAR)
    assert len(peaks) == 2
    np.testing.assert_allclose(peaks.range_m, [1.5, 3.0], atol=0.005)
    np.testing.assert_allclose(peaks.velocity_mps, [3.1, -1.0], atol=0.03)
    np.testing.assert_allclose(np.degrees(peaks.azimuth_rad), [30.0, -20.0], atol=0.5)
    np.testing.assert_allclose(peaks.points_m()[0], [1.5 * np.cos(np.pi / 6), 0.75, 0.0], atol=0.015)


def test_sidelobes_are_no_targets_and_noise_rarely_is():
    rng = np.random.default_rng(11)
    iq = echo(4.0)
    noise = 0.003 * (rng.normal(size=iq.shape) + 1j * rng.normal(size=iq.shape))
    peaks = detect(iq + noise.astype(np.complex64), RADAR)
    np.testing.assert_allclose(peaks.range_m, [4.0], atol=0.003)


@pytest.mark.parametrize("method", ["ca", "os"])
def test_a_weak_target_beside_a_strong_one_is_found(method):
    iq = echo(4.0) + echo(4.6, amplitude=0.01)
    np.testing.assert_allclose(detect(iq, RADAR, Detector(method)).range_m, [4.0, 4.6], atol=0.01)


def test_removing_what_is_static_leaves_what_moves():
    iq = echo(1.2, frames=6) + echo(3.0, 0.5, amplitude=0.003, frames=6)
    peaks = detect(iq, RADAR, chain=Chain(static_removed=True))
    assert np.all(np.abs(peaks.velocity_mps) > 0.2)
    assert peaks.range_m[0] == pytest.approx(3.0 + 0.5 * 0.25, abs=0.15)
    assert survey(iq, RADAR, Chain(static_removed=True)).range_time.max() < 1e-4


def test_blocks_of_frames_change_nothing(monkeypatch):
    iq = echo(2.0, 0.3, 10.0, frames=5)
    whole, peaks = survey(iq, RADAR), detect(iq, RADAR)
    monkeypatch.setattr("radartwin.radar.maps._BLOCK_BYTES", 1)
    blocked = survey(iq, RADAR)
    for name in ("range_time", "range_doppler", "range_azimuth"):
        # Single-precision transforms of another batch size round differently.
        np.testing.assert_allclose(getattr(blocked, name), getattr(whole, name), rtol=1e-5, atol=2e-7)
    np.testing.assert_allclose(detect(iq, RADAR).azimuth_rad, peaks.azimuth_rad, atol=1e-5)


def test_frames_of_a_moving_target_follow_it_over_time():
    maps = survey(echo(2.0, 0.4, frames=8), RADAR)
    assert maps.range_time.shape[0] == 8
    np.testing.assert_allclose(maps.time_s, np.arange(8) / 10)
    track = maps.range_m[np.argmax(maps.range_time, axis=1)]
    np.testing.assert_allclose(track, 2.0 + 0.4 * maps.time_s, atol=RADAR.range_resolution_m / 2)


def test_real_sampling_reads_range_and_amplitude():
    radar = dataclasses.replace(RADAR, real_sampling=True)
    peaks = detect(echo(40 * RADAR.range_resolution_m, radar=radar), radar)
    assert peaks.range_m[0] == pytest.approx(40 * RADAR.range_resolution_m, abs=0.002)
    assert 10 * np.log10(peaks.power[0]) == pytest.approx(0.0, abs=0.1)


def test_a_raised_transmitter_does_not_disturb_azimuth():
    raised = ((0.0, -0.004, 0.0), (0.0, 0.0, 0.002), (0.0, 0.004, 0.0))
    radar = dataclasses.replace(RADAR, tx_positions_m=raised)
    peaks = detect(echo(5.0, 0.3, 25.0, radar=radar), radar)
    assert np.degrees(peaks.azimuth_rad[0]) == pytest.approx(25.0, abs=0.5)


@pytest.mark.parametrize("name", ["hann", "hamming", "blackman", "rectangular"])
def test_every_window_keeps_the_level_of_a_tone(name):
    assert window(name, 64).sum() == pytest.approx(1.0)
    profile, _ = range_fft(echo(40 * RADAR.range_resolution_m), RADAR, taper=name)
    assert np.abs(profile).max() == pytest.approx(1.0, abs=1e-3)


def test_silence_has_no_peaks():
    assert len(detect(np.zeros((2, 16, 2, 4, 256), np.complex64), RADAR)) == 0


def test_shapes_and_options_that_do_not_fit_are_refused():
    with pytest.raises(InputError, match="256 sample"):
        range_fft(np.zeros((4, 255), complex), RADAR)
    with pytest.raises(InputError, match="cut off"):
        range_fft(np.zeros((4, 256), complex), RADAR, bins=128)
    with pytest.raises(InputError, match="kaiser"):
        window("kaiser", 16)
    with pytest.raises(InputError, match="16 chirp"):
        doppler_fft(np.zeros((1, 15, 2, 4, 256), complex), RADAR)
    with pytest.raises(InputError, match="method"):
        Detector("cell")
    with pytest.raises(InputError, match="padding"):
        Chain(padding=0)


def synthesized(range_m: float, velocity_mps: float = 0.0, azimuth_deg: float = 0.0, elements: str = "exact") -> np.ndarray:
    """The same point through the synthesis: one path there and back along one direction, as a tracer hands it over."""
    direction = np.array([[np.cos(np.radians(azimuth_deg)), np.sin(np.radians(azimuth_deg)), 0.0]])
    length, rate = np.array([range_m]), np.array([2 * velocity_mps])
    amplitude, frequency = np.ones((1, 1), complex), np.array([RADAR.center_frequency_hz])
    path = Paths(1, np.zeros(1, int), np.ones(1, int), amplitude, frequency, length, length, direction, direction, rate)
    return synthesize(path, RADAR, elements=elements)


@pytest.mark.parametrize("velocity", [0.2, -0.2, 1.0, -5.0])
@pytest.mark.parametrize("elements", ["exact", "planar"])
def test_synthesis_of_a_mover_is_the_moving_point_itself(velocity, elements):
    """A point on the axis that moves within the chirps too; by 1 cm or less in a frame, so that one rate serves all elements."""
    t = np.arange(256) / RADAR.sample_rate_hz
    place = np.zeros((16, 2, 1, 256, 3))
    place[..., 0] = 4.0 + velocity * (64e-6 * np.arange(32).reshape(16, 2, 1, 1) + t)
    to_tx = np.linalg.norm(place - RADAR.tx_positions[:, None, None], axis=-1)
    to_rx = np.linalg.norm(place - RADAR.rx_positions[:, None], axis=-1)
    expected = np.exp(2j * np.pi * (77e9 + 70e12 * t) * (to_tx + to_rx) / C)[None]
    error = np.linalg.norm(synthesized(4.0, velocity, elements=elements) - expected) / np.linalg.norm(expected)
    assert error < (1e-4 if elements == "exact" else 4.8e-3)  # the planar array is at most 0.27 degrees off at 4 m


@pytest.mark.parametrize("velocity", [0.2, -0.2, 1.7, -6.5])
def test_synthesis_turns_from_loop_to_loop_by_the_doppler_frequency(velocity):
    """Without the processing: the phase between chirps of one transmitter is 2 pi f 2 v T/c at every sample, to 1 %."""
    iq = synthesized(2.0, velocity)[0, :, 0, 0]
    turn = np.angle(np.mean(iq[1:] * iq[:-1].conj(), axis=0))
    f = 77e9 + 70e12 * np.arange(256) / 5.21e6
    expected = 2 * np.pi * f * 2 * velocity * (2 * 64e-6) / C
    np.testing.assert_allclose(turn, np.angle(np.exp(1j * expected)), atol=0.01 * abs(expected).min())


@pytest.mark.parametrize("velocity", [0.2, -3.0])
def test_synthesis_lets_the_second_transmitter_see_the_target_a_chirp_later(velocity):
    """On the axis, with both transmitters at the origin, all that tells them apart is half a loop of motion."""
    radar = dataclasses.replace(RADAR, tx_positions_m=((0, 0, 0),) * 2, rx_positions_m=((0, 0, 0),))
    forward, length = np.array([[1.0, 0.0, 0.0]]), np.array([2.0])
    rest = (np.array([RADAR.center_frequency_hz]), length, length, forward, forward, np.array([2 * velocity]))
    iq = synthesize(Paths(1, np.zeros(1, int), np.ones(1, int), np.ones((1, 1), complex), *rest), radar)[0, :, :, 0]
    f = 77e9 + 70e12 * np.arange(256) / 5.21e6
    turn = np.angle((iq[:, 1] * iq[:, 0].conj()).mean(0))
    np.testing.assert_allclose(turn, 2 * np.pi * f * 2 * velocity * 64e-6 / C, rtol=0.01)


@pytest.mark.parametrize("velocity", [0.2, -0.2])
@pytest.mark.parametrize("azimuth", [-40.0, 0.0, 15.0, 55.0])
def test_a_synthesized_target_at_20_cm_a_second_reads_so_at_its_angle(velocity, azimuth):
    peaks = detect(synthesized(3.0, velocity, azimuth), RADAR)
    assert len(peaks) == 1
    assert peaks.velocity_mps[0] == pytest.approx(velocity, rel=0.01)
    assert np.degrees(peaks.azimuth_rad[0]) == pytest.approx(azimuth, abs=0.3)
    assert peaks.range_m[0] == pytest.approx(3.0, abs=0.005)


def test_phase_grows_by_a_millimetre_of_range_as_it_should():
    """2 pi 2 mm/lambda: 184.9 degrees at 77 GHz on the first sample, 193.2 at the end of the sweep; to a degree over ten of them."""
    f = 77e9 + 70e12 * np.arange(256) / 5.21e6
    before = synthesized(1.5)[0, 0, 0, 0]
    for step in range(1, 11):
        turn = np.angle(synthesized(1.5 + 1e-3 * step)[0, 0, 0, 0] * before.conj())
        off = np.angle(np.exp(1j * (turn - 2 * np.pi * f * 2e-3 * step / C)))
        assert np.degrees(np.abs(off).max()) < 1.0
