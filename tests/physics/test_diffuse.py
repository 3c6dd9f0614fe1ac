"""Compare the diffuse point cloud of rough walls with quadratures and closed forms: energy, fixed points, point density, shadows and
motion.
"""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from radartwin.materials import Layered, permittivity, reflection
from radartwin.radar.chirp import Radar
from radartwin.scene.scene import Surface
from radartwin.simulation import diffuse, geometry, variant
from radartwin.simulation.paths import Paths
from radartwin.simulation.signal.synthesis import synthesize

C = 299_792_458.0
ISOTROPIC = Radar.iwr1843(element="isotropic")
MIDDLE = ISOTROPIC.start_frequency_hz + ISOTROPIC.sampled_bandwidth_hz / 2
WAVELENGTH = C / MIDDLE
SIGMA = 0.3e-3


def rectangle(distance: float, low: tuple[float, float], high: tuple[float, float]) -> trimesh.Trimesh:
    """Return a rectangle in the plane x = distance that faces -x, between two corners (y, z)."""
    (y0, z0), (y1, z1) = low, high
    corners = np.array([[distance, y, z] for y, z in ((y0, z0), (y0, z1), (y1, z1), (y1, z0))])
    return trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], process=False)


WALL = Surface(rectangle(2.0, (-1.5, -1.0), (1.5, 1.5)), "concrete", "wall", roughness_m=SIGMA)


def at(*positions: tuple[float, float, float]) -> np.ndarray:
    poses = np.tile(np.eye(4), (len(positions), 1, 1))
    poses[:, :3, 3] = positions
    return poses


def traced(surfaces, poses, radar=ISOTROPIC, count=None, velocity=None, unit=False) -> Paths:
    variant.activate("auto")
    scatterers = diffuse.cloud(surfaces, count)
    if unit:
        scatterers = replace(scatterers, field=np.ones(len(scatterers), complex))
    room = geometry.build([s.mesh for s in surfaces])
    return diffuse.paths(scatterers, diffuse.strengths(surfaces, radar), room, radar, poses, velocity)


def fresnel(cosine, eta):
    """Return the power reflection coefficients (te, tm) of a half-space with permittivity eta."""
    inside = np.sqrt(eta - 1 + cosine**2)
    return np.abs((cosine - inside) / (cosine + inside)) ** 2, np.abs((eta * cosine - inside) / (eta * cosine + inside)) ** 2


def wall_power(distance: float, low: tuple[float, float], high: tuple[float, float], steps: int = 400) -> float:
    """Return the mean diffuse power of a concrete wall by the midpoint rule, for isotropic antenna elements along z."""
    (y0, z0), (y1, z1) = low, high
    y = y0 + (y1 - y0) * (np.arange(steps)[:, None] + 0.5) / steps
    z = z0 + (z1 - z0) * (np.arange(steps)[None, :] + 0.5) / steps
    r = np.sqrt(distance**2 + y**2 + z**2)
    cosine = distance / r
    te, tm = fresnel(cosine, complex(permittivity("concrete", MIDDLE)))
    share = (y / r) ** 2 / ((y**2 + z**2) / r**2 * (1 - (z / r) ** 2))
    removed = 1 - np.exp(-4 * (2 * np.pi / WAVELENGTH * SIGMA * cosine) ** 2)
    density = removed * (share * te + (1 - share) * tm) * cosine / (4 * np.pi * r**2) * cosine / np.pi * WAVELENGTH**2 / (4 * np.pi * r**2)
    return float(density.sum() * (y1 - y0) * (z1 - z0) / steps**2)


@pytest.mark.parametrize("angle_deg", [0.0, 40.0, 75.0])
@pytest.mark.parametrize("material", ["concrete", Layered([("plasterboard", 0.0125)])])
def test_patch_scatters_the_power_that_roughness_removes(material, angle_deg):
    """A hemisphere of receivers collects the fraction (1 - rho^2) |Gamma|^2 of the incident power (Gauss-Legendre quadrature over the
    cosine).
    """
    cosine, f = np.cos(np.radians(angle_deg)), np.linspace(77e9, 80e9, 5)
    nodes, weights = np.polynomial.legendre.leggauss(24)
    cos_out = (nodes + 1) / 2
    smooth, rough = (reflection(material, np.array(cosine), f, s) for s in (0.0, SIGMA))
    for which in (0, 1):
        strength = diffuse.scattered_share(material, SIGMA, np.array([cosine]), f)[which, 0]
        received = diffuse.scattered_power(0.01, strength, cosine, cos_out, 5.0, 7.0, WAVELENGTH)
        scattered = (received / (WAVELENGTH**2 / (4 * np.pi)) * 7.0**2 * np.pi * weights).sum()
        incident = 0.01 * cosine / (4 * np.pi * 5.0**2)
        removed = (np.abs(smooth[which]) ** 2 - np.abs(rough[which]) ** 2).mean()
        assert scattered / incident == pytest.approx(removed, rel=0.01)
        assert scattered / incident + (np.abs(rough[which]) ** 2).mean() == pytest.approx((np.abs(smooth[which]) ** 2).mean(), rel=0.01)


