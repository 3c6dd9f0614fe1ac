"""The diffuse point cloud of rough walls and moving bodies: level, energy, fixed points, density, shadows and motion."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from posing import placed, turning
from scipy.spatial.transform import Rotation

import radartwin as rt
from experiments.validation.oracles.energy import rough_wall_power
from radartwin.constants import SPEED_OF_LIGHT
from radartwin.materials import CORRELATION_M
from radartwin.radar.chirp import Radar
from radartwin.scene.scene import Surface
from radartwin.simulation import diffuse, geometry, variant, visibility
from radartwin.simulation.backends.mitsuba import MitsubaBackend
from radartwin.simulation.backends.trace_settings import TraceSettings
from radartwin.simulation.backends.track_paths import Track
from radartwin.simulation.paths import Paths
from radartwin.simulation.signal.synthesis import synthesize

ISOTROPIC = Radar.iwr1843(element="isotropic")
MIDDLE = ISOTROPIC.start_frequency_hz + ISOTROPIC.sampled_bandwidth_hz / 2
WAVELENGTH = SPEED_OF_LIGHT / MIDDLE
SIGMA, LENGTH = 0.3e-3, CORRELATION_M  # rms height and correlation length of the wall


def rectangle(distance: float, low: tuple[float, float], high: tuple[float, float]) -> trimesh.Trimesh:
    """Return a rectangle in the plane x = distance that faces -x, between two corners (y, z)."""
    (y0, z0), (y1, z1) = low, high
    corners = np.array([[distance, y, z] for y, z in ((y0, z0), (y0, z1), (y1, z1), (y1, z0))])
    return trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], process=False)


WALL = Surface(rectangle(2.0, (-1.5, -1.0), (1.5, 1.5)), "concrete", "wall", roughness_m=SIGMA, correlation_m=LENGTH)


HERE = np.eye(4)[None]


def wall_power(distance: float, low: tuple[float, float], high: tuple[float, float]) -> float:
    """Return the mean diffuse power of a rectangle of the wall by quadrature of Kirchhoff's integral."""
    return rough_wall_power(rectangle(0.0, low, high).vertices, np.array([distance, 0.0, 0.0]), SIGMA, WAVELENGTH)


def traced(surfaces, poses, radar=ISOTROPIC, count=None, velocity=None, unit=False) -> Paths:
    variant.activate("auto")
    room = geometry.build([s.mesh for s in surfaces])
    scatterers = diffuse.cloud(surfaces, room, count)
    if unit:
        scatterers = replace(scatterers, field=np.ones(len(scatterers), complex))
    return diffuse.paths(scatterers, diffuse.strengths(surfaces, radar), room, radar, poses, velocity)


