"""Closed metal bodies with sharp rims return the echo of exact solutions at all elevations, in the far field and at 1 m."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from physics_helpers import FREQUENCY, WAVELENGTH, K
from posing import posed
from scipy.integrate import quad
from scipy.spatial.transform import Rotation
from scipy.special import erfcx

import radartwin as rt
from radartwin.simulation import geometry, reflection_table, variant
from radartwin.simulation.backends.trace_settings import TraceSettings
from radartwin.simulation.curved import rims, tube_grid
from radartwin.simulation.hits import Antennas, Hits, TraceOptions
from radartwin.simulation.simulate import trace_paths

OUTLINES_MM = {  # (radius, height)
    "can": [(0, 0), (33, 0), (33, 115), (0, 115)],
    "tin": [(0, 0), (42, 0), (42, 60), (0, 60)],
    "cup": [(0, 0), (45, 0), (30, 90), (0, 90)],
}


def body(name: str) -> trimesh.Trimesh:
    """Return a body of revolution with its origin in the middle of its height."""
    if name == "capsule":
        turn = np.linspace(0, np.pi / 2, 17)
        cap = np.stack([10 * np.cos(turn), 10 * np.sin(turn)], axis=1)
        side = np.stack([np.full(39, 10.0), np.arange(11.0, 50.0)], axis=1)
        outline = np.concatenate([cap[::-1] * [1, -1] + np.array([0, 10]), side, cap + np.array([0, 50])])
        outline[[0, -1], 0] = 0
    else:
        outline = np.array(OUTLINES_MM[name], float)
    outline[:, 1] -= outline[:, 1].max() / 2
    return trimesh.creation.revolve(outline * 1e-3, sections=96)


def poses(elevation_deg: np.ndarray, polarization: str, distance_m: float) -> np.ndarray:
    """Return poses (F, 4, 4) of a sensor that looks at the origin; for H, the sensor is turned by 90 degrees about its line of sight."""
    angle = np.radians(elevation_deg)
    places = distance_m * np.stack([np.cos(angle), 0 * angle, np.sin(angle)], axis=1)
    upright = np.stack([-np.sin(angle), 0 * angle, np.cos(angle)], axis=1)
    return posed(places, upright if polarization == "V" else np.tile([0.0, -1.0, 0.0], (len(angle), 1)))


def errors(elevation_deg: np.ndarray, ours: np.ndarray, exact: np.ndarray) -> tuple[float, float, float]:
    """Return three errors of cross-sections in dB: the rms error, the error of the mean at 20 to 70 degrees of elevation, and the rms error
    within 30 dB of the maximum.
    """
    level, middle = 10 * np.log10(ours / exact), (elevation_deg >= 20) & (elevation_deg <= 70)
    strong = exact > 1e-3 * exact.max()
    mean = 10 * np.log10(ours[middle].mean() / exact[middle].mean())
    return float(np.sqrt(np.mean(level**2))), float(mean), float(np.sqrt(np.mean(level[strong] ** 2)))


@pytest.mark.parametrize("polarization", ["V", "H"])
@pytest.mark.parametrize("name", [*OUTLINES_MM, "capsule"])
def test_rcs_matches_the_method_of_moments(name, polarization, shared_data):
    answers = np.load(shared_data.parent / "reference" / "bodies_of_revolution" / "answers.npz")
    elevation = answers[f"{name}_far_elevation_deg"][::3]
    exact = 4 * np.pi * np.abs(answers[f"{name}_far_mom"]["VH".index(polarization), ::3]) ** 2
    mesh, angles = body(name), np.radians(elevation)
    ours = np.array([rt.rcs(mesh, [np.cos(a), 0, np.sin(a)], polarization=2 * polarization) for a in angles])
    rms, mean, strong = errors(elevation, ours, exact)
    assert rms < (0.5 if name == "capsule" else 2.0 if polarization == "V" else 1.0)
    assert abs(mean) < 0.5
    assert strong < (0.5 if name == "capsule" else 0.4)


def test_rcs_of_a_can_matches_exact_values():
    """The values in dBsm at 5, 10, ... 85 degrees of elevation are those of the method of moments that the other tests read from a file."""
    exact = {
        "V": [
            -32.06, -34.34, -35.46, -40.97, -49.67, -43.59, -44.94, -45.89, -39.45, -39.39, -38.52, -43.72, -45.25, -31.87, -30.59, -26.33,
            -16.78,
        ],
        "H": [
            -32.40, -34.21, -36.54, -40.22, -44.36, -39.84, -42.59, -43.18, -41.47, -39.65, -39.64, -38.51, -40.03, -33.46, -29.18, -24.59,
            -17.12,
        ],
    }  # fmt: skip
    mesh = body("can")
    for polarization, values in exact.items():
        angles = np.radians(np.arange(5, 90, 5))
        ours = 10 * np.log10([rt.rcs(mesh, [np.cos(a), 0, np.sin(a)], polarization=2 * polarization) for a in angles])
        assert np.sqrt(np.mean((ours - values) ** 2)) < (0.6 if polarization == "V" else 0.45)


@pytest.mark.parametrize("polarization", ["V", "H"])
@pytest.mark.parametrize("name", ["can", "cup"])
def test_simulated_echo_at_one_metre_matches_the_method_of_moments(name, polarization, shared_data):
    answers = np.load(shared_data.parent / "reference" / "bodies_of_revolution" / "answers.npz")
    elevation = answers[f"{name}_1m_elevation_deg"]
    exact = 4 * np.pi * np.abs(answers[f"{name}_1m_mom"]["VH".index(polarization)]) ** 2
    scene = rt.Scene([rt.Surface(body(name), "metal", name, role="object")])
    radar = replace(rt.Radar.iwr1843(), start_frequency_hz=FREQUENCY, slope_hz_per_s=1e9)
    paths, _ = trace_paths(
        scene, radar, poses(elevation, polarization, 1.0), {name: np.tile(np.eye(4), (len(elevation), 1, 1))}, TraceSettings()
    )
    total = np.zeros(len(elevation), complex)
    for part in paths:
        np.add.at(total, part.pose, part.amplitude[:, 0] * np.exp(1j * K * (part.length_in_m + part.length_out_m)))
    rms, mean, strong = errors(elevation, (4 * np.pi) ** 3 * np.abs(total) ** 2 / WAVELENGTH**2, exact)
    assert rms < (2.0 if polarization == "V" else 1.0)
    assert abs(mean) < 0.5
    assert strong < 0.4


def physical_optics(radius: float, height: float, elevation: float) -> float:
    """Return the far-field cross-section of a metal can by physical optics: the lit part of the side as an integral over the azimuth
    times a sinc over the height, and the lit end as a disc.
    """
    c, s = np.cos(elevation), np.sin(elevation)
    azimuth = (np.arange(20_000) + 0.5) / 20_000 * np.pi - np.pi / 2
    # S = j k/(2 pi) integral of (n . s) exp(2 j k s . x) over the lit surface, up to a common phase
    side = np.mean(np.cos(azimuth) * np.exp(2j * K * radius * c * np.cos(azimuth))) * np.pi * radius * c
    side *= height * np.sinc(K * height * s / np.pi)
    rho = radius * (np.arange(2000) + 0.5) / 2000
    around = np.exp(2j * K * c * rho[:, None] * np.cos(np.linspace(0, 2 * np.pi, 720, endpoint=False))).mean(axis=1)
    end = s * np.exp(1j * K * height * s) * 2 * np.pi * np.mean(rho * around) * radius
    return 4 * np.pi * abs(K / (2 * np.pi) * (side + end)) ** 2


@pytest.mark.parametrize("density", [1.0, 4.0])
def test_tubes_end_at_rims_as_physical_optics_does(density, monkeypatch):
    """Without fringe currents. The mesh has so many sides that its rim is a circle."""
    monkeypatch.setattr(rims, "hits", lambda *_: [])
    mesh = body("can")
    angles = np.radians(np.arange(1.0, 90.0, 4.0))
    ours = np.array([rt.rcs(mesh, [np.cos(a), 0, np.sin(a)], rays_per_wavelength2=density) for a in angles])
    exact = np.array([physical_optics(0.033, 0.115, a) for a in angles])
    assert 10 * np.log10(ours.mean() / exact.mean()) == pytest.approx(0, abs=0.2)
    np.testing.assert_array_less(np.abs(np.sqrt(ours) - np.sqrt(exact)), 0.15 * np.sqrt(np.median(exact)) + 0.02 * np.sqrt(exact))


@pytest.mark.parametrize("hard", [False, True])
@pytest.mark.parametrize("opening", [1.5, 1.75, 4 / 3])
@pytest.mark.parametrize("skew_deg", [90.0, 50.0])
def test_fringe_currents_complete_physical_optics_to_keller(skew_deg, opening, hard):
    """On the cone of diffracted rays, both together have the coefficient of J. Keller, J. Opt. Soc. Am. 52 (1962) 116."""
    sine, cosine, last = np.sin(np.radians(skew_deg)), np.cos(np.radians(skew_deg)), opening * np.pi
    faces = [
        (np.array([1.0, 0, 0]), np.array([0, 1.0, 0])),
        (np.array([np.cos(last), np.sin(last), 0]), np.array([np.sin(last), -np.cos(last), 0])),
    ]
    for source, receiver in ((0.4, 1.1), (2.0, 2.0), (3.5, 1.0), (0.3, last - 0.2), (last - 0.5, last - 1.3)):
        way = np.array([-sine * np.cos(source), -sine * np.sin(source), cosine])
        away = np.array([sine * np.cos(receiver), sine * np.sin(receiver), cosine])
        # the soft field lies in the plane of ray and edge, the hard field is perpendicular to it; both magnetic fields are way x electric
        soft_in, soft_out = (np.array([0, 0, 1.0]) - cosine * ray for ray in (way, away))
        electric, got, other = soft_in / sine, soft_out / sine, np.cross(soft_out, away) / sine
        if hard:
            electric, got, other = np.cross(electric, way), other, got
        magnetic = np.cross(way, electric)
        total, mixed = 0.0, 0.0
        for p, q, (x, n) in ((source, receiver, faces[0]), (last - source, last - receiver, faces[1])):
            total += rims._face(x, n, opening, way, away, electric, magnetic, got)
            mixed += rims._face(x, n, opening, way, away, electric, magnetic, other)
            if p < np.pi:  # the currents n x H on a lit face, which end at the edge
                lit = np.cross(n, magnetic) / (sine * (np.cos(p) + np.cos(q)))
                total, mixed = total + got @ lit, mixed + other @ lit
        minus, plus = (1 / (np.cos(np.pi / opening) - np.cos((receiver + s * source) / opening)) for s in (-1, 1))
        keller = np.sin(np.pi / opening) / opening * (minus + plus if hard else minus - plus)
        assert total == pytest.approx(keller, rel=1e-6), (source, receiver)
        assert mixed == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize("source", [0.5, 1.4, 2.4])
def test_fringe_currents_off_the_cone_are_those_of_a_half_plane(source):
    """In any direction, the moment of the currents across the edge of a half-plane is an integral of Sommerfeld's exact currents less those
    of physical optics, -exp(j kt x cos p) erfc(sqrt(2 j kt x) cos(p/2)) for a unit magnetic field along the edge. Here p is the angle of
    the source and kt the wavenumber across the edge. The integral runs along the ray that grazes the face, over imaginary x, where it
    converges.
    """
    sine, cosine = np.sin(1.1), np.cos(1.1)
    x, n, z = np.eye(3)
    way = np.array([-sine * np.cos(source), -sine * np.sin(source), cosine])
    for away in np.array([[0.3, 0.5, 0.8], [-0.6, 0.7, 0.2], [0.1, 0.4, -0.9]]):
        away = away / np.linalg.norm(away)
        grazing = sine * x + cosine * z
        mu = (away @ grazing - cosine**2) / sine**2
        integral, _ = quad(lambda t, mu=mu: erfcx(np.sqrt(2 * t) * np.cos(source / 2)) * np.exp((mu - 1) * t), 0, np.inf)
        moment = rims._face(x, n, 2.0, way, away, np.zeros(3), z, x)
        assert moment == pytest.approx(integral / (2 * sine), rel=1e-6)


def test_a_radar_near_a_body_sees_the_echo_of_each_rim_once():
    """The six grids around the radar have together the rim echoes of the one grid towards the body."""
    variant.activate()
    can, place = geometry.build([body("can")]), np.array([[0.3, 0.05, 0.2]])
    table, antenna = reflection_table.build([("metal", 0.0)], FREQUENCY), Antennas(place, np.array([[0.0, 0.0, 1.0]]))
    rotation = Rotation.from_euler("z", 1.25 * np.pi + 0.165).as_matrix()  # an edge of the cube is before the can
    whole = tube_grid.towards(can.hull_points(), place, can.centre, WAVELENGTH, (0.0, 0.0))
    assert whole is not None
    grids = [whole, *tube_grid.all_around(place, rotation[None], 60_000)]
    once, *found = [Hits.concatenate(rims.hits(can, table, grid, antenna, antenna, TraceOptions(1))).length_in_m for grid in grids]
    assert len(once) > 50
    assert np.count_nonzero([len(each) for each in found]) > 1
    assert np.sort(np.concatenate(found)) == pytest.approx(np.sort(once))


def test_a_grid_contains_the_points_that_span_it():
    corners = np.array([[1.0, y, z] for y in (-0.1, 0.2) for z in (-0.3, 0.1)]) / 3
    for turn in np.arange(0.0, 6.0, 0.7):
        points = Rotation.from_rotvec(turn * np.array([0.4, 0.9, 0.2])).apply(corners)
        grid = tube_grid.towards(points, np.zeros((1, 3)), points.mean(axis=0), 0.004, (0.0, 0.0))
        assert grid is not None
        assert grid.covers(np.zeros(4, int), points).all()
