"""Compare the Fresnel factors of polygons with quadrature of the same integrals, and test image paths over several panels."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import fresnel
from shapely import LinearRing, Polygon

from experiments.validation.oracles.nearfield import chain_quadrature, panel_quadrature
from radartwin.constants import SPEED_OF_LIGHT
from radartwin.simulation import reflection_table
from radartwin.simulation.flat import aperture, images, panels
from radartwin.simulation.geometry import Geometry

FREQUENCY = 78.72e9
WAVELENGTH = SPEED_OF_LIGHT / FREQUENCY
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


def factor(shape, source, receiver=None, along=0):
    """Return our Fresnel factor of a polygon in the plane x = 0, seen from x > 0. The polygon's list of corners is rotated by `along`
    entries.
    """
    receiver = np.array(source if receiver is None else receiver, float)
    image = np.array(source, float) * (-1, 1, 1)
    way = receiver - image
    specular = image + way * (-image[0] / way[0])
    polygon = np.roll(np.array(shape, float) - specular[1:], along, axis=0).copy()
    aperture.orient(polygon, len(polygon))
    length = float(np.linalg.norm(way))
    return aperture.polygon_factor(
        polygon, len(polygon), specular, np.array([0.0, 1, 0]), np.array([0.0, 0, 1]), image, receiver, length, K
    )


def exact(shape, source, receiver=None):
    """Return the Fresnel factor by quadrature: the field from the polygon over the field from an infinite mirror. For separate antennas, it
    is the mean of both propagation directions, which is reciprocal.
    """
    other = np.array(source if receiver is None else receiver, float)
    corners, source = lifted(shape), np.array(source, float)
    received = [panel_quadrature(corners, source, WAVELENGTH, receiver=other)]
    if receiver is not None:
        received.append(panel_quadrature(corners, other, WAVELENGTH, receiver=source))
    length = np.linalg.norm(source * (-1, 1, 1) - other)
    return -np.mean(received) * 4 * np.pi * length / WAVELENGTH * np.exp(-1j * K * length)


def half_plane(distance, beyond):
    """Return the Fresnel factor of a half-plane by Fresnel integrals of the exact excess path, with the sensor `beyond` metres past the
    edge.
    """
    excess = 2 * (np.hypot(distance, beyond) - distance)
    s, c = fresnel(np.sqrt(2 * K * excess / np.pi))
    dark = (1 - (1 - 1j) * (c + 1j * s)) / 2
    return dark if beyond > 0 else 1 - dark


@pytest.mark.parametrize("d", [1e-6, 0.05, 1.0, 1.999, 2.001, 4.0])
def test_edge_wave_matches_its_integral(d):
    def integrand(x, part):
        return getattr(d / (d * d + x * x) * np.exp(0.5j * np.pi * (d * d + x * x)), part)

    spans = [(-1, 2.5), (0.1, 0.5), (-6, -3), (2.1, 7), (-8, 9), (1.5, 3), (-2.5, -1.9), (1.999, 2.001), (-0.3, 0.0), (0.0, 2.0), (5, 5)]
    for low, high in spans:
        breaks = sorted({low, high, *(p for p in (-10 * d, -d, 0.0, d, 10 * d) if low < p < high), *np.arange(np.ceil(low), high)})
        value = sum(
            quad(integrand, a, b, args=("real",), limit=200)[0] + 1j * quad(integrand, a, b, args=("imag",), limit=200)[0]
            for a, b in itertools.pairwise(breaks)
        )
        assert abs(aperture.edge_wave(d, low, high) - value) < 2e-6, (low, high)


def test_edge_wave_over_a_whole_line_matches_the_half_plane():
    for beyond in (1e-4, 0.01, 0.1, 0.5, 2.0):
        d = np.sqrt(2 * K / np.pi * 2 * (np.hypot(1.0, beyond) - 1))
        assert aperture.edge_wave(d, -1e4, 1e4) / (2 * np.pi) == pytest.approx(half_plane(1.0, beyond), abs=1e-5)


@pytest.mark.parametrize("name", SHAPES)
def test_factor_of_a_polygon_matches_quadrature(name):
    """The Fresnel factor of a polygon is tested with the sensor in front of its middle, in front of its edges, and up to one polygon width
    beyond the edges.
    """
    shape = SHAPES[name]
    width = np.ptp(np.array(shape)[:, 0])
    places = [(d, share * width, z) for d in (0.5, 1.0, 2.0, 4.0) for share in (0.0, 0.25, 0.5, 1.0, 1.5) for z in (0.01, 0.13)]
    errors = [abs(factor(shape, place) - exact(shape, place)) for place in places]
    assert max(errors) < 0.0025
    assert np.sqrt(np.mean(np.square(errors))) < 0.001


@pytest.mark.parametrize(("distance", "limit"), [(0.01, 0.08), (0.05, 0.015)])
def test_factor_close_to_a_panel_matches_quadrature(distance, limit):
    """At a distance of a few wavelengths the excess path is not quadratic, so the error of the factor is 0.07 of the image at 1 cm and
    0.012 at 5 cm.
    """
    shape = np.array([(0, 0), (0.6, 0), (0.6, 0.6), (0, 0.6)])
    for place in ((0.3, 0.3), (distance, 0.3), (distance, distance), (0.05, 0.1), (-distance, 0.3)):
        assert abs(factor(shape, (distance, *place)) - exact(shape, (distance, *place))) < limit


@pytest.mark.parametrize("name", ["triangle", "trapezium"])
def test_factor_at_oblique_incidence_matches_quadrature(name):
    """The transmitter and the receiver are at different positions, up to 55 degrees off the normal of the polygon."""
    shape = SHAPES[name]
    width = np.ptp(np.array(shape)[:, 0])
    errors = []
    for distance in (0.5, 2.0):
        for off in (0.2, 0.7, 1.4):
            for shift in (0.0, 0.5 * width, width):
                pair = (distance, shift - off * distance, 0.01), (1.3 * distance, shift + off * distance, -0.02)
                errors.append(abs(factor(shape, pair[0], pair[1]) - exact(shape, pair[0], pair[1])))
                # exchanging transmitter and receiver does not change the factor
                assert factor(shape, pair[0], pair[1]) == pytest.approx(factor(shape, pair[1], pair[0]), abs=1e-10)
    assert max(errors) < 0.01


def test_factor_does_not_depend_on_the_order_of_corners():
    for shape in SHAPES.values():
        values = [factor(ring, (1.0, 0.07, -0.04), along=i) for ring in (shape, shape[::-1]) for i in range(len(shape))]
        assert np.ptp(np.real(values)) + np.ptp(np.imag(values)) < 1e-11


def test_factors_of_parts_add_up_to_the_whole():
    rng = np.random.default_rng(1)
    worst = 0.0
    for shape in SHAPES.values():
        ring = np.array(shape)
        for _ in range(12):
            source = np.array([rng.uniform(0.4, 4), *rng.uniform(-0.5, 0.5, 2)])
            receiver = source + rng.uniform(-0.3, 0.3, 3) * (rng.random() < 0.5)
            turn, offset = rng.uniform(0, 2 * np.pi), rng.uniform(-0.1, 0.1)
            line = np.cos(turn), np.sin(turn), offset
            out = np.zeros((aperture.MAX_CORNERS, 2))
            total = 0j
            for sign in (1, -1):
                kept = aperture.clip(ring, len(ring), *(sign * v for v in line), out)
                if kept:
                    total += factor(out[:kept].copy(), source, receiver)
            worst = max(worst, abs(total - factor(shape, source, receiver)))
    assert worst < 1e-3


def test_cuts_through_corners_preserve_the_area():
    """If a line through two corners divides a polygon, the areas of the two pieces sum to the area of the polygon, for any rounding of the
    corners.
    """
    rng = np.random.default_rng(11)
    out = np.zeros((aperture.MAX_CORNERS, 2))
    worst = 0.0
    for _ in range(3000):
        n = rng.integers(4, 9)
        turn = np.sort(rng.uniform(0, 2 * np.pi, n))
        ring = rng.uniform(0.5, 5) * np.column_stack([np.cos(turn), np.sin(turn)]) + rng.uniform(-5, 5, 2)
        whole = Polygon(ring).area
        i, j = rng.choice(n, 2, replace=False)
        (x, y), (p, q) = ring[i], ring[j] + rng.uniform(-2, 2) * (ring[j] - ring[i])
        a, b = y - q, p - x
        total = 0.0
        for sign in (1, -1):
            kept = aperture.clip(ring, n, sign * a, sign * b, -sign * (a * x + b * y), out)
            total += Polygon(out[:kept]).area if kept else 0.0
        worst = max(worst, abs(total - whole) / whole)
    assert worst < 1e-9


def pieces_of(shape, *others):
    """Return the pieces of a polygon that remain after `subtract` removes other polygons, as a list of rings."""
    pieces = np.zeros((aperture.MAX_PIECES, aperture.MAX_CORNERS, 2))
    counts = np.zeros(aperture.MAX_PIECES, np.int64)
    pieces[0, : len(shape)], counts[0], number = shape, len(shape), 1
    spare, around = np.zeros((3, aperture.MAX_CORNERS, 2)), np.zeros((2, 2))
    for other in others:
        ring = np.array(other, float)
        aperture.orient(ring, len(ring))
        aperture.box(ring, len(ring), around)
        number = aperture.subtract(pieces, counts, number, ring, len(ring), around, spare, np.zeros((2, 2)))
    return [pieces[i, : counts[i]].copy() for i in range(number)]


HOLES = {
    "inside": [(-0.05, -0.03), (0.06, -0.04), (0.02, 0.08)],
    "over an edge": [(0.1, -0.05), (0.4, -0.02), (0.3, 0.1)],
    "over a corner": [(0.1, 0.1), (0.3, 0.1), (0.3, 0.3), (0.1, 0.3)],
    "across": [(-1, -0.02), (1, -0.02), (1, 0.02), (-1, 0.02)],
    "beside": [(0.2, 0.2), (0.3, 0.2), (0.3, 0.3)],
    "aslant of a corner": [(0.14, 0.2), (0.2, 0.14), (0.2, 0.2)],  # the bounding boxes of the two shapes overlap
    "touching an edge": [(0.15, -0.1), (0.3, -0.1), (0.3, 0.1), (0.15, 0.1)],
    "itself": SHAPES["square"],
    "all": [(-1, -1), (1, -1), (1, 1), (-1, 1)],
}


@pytest.mark.parametrize("name", HOLES)
def test_subtraction_leaves_the_remaining_area_and_factor(name):
    whole, hole = SHAPES["square"], HOLES[name]
    left = pieces_of(whole, hole)
    assert all(LinearRing(ring).is_ccw for ring in left)
    assert sum(Polygon(ring).area for ring in left) == pytest.approx(Polygon(whole).difference(Polygon(hole)).area, abs=1e-8)
    for place in ((1.0, 0.03, 0.02), (0.6, 0.11, -0.2), (3.0, 0.0, 0.0)):
        rest = sum((factor(ring, place) for ring in left), 0j)
        if name == "inside":
            assert rest == pytest.approx(factor(whole, place) - factor(hole, place), abs=1e-3)
        direct = sum((exact(ring, place) for ring in left), 0j)
        assert abs(rest - direct) < 0.005


def test_order_of_subtractions_does_not_matter():
    whole = SHAPES["square"]
    rng = np.random.default_rng(5)
    holes = [rng.uniform(-0.17, 0.17, 2) + 0.03 * np.array([(0, 0), (1, 0.2), (0.3, 1.0)]) for _ in range(9)]
    factors, left = [], []
    for order in (range(9), range(8, -1, -1), rng.permutation(9)):
        rings = pieces_of(whole, *(holes[i] for i in order))
        assert len(rings) < aperture.MAX_PIECES
        left.append(sum(Polygon(ring).area for ring in rings))
        factors.append(sum(factor(ring, (1.0, 0.02, 0.03)) for ring in rings))
    assert np.ptp(left) < 1e-8
    assert np.abs(np.diff(factors)).max() < 2e-3
    once = pieces_of(whole, *holes)
    twice = pieces_of(whole, *holes, *holes)
    assert sum(Polygon(ring).area for ring in once) == pytest.approx(sum(Polygon(ring).area for ring in twice), abs=1e-8)


def test_polygons_without_area_have_no_factor():
    for shape in ([(0, 0), (0.1, 0), (0.2, 0)], [(0.1, 0.1)] * 3, [(0, 0), (0.2, 0), (0.2, 0), (0, 0)]):
        for place in ((1.0, 0.05, 0.02), (1.0, 0.7, 0.3)):
            value = factor(shape, place)
            assert np.isfinite(value)
            assert abs(value) < 1e-4


def test_repeated_and_straight_corners_change_nothing():
    ring = [(-0.15, -0.15), (0.0, -0.15), (0.15, -0.15), (0.15, -0.15), (0.15, 0.15), (-0.15, 0.15), (-0.15, 0.02)]
    for place in ((1.0, 0.03, 0.02), (1.0, 0.15, 0.02), (0.5, 0.3, -0.2)):
        assert factor(ring, place) == pytest.approx(factor(SHAPES["square"], place), abs=1e-3)


@pytest.mark.parametrize("off", [0.0, 1e-9, -1e-9, 1e-7, 1e-5])
def test_factor_above_an_edge_is_one_half(off):
    """Near the middle of its edge, a plate of 9 m has the Fresnel factor of a half-plane."""
    plate = 30 * np.array(SHAPES["square"])
    assert factor(plate, (1.0, 4.5 + off, 0.3)) == pytest.approx(0.5, abs=2e-3)


@pytest.mark.parametrize("degrees", [30.0, 50.0, 90.0, 120.0, 150.0])
def test_factor_above_a_corner_is_its_share_of_the_angle(degrees):
    """In front of a polygon's corner, the Fresnel factor is the corner's angle divided by 360 degrees. The test places the sensor one
    micrometre beside the axis through the corner, on all sides of this axis. The function `evaluate` never uses the corner itself, because
    it offsets the receiver.
    """
    angle = np.radians(degrees)
    wedge = [(0.0, 0.0), (6.0, 0.0), (6 * np.cos(angle), 6 * np.sin(angle))]
    for turn in np.linspace(0, 2 * np.pi, 9):
        y, z = 1e-6 * np.cos(turn), 1e-6 * np.sin(turn)
        assert factor(wedge, (1.0, y, z)) == pytest.approx(degrees / 360, abs=3e-3)


def test_factor_is_continuous_across_an_edge():
    """The Fresnel factor of a polygon has no jump when the specular point crosses an edge, for steps from 1 nm to 10 um."""
    for shape in SHAPES.values():
        corner, following = (np.array(shape[i]) for i in (0, 1))
        middle, normal = 0.6 * corner + 0.4 * following, np.array([following[1] - corner[1], corner[0] - following[0]])
        normal /= np.linalg.norm(normal)
        for step in (1e-9, 1e-7, 1e-5):
            sides = [factor(shape, (1.0, *(middle + s * step * normal))) for s in (-1, 0, 1)]
            assert np.abs(np.diff(sides)).max() < 1e-3 + 50 * step


# ---- images over panels


def flat_panels(*polygons):
    """Return panels with exactly these rings (corners (n, 3)), each on a surface of its own."""
    rings = [np.array(p, float) for p in polygons]
    corners = np.zeros((len(rings), panels.MAX_SIDES, 3))
    normal = np.zeros((len(rings), 3))
    for i, ring in enumerate(rings):
        corners[i, : len(ring)] = ring
        normal[i] = np.cross(ring[1] - ring[0], ring[2] - ring[1])
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    offset = np.array([n @ r[0] for n, r in zip(normal, rings, strict=True)])
    count = np.array([len(r) for r in rings])
    nothing = np.full(len(rings), -1)
    return panels.Panels(corners, count, normal, offset, np.zeros(len(rings), int), nothing, np.zeros(0, int))


def metal():
    table = reflection_table.build([("metal", 0.0)], FREQUENCY)
    return replace(table, frequencies_hz=np.array([FREQUENCY]))


def received(found, chains, sensor, axis=(0.0, 0, 1), others=()):
    """Return the sum of the image paths over the given sequences of panels, for one sensor that transmits and receives."""
    sensor, axis = np.array(sensor, float)[None], np.array(axis, float)[None]
    things = images.obstacles(found, others)
    ready = images.prepare(found, things, chains, sensor, sensor)
    n = len(ready)
    ends = np.repeat(sensor, n, axis=0)
    one = images.evaluate(found, things, ready, metal(), np.arange(n), ends, np.repeat(axis, n, axis=0), ends)
    lit = one.factor != 0
    field = np.einsum("nk,nk->n", images.across(np.repeat(axis, n, axis=0)[lit], one.arrival[lit]), one.field[lit, 0]).conj()
    length = one.length_m[lit]
    return complex((field * one.factor[lit] * WAVELENGTH / (4 * np.pi * length) * np.exp(1j * K * length)).sum())


def rectangle(centre, u, v):
    """Return the ring of a rectangle from its centre and its two half sides."""
    centre, u, v = (np.array(x, float) for x in (centre, u, v))
    return [centre - u - v, centre + u - v, centre + u + v, centre - u + v]


def image_level(length):
    return WAVELENGTH / (4 * np.pi * length)


@pytest.mark.parametrize("side", [1, -1])
def test_panel_reflects_on_both_sides(side):
    ring = lifted(SHAPES["trapezium"])
    for place in ((1.0, 0.05, 0.02), (0.5, 0.3, 0.1), (2.0, -0.6, 0.2)):
        sensor = np.array(place) * (side, 1, 1)
        error = received(flat_panels(ring), [(0,)], sensor) - panel_quadrature(ring, sensor, WAVELENGTH)
        assert abs(error) / image_level(2 * place[0]) < 0.004


@pytest.mark.parametrize("sensor", [(1.0, 0.8, 0.02), (0.4, 1.5, 0.1), (1.2, 1.2, -0.2), (0.25, 0.25, 0.3)])
def test_two_panels_at_a_right_angle_match_quadrature(sensor):
    """For two panels of 0.5 m at a right angle, both orders of reflection agree with quadrature, relative to the double image."""
    first = rectangle((0.2505, 0, 0), (0.2495, 0, 0), (0, 0, 0.25))
    second = rectangle((0, 0.2505, 0), (0, 0.2495, 0), (0, 0, 0.25))
    exact_ = sum(chain_quadrature(order, sensor, WAVELENGTH) for order in ((first, second), (second, first)))
    ours = received(flat_panels(first, second), [(0, 1), (1, 0)], sensor)
    assert abs(ours - exact_) / image_level(2 * np.hypot(*sensor[:2])) < 0.03


def test_trihedral_of_squares_matches_its_three_bounces():
    """The triple reflection at three squares of 0.3 m at right angles, seen from 1.2 m, agrees with a quadrature over the squares. The
    triple reflection has six orders, each with its own share of the field.
    """
    low, high = 5e-4, 0.3
    square = [(low, low), (high, low), (high, high), (low, high)]
    rings = [[np.insert(p, axis, 0.0) for p in np.array(square)] for axis in range(3)]
    orders = [(0, 1, 2), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0)]
    for sensor in ((0.75, 0.65, 0.7), (1.0, 0.5, 0.6)):
        exact_ = sum(chain_quadrature([rings[i] for i in order], sensor, WAVELENGTH, axis=(0.6, -0.64, 0.48)) for order in orders)
        ours = received(flat_panels(*rings), orders, sensor, axis=(0.6, -0.64, 0.48))
        assert abs(ours - exact_) / image_level(2 * np.linalg.norm(sensor)) < 0.05


@pytest.mark.parametrize("centre", [(0.5, 0.0, 0.0), (0.5, 0.08, 0.03), (0.3, 0.2, 0.0), (0.9, 0.5, 0.1)])
def test_plate_in_front_of_a_panel_removes_its_shadow(centre):
    """A plate in front of a wall removes its geometric shadow from the wall's echo, both on the way from radar to wall and on the way
    back. The echo of the wall agrees with a quadrature over the wall without the shadow that the plate casts as seen from the sensor.
    """
    wall = rectangle((0, 0, 0), (0, 0.5, 0), (0, 0, 0.4))
    plate = rectangle(centre, (0, 0.06, 0), (0, 0, 0.05))
    sensor = np.array([1.2, 0.02, -0.01])
    shadow = [sensor + (corner - sensor) * (sensor[0] / (sensor[0] - corner[0])) for corner in np.array(plate)]
    dark = common_shadow(wall, shadow)
    exact_ = panel_quadrature(wall, sensor, WAVELENGTH)
    if dark is not None:
        exact_ -= panel_quadrature(dark, sensor, WAVELENGTH)
    ours = received(flat_panels(wall, plate), [(0,)], sensor)
    assert abs(ours - exact_) / image_level(2 * sensor[0]) < 0.01


def common_shadow(wall, shadow):
    """Return, as a ring, the part of an upright rectangle in the plane x = 0 that lies on a wall; None if there is no such part."""
    low = np.maximum(np.min(wall, axis=0), np.min(shadow, axis=0))
    high = np.minimum(np.max(wall, axis=0), np.max(shadow, axis=0))
    if (high[1:] <= low[1:]).any():
        return None
    return rectangle((low + high) / 2, (0, (high[1] - low[1]) / 2, 0), (0, 0, (high[2] - low[2]) / 2))


def test_plate_behind_a_panel_or_the_sensor_hides_nothing():
    wall = rectangle((0, 0, 0), (0, 0.5, 0), (0, 0, 0.4))
    sensor = (1.2, 0.02, -0.01)
    alone = received(flat_panels(wall), [(0,)], sensor)
    for centre in ((-0.3, 0, 0), (1.5, 0, 0), (0.6, 0.9, 0.0)):
        other = rectangle(centre, (0, 0.1, 0), (0, 0, 0.1))
        assert abs(received(flat_panels(wall, other), [(0,)], sensor) - alone) < 1e-3 * abs(alone)


def test_plate_in_a_fold_hides_the_double_bounce():
    """A plate between two panels at a right angle interrupts the path between the panels, in both orders of reflection."""
    first = rectangle((0.2505, 0, 0), (0.2495, 0, 0), (0, 0, 0.25))
    second = rectangle((0, 0.2505, 0), (0, 0.2495, 0), (0, 0, 0.25))
    sensor = (1.0, 0.8, 0.02)
    whole = received(flat_panels(first, second), [(0, 1), (1, 0)], sensor)
    across = rectangle((0.2, 0.2, 0.0), (0.19, -0.19, 0), (0, 0, 0.5))
    assert abs(received(flat_panels(first, second, across), [(0, 1), (1, 0)], sensor)) < 0.05 * abs(whole)
    aside = rectangle((0.2, 0.2, 1.0), (0.19, -0.19, 0), (0, 0, 0.2))
    assert abs(received(flat_panels(first, second, aside), [(0, 1), (1, 0)], sensor) - whole) < 0.02 * abs(whole)


@pytest.mark.parametrize(("corners", "limit"), [(4, 0.01), (12, 0.01), (48, 0.1)])
def test_column_in_front_of_a_wall_removes_its_outline(corners, limit):
    """An upright prism removes its geometric shadow from the echo of the wall.

    The shadow is exact for a prism whose outline has up to 24 points. A round prism keeps only its outermost points, so that its outline
    shrinks by a few millimetres.
    """
    wall = rectangle((0, 0, 0), (0, 0.6, 0), (0, 0, 0.2))
    turn = 0.1 + np.linspace(0, 2 * np.pi, corners, endpoint=False)
    sensor = np.array([1.2, 0.02, -0.01])
    for aside in (0.0, 0.1, 0.2):
        column = np.array([(0.5 + 0.05 * np.cos(t), aside + 0.05 * np.sin(t), z) for t in turn for z in (-2.0, 2.0)])
        bearing = np.arctan2(column[:, 1] - sensor[1], sensor[0] - column[:, 0])
        edges = sensor[1] + sensor[0] * np.tan([bearing.min(), bearing.max()])
        dark = rectangle((0, edges.mean(), 0), (0, np.ptp(edges) / 2, 0), (0, 0, 0.2))
        exact_ = panel_quadrature(wall, sensor, WAVELENGTH) - panel_quadrature(dark, sensor, WAVELENGTH)
        ours = received(flat_panels(wall), [(0,)], sensor, others=[column])
        assert abs(ours - exact_) / image_level(2 * sensor[0]) < limit


def test_geometry_without_panels_has_no_images():
    empty = panels.find(Geometry(np.zeros((0, 3, 3)), np.zeros((0, 3, 3)), np.zeros(0, int)))
    ready = images.prepare(empty, images.obstacles(empty), [], np.zeros((1, 3)), np.zeros((1, 3)))
    assert len(ready) == 0
