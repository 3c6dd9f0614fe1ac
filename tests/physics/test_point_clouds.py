"""Point clouds of exact point echoes, and of two traced spheres at equal range closer than the Rayleigh width."""

import dataclasses

import numpy as np
import pytest
from physics_helpers import noisy
from physics_helpers import point_echo as echo

import radartwin as rt
from radartwin.errors import InputError
from radartwin.radar.angles import azimuth_spectrum
from radartwin.radar.boards import IWR1843BOOST
from radartwin.radar.cell_directions import maxima, standard_method
from radartwin.radar.chirp import Radar
from radartwin.radar.detection import detect, point_clouds
from radartwin.radar.named import awr2243_cascade
from radartwin.radar.processing import range_fft
from radartwin.scene import objects
from radartwin.scene.trajectories import trajectory

C = 299_792_458.0
RADAR = Radar.iwr1843(element="isotropic")
RAISED = dataclasses.replace(RADAR, tx_positions_m=IWR1843BOOST.tx_positions_m)
METHODS = ["bartlett", "capon", "music"]
# Width of the main lobe from maximum to first null, lambda / (M d), of the eight antennas half a wavelength of 77 GHz apart: 14 degrees.
RAYLEIGH_DEG = np.degrees(np.arcsin(C / RADAR.center_frequency_hz / (8 * C / 77e9 / 2)))


def place(range_m: float, azimuth_deg: float, elevation_deg: float = 0.0) -> np.ndarray:
    a, e = np.radians([azimuth_deg, elevation_deg])
    return range_m * np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("azimuth", "elevation"), [(25.0, 12.0), (-30.0, -20.0)])
def test_point_is_in_its_place_in_three_dimensions_at_any_speed(method, azimuth, elevation):
    where = place(4.0, azimuth, elevation)
    clouds = point_clouds(noisy(echo(RAISED, where, 1.7, frames=3), 0.03), RAISED, angle=method)
    assert len(clouds) == 3
    for frame, cloud in enumerate(clouds):
        assert len(cloud) == 1
        # The frame lasts 3 ms, in which the point moves by 5 mm; the azimuth and elevation errors of 30 dB are 0.3 degrees, 2 cm at 4 m.
        np.testing.assert_allclose(cloud.xyz_m[0], where * (4.0 + 1.7 * frame / RAISED.frame_rate_hz) / 4.0, atol=0.03)
        assert cloud.velocity_mps[0] == pytest.approx(1.7, abs=0.02)
        assert np.degrees(cloud.azimuth_rad[0]) == pytest.approx(azimuth, abs=0.4)
        assert np.degrees(cloud.elevation_rad[0]) == pytest.approx(elevation, abs=0.4)


def test_signal_to_noise_ratio_is_that_of_the_integrated_echo():
    """The Hann windows of range and Doppler have the noise bandwidth 3/2 each, so the ratio grows by N C / (3/2)^2 in a cell."""
    iq = noisy(echo(RADAR, place(40 * RADAR.range_resolution_m, 0.0), frames=40), 1.0)
    expected = 10 * np.log10(RADAR.num_samples * RADAR.num_chirps / 2.25)
    found = [cloud.snr_db[0] for cloud in point_clouds(iq, RADAR)]
    # The mean over 40 frames of 8 channels; the training cells have the statistical error 0.1 dB and the echo 0.05 dB.
    assert np.mean(found) == pytest.approx(expected, abs=0.3)


def test_frame_without_an_echo_has_no_points_and_static_echoes_can_be_removed():
    assert [len(cloud) for cloud in point_clouds(np.zeros((2, 16, 2, 4, 256), np.complex64), RADAR)] == [0, 0]
    iq = echo(RADAR, place(1.2, 0.0), frames=6) + echo(RADAR, place(3.0, 30.0), 0.6, frames=6, amplitude=0.01)
    for frame, cloud in enumerate(point_clouds(noisy(iq, 1e-3), RADAR, static_removed=True)):
        assert cloud.range_m[0] == pytest.approx(3.0 + 0.06 * frame, abs=0.02)
        assert (cloud.range_m > 2).all()