def test_specular_and_diffuse_add_up_to_fresnel():
    """For a half-space, the tabulated diffuse strength plus the squared specular reflection of the rough surface equals Fresnel's power
    reflection at every angle.
    """
    cosine = np.linspace(0, 1, diffuse.COSINES)[1::37]
    table = diffuse.strengths([WALL], ISOTROPIC)
    f = ISOTROPIC.start_frequency_hz + ISOTROPIC.sampled_bandwidth_hz * np.linspace(0, 1, 5)
    for which, scattered in enumerate((table.te, table.tm)):
        coherent = (np.abs(reflection("concrete", cosine[:, None], f, SIGMA)[which]) ** 2).mean(axis=1)
        total = np.mean([fresnel(cosine, complex(permittivity("concrete", one)))[which] for one in f], axis=0)
        assert scattered[0, 1::37] + coherent == pytest.approx(total, rel=1e-6)


@pytest.mark.parametrize("count", [1_000, 50_000])
def test_mean_power_is_the_integral_for_any_number_of_points(count):
    """The power sum over the points agrees with the integral over the wall within 1 % plus the share of power that the near-field limit of
    a point removes, 1.5 x = 1.5 A/(pi r^2).
    """
    mean = (np.abs(traced([WALL], at((0, 0, 0)), count=count, unit=True).amplitude) ** 2).sum()
    expected = wall_power(2.0, (-1.5, -1.0), (1.5, 1.5))
    bias = 1.5 * 7.5 / count / (np.pi * 2.0**2)
    assert mean / expected == pytest.approx(1.0 - bias / 2, abs=0.01 + bias / 2)


def test_speckle_is_exponential_about_the_same_mean():
    """Sums of |field|^2 over the points are within four standard deviations of their mean, and |field|^2 has the moments of an exponential
    distribution.
    """
    count = 10_000
    mean = np.abs(traced([WALL], at((0, 0, 0)), count=count, unit=True).amplitude[:, 0]) ** 2
    drawn = np.abs(traced([WALL], at((0, 0, 0)), count=count).amplitude[:, 0]) ** 2
    assert abs(drawn.sum() - mean.sum()) < 4 * np.sqrt((mean**2).sum())
    power = np.abs(diffuse.cloud([WALL], count).field) ** 2
    assert power.mean() == pytest.approx(1.0, abs=4 / np.sqrt(count))
    assert (power**2).mean() == pytest.approx(2.0, abs=4 * np.sqrt(20 / count))


def test_close_points_return_no_more_than_their_cell():
    """At 15 cm from a wall, the mean power of the point cloud is at most 1 dB below the integral, and no point returns more than the disc
    of wall that it represents.
    """
    sensor = at((1.85, 0.05, 0.03))
    mean = (np.abs(traced([WALL], sensor, count=20_000, unit=True).amplitude) ** 2).sum()
    expected = wall_power(0.15, (-1.55, -1.03), (1.45, 1.47), steps=2000)
    assert -1.0 < 10 * np.log10(mean / expected) < 0.1
    height, area = 0.05, 0.0125
    disc = np.pi * height**2 / 2 * (height**-4 - (height**2 + area / np.pi) ** -2)  # integral of cos^2/r^4 over the disc
    assert diffuse.scattered_power(area, 1.0, 1.0, 1.0, height, height, WAVELENGTH) == pytest.approx(disc * WAVELENGTH**2 / (16 * np.pi**3))


def test_static_scene_vanishes_after_background_subtraction():
    """In a static scene, points, fields and samples are equal in every frame. Another random seed gives another scene with equal power."""
    iq = synthesize(traced([WALL], at((0, 0, 0), (0, 0, 0)), count=2_000), ISOTROPIC)
    assert np.abs(iq).max() > 0
    assert np.array_equal(iq[0], iq[1])
    one, two, other = (diffuse.cloud([WALL], 2_000, seed) for seed in (0, 0, 1))
    assert np.array_equal(one.points, two.points)
    assert np.array_equal(one.field, two.field)
    assert not np.array_equal(one.points, other.points)
    assert one.area.sum() == other.area.sum() == pytest.approx(7.5)


def test_smooth_surfaces_have_no_cloud():
    smooth = WALL.replaced(roughness_m=0.0)
    assert len(diffuse.cloud([smooth])) == 0
    assert len(diffuse.cloud([])) == 0
    assert not diffuse.strengths([smooth], ISOTROPIC).te.any()
    nothing = traced([smooth], at((0, 0, 0), (0, 0, 1)))
    assert (len(nothing), nothing.poses) == (0, 2)
    assert not synthesize(nothing, ISOTROPIC).any()


