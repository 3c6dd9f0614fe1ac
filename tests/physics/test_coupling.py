"""Paths between objects and a room against image sources, geometric optics, exact geometry and finite differences."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from physics_helpers import assert_finite_and_passive, between, flat_room_paths, geometric_optics_of_a_sphere
from posing import placed
from scipy.spatial.transform import Rotation
from scipy.special import fresnel

import radartwin as rt
from experiments.validation.oracles import stack, traced
from radartwin.constants import SPEED_OF_LIGHT
from radartwin.scene import objects, rooms
from radartwin.scene.surface import Role
from radartwin.simulation.backends import coupling
from radartwin.simulation.backends.mitsuba import MitsubaBackend, TraceSettings
from radartwin.simulation.flat.legs import Legs

RADAR = traced.MONOSTATIC
WAVELENGTH = SPEED_OF_LIGHT / RADAR.center_frequency_hz
K = 2 * np.pi / WAVELENGTH
RADIUS = 0.05
SENSOR = np.array([0.0, 0.0, 1.0])
MIRRORED = SENSOR * (1, 1, -1)
FREE_SPACE = Legs.of_free_space(1, np.array([RADAR.center_frequency_hz]))


def floor(material="metal", half=3.0, height=0.0, name="floor"):
    mesh = rooms.rectangle([-half + 1, -half, height], np.eye(3)[0], np.eye(3)[1], (2 * half, 2 * half))
    return rt.Surface(mesh, material if material == "metal" else rt.Layered([], material), name, role="room")


def ball(centre=(0.0, 0, 0)):
    return rt.Surface(objects.sphere(RADIUS, 5).apply_translation(centre), "metal", "ball", role="object")


def test_a_sharp_field_is_evaluated_once_beside_its_points():
    """A field that is linear in space is interpolated exactly, for any division of the points and also after other places."""
    asked, rng, slope = [], np.random.default_rng(0), np.array([[1.0, 2j], [3.0, -1.0], [0.5j, 2.0]])

    def exact(place: int, leg: int, points: np.ndarray) -> np.ndarray:
        asked.append(np.column_stack([np.full(len(points), 10 * place + leg), points.round(9)]))
        return (1 + leg) * (points @ slope) + place

    corner = np.array([[0.0, 0, 0], [2.0, 1.0, 0]])
    shape, sharp = np.zeros((2, 3, 3)), np.array([[0.0, 0.01], [0.02, 0.01]])
    legs = Legs(np.arange(2), shape, shape[:, 0], corner, 0.2, np.ones(2), FREE_SPACE.carried, np.ones((2, 2)), sharp, exact)
    place, leg = np.array([0, 1, 1] * 40), np.array([1, 0, 1] * 40)
    point = corner[place] + 0.2 * rng.random((120, 3))
    for rows in (slice(70), slice(50, 120)):
        amplitude = np.ones((len(point[rows]), 2), complex)
        legs.weigh(amplitude, place[rows], leg[rows], point[rows])
        np.testing.assert_allclose(amplitude, (1 + leg[rows, None]) * (point[rows] @ slope) + place[rows, None], rtol=1e-12)
    nodes = np.concatenate(asked)
    assert len(np.unique(nodes, axis=0)) == len(nodes)


paths_of = partial(flat_room_paths, rays_per_wavelength2=4.0)


def backend(**values):
    return MitsubaBackend(TraceSettings(**{"room": "panels", "diffuse": False, "rays_per_wavelength2": 4.0, **values}))


def at(position, rotation=None):
    return traced.pose(position, rotation)[None]


def near(parts, length, within=0.07):
    return between(parts, length - within, length + within)


def sphere_echo(centre, source, target):
    return geometric_optics_of_a_sphere(centre, RADIUS, source, target, WAVELENGTH)


def db(ratio):
    return 20 * np.log10(abs(ratio))


@pytest.mark.parametrize(
    ("material", "height", "limit_db"), [("metal", 0.3, 0.3), ("metal", 0.7, 0.3), ("concrete", 0.35, 0.5), ("water", 0.35, 0.5)]
)
def test_sphere_over_a_floor_matches_geometric_optics(material, height, limit_db):
    """The direct echo, the two echoes over floor and sphere, and the echo floor - sphere - floor.

    The coefficient is TM, because the field is vertical, and conjugated, because the phase of the signal grows with the path length.
    Water turns the phase by 20 degrees at each reflection.
    """
    centre = np.array([1.2, 0.0, height])
    parts = paths_of(rt.Scene([floor(material), ball(centre)]), at(SENSOR), rays_per_wavelength2=4.0 if material == "metal" else 9.0)[1:]
    eps = stack.permittivity(material, RADAR.center_frequency_hz)
    for source, target, ways, reflections in ((SENSOR, SENSOR, 1, 0), (SENSOR, MIRRORED, 2, 1), (MIRRORED, MIRRORED, 1, 2)):
        level, length, place = sphere_echo(centre, source, target)
        cosine = (place - MIRRORED)[2] / np.linalg.norm(place - MIRRORED)
        reflected = np.conj(stack.fresnel(eps, float(cosine))[1]) ** reflections
        value = near(parts, length)
        assert db(value / (ways * level * reflected)) == pytest.approx(0, abs=limit_db)
        turned = abs(np.degrees(np.angle(value * np.exp(-1j * K * length) / reflected)))
        assert min(turned, 180 - turned) < 8  # the sphere turns the field over once


def test_pairs_of_legs_are_chosen_for_each_pose_by_their_field():
    legs = replace(FREE_SPACE, order=np.array([0, 1, 1, 2]), share=np.array([[1.0, 0.5, 0.4, 0.3]] * 2))
    frame, (place, out, back) = coupling._strong_pairs(legs, np.array([0, 1, 0]), 4, np.array([0.01, 0.45, 1.0]))
    every = [(0, 0, i, k) for i in range(4) for k in range(max(i, 1), 4) if (i, k) != (3, 3)]  # 4 reflections leave none for the object
    assert list(zip(frame, place, out, back, strict=True)) == [*every, (1, 1, 0, 1)]


def test_paths_do_not_depend_on_the_number_traced_at_once_or_on_other_poses(monkeypatch):
    """The strongest pairs of legs differ from pose to pose, and one of the poses is too close to the ball for a planar grid of tubes."""
    scene, poses = rt.Scene([floor(), ball((0.4, 0.0, 0.3))]), np.concatenate([at(SENSOR), at((0.345, 0.0, 0.3)), at((-0.5, 0.2, 0.7))])
    motion = {"ball": np.tile(np.eye(4), (3, 1, 1))}

    def fields(some):
        parts = backend(max_bounces=3).traced(scene, RADAR, poses[some], {"ball": motion["ball"][some]}).groups[("ball",)]
        paths = [[part.frames(k, k + 1) for part in parts] for k in range(len(poses[some]))]
        return np.array([[traced.field([part], RADAR.center_frequency_hz) for part in pose] for pose in paths])

    whole = fields(slice(None))
    assert (np.abs(whole[:, 0]) > 0).all()
    assert (np.abs(whole[:, 1]) > 0).tolist() == [True, False, True]
    for k in range(3):
        assert fields(slice(k, k + 1))[0] == pytest.approx(whole[k], rel=1e-4)
    monkeypatch.setattr(coupling, "AT_ONCE", 100)
    assert fields(slice(None)) == pytest.approx(whole, rel=1e-6)


def table_top(edge):
    """Return a metal table top from x = edge[0] (near edge) to x = edge[1] (far edge) that is 3 m wide along y."""
    mesh = rooms.rectangle([edge[0], -1.5, 0.0], np.eye(3)[0], np.eye(3)[1], (edge[1] - edge[0], 3.0))
    return rt.Surface(mesh, "metal", "top", role="room")


def test_table_edge_under_the_object_matches_the_half_plane_factor():
    """The echo over table and sphere becomes weaker as the table moves away from the sphere."""
    centre = np.array([1.2, 0.0, 0.3])
    level, length, place = sphere_echo(centre, SENSOR, MIRRORED)
    mirror_point = place[0] * (1.0 / (1.0 + place[2]))
    for beyond in np.arange(-0.3, 0.31, 0.06):
        scene = rt.Scene([table_top((mirror_point + beyond, mirror_point + beyond + 1.2)), ball(centre)])
        value = near(paths_of(scene, at(SENSOR), rays_per_wavelength2=4.0)[1:], length)
        edge = np.array([mirror_point + beyond, 0.0, 0.0])
        target = np.linalg.norm(place - MIRRORED)
        excess = max(np.linalg.norm(edge - SENSOR) + np.linalg.norm(edge - place) - target, 0.0)
        s, c = fresnel(np.sqrt(2 * K * excess / np.pi))
        dark = (1 - (1 - 1j) * (c + 1j * s)) / 2
        half_plane = dark if beyond > 0 else 1 - dark
        assert abs(value) / (2 * level) == pytest.approx(abs(half_plane), abs=0.1)


def test_object_behind_a_screen_is_seen_over_a_wall():
    """The direct echo and the two echoes with one reflection on the wall vanish, and the echo wall - sphere - wall keeps its level."""
    centre = np.array([1.6, 0.0, 1.0])
    wall = rt.Surface(rooms.rectangle([-1, 1.0, -0.5], np.eye(3)[0], np.eye(3)[2], (4.5, 3.0)), "metal", "wall", role="room")
    screen = rt.Surface(rooms.rectangle([0.8, -0.35, 0.5], np.eye(3)[1], np.eye(3)[2], (0.7, 1.0)), "metal", "screen", role="room")
    image = np.array([0.0, 2.0, 1.0])
    parts = paths_of(rt.Scene([wall, screen, ball(centre)]), at(SENSOR))[1:]
    both = sphere_echo(centre, image, image)
    direct = sphere_echo(centre, SENSOR, SENSOR)
    mixed = sphere_echo(centre, SENSOR, image)
    open_ = paths_of(rt.Scene([wall, ball(centre)]), at(SENSOR))[1:]
    for value, ways in ((direct, 1), (mixed, 2), (both, 1)):
        assert db(near(open_, value[1]) / (ways * value[0])) == pytest.approx(0, abs=0.4)
    assert abs(near(parts, direct[1])) < 1e-3 * direct[0]
    assert abs(near(parts, mixed[1])) < 0.05 * mixed[0]
    assert db(near(parts, both[1]) / both[0]) == pytest.approx(0, abs=0.5)


WAYS = {"slide": (0.5, 0.3, 0.8), "sensor": (0.6, -0.2, -0.7)}


@pytest.mark.parametrize("kind", [*WAYS, "turn"])
def test_doppler_of_every_leg_pair_matches_path_differences(kind):
    """The range rate is the mean of an echo, weighted by amplitude."""
    frames, aside = 3, 0.1 if kind == "turn" else 0.0
    steps = {name: 0.004 * np.arange(frames)[:, None] * np.array(way) * (kind == name) for name, way in WAYS.items()}
    turn = Rotation.from_euler("z", 0.7 + 0.04 * np.arange(frames)[:, None]) if kind == "turn" else None
    motion, sensors = placed(np.array([1.2, 0.05, 0.35]) + steps["slide"], turn), placed(SENSOR + steps["sensor"])
    centre = (motion @ np.array([aside, 0, 0, 1]))[:, :3]
    parts = paths_of(rt.Scene([floor(), ball((aside, 0, 0))]), sensors, {"ball": motion})[1:]
    exact = []
    for i in range(frames):
        eye, below = sensors[i, :3, 3], sensors[i, :3, 3] * (1, 1, -1)
        exact.append([sphere_echo(centre[i], s, t)[1] for s, t in ((eye, eye), (eye, below), (below, below))])
    rates = (np.array(exact)[2] - np.array(exact)[0]) / 2 * RADAR.frame_rate_hz
    for echo in range(3):
        total, weighted = 0j, 0j
        for part in parts:
            one = part.frames(1, 2)
            chosen = np.abs(one.length_m - exact[1][echo]) < 0.07
            field = one.amplitude[chosen, 0] * np.exp(1j * K * one.length_m[chosen])
            total, weighted = total + field.sum(), weighted + (field * one.rate_mps[chosen]).sum()
        assert (weighted / total).real == pytest.approx(rates[echo], abs=0.01 * np.abs(rates).max() + 1e-3)


def test_channels_of_image_paths_match_image_geometry():
    """The exact echoes run between mirrored antenna elements."""
    turn = np.linalg.qr(np.array([[0.9, -0.1, 0.3], [0.15, 0.95, -0.25], [-0.3, 0.2, 0.9]]))[0]
    turn *= np.sign(np.diag(turn))
    turn[:, 2] *= np.linalg.det(turn)
    radar = replace(rt.Radar.iwr1843(element="isotropic"), num_chirps=1)
    centre = np.array([1.2, 0.3, 0.6])  # no component of the directions is zero
    scene, bare = rt.Scene([floor(), ball(centre)]), rt.Scene([floor()])
    ours = rt.simulate(scene, radar, at(SENSOR, turn), simulator=backend(rays_per_wavelength2=9.0)).iq[0, 0]
    ours = ours - rt.simulate(bare, radar, at(SENSOR, turn), simulator=backend()).iq[0, 0]
    f = radar.start_frequency_hz + radar.slope_hz_per_s * np.arange(radar.num_samples) / radar.sample_rate_hz
    flip = np.diag([1.0, 1, -1])
    exact = np.zeros((3, *ours.shape), complex)
    for t, r in np.ndindex(ours.shape[:2]):
        tx, rx = SENSOR + turn @ radar.tx_positions[t], SENSOR + turn @ radar.rx_positions[r]
        for echo, pairs in enumerate(([(tx, rx)], [(flip @ tx, rx), (tx, flip @ rx)], [(flip @ tx, flip @ rx)])):
            for source, target in pairs:
                level, length, _ = sphere_echo(centre, source, target)
                exact[echo, t, r] += level * np.exp(2j * np.pi * f / SPEED_OF_LIGHT * length)
    basis = exact.reshape(3, -1, radar.num_samples)
    for echo in range(3):
        # amplitude of each echo per channel by least squares over the sweep
        channels = [
            np.linalg.lstsq(basis[:, c].T, ours.reshape(-1, radar.num_samples)[c], rcond=None)[0][echo] for c in range(basis.shape[1])
        ]
        turned = np.angle(np.array(channels) / np.mean(channels))
        assert np.degrees(np.abs(turned)).max() < 4
        assert np.ptp(db(np.array(channels))) < 0.5


def opening(low, high, d1, d2):
    """Return the field behind an opening (low, high) in a plane, relative to the undisturbed field; one dimension."""
    scale = np.sqrt(2 / WAVELENGTH * (1 / d1 + 1 / d2))
    (s_low, c_low), (s_high, c_high) = fresnel(scale * low), fresnel(scale * high)
    return (c_high - c_low + 1j * (s_high - s_low)) / (1 + 1j)


def two_openings(half, d1, between, points=1501):
    """Return the field behind two openings (-half, half) at the distance d1 from either end of a path, by quadrature of both; one
    dimension.
    """
    x, step = np.linspace(-half, half, points, retstep=True)
    weight = np.full(points, step)
    weight[[0, -1]] /= 2
    field = weight * np.exp(1j * K * x**2 / (2 * d1))
    kernel = np.exp(1j * K * (x[:, None] - x) ** 2 / (2 * between))
    return np.sqrt((2 * d1 + between) / between) / (d1 * 1j * WAVELENGTH) * (field @ kernel @ field)


def test_objects_that_touch_overlap_or_leave_the_room_stay_finite():
    walls = objects.box((0, 0, 0), (4.0, 3.0, 2.5))
    walls.invert()
    room = rt.Surface(walls, "concrete", "walls", role="room")
    top = rt.Surface(objects.box((1.5, 1, 0.7), (2.5, 2, 0.73)), "wood", "top", role="room")
    for low in ((2.0, 1.2, 0.0), (2.0, 1.2, 0.73), (3.95, 1.0, 0.5), (3.5, 2.9, -0.05), (2.0, 1.5, 0.715)):
        thing = objects.box(low, (np.array(low) + np.array([0.1, 0.12, 0.2])).tolist())
        for surface, motion in (
            (rt.Surface(thing, "metal", "thing", role="object"), None),
            (rt.Surface(objects.cylinder(0.05, 0.2), "metal", "thing", role="object"), {"thing": traced.pose(np.array(low) + 0.06)[None]}),
        ):
            for eye in ((0.5, 1.5, 1.0), (1.0, 1.5, 0.73)):
                assert_finite_and_passive(paths_of(rt.Scene([room, top, surface]), at(eye), motion, rays_per_wavelength2=1.0))


@pytest.mark.parametrize("height", [0.06, 0.2])
def test_box_on_the_floor_is_a_corner_reflector(height):
    """Box front and its image in the floor are an opening. The box belongs to the room, is an object, or moves."""
    box = objects.box((1.15, -0.075, 0.0), (1.25, 0.075, height))
    pose = at((0, 0, 0.6))
    half = np.hypot(1.15, 0.6)
    seen = height * 1.15 / half
    factor = opening(-0.075, 0.075, half, half) * opening(-seen, seen, half, half)
    exact = db(WAVELENGTH / (8 * np.pi * half) * factor)
    there = np.eye(4)[None]
    moved = np.concatenate([pose, pose])
    moved[1, 0, 3] += 1e-3

    def level(role: Role, poses, motion=None):
        parts = paths_of(rt.Scene([floor(), rt.Surface(box, "metal", "box", role=role)]), poses, motion)
        return db(near(parts, 2.55, 0.35))

    at_rest = [level("room", pose), level("object", pose), level("object", pose, {"box": there})]
    levels = [*at_rest, level("object", moved, {"box": np.repeat(there, 2, 0)})]
    assert levels == pytest.approx([exact] * 4, abs=0.8)
    assert levels[1:] == pytest.approx([levels[1]] * 3, abs=0.05)


@pytest.mark.parametrize("edge", [1.6, 1.75, 1.85])
def test_box_behind_the_edge_of_a_table_is_lit_in_part(edge):
    """The table lights only the lowest 1 to 12 cm of a box whose front is 30 to 5 cm behind its edge, so that the field of the mirror image
    is not smooth over the box.

    The reference is the box as a part of the room. Quadrature of physical optics with the half-plane factor of the table differs from the
    reference by at most 0.07, and from the object by at most 0.08. When five points across the object carried the field, the error was 0.23
    to 0.62.
    """
    table = rt.Surface(rooms.rectangle([edge, -2, 0], np.eye(3)[0], np.eye(3)[1], (3, 4)), "metal", "table", role="room")
    box = rt.Surface(objects.box((-0.1, -0.1, 0), (0.1, 0.1, 0.3)), "metal", "box", role="object")
    box = box.moved(traced.pose([2.0, 0, 0]))
    pose = at([0, 0, 0.5], Rotation.from_euler("y", np.arctan2(0.35, 2.0)).as_matrix())
    scenes = [rt.Scene([table]), *(rt.Scene([table, box.replaced(role=role)]) for role in ("object", "room"))]
    alone, *both = (np.hanning(RADAR.num_samples) * traced.sweep(backend().paths(scene, RADAR, pose, None), RADAR) for scene in scenes)
    ours, reference = (np.fft.fft(signal - alone)[37:66] for signal in both)  # 1.6 to 2.9 m
    assert np.linalg.norm(ours - reference) < 0.1 * np.linalg.norm(reference)


def mirror_facing(centre, towards, thickness, size=0.3):
    """Return a square metal plate at `centre` whose face points towards `towards`."""
    plate = objects.box((-thickness, -size / 2, -size / 2), (0.0, size / 2, size / 2))
    x = towards / np.linalg.norm(towards)
    y = np.cross([0, 0, 1.0], x)
    y /= np.linalg.norm(y)
    turn = np.eye(4)
    turn[:3, :3] = np.stack([x, y, np.cross(x, y)], axis=1)
    turn[:3, 3] = centre
    return plate.apply_transform(turn)


@pytest.mark.parametrize("thickness", [0.0005, 0.02])
def test_paths_between_two_small_mirrors_count_once(thickness):
    """The path occurs in two directions, so that the field is twice that behind two openings, whose level has no thickness."""
    sensor, a, b = np.array([0, 0, 1.5]), np.array([3.0, 1, 1.5]), np.array([3.0, -1, 1.5])

    def unit(v):
        return v / np.linalg.norm(v)

    plates = [
        rt.Surface(mirror_facing(one, unit(sensor - one) + unit(other - one), thickness), "metal", name, role="object")
        for one, other, name in ((a, b, "a"), (b, a, "b"))
    ]
    far = rt.Surface(rooms.rectangle([-30, 20, 0], np.eye(3)[0], np.eye(3)[2], (1, 1)), "metal", "far", role="room")
    length = float(2 * np.linalg.norm(a - sensor) + 2)
    way = float(np.linalg.norm(a - sensor))
    seen = 0.15 * float(unit(unit(sensor - a) + unit(b - a)) @ unit(sensor - a))
    openings = two_openings(0.15, way, 2.0) * two_openings(seen, way, 2.0)
    exact = db(2 * WAVELENGTH / (4 * np.pi * length) * openings)
    scene = rt.Scene([*plates, far])
    for motion in (None, {"a": np.eye(4)[None]}):
        assert db(near(paths_of(scene, at(sensor), motion), length, 0.15)) == pytest.approx(exact, abs=0.7)


@pytest.mark.parametrize("room", ["auto", "tubes"])
def test_object_moves_beside_curved_surfaces_without_panels(room):
    """The room consists of a ball and a floor that scan errors have bent; neither is flat enough to become a panel."""
    bent = rooms.rectangle([0.5, -0.5, 0], np.eye(3)[0], np.eye(3)[1], (1, 1)).subdivide_loop(4)
    bent.vertices[:, 2] += 2e-3 * np.random.default_rng(0).standard_normal(len(bent.vertices))
    for static in (ball((1.5, 0.5, 1.0)), rt.Surface(bent, "concrete", "floor", role="room")):
        parts = paths_of(rt.Scene([static, rt.Surface(objects.box((-0.05,) * 3, (0.05,) * 3), "metal", "box")]), at((0, 0, 1.0)),
                         {"box": traced.pose((1.2, 0, 1.0), None)[None]}, room=room)  # fmt: skip
        assert all(np.isfinite(p.amplitude).all() for p in parts)
        assert sum(len(p) for p in parts)


def test_surface_names_do_not_change_the_paths():
    scene = [floor("concrete"), ball((1.2, 0.2, 0.5)), ball((1.5, -0.3, 0.4))]
    levels = []
    for names in (("x", "y"), ("x", "x")):
        named = [scene[0], *(s.replaced(name=name) for s, name in zip(scene[1:], names, strict=True))]
        levels.append(db(near(paths_of(rt.Scene(named), at(SENSOR), room="tubes", rays=100_000), 0.0, np.inf)))
    assert levels[0] == pytest.approx(levels[1], abs=1e-6)