@pytest.mark.parametrize("method", ["capon", "music"])
def test_one_target_gives_one_point(method):
    """A false second target of a cell would need a third of the amplitude of the first target."""
    counts = []
    for seed in range(40):
        azimuth = np.random.default_rng(seed).uniform(-50, 50)
        (cloud,) = point_clouds(noisy(echo(RADAR, place(3.0, azimuth), 0.3), 0.3, seed), RADAR, angle=method)
        counts.append(len(cloud))
        assert np.degrees(cloud.azimuth_rad[0]) == pytest.approx(azimuth, abs=0.5)
    assert sum(count != 1 for count in counts) <= 3


def test_second_target_of_a_cell_has_its_own_power():
    iq = noisy(echo(RADAR, place(3.0, -6.0)) + echo(RADAR, place(3.0008, 6.0), amplitude=0.5), 1e-3)
    (peaks,) = point_clouds(iq, RADAR, angle="music")
    assert len(peaks) == 2
    np.testing.assert_allclose(np.degrees(peaks.azimuth_rad), [-6.0, 6.0], atol=0.5)
    assert 10 * np.log10(peaks.power[0] / peaks.power[1]) == pytest.approx(6.02, abs=0.5)


@pytest.mark.parametrize("speed_mps", [0.0, 3.0])
def test_frame_of_two_chirps_measures_speed_and_azimuth(speed_mps):
    radar = dataclasses.replace(RADAR, num_chirps=2)
    peaks = detect(noisy(echo(radar, place(3.0, 20.0), speed_mps), 0.01), radar)
    # The power over the velocity is a cosine squared of the period 14.9 m/s. The parabola in decibels through its bins is not exact.
    assert peaks.velocity_mps[0] == pytest.approx(speed_mps, abs=0.15)
    assert np.degrees(peaks.azimuth_rad[0]) == pytest.approx(20.0, abs=0.3)


@pytest.mark.parametrize("azimuth", [60.0, -80.0])
@pytest.mark.parametrize("method", METHODS)
def test_point_near_the_plane_of_the_array_keeps_its_power(method, azimuth):
    """At 78.72 GHz, antennas half a wavelength of 77 GHz apart have equal phases in two directions if |sin(azimuth)| exceeds 0.956."""
    alias = np.sin(np.radians(azimuth)) - np.sign(azimuth) * 2 * C / RADAR.center_frequency_hz / (C / 77e9)
    peaks = detect(noisy(echo(RADAR, place(3.0, azimuth)), 0.1), RADAR, angle=method)
    assert 10 * np.log10(peaks.power[0]) == pytest.approx(0.0, abs=0.5)  # the amplitude is 1
    same = [np.sin(np.radians(azimuth)), *([alias] if abs(alias) <= 1 else [])]
    # The wave's curvature at 3 m and the grid of Bartlett move the estimate by less than a tenth of the Rayleigh width.
    assert min(abs(np.sin(peaks.azimuth_rad[0]) - uy) for uy in same) < 0.025


@pytest.mark.parametrize("method", ["capon", "music"])
@pytest.mark.parametrize(
    ("radar", "range_m", "azimuths", "away_deg"),
    [
        *((dataclasses.replace(RADAR, **{name: getattr(RADAR, name)[::-1]}), 3.0, (-20.0, -8.0), 0.5)
          for name in ("tx_positions_m", "rx_positions_m")),
        # 144 channels at 86 places of a uniform line, whose Rayleigh width is 1.3 degrees; at 14 m, the waves are curved by 0.2 radian
        (dataclasses.replace(awr2243_cascade(), num_chirps=2, num_samples=64), 14.0, (-1.5, 1.5), 0.2),
    ],
    ids=["reversed transmitters", "reversed receivers", "cascade"],
)  # fmt: skip
def test_two_echoes_of_one_cell_are_separate(method, radar, range_m, azimuths, away_deg):
    """The second point is 0.3 mm farther, which is 57 degrees of its echo's phase. Smoothing restores no rank for equal phases."""
    iq = noisy(sum(echo(radar, place(range_m + 3e-4 * n, azimuth)) for n, azimuth in enumerate(azimuths)), 1e-2)
    np.testing.assert_allclose(np.sort(np.degrees(detect(iq, radar, angle=method).azimuth_rad)), azimuths, atol=away_deg)


