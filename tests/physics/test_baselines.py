"""The naive tracer behaves like the original RF-Genesis program, and point scatterers follow the radar equation."""

import baselines
import numpy as np
import pytest
from physics_helpers import at

import radartwin as rt
from experiments.stability.sweeps import speed_read_mps
from radartwin.constants import SPEED_OF_LIGHT
from radartwin.scene import objects
from radartwin.scene.trajectories import trajectory
from radartwin.simulation.backends import rfgenesis
from radartwin.simulation.backends.backend import backend
from radartwin.simulation.backends.rfgenesis_signal import direct_frame

RADAR = rt.Radar.iwr1843(element="isotropic")
HERE = np.eye(4)[None]


def test_shipped_trihedral_is_below_the_sphere_instead_of_29_db_above():
    """The ratio at 2 m, -11.6 dB in the original program, depends on how the ray pixels of 1.8 cm fall on the trihedral."""
    ratio = baselines.trihedral_over_sphere_db(backend("rfgenesis"), np.linspace(1.9, 2.1, 11))
    assert pytest.approx(29.4, abs=0.05) == baselines.CLOSED_FORM_RATIO_DB
    assert np.median(ratio) == pytest.approx(-11.6, abs=2)
    assert ratio.max() < -5


@pytest.mark.parametrize(("version", "low", "high"), [("shipped", 3, 5), ("corrected", 3.5, 4.5)])
def test_levels_follow_the_range_law_of_each_version(version, low, high):
    exponents = baselines.range_exponents(backend("rfgenesis", version=version), np.geomspace(1, 4, 9)).values()
    assert low <= min(exponents)
    assert max(exponents) <= high


@pytest.mark.parametrize(("version", "levels_db"), [("shipped", (-143, -105)), ("corrected", (-103, -86))])
def test_level_grows_with_the_number_of_rays(version, levels_db):
    """The power grows as rays^2 if every ray keeps its weight, and as rays if each ray carries an equal share of the power."""
    assert baselines.plate_levels_db(version, (128, 1024)) == pytest.approx(levels_db, abs=1.5)


@pytest.mark.parametrize(("version", "speed"), [("shipped", 0.743), ("corrected", 0.2 * 79.106 / 77)])
def test_speed_error_of_the_published_radar(version, speed):
    """The original RF-Genesis program computes speeds with the wavelength at 77 GHz, but its chirps are at about 79.1 GHz."""
    assert speed_read_mps(backend("rfgenesis", version=version), baselines.published_radar(), 0.2) == pytest.approx(speed, rel=0.005)


def test_direct_signal_and_shared_synthesis_agree():
    """The signal of a single hit at rest agrees after removal of the residual video phase."""
    point = np.array([[2.0, 0.3, 0.1]])
    distance = float(np.linalg.norm(point))
    signal = direct_frame(point, point, np.array([distance]), RADAR)[0]
    out, back = (np.linalg.norm(point - p, axis=1) for p in (RADAR.tx_positions, RADAR.rx_positions))
    length = (out[:, None] + back)[..., None]
    frequency = RADAR.start_frequency_hz + RADAR.slope_hz_per_s * np.arange(256) / RADAR.sample_rate_hz
    expected = distance * rfgenesis.power_loss(length) * np.exp(2j * np.pi * frequency * length / SPEED_OF_LIGHT)
    residual = np.exp(-1j * np.pi * RADAR.slope_hz_per_s * (length / SPEED_OF_LIGHT) ** 2)
    assert np.abs(signal - expected * residual).max() < 1e-3 * np.abs(expected).max()


def test_hits_have_exact_directions_and_distances():
    """The pixel rows start at the top and the columns at the left. Of two surfaces the nearer surface is hit."""
    back = rt.Surface(objects.plate(6, 6).apply_transform(at(3.0)), "metal", "back")
    front = rt.Surface(objects.plate(0.5, 0.5), "metal", "front")
    settings = rfgenesis.RFGenesisSettings("corrected", 32)
    hits = rfgenesis.trace(rt.Scene([back, front]), RADAR, HERE, {"front": at(1.0)[None]}, settings)
    plane = np.where(hits.surface[0] == 1, 1.0, 3.0)
    assert hits.directions[0] @ [0, 1, 1] > 0.5
    assert hits.directions[31, 1] < 0
    assert np.abs(hits.distance[0] * hits.directions[:, 0] - plane).max() < 1e-9
    assert (hits.surface[0] == 1).mean() == pytest.approx((0.25 / np.tan(np.radians(30))) ** 2, rel=0.1)


def test_corrected_power_matches_a_diffuse_sphere():
    """Without phases, a Lambert sphere returns 8/3 times the cross-section of a mirror sphere."""
    scene = rt.Scene([rt.Surface(objects.sphere(0.2).apply_transform(at(3.0)), "metal", "ball")])
    (paths,) = backend("rfgenesis", version="corrected", grid=512).paths(scene, RADAR, HERE)
    wavelength = SPEED_OF_LIGHT / RADAR.center_frequency_hz
    expected = 8 / 3 * np.pi * 0.2**2 * wavelength**2 / ((4 * np.pi) ** 3 * 3.0**4)
    assert np.sum(np.abs(paths.amplitude) ** 2) == pytest.approx(expected, rel=0.15)


def test_shipped_hits_remain_where_a_target_was():
    """The original program fills a pixel without a hit from the previous frame."""
    poses = np.array([at(1.5, y) for y in (0.0, 0.3, 0.6)])
    scene = rt.Scene([rt.Surface(objects.plate(0.2, 0.2), "metal", "plate")])
    counts = {}
    for version in ("shipped", "corrected"):
        parts = backend("rfgenesis", version=version).paths(scene, RADAR, np.repeat(HERE, 3, 0), {"plate": poses})
        counts[version] = sum(np.bincount(part.pose, minlength=3) for part in parts)
    assert counts["shipped"][2] > 2.5 * counts["corrected"][2]


def test_point_levels_follow_the_radar_equation_and_miss_the_near_field():
    """At 0.5 m, a plate of 10 cm returns 17.6 dB less than its far-field cross-section."""
    plate = objects.plate(0.1, 0.1)
    far = baselines.level_db(plate, 4.0, backend("points")) - baselines.level_db(plate, 2.0, backend("points"))
    assert far == pytest.approx(-40 * np.log10(2), abs=0.05)
    excess = baselines.level_db(plate, 0.5, backend("points")) - baselines.level_db(plate, 0.5, backend("mitsuba"))
    assert excess == pytest.approx(17.6, abs=1.0)


def test_point_wall_is_the_exact_image_in_level_and_phase():
    wall = rt.Scene([rt.Surface(objects.plate(20.0, 20.0).apply_transform(at(2.0)), "metal", "wall")])
    (paths,) = backend("points").paths(wall, RADAR, HERE)
    assert len(paths) == 1
    wavelength = SPEED_OF_LIGHT / RADAR.center_frequency_hz
    assert complex(paths.amplitude[0, 0]) == pytest.approx(-wavelength / (4 * np.pi * 4.0), rel=2e-3)
    assert paths.length_m == pytest.approx([4.0])
    beside = trajectory.pose([0.0, 30.0, 0.0])[None]
    assert backend("points").paths(wall, RADAR, beside) == []
    assert backend("points", room="void").paths(wall, RADAR, HERE) == []
