"""Mirrors of finite size and shadows of bodies against quadrature and Fresnel integrals."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy.special import fresnel

from experiments.validation.oracles import traced
from experiments.validation.oracles.nearfield import chain_quadrature, panel_quadrature
from radartwin.constants import SPEED_OF_LIGHT
from radartwin.radar.chirp import Radar
from radartwin.scene import objects
from radartwin.scene.surface import Surface
from radartwin.simulation import geometry
from radartwin.simulation.backends.static_scene import static_scene
from radartwin.simulation.flat import faces, legs, obstacles, shadows

RADAR = Radar.iwr1843("isotropic")
WAVELENGTH = SPEED_OF_LIGHT / RADAR.center_frequency_hz
K = 2 * np.pi / WAVELENGTH
SHAPES = {
    "triangle": [(-0.2, -0.15), (0.25, -0.1), (-0.05, 0.3)],
    "thin triangle": [(-0.3, -0.02), (0.3, 0.0), (-0.28, 0.05)],
    "square": [(-0.15, -0.15), (0.15, -0.15), (0.15, 0.15), (-0.15, 0.15)],
    "strip": [(-0.25, -0.03), (0.25, -0.03), (0.25, 0.03), (-0.25, 0.03)],
    "pentagon": [(0.3 * np.cos(t), 0.2 * np.sin(t)) for t in 0.3 + 2 * np.pi * np.arange(5) / 5],
    "trapezium": [(-0.3, -0.2), (0.35, -0.22), (0.2, 0.2), (-0.25, 0.15)],
}


def lifted(shape):
    """Return the corners (n, 3) of a polygon in the plane x = 0."""
    flat = np.array(shape, float)
    return np.column_stack([np.zeros(len(flat)), flat])


def rectangle(centre, u, v):
    """Return the ring of a rectangle from its centre and its two half sides."""
    centre, u, v = (np.array(x, float) for x in (centre, u, v))
    return [centre - u - v, centre + u - v, centre + u + v, centre - u + v]


def room_of(*rings):
    """Return the room of flat metal faces with these rings (corners (n, 3)), each on a surface of its own."""
    surfaces = [Surface(traced.polygon(np.array(ring, float)), "metal", f"face {i}", role="room") for i, ring in enumerate(rings)]
    return static_scene(surfaces, RADAR).room


def received(room, chains, source, receiver=None, axis=(0.0, 0.0, 1.0)):
    """Return the sum of the fields of a leg over sequences of faces, relative to the undisturbed image of the source."""
    source = np.array(source, float)
    receiver = source if receiver is None else np.array(receiver, float)
    count, face = len(chains), np.argsort(room.faces.surface)
    values = legs.room_fields(
        room, face[np.array(chains)], np.arange(count), source[None], np.array(axis, float)[None], np.zeros(count, int),
        np.repeat(receiver[None], count, axis=0),
    )  # fmt: skip
    return complex(values[:, values.shape[1] // 2].sum())


def mirror(shape, source, receiver=None):
    """Return the factor of a polygon in the plane x = 0 as a mirror of metal."""
    return -received(room_of(lifted(shape)), [(0,)], source, receiver)


def exact_mirror(shape, source, receiver=None):
    """Return the same factor by quadrature: the field from the polygon over the field from an infinite mirror. For separate antennas, it
    is the mean of both propagation directions, which is reciprocal.
    """
    other = np.array(source if receiver is None else receiver, float)
    corners, source = lifted(shape), np.array(source, float)
    found = [panel_quadrature(corners, source, WAVELENGTH, receiver=other)]
    if receiver is not None:
        found.append(panel_quadrature(corners, other, WAVELENGTH, receiver=source))
    length = np.linalg.norm(source * (-1, 1, 1) - other)
    return -np.mean(found) * 4 * np.pi * length / WAVELENGTH * np.exp(-1j * K * length)


def shadow(mesh, source, receiver):
    """Return the factor of a line past flat faces. The source is moved as in legs, so that no line hits an edge exactly."""
    body = geometry.build([mesh])
    normals = np.asarray(trimesh.util.unitize(np.cross(*np.diff(body.corners, axis=1).transpose(1, 0, 2)).reshape(-1, 3)))
    body = replace(body, normals=np.repeat(normals[:, None], 3, axis=1))  # also the facets of a round column are flat faces
    found, tree, none = faces.find(body, 1e-3)[0], obstacles.build(body.corners, body.surface), (0.0, 0.0, 0.0)
    line = shadows.line_of(tuple(np.array(source, float) + legs.NUDGE / K), tuple(np.array(receiver, float)), 0.0, 0.0, none, none)
    memory = np.empty(obstacles.MAX_PANES, int), np.empty(1, bool)
    return shadows.past_faces(found, shadows.edges_of(found), tree, np.ones(1, bool), line, K, -1, -1, *memory)


def half_plane(excess):
    """Return the field behind the edge of a half-plane by Fresnel integrals, for an excess length that is positive in the shadow."""
    s, c = fresnel(np.sqrt(2 * K * abs(excess) / np.pi))
    dark = (1 - (1 - 1j) * (c + 1j * s)) / 2
    return dark if excess > 0 else 1 - dark


@pytest.mark.parametrize("name", SHAPES)
def test_mirror_of_a_polygon_matches_quadrature(name):
    shape = SHAPES[name]
    width = np.ptp(np.array(shape)[:, 0])
    places = [(d, share * width, z) for d in (0.5, 1.0, 2.0, 4.0) for share in (0.0, 0.25, 0.5, 1.0, 1.5) for z in (0.01, 0.13)]
    errors = [abs(mirror(shape, place) - exact_mirror(shape, place)) for place in places]
    assert max(errors) < 0.01
    assert np.sqrt(np.mean(np.square(errors))) < 0.004
    if name == "trapezium":  # from both sides
        for place in ((1.0, 0.05, 0.02), (-1.0, 0.05, 0.02), (0.5, 0.3, 0.1), (-0.5, 0.3, 0.1), (2.0, -0.6, 0.2), (-2.0, -0.6, 0.2)):
            assert abs(mirror(shape, place) - exact_mirror(shape, place)) < 0.006


@pytest.mark.parametrize(("distance", "limit"), [(0.01, 0.1), (0.05, 0.05)])
def test_mirror_close_to_a_panel_matches_quadrature(distance, limit):
    """Far beside a close sensor, the edge waves lack the obliquity of the quadrature."""
    shape = np.array([(0, 0), (0.6, 0), (0.6, 0.6), (0, 0.6)])
    for place in ((0.3, 0.3), (distance, 0.3), (distance, distance), (0.05, 0.1), (-distance, 0.3)):
        assert abs(mirror(shape, (distance, *place)) - exact_mirror(shape, (distance, *place))) < limit


@pytest.mark.parametrize("name", ["triangle", "trapezium"])
def test_mirror_at_oblique_incidence_matches_quadrature(name):
    """Up to 55 degrees off the normal of the polygon."""
    shape = SHAPES[name]
    width = np.ptp(np.array(shape)[:, 0])
    for distance in (0.5, 2.0):
        for off in (0.2, 0.7, 1.4):
            for shift in (0.0, 0.5 * width, width):
                pair = (distance, shift - off * distance, 0.01), (1.3 * distance, shift + off * distance, -0.02)
                there, back = mirror(shape, *pair), mirror(shape, *pair[::-1])
                assert abs(there - exact_mirror(shape, *pair)) < 0.015
                assert there == pytest.approx(back, abs=2e-3)  # the source is moved by 0.05/k, the receiver is not


@pytest.mark.parametrize("degrees", [30.0, 50.0, 90.0, 120.0, 150.0])
def test_mirror_above_a_corner_is_its_share_of_the_angle(degrees):
    angle = np.radians(degrees)
    wedge = [(0.0, 0.0), (6.0, 0.0), (6 * np.cos(angle), 6 * np.sin(angle))]
    for turn in np.linspace(0, 2 * np.pi, 9):
        assert mirror(wedge, (1.0, 1e-6 * np.cos(turn), 1e-6 * np.sin(turn))) == pytest.approx(degrees / 360, abs=3e-3)


def test_mirror_is_continuous_across_an_edge():
    """The factor of a polygon has no jump when the point of reflection crosses an edge, for steps from 1 nm to 10 um."""
    for shape in SHAPES.values():
        corner, following = (np.array(shape[i]) for i in (0, 1))
        middle, normal = 0.6 * corner + 0.4 * following, np.array([following[1] - corner[1], corner[0] - following[0]])
        normal /= np.linalg.norm(normal)
        middle = middle - legs.NUDGE[1:] / K / 2  # so that the point of reflection of the moved source is on the edge
        for step in (1e-9, 1e-7, 1e-5):
            sides = [mirror(shape, (1.0, *(middle + s * step * normal))) for s in (-1, 0, 1)]
            assert np.abs(np.diff(sides)).max() < 1e-3 + 50 * step


def image_of(value, length):
    """Return a received amplitude relative to that of an image at half the length."""
    return value * 4 * np.pi * length / WAVELENGTH * np.exp(-1j * K * length)


FOLD = rectangle((0.25, 0, 0), (0.25, 0, 0), (0, 0, 0.25)), rectangle((0, 0.25, 0), (0, 0.25, 0), (0, 0, 0.25))


@pytest.mark.parametrize("sensor", [(1.0, 0.8, 0.02), (0.25, 0.25, 0.3)])
def test_two_mirrors_at_a_right_angle_match_quadrature(sensor):
    """The sum of both orders of reflection agrees with quadrature of the double image."""
    exact = sum(chain_quadrature(order, sensor, WAVELENGTH) for order in (FOLD, FOLD[::-1]))
    ours = received(room_of(*FOLD), [(0, 1), (1, 0)], sensor)
    assert abs(ours - image_of(exact, 2 * np.hypot(*sensor[:2]))) < 0.085


def test_plate_in_a_fold_hides_the_double_reflection():
    sensor = (1.0, 0.8, 0.02)
    whole = received(room_of(*FOLD), [(0, 1), (1, 0)], sensor)
    across = rectangle((0.2, 0.2, 0.0), (0.19, -0.19, 0), (0, 0, 0.5))
    assert abs(received(room_of(*FOLD, across), [(0, 1), (1, 0)], sensor)) < 0.05 * abs(whole)
    aside = rectangle((0.2, 0.2, 1.0), (0.19, -0.19, 0), (0, 0, 0.2))
    assert abs(received(room_of(*FOLD, aside), [(0, 1), (1, 0)], sensor) - whole) < 0.02 * abs(whole)


def exact_shadow(shape, source, receiver):
    """Return the factor of a line past a plate in the plane x = 0 by quadrature of Kirchhoff's integral over the plate.

    The field that the plate removes is that of an opening of its shape, and an opening is a mirror for the image of the source.
    """
    return 1 - exact_mirror(shape, np.array(source, float) * (-1, 1, 1), receiver)


@pytest.mark.parametrize(("scale", "worst", "rms"), [(0.4, 0.03, 0.011), (1.0, 0.055, 0.02)], ids=["small", "large"])
@pytest.mark.parametrize("name", SHAPES)
def test_shadow_of_a_plate_matches_quadrature(name, scale, worst, rms):
    """Edges beyond the Fresnel coordinate REACH are left out. Most of them belong to the large plates."""
    shape = scale * np.array(SHAPES[name])
    mesh, width = traced.polygon(lifted(shape)), np.ptp(shape[:, 0])
    errors = []
    for near, far in ((0.7, 1.0), (1.5, 0.7), (2.0, 2.0)):
        for share in (0.0, 0.25, 0.45, 0.55, 1.0):
            for z in (0.01, 0.13):
                ends = (-near, share * width, z * scale), (far, share * width + 0.05 * scale, (z - 0.03) * scale)
                errors.append(abs(shadow(mesh, *ends) - exact_shadow(shape, *ends)))
    assert max(errors) < worst
    assert np.sqrt(np.mean(np.square(errors))) < rms


@pytest.mark.parametrize("corners", [4, 12, 48])
def test_shadow_of_a_column_is_that_of_its_outline(corners):
    """The field behind a tall column is the sum of the fields that pass the two edges of its outline, as seen from the source."""
    column = trimesh.creation.cylinder(0.05, 4.0, sections=corners)
    sides = np.unique(np.round(column.vertices[:, :2], 9), axis=0)
    sides = sides[np.linalg.norm(sides, axis=1) > 1e-6]
    for aside in (0.0, 0.03, 0.1, 0.2):
        source, receiver = np.array([-0.7, aside]), np.array([0.5, aside])
        way = sides - source
        bearing = np.arctan2(way[:, 1], way[:, 0])
        total = 0j
        for edge, sign in ((sides[bearing.argmin()], 1), (sides[bearing.argmax()], -1)):
            excess = np.linalg.norm(edge - source) + np.linalg.norm(receiver - edge) - 1.2
            line = edge[1] + 0.0
            total += half_plane(sign * np.sign(source[1] - line) * excess)
        assert shadow(column, (*source, 0.1), (*receiver, 0.1)) == pytest.approx(total, abs=0.03)


def test_bodies_behind_either_end_hide_nothing():
    for x in (-1.5, 1.5):
        body = objects.box([x - 0.1, -0.3, -0.3], [x + 0.1, 0.3, 0.3])
        assert shadow(body, (-1, 0.01, 0.02), (1, 0.01, 0.02)) == pytest.approx(1, abs=1e-6)
    aside = objects.box([-0.1, 1.0, -0.3], [0.1, 1.3, 0.3])
    assert shadow(aside, (-1, 0.01, 0.02), (1, 0.01, 0.02)) == pytest.approx(1, abs=1e-6)


def test_shadow_is_continuous_across_the_outline_of_a_box():
    box = objects.box([-0.2, -0.3, -0.3], [0.2, 0.0, 0.3])
    for step in (1e-8, 1e-6, 1e-5):
        sides = [shadow(box, (-1.0, s * step, 0.02), (1.0, s * step, 0.02)) for s in (-1, 1)]
        assert abs(sides[0] - sides[1]) < 1e-3 + 200 * step