def test_traced_spheres_within_the_rayleigh_width_need_capon_or_music():
    """The nearest points are at 2 m. One sphere is farther by 0.48 mm, a quarter turn of phase: at 0, the smoothed matrix has one rank."""
    true_deg = 0.35 * RAYLEIGH_DEG * np.array([-1, 1])
    motion = {f"ball{n}": np.repeat(trajectory.pose(place(2.03 + 0.48e-3 * n, true_deg[n]))[None], 10, axis=0) for n in (0, 1)}
    scene = rt.Scene([rt.Surface(objects.sphere(0.03), "metal", name) for name in motion])
    recording = rt.simulate(scene, RADAR, np.eye(4), motion=motion, noise=True)
    profiles, range_m = range_fft(recording.iq, RADAR)
    grid = np.radians(np.arange(-60, 60.25, 0.25))
    bartlett = azimuth_spectrum(profiles[0, :1, :, :, np.argmin(np.abs(range_m - 2.0))], RADAR, grid)
    assert np.abs(np.degrees(np.sort(grid[maxima(bartlett)[:2]])) - true_deg).max() > 3.0
    assert len(detect(recording.iq, RADAR)) == 1
    for method in ("capon", "music"):
        peaks = detect(recording.iq, RADAR, angle=method)
        assert len(peaks) == 2
        np.testing.assert_allclose(peaks.range_m, 2.0, atol=0.01)
        # Noise 32 dB below the echo moves the estimates by some tenths of a degree, as does the wave's curvature of 2 degrees of phase.
        np.testing.assert_allclose(np.sort(np.degrees(peaks.azimuth_rad)), true_deg, atol=0.8)


def line(ways: tuple[float, float, float], *places: float) -> tuple[tuple[float, ...], ...]:
    return tuple(tuple(way * place for way in ways) for place in places)


FOUR = (0.0, 0.0014, 0.0028, 0.0042)
SINGLE = {"tx_positions_m": ((0.0, 0.0, 0.0),), "rx_positions_m": ((0.0, 0.0, 0.0),)}
VERTICAL = {"tx_positions_m": line((0, 0, 1), 0.0, 0.0078), "rx_positions_m": line((0, 0, 1), 0.0, 0.00195, 0.0039, 0.00585)}
UNEVEN = {"rx_positions_m": line((0, 1, 0), -0.003, -0.0012, 0.001, 0.0029)}
NONE = float("nan")


@pytest.mark.parametrize(
    ("array", "method", "where", "azimuth", "elevation", "noise", "away_m"),
    [
        ({}, "bartlett", place(3.0, 20.0), 20.0, NONE, 0.01, 0.02),
        (VERTICAL, "capon", place(4.0, 0.0, 15.0), NONE, 15.0, 0.01, 0.04),
        *((UNEVEN, method, place(3.0, 15.0), 15.0, NONE, 0.03, 0.03) for method in METHODS),
        # On a diagonal line, the phases depend on u_y + u_z only; a single channel has no phases to compare.
        (SINGLE | {"rx_positions_m": line((0, 1, 1), *FOUR)}, "bartlett", place(2.0, 0.0), NONE, NONE, 1e-3, 0.005),
        (SINGLE, "music", place(2.0, 0.0), NONE, NONE, 1e-3, 0.005),
    ],
)
def test_point_has_the_directions_that_its_array_measures(array, method, where, azimuth, elevation, noise, away_m):
    radar = dataclasses.replace(RADAR, **array)
    (cloud,) = point_clouds(noisy(echo(radar, where), noise), radar, angle=method)
    assert len(cloud)
    for found, expected in ((cloud.azimuth_rad, azimuth), (cloud.elevation_rad, elevation)):
        assert np.degrees(found) == pytest.approx(np.full(len(cloud), expected), abs=0.4, nan_ok=True)
    np.testing.assert_allclose(cloud.xyz_m, np.tile(where, (len(cloud), 1)), atol=away_m)
    assert array is not UNEVEN or standard_method("music", radar.virtual_positions).subarray == 0  # no smoothing


def test_unknown_method_is_refused():
    with pytest.raises(InputError, match="bartlett"):
        point_clouds(echo(RADAR, place(3.0, 0.0)), RADAR, angle="esprit")