def test_points_are_distributed_by_scattered_power():
    """A wall that scatters four times the power gets four times the points, and each point represents its part of the wall."""
    k = 2 * np.pi * 77e9 / C
    quiet = WALL.replaced(roughness_m=float(np.sqrt(-np.log(1 - 0.1) / 4) / k), name="quiet")
    loud = WALL.replaced(roughness_m=float(np.sqrt(-np.log(1 - 0.4) / 4) / k), name="loud", mesh=rectangle(3.0, (-1.5, -1.0), (1.5, 1.5)))
    scatterers = diffuse.cloud([quiet, WALL.replaced(roughness_m=0.0), loud], 5_000)
    assert np.bincount(scatterers.surface).tolist() == pytest.approx([1000, 0, 4000], abs=1)
    assert np.bincount(scatterers.surface, scatterers.area) == pytest.approx([7.5, 0, 7.5], rel=2e-3)
    assert scatterers.points[scatterers.surface == 2, 0] == pytest.approx(3.0)


def test_path_rate_is_the_change_of_length():
    """The range rate of each path agrees with the difference of path lengths between poses one millimetre apart, which is -2 v.u."""
    velocity, step = np.array([0.3, -0.2, 0.1]), 1e-3
    poses = at((0, 0, 0), tuple(velocity * step))
    found = traced([WALL], poses, count=500, velocity=np.tile(velocity, (2, 1)))
    first, second = found.frames(0, 1), found.frames(1, 2)
    assert len(first) == len(second) > 100
    assert first.rate_mps == pytest.approx((second.length_m - first.length_m) / step, abs=1e-3)
    assert first.rate_mps == pytest.approx(-2 * first.departure @ velocity)


def test_shadowed_points_vanish():
    """A plate at half the distance hides an area of twice its size on the wall, and nothing else. A rotated sensor sees the same points in
    its own frame.
    """
    plate = Surface(rectangle(1.0, (-0.3, -0.2), (0.3, 0.2)), "metal", "plate")
    open_wall = traced([WALL], at((0, 0, 0)), count=4_000)
    found = traced([WALL, plate], at((0, 0, 0)), count=4_000)
    on_wall = 2.0 * open_wall.departure / open_wall.departure[:, :1]
    behind = (np.abs(on_wall[:, 1]) < 0.6) & (np.abs(on_wall[:, 2]) < 0.4)
    edge = (np.abs(np.abs(on_wall[:, 1]) - 0.6) < 1e-3) | (np.abs(np.abs(on_wall[:, 2]) - 0.4) < 1e-3)
    kept = np.isin(open_wall.length_m, found.length_m)
    assert behind.sum() > 300
    # a few further points differ, because pruning changes when the strongest points are hidden
    assert (kept == ~behind)[~edge].mean() > 0.999
    turned = at((0, 0, 0))
    turned[0, :3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    other = traced([WALL], turned, count=4_000)
    assert other.departure @ turned[0, :3, :3].T == pytest.approx(open_wall.departure, abs=1e-12)
    assert np.abs(other.amplitude) == pytest.approx(np.abs(open_wall.amplitude))


def test_directional_antennas_have_no_paths_behind():
    behind = WALL.replaced(mesh=rectangle(-2.0, (-1.5, -1.0), (1.5, 1.5)))
    assert len(traced([behind], at((0, 0, 0)), radar=Radar.iwr1843(), count=500)) == 0
    assert len(traced([behind], at((0, 0, 0)), count=500)) > 400


def test_pruned_points_have_less_power_than_stated(monkeypatch):
    wide = WALL.replaced(mesh=rectangle(0.3, (-6.0, -6.0), (6.0, 6.0)))
    found = np.abs(traced([wide], at((0, 0, 0)), count=20_000).amplitude) ** 2
    monkeypatch.setattr(diffuse, "PRUNED_POWER", 0.0)
    everything = np.abs(traced([wide], at((0, 0, 0)), count=20_000).amplitude) ** 2
    assert len(found) < 0.9 * len(everything)
    assert 0 < 1 - found.sum() / everything.sum() < 1.5e-4


def test_poses_are_independent(monkeypatch):
    poses = at(*((0.1 * i, 0.05 * i, 0.0) for i in range(7)))
    monkeypatch.setattr(diffuse, "LANES", 2 * 800)
    together = traced([WALL], poses, count=800)
    for i in (0, 3, 6):
        alone = traced([WALL], poses[i : i + 1], count=800)
        part = together.frames(i, i + 1)
        assert np.array_equal(part.amplitude, alone.amplitude)
        assert np.array_equal(part.length_m, alone.length_m)