def test_backscatter_is_equal_in_both_polarisations():
    """A carpet under the radar has a wide lobe."""
    floor = rectangle(0.0, (-1.0, 1.0), (1.0, 3.0)).apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [0, 1, 0]))
    carpet = Surface(floor.apply_translation([0, 0, -1.0]), "plasterboard", "carpet", roughness_m=3e-3, correlation_m=3e-3)
    upright, rolled = np.eye(4), np.eye(4)
    rolled[:3, :3] = [[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]
    power = [float((np.abs(traced([carpet], pose[None]).amplitude) ** 2).sum()) for pose in (upright, rolled)]
    assert power[0] > 0
    assert power[0] == pytest.approx(power[1], rel=1e-6)


@pytest.mark.parametrize("count", [2_000, 50_000])
def test_mean_power_is_the_integral_for_any_number_of_points(count):
    mean = (np.abs(traced([WALL], HERE, count=count, unit=True).amplitude) ** 2).sum()
    assert mean == pytest.approx(wall_power(2.0, (-1.5, -1.0), (1.5, 1.5)), rel=0.03)


def test_speckle_is_exponential_about_the_same_mean():
    """The tolerances are four standard deviations."""
    count = 10_000
    mean = np.abs(traced([WALL], HERE, count=count, unit=True).amplitude[:, 0]) ** 2
    drawn = np.abs(traced([WALL], HERE, count=count).amplitude[:, 0]) ** 2
    assert abs(drawn.sum() - mean.sum()) < 4 * np.sqrt((mean**2).sum())
    power = np.abs(diffuse.cloud([WALL], geometry.build([WALL.mesh]), count).field) ** 2
    assert power.mean() == pytest.approx(1.0, abs=4 / np.sqrt(count))
    assert (power**2).mean() == pytest.approx(2.0, abs=4 * np.sqrt(20 / count))


@pytest.mark.parametrize(("count", "least_db"), [(20_000, -0.3), (None, -1.5)])
def test_close_points_return_no_more_than_their_cell(count, least_db):
    """The radar is at 15 cm from a wall; no point returns more than the whole lobe of its surface."""
    sensors = placed([(1.85, 0.05 + 0.013 * i, 0.03 - 0.017 * i) for i in range(40)])
    power = np.abs(traced([WALL], sensors, count=count, unit=True).amplitude[:, 0]) ** 2
    expected = wall_power(0.15, (-0.6, -0.6), (0.6, 0.6))
    assert least_db < 10 * np.log10(power.sum() / 40 / expected) < 0.1
    assert power.max() < 1.1 * expected


def test_static_scene_vanishes_after_background_subtraction():
    """The points of a wall depend on the seed, and on neither the frame nor other surfaces."""
    iq = synthesize(traced([WALL], np.repeat(HERE, 2, 0), count=2_000), ISOTROPIC)
    assert np.abs(iq).max() > 0
    assert np.array_equal(iq[0], iq[1])
    beside = WALL.replaced(name="beside", mesh=rectangle(3.0, (-1.5, -1.0), (1.5, 1.5)))
    both = diffuse.cloud([beside, WALL], geometry.build([beside.mesh, WALL.mesh]))
    alone, other = (diffuse.cloud([WALL], geometry.build([WALL.mesh]), seed=seed) for seed in (0, 1))
    assert np.array_equal(both.points[both.surface == 1], alone.points)
    assert np.array_equal(both.field[both.surface == 1], alone.field)
    assert not np.array_equal(alone.points, other.points)
    assert alone.area.sum() == other.area.sum() == pytest.approx(7.5)


def test_smooth_surfaces_have_no_cloud():
    smooth = WALL.replaced(roughness_m=0.0)
    assert len(diffuse.cloud([smooth], geometry.build([smooth.mesh]))) == 0
    assert len(diffuse.cloud([], geometry.build([]))) == 0
    assert not diffuse.strengths([smooth], ISOTROPIC).back.any()
    nothing = traced([smooth], placed([(0, 0, 0), (0, 0, 1)]))
    assert (len(nothing), nothing.poses) == (0, 2)
    assert not synthesize(nothing, ISOTROPIC).any()


def test_density_follows_the_width_of_the_lobe():
    """A wall with half the lobe width gets four times the points, and each point represents its part of the wall."""
    wide, narrow = (WALL.replaced(correlation_m=length, roughness_m=0.1e-3, name=str(length)) for length in (10e-3, 20e-3))
    surfaces = [wide, WALL.replaced(roughness_m=0.0), narrow.replaced(mesh=rectangle(3.0, (-1.5, -1.0), (1.5, 1.5)))]
    built = geometry.build([s.mesh for s in surfaces])
    scatterers = diffuse.cloud(surfaces, built, 5_000)
    assert np.bincount(scatterers.surface).tolist() == pytest.approx([1000, 0, 4000], abs=1)
    assert np.bincount(scatterers.surface, scatterers.area) == pytest.approx([7.5, 0, 7.5], rel=1e-9)
    assert scatterers.points[scatterers.surface == 2, 0] == pytest.approx(3.0)
    normal = len(diffuse.cloud([WALL], geometry.build([WALL.mesh])))
    assert normal == pytest.approx(diffuse.DENSITY_PER_M2 * 7.5, rel=0.05)
    huge = WALL.replaced(mesh=rectangle(2.0, (-45, -45), (45, 45)))
    with pytest.warns(diffuse.DiffuseWarning, match="scattering points, over MAX_POINTS = 50,000"):
        assert len(diffuse.cloud([huge], geometry.build([huge.mesh]))) == diffuse.MAX_POINTS


def test_path_rate_is_the_change_of_length():
    velocity, step = np.array([0.3, -0.2, 0.1]), 1e-3
    poses = placed([np.zeros(3), velocity * step])
    found = traced([WALL], poses, count=500, velocity=np.tile(velocity, (2, 1)))
    first, second = found.frames(0, 1), found.frames(1, 2)
    assert len(first) == len(second) > 100
    assert first.rate_mps == pytest.approx((second.length_m - first.length_m) / step, abs=1e-3)
    assert first.rate_mps == pytest.approx(-2 * first.departure @ velocity)


def test_shadowed_points_vanish():
    """A plate at half the distance hides an area of twice its size. A rotated sensor sees the same points in its own frame."""
    plate = Surface(rectangle(1.0, (-0.3, -0.2), (0.3, 0.2)), "metal", "plate")
    open_wall = traced([WALL], HERE, count=4_000)
    found = traced([WALL, plate], HERE, count=4_000)
    on_wall = 2.0 * open_wall.departure / open_wall.departure[:, :1]
    behind = (np.abs(on_wall[:, 1]) < 0.6) & (np.abs(on_wall[:, 2]) < 0.4)
    edge = (np.abs(np.abs(on_wall[:, 1]) - 0.6) < 1e-3) | (np.abs(np.abs(on_wall[:, 2]) - 0.4) < 1e-3)
    kept = np.isin(open_wall.length_m, found.length_m)
    assert behind.sum() > 300
    # a few further points differ, because pruning changes when the strongest points are hidden
    assert (kept == ~behind)[~edge].mean() > 0.999
    turned = turning("z", np.pi / 2)
    other = traced([WALL], turned, count=4_000)
    assert other.departure @ turned[0, :3, :3].T == pytest.approx(open_wall.departure, abs=1e-12)
    assert np.abs(other.amplitude) == pytest.approx(np.abs(open_wall.amplitude))


def bodies(*groups: tuple[Surface, np.ndarray]) -> list[diffuse.Body]:
    variant.activate("auto")
    return [diffuse.Body([surface], geometry.build([surface.mesh]), poses) for surface, poses in groups]


def ball(roughness: float, length: float = 5e-3) -> Surface:
    return Surface(trimesh.creation.icosphere(4, 0.1), "metal", "ball", roughness_m=roughness, correlation_m=length)


def test_moving_rough_sphere_has_the_power_of_a_smooth_sphere():
    """Gentle roughness keeps the cross-section pi a^2: the diffuse paths return the share 1 - exp(-4 (k sigma)^2) of it."""
    turned = placed([(2.0, 0, 0)] * 500, Rotation.random(500, np.random.default_rng(3)))
    for sigma in (0.1e-3, 0.3e-3):
        (found,) = diffuse.of_scene(None, bodies((ball(sigma), turned)), ISOTROPIC, np.repeat(HERE, 500, 0))
        power = (np.abs(found.amplitude) ** 2).sum() / 500
        lost = 1 - np.exp(-4 * (2 * np.pi / WAVELENGTH * sigma) ** 2)
        expected = lost * np.pi * 0.1**2 * WAVELENGTH**2 / ((4 * np.pi) ** 3 * 1.9**4)
        assert abs(10 * np.log10(power / expected)) < 0.5


def test_drives_have_the_cloud_of_their_object():
    """Along a drive, a rough object has the same diffuse paths as in a simulation with `motion`."""
    plate = Surface(rectangle(0.0, (-0.3, -0.3), (0.3, 0.3)), "concrete", "plate", roughness_m=SIGMA)
    poses = placed([(2.0, 0, 0)] * 3)
    sensor = placed([(0, 0, 0), (0, 0.01, 0), (0, 0.02, 0)])
    *_, found = Track.of_drives([], ISOTROPIC, sensor, TraceSettings()).moving([plate], sensor, poses[:1])
    (expected,) = diffuse.of_scene(None, bodies((plate, poses)), ISOTROPIC, sensor)
    assert len(found) > 50
    assert np.array_equal(found.amplitude, expected.amplitude)
    assert found.rate_mps == pytest.approx(expected.rate_mps)


def test_moving_body_shadows_the_wall_and_only_the_wall_behind_it():
    """The shadow cancels the points behind the plate; a plate turned by 180 degrees has the same shadow."""
    plate = Surface(rectangle(0.0, (-0.3, -0.2), (0.3, 0.2)), "metal", "plate")
    poses = placed([(1.0, 0, 0), (1.0, 0.1, 0), (-5.0, 0, 0), (1.0, 0, 0)])
    poses[3, :3, :3] = np.diag([-1.0, -1.0, 1.0])
    wall = bodies((WALL, HERE))[0]
    sensor = np.repeat(HERE, 4, 0)
    still, shadow = diffuse.of_scene(wall, bodies((plate, poses)), ISOTROPIC, sensor)
    (alone,) = diffuse.of_scene(wall, [], ISOTROPIC, sensor)
    assert np.array_equal(still.amplitude, alone.amplitude)
    assert np.bincount(shadow.pose, minlength=4)[2] == 0
    for frame, y in ((0, 0.0), (1, 0.1), (3, 0.0)):
        part = shadow.frames(frame, frame + 1)
        on_wall = 2.0 * still.departure / still.departure[:, :1]
        behind = (np.abs(on_wall[:, 1] - 2 * y) < 0.6) & (np.abs(on_wall[:, 2]) < 0.4)
        assert len(part) == behind.sum() > 20
        assert np.isin(still.length_m[behind], part.length_m).all()
        left = {length: amplitude for length, amplitude in zip(still.length_m, still.amplitude[:, 0], strict=True)}
        assert all(left[length] == -amplitude for length, amplitude in zip(part.length_m, part.amplitude[:, 0], strict=True))


def test_room_and_other_bodies_hide_the_cloud_of_a_body():
    """A screen of the room hides the lower half of a rough plate behind it, and a moving screen hides the upper half."""
    plate = Surface(rectangle(0.0, (-0.3, -0.3), (0.3, 0.3)), "concrete", "plate", roughness_m=SIGMA)
    screen = Surface(rectangle(1.0, (-0.5, -0.5), (0.5, 0.0)), "metal", "screen")
    upper = Surface(rectangle(0.0, (-0.5, 0.0), (0.5, 0.5)), "metal", "upper")
    away, near = placed([(2.0, 0, 0)] * 2), placed([(1.2, 0, 0), (-3.0, 0, 0)])
    static = bodies((screen, HERE))[0]
    parts = diffuse.of_scene(static, bodies((plate, away), (upper, near)), ISOTROPIC, np.repeat(HERE, 2, 0))
    (found,) = parts
    assert set(found.pose) == {1}
    assert (found.departure[:, 2] > 0).all()
    (free,) = diffuse.of_scene(None, bodies((plate, away)), ISOTROPIC, np.repeat(HERE, 2, 0))
    assert len(found) == (free.departure[:, 2] > 0).sum()


def test_directional_antennas_have_no_paths_behind():
    behind = WALL.replaced(mesh=rectangle(-2.0, (-1.5, -1.0), (1.5, 1.5)))
    assert len(traced([behind], HERE, radar=Radar.iwr1843(), count=500)) == 0
    assert len(traced([behind], HERE, count=500)) > 400


def test_pruned_points_have_less_power_than_stated(monkeypatch):
    wide = WALL.replaced(mesh=rectangle(0.3, (-6.0, -6.0), (6.0, 6.0)))
    found = np.abs(traced([wide], HERE, count=20_000).amplitude) ** 2
    monkeypatch.setattr(diffuse, "DIFFUSE_POWER", 0.0)
    everything = np.abs(traced([wide], HERE, count=20_000).amplitude) ** 2
    assert len(found) < 0.9 * len(everything)
    assert 0 < 1 - found.sum() / everything.sum() < 1.5e-4


def test_simulator_adds_the_cloud_of_moving_objects():
    """The paths of a moving rough can contain its diffuse power, and the paths of a smooth can do not."""
    can = Surface(trimesh.creation.cylinder(0.033, 0.12, sections=64), "metal", "can")
    poses = turning("z", 0.3 * np.arange(3), (1.5, 0, 0))
    for sigma, diffuse_wanted in ((0.2e-3, True), (0.0, False)):
        scene = rt.Scene([can.replaced(roughness_m=sigma, correlation_m=3e-3)])
        with_cloud, without = (
            MitsubaBackend(TraceSettings(diffuse=on)).paths(scene, ISOTROPIC, np.repeat(HERE, 3, 0), {"can": poses}) for on in (True, False)
        )
        more = sum(map(len, with_cloud)) - sum(map(len, without))
        assert (more > 0) == diffuse_wanted


def test_results_do_not_depend_on_the_blocks_of_the_work(monkeypatch):
    """Poses are independent, and so are the examined paths of hidden points."""
    poses = placed([(0.1 * i, 0.05 * i, 0.0) for i in range(7)])
    wall, plate = bodies(
        (WALL, HERE), (Surface(rectangle(0.0, (-0.3, -0.2), (0.3, 0.2)), "metal", "plate"), turning("z", 0.3 * np.arange(5), (1, 0, 0)))
    )
    together = diffuse.of_scene(wall, [plate], ISOTROPIC, np.repeat(HERE, 5, 0))[1]
    monkeypatch.setattr(diffuse, "LANES", 2 * 800)
    monkeypatch.setattr(visibility, "LANES", 900)
    blocks = diffuse.of_scene(wall, [plate], ISOTROPIC, np.repeat(HERE, 5, 0))[1]
    whole = traced([WALL], poses, count=800)
    pairs = [(together, blocks), *((whole.frames(i, i + 1), traced([WALL], poses[i : i + 1], count=800)) for i in (0, 3, 6))]
    for some, same in pairs:
        assert len(some) > 100
        assert np.array_equal(some.amplitude, same.amplitude)
        assert np.array_equal(some.length_m, same.length_m)
