"""Rooms of flat faces: image sources of boxes, edges and shadows of furniture, moving sensors, and damaged meshes."""

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest
import trimesh
from physics_helpers import assert_finite_and_passive, between, flat_room_paths, metal_wall, relative_error, two_ways
from posing import placed
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation

import radartwin as rt
from experiments.validation.oracles import rooms as room_oracles
from experiments.validation.oracles import stack, traced
from experiments.validation.oracles.box import image_paths, image_sum
from experiments.validation.oracles.nearfield import panel_quadrature
from radartwin.compiled import compiled
from radartwin.constants import SPEED_OF_LIGHT
from radartwin.errors import SceneError
from radartwin.scene import objects, rooms
from radartwin.simulation.backends.mitsuba import MitsubaBackend, TraceSettings
from radartwin.simulation.backends.track_paths import Track
from radartwin.simulation.flat import field
from radartwin.simulation.flat import room as flat_room
from radartwin.simulation.flat.faces import Faces

RADAR = traced.MONOSTATIC
FREQUENCY = RADAR.center_frequency_hz
WAVELENGTH = SPEED_OF_LIGHT / FREQUENCY
K = 2 * np.pi / WAVELENGTH
# rotations for which no image is exactly on the antenna's axis
ATTITUDES = {"tilted": room_oracles.rotation(), "turned": Rotation.from_rotvec([0.3, -1.9, 0.8]).as_matrix()}


paths_of = partial(flat_room_paths, coupling=False)
BOUNCE = MitsubaBackend(TraceSettings(room="panels", diffuse=False, coupling=False, max_bounces=1))


def fields(parts, frames, low_m=0.0, high_m=np.inf):
    """Return the field (frames,) of all paths between two lengths."""
    return np.array([between(parts, low_m, high_m, frame) for frame in range(frames)])


def looking(position, rotation=None):
    return traced.pose(position, rotation)[None]


def amplitudes(part):
    return np.array([traced.field([part.where(slice(i, i + 1))], FREQUENCY) for i in range(len(part))])


def sampled(parts):
    return traced.sweep(parts, RADAR)


def by_image(size, sensor, rotation, material="metal", bounces=4, **values):
    """Return, for every distinct path length of a box, the error relative to the image's own level, and the level relative to the strongest
    image.
    """
    part = paths_of(room_oracles.room_scene(size, material), looking(sensor, rotation), max_bounces=bounces, **values)[0]
    ours = amplitudes(part)
    together = {}
    reflection = room_oracles.wall_reflection(material)
    for amplitude, length, _ in image_paths(np.array(size), np.array(sensor), rotation[:, 2], reflection, bounces):
        together.setdefault(round(length, 5), []).append((amplitude, length))
    rows = []
    for images in together.values():
        length = images[0][1]
        exact = sum(a * WAVELENGTH / (4 * np.pi * n) * np.exp(1j * K * n) for a, n in images)
        mine = ours[np.abs(part.length_m - length) < 2e-5].sum()
        rows.append((abs(mine - exact) / (len(images) * WAVELENGTH / (4 * np.pi * length)), abs(exact)))
    errors, levels = np.array(rows).T
    strays = np.array([np.abs(np.array(list(together)) - n).min() for n in part.length_m])
    assert strays.max(initial=0) < 3e-5  # the tracer finds no path that is not an image
    return errors, levels / levels.max()


def signal_error(size, sensor, rotation, material, bounces):
    """Return the relative error of the signal of a box against the sum of its images."""
    reflection = room_oracles.wall_reflection(material)
    exact = image_sum(np.array(size), np.array(sensor), rotation[:, 2], reflection, bounces, traced.frequencies(RADAR))
    parts = paths_of(room_oracles.room_scene(size, material), looking(sensor, rotation), max_bounces=bounces)
    return relative_error(sampled(parts), exact)


@pytest.mark.parametrize(
    ("name", "attitude", "material", "worst", "rms"),
    [
        ("court", "tilted", "metal", 0.04, 0.015), ("office", "turned", "metal", 0.04, 0.015), ("corridor", "tilted", "metal", 0.08, 0.025),
        ("office", "tilted", "concrete", 0.05, 0.05), ("corridor", "tilted", "glass", 0.05, 0.05),
    ],
)  # fmt: skip
def test_every_image_of_a_box_has_its_level(name, attitude, material, worst, rms):
    """The tracer finds all images above the pruning level and no others. An image at an edge or corner is the sum of its orders of
    reflection.
    """
    _, size, sensor = room_oracles.ROOMS[name]
    errors, levels = by_image(size, sensor, ATTITUDES[attitude], material)
    seen = levels > (2e-3 if material == "metal" else 0)
    assert seen.sum() > 60
    assert errors[seen].max() < worst
    assert np.sqrt(np.mean(errors[seen] ** 2)) < rms
    if material != "metal":
        assert signal_error(size, sensor, ATTITUDES[attitude], material, 4) < 0.03


@pytest.mark.parametrize("sensor", [(0.01, 1.7, 1.1), (0.02, 0.015, 1.1), (0.01, 0.02, 0.03)])
def test_signal_close_to_walls_is_accurate(sensor):
    """The amplitude of metal is that of the middle frequency, which is an error of 0.9 % rms over the sweep."""
    size, turn = (5.0, 4.0, 2.5), ATTITUDES["tilted"]
    assert signal_error(size, sensor, turn, "metal", 3) < 0.015
    if sensor[2] > 1:
        errors, levels = by_image(size, sensor, turn, bounces=3)
        assert errors[levels > 5e-3].max() < 0.01


@pytest.mark.parametrize(
    ("centre", "limit"), [((0.0, 0.0), 0.06), ((0.05, 0.02), 0.06), ((0.3, 0.15), 0.06), ((0.16, 0.0), 0.18)],
    ids=["middle", "beside the middle", "aside", "1 cm from the line"],
)  # fmt: skip
def test_wall_behind_a_plate_matches_fresnel_sums(centre, limit):
    """A line that misses an edge by 1 cm on both ways is in the transition region of both diffractions: their product is not exact."""
    plate = objects.plate(0.3, 0.2).apply_translation([0.8, *centre])
    parts = paths_of(rt.Scene([metal_wall(1.5), rt.Surface(plate, "metal", "plate", role="room")]), looking((0, 0, 0)), max_bounces=3)
    y, z = (np.arange(-half + 2.5e-4, half, 5e-4) for half in (0.15, 0.1))
    exact = -two_ways(np.ones((len(y), len(z))), y + centre[0], z + centre[1], 0.8, 1.5, K) * np.exp(3j * K)
    assert abs(between(parts, 2.9, 3.9) * 8 * np.pi * 1.5 / WAVELENGTH - exact) < limit


def test_box_over_the_floor_hides_the_floor():
    """The box floats 1 cm above the floor, exactly below the radar. Its lid has the level of Fresnel integrals."""
    floor = rt.Surface(rooms.rectangle([-2, -2, 0], np.eye(3)[0], np.eye(3)[1], (4, 4)), "metal", "floor", role="room")
    box = rt.Surface(objects.box([-0.3, -0.25, 0.01], [0.3, 0.25, 0.41]), "metal", "box", role="room")
    place = np.array([0.1, 0.05, 1.6])
    parts = paths_of(rt.Scene([floor, box]), looking(place), max_bounces=1)
    assert np.abs(parts[0].length_m - 3.2).min() > 0.01
    lid = panel_quadrature(np.array([(-0.3, -0.25, 0.41), (0.3, -0.25, 0.41), (0.3, 0.25, 0.41), (-0.3, 0.25, 0.41)]), place, WAVELENGTH)
    assert abs(between(parts, 2.3, 2.9) - lid) < 0.05 * WAVELENGTH / (8 * np.pi * 1.19)


def keller(angle, distance, sign):
    """Return the echo of a long straight edge of a metal half-plane. sign: -1 for the field along the edge, +1 for the field across it.

    angle: between the half-plane and the direction to the sensor, in a plane perpendicular to the edge. distance: of the sensor from the
    edge. Ref: J. Keller, J. Opt. Soc. Am. 52 (1962) 116, the diffraction coefficient of a half-plane and the spreading of its wave.
    """
    coefficient = np.exp(0.25j * np.pi) / (2 * np.sqrt(2 * np.pi * K)) * (1 + sign / np.cos(angle))
    return abs(coefficient) * WAVELENGTH / (4 * np.pi) / (distance * np.sqrt(2 * distance))


ROLLED = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # the antenna's axis is horizontal


@pytest.mark.parametrize(("edge", "rotation", "sign"), [(1.2, ROLLED, -1), (2.0, np.eye(3), 1)], ids=["near", "far"])
def test_table_top_echoes_at_its_edges(edge, rotation, sign):
    """A table top 0.35 m below the radar echoes at its near edge in horizontal and at its far edge in vertical polarisation only."""
    top = rt.Surface(rooms.rectangle([1.2, -1.5, -0.35], np.eye(3)[0], np.eye(3)[1], (0.8, 3.0)), "metal", "top", role="room")
    parts = paths_of(rt.Scene([top]), looking((0, 0, 0), rotation))
    distance, down = np.hypot(edge, 0.35), np.arctan2(0.35, edge)
    assert abs(between(parts, 2 * distance - 0.02, 2 * distance + 0.02)) == pytest.approx(
        keller(np.pi - down if edge == 1.2 else down, distance, sign), rel=0.08
    )
    assert all(part.length_m.min(initial=9.0) > 2.4 for part in parts)
    profile = np.abs(np.fft.fft(sampled(parts) * np.hanning(RADAR.num_samples), 4096))
    assert profile.argmax() / 4096 * RADAR.unambiguous_range_m == pytest.approx(distance, abs=0.02)


def test_faces_after_an_edge_come_in_the_order_of_the_path():
    """A wave from an edge reaches the radar over the left and then the right of two short walls, but not vice versa."""

    def upright(corner, along, length, name):
        mesh = rooms.rectangle([*corner, -3.0], np.array([*along, 0.0]), np.eye(3)[2], (length, 6.0))
        return rt.Surface(mesh, "metal", name, role="room")

    edge, walls = np.array([0.7, 0.5]), [upright((-2.0, 0.25), (0, 1), 0.75, "left"), upright((2.0, 0.05), (0, 1), 0.25, "right")]
    parts = paths_of(rt.Scene([*walls, upright(edge, (0.6, 0.8), 0.4, "strip")]), looking((0, 0, 0), ROLLED), max_bounces=4)
    lengths = np.concatenate([part.length_m for part in parts])
    over_both, other_order = (np.linalg.norm(edge) + np.linalg.norm(edge - [image, 0]) for image in (-8.0, 8.0))
    assert np.abs(lengths - over_both).min() < 1e-6
    assert np.abs(lengths - other_order).min() > 1e-3


def test_the_point_of_diffraction_has_the_shortest_path():
    for start, along, source, receiver in np.random.default_rng(5).uniform(-1, 1, (20, 4, 3)):
        along = along / np.linalg.norm(along)

        def length(place, start=start, along=along, source=source, receiver=receiver):
            point = start + place * along
            return np.linalg.norm(point - source) + np.linalg.norm(point - receiver)

        place = field.keller(*(tuple(one.tolist()) for one in (start, along, source, receiver)))
        shortest: Any = minimize_scalar(length, bracket=(-3, 3), tol=1e-12)
        assert place == pytest.approx(shortest.x, abs=1e-5)


def test_edge_behind_a_slit_echoes_at_its_foot():
    """A metal box stands behind a slit. The foot of its upper front edge returns its strongest echo."""
    parts = (("left", (1, -3, -3), (1.05, -0.15, 3)), ("right", (1, 0.15, -3), (1.05, 3, 3)), ("box", (3, -4.2, -1), (3.5, 3, -0.3)))
    scene = rt.Scene([rt.Surface(objects.box(*corners), "metal", name, role="room") for name, *corners in parts])
    paths = paths_of(scene, looking((0, 0, 0)), max_bounces=1, diffractions=1)
    lengths = np.concatenate([part.length_m for part in paths])
    assert np.abs(lengths - 2 * np.hypot(3, 0.3)).min() < 1e-6


def test_room_with_too_many_edges_warns_and_has_one_diffraction_a_path(monkeypatch):
    strip = rooms.rectangle([1.0, -0.02, -1.0], np.array([0.8, 0.6, 0.0]), np.eye(3)[2], (0.05, 2.0))
    scene = rt.Scene([rt.Surface(strip, "metal", "strip", role="room")])
    twice = sum(len(part) for part in paths_of(scene, looking((0, 0, 0), ROLLED)))
    monkeypatch.setattr(flat_room, "MAX_EDGES", 3)
    with pytest.warns(flat_room.RoomWarning, match="4 edges, over MAX_EDGES = 3; its paths have at most one diffraction"):
        once = sum(len(part) for part in paths_of(scene, looking((1e-6, 0, 0), ROLLED)))  # another place, whose paths no cache holds
    assert once == 2
    assert twice > 2


def test_rates_match_length_differences():
    """For up to four bounces and an oblique motion, the range rate of every path agrees with its change of length two frames later."""
    places = np.array([2.0, 1.7, 1.1]) + np.arange(3)[:, None] * np.array([0.004, -0.003, 0.002])
    poses = placed(places, Rotation.from_matrix(ATTITUDES["tilted"]))
    part = paths_of(room_oracles.room_scene((6.0, 4.0, 2.5), "metal"), poses)[0]
    before, now, after = (part.frames(i, i + 1) for i in range(3))
    checked = 0
    for length, rate, way in zip(now.length_m, now.rate_mps, now.departure, strict=True):
        ends = []
        for other in (before, after):
            near = np.flatnonzero((np.abs(other.length_m - length) < 0.03) & (other.departure @ way > 1 - 3e-5))
            if len(near) and np.ptp(other.length_m[near]) < 1e-9:
                ends.append(other.length_m[near[0]])
        if len(ends) == 2:
            checked += 1
            assert (ends[1] - ends[0]) / 2 * RADAR.frame_rate_hz == pytest.approx(rate, abs=2e-4)
    assert checked > 0.8 * len(now)


@pytest.mark.parametrize("places", [(0.05, 0.13), (0.06, 0.3)], ids=["between", "where key and test places hand over"])
def test_signal_is_smooth_along_a_motion(places):
    """The phases alone explain a second difference of 0.008 over steps of 20 um: (2 k 20 um)^2 is 0.004, the crest factor about two."""
    fine = np.concatenate([np.arange(0, 0.33, 0.04), *(place + 2e-5 * np.arange(-4, 5) for place in places)])
    where = np.unique(np.round(fine, 7))
    poses = placed([1.0, 0.1, 1.1] + where[:, None] * np.eye(3)[0])
    signal = fields(paths_of(rooms.lab(detail="furnished"), poses, max_bounces=2), len(where))
    gaps = np.diff(where)
    bends = np.flatnonzero((np.abs(gaps[1:] - 2e-5) < 1e-9) & (np.abs(gaps[:-1] - 2e-5) < 1e-9)) + 1
    assert len(bends) >= 7 * len(places)
    steps = np.abs(signal[bends + 1] - 2 * signal[bends] + signal[bends - 1]) / np.sqrt(np.mean(np.abs(signal) ** 2))
    assert steps.max() < 0.015


@pytest.mark.parametrize("rotation", list(ATTITUDES))
def test_channels_match_images_seen_by_each_element(rotation):
    """The signals of the real antenna array agree with image sources from every transmitter to every receiver."""
    size, sensor = np.array([6.0, 4.0, 2.6]), np.array([2.2, 1.7, 1.1])
    turn = ATTITUDES[rotation]
    radar = replace(rt.Radar.iwr1843(element="isotropic"), num_chirps=1, num_samples=4 * 256, sample_rate_hz=4 * RADAR.sample_rate_hz)
    scene = room_oracles.room_scene(tuple(size), "metal")
    ours = rt.simulate(scene, radar, looking(sensor, turn), simulator=BOUNCE).iq[0, 0]
    f = radar.start_frequency_hz + radar.slope_hz_per_s * np.arange(radar.num_samples) / radar.sample_rate_hz
    exact = np.zeros(ours.shape, complex)
    for t, r in np.ndindex(ours.shape[:2]):
        transmitter, receiver = (sensor + turn @ p[i] for p, i in ((radar.tx_positions, t), (radar.rx_positions, r)))
        for axis in range(3):
            for plane in (0.0, size[axis]):
                image = transmitter.copy()
                image[axis] = 2 * plane - image[axis]
                centre = 2 * abs(plane - sensor[axis])
                length = np.linalg.norm(receiver - image)
                exact[t, r] -= SPEED_OF_LIGHT / (4 * np.pi * f * centre) * np.exp(2j * np.pi * f / SPEED_OF_LIGHT * length)
    assert relative_error(ours, exact) < 0.03
    turned = np.angle((ours * exact.conj()).sum(axis=-1))
    assert np.degrees(np.abs(turned - turned.mean())).max() < 0.5


def fuzzed(seed):
    """Return a box room with furniture that overlaps, touches, coincides and degenerates, drawn from this seed."""
    rng = np.random.default_rng(seed)
    walls = objects.box((0, 0, 0), (5.0, 4.0, 2.5))
    walls.invert()
    surfaces = [rt.Surface(walls, "concrete", "walls", role="room")]
    for i in range(6):
        low = rng.uniform([0, 0, 0], [4, 3, 1.5])
        high = low + rng.uniform(0.02, 1.0, 3)
        if seed % 3 == 0:
            low[2] = 0.0  # this box touches the floor
        mesh = objects.box(low.tolist(), high.tolist())
        if seed % 2:
            vertices = np.concatenate([mesh.vertices, rng.uniform(0, 2, (3, 3))])
            n = len(mesh.vertices)
            extra = [mesh.faces[0], mesh.faces[1][::-1], [n, n, n + 1], [n, n + 1, n + 1], [0, 1, 0]]
            mesh = trimesh.Trimesh(vertices, np.concatenate([mesh.faces[: 12 - i % 3], extra]), process=False)
        surfaces.append(rt.Surface(mesh, ["metal", "glass", "wood"][i % 3], f"thing {i}", role="room"))
    copy = rooms.rectangle([0, 0, 0], np.eye(3)[0], np.eye(3)[1], (5.0, 4.0))
    surfaces.append(rt.Surface(copy, "metal", "second floor", role="room"))
    surfaces.append(rt.Surface(rooms.rectangle([1, 1, 0], np.eye(3)[0], np.eye(3)[1], (1.0, 9.0)), "wood", "carpet", role="room"))
    return rt.Scene(surfaces)


def outside(scene, rng):
    for _ in range(200):
        place = rng.uniform([0.05, 0.05, 0.05], [4.95, 3.95, 2.45])
        try:
            scene.check_sensor(place)
        except SceneError:
            continue
        return place
    raise AssertionError("no free place")


@pytest.mark.parametrize("seed", range(4))
def test_fuzzed_rooms_stay_finite_and_passive(seed):
    scene = fuzzed(seed)
    rng = np.random.default_rng(100 + seed)
    poses = np.array([traced.pose(outside(scene, rng), ATTITUDES["tilted"]) for _ in range(3)])
    parts = paths_of(scene, poses, coupling=True)
    assert_finite_and_passive(parts)
    for part in parts:
        np.testing.assert_allclose(np.linalg.norm(part.departure, axis=1), 1, atol=1e-6)


def test_round_pillar_in_a_flat_room_loses_no_face():
    """The pillar's echo is that of a simulation of the whole room by ray tubes."""
    pillar = trimesh.creation.cylinder(0.15, 2.7, sections=64).apply_translation([2.5, 0, 1.36])
    scene = rt.Scene([*rooms.lab(), rt.Surface(pillar, "metal", "pillar")])
    levels = []
    for room in ("auto", "tubes"):
        parts = MitsubaBackend(TraceSettings(room=room, max_bounces=1, diffuse=False)).paths(scene, RADAR, looking((1.0, 0, 1.0)))
        levels.append(20 * np.log10(abs(between(parts, 2.1, 3.3, frequency_hz=77e9))))
    assert levels[0] == pytest.approx(levels[1], abs=0.5)


def test_wall_with_a_deep_cavity_has_its_reflection_at_every_sample():
    """The level of metal is that of the middle frequency at all samples, that of the other wall is proportional to the wavelength."""
    wall = objects.plate(60.0, 60.0).apply_translation((2.0, 0.0, 0.0))
    radar = rt.Radar.iwr1843(element="isotropic")

    def samples(material):
        scene = rt.Scene([rt.Surface(wall, material, "wall", role="room")])
        return rt.simulate(scene, radar, np.eye(4)[None], simulator=BOUNCE).iq[0, 0, 0, 0]

    frequency = radar.start_frequency_hz + radar.slope_hz_per_s * np.arange(radar.num_samples) / radar.sample_rate_hz
    layers = [("plasterboard", 0.0125), ("air", 0.3), ("plasterboard", 0.0125)]
    exact = np.array([stack.stack(layers, "air", 0.0, one)[0] for one in frequency])
    ratio = samples(rt.Layered(layers)) / samples("metal") * frequency / radar.center_frequency_hz
    assert np.abs(ratio + np.conj(exact)).max() < 3e-3


@pytest.mark.parametrize("material", ["concrete", "metal"])
def test_echo_of_an_inner_corner_is_continuous_in_its_angle(material):
    """A corner of exactly 90 degrees has a double image and no edge. Beside this angle, the edge continues the doubly reflected waves."""
    echoes = []
    for angle in (0.0, 1e-6, -1e-6, 1e-4, 2.4e-3, -2.4e-3):
        end = np.array([np.cos(angle), np.sin(angle), 0.0])
        walls = [rooms.rectangle([0, 0, -1.4], way, np.eye(3)[2], (5, 2.8)) for way in (end, np.array([0, 1.0, 0]))]
        scene = rt.Scene([rt.Surface(wall, material, f"wall{i}", role="room") for i, wall in enumerate(walls)])
        parts = paths_of(scene, np.concatenate([looking((2.5, 3.4, 0.1)), looking((3.45, 2.5, -0.1))]), max_bounces=2)
        double = 2 * np.hypot(2.5, 3.4)
        echoes.append(fields(parts, 2, double - 0.1, double + 0.1))
    change = 20 * np.log10(np.abs(np.array(echoes[1:]) / echoes[0]))
    assert np.abs(change[:2]).max() < 0.1
    assert np.abs(change[2]).max() < 0.3
    assert np.abs(change[3:]).max() < 2


@compiled
def doubled(wedge, te, tm, phi, phi0, sine, cosine):
    return field.doubled_matrix(wedge, field.Tables(te, tm, te, tm), 0, 0, phi, phi0, sine, cosine)


@pytest.mark.parametrize(("opening", "source", "first"), [(0.6, 0.15, 0), (0.6, 0.45, 1), (0.42, 0.3, 0), (0.48, 0.3, 1), (0.8, 0.1, 0)])
@pytest.mark.parametrize("cosine", [0.0, 0.4, -0.7])
def test_inner_corner_continues_the_wave_that_both_faces_reflect(opening, source, first, cosine):
    """The matrix equals two reflections at dielectric faces, for the ray that meets the edge of the corner along z."""
    angle, edge, sine = opening * np.pi, np.eye(3)[2], np.sqrt(1 - cosine**2)
    normals = np.array([[0, 1.0, 0], [np.sin(angle), -np.cos(angle), 0]])
    wedge = Faces(
        normals, np.zeros(2), np.zeros(2, int), np.zeros((2, 3, 3)), np.arange(3), np.zeros((2, 3, 3)), np.full(2, 3), np.zeros((1, 3)),
        edge[None], np.ones(1), np.eye(3)[:1], np.eye(3)[1:2], np.array([opening]), np.array([[0, 1]]),
    )  # fmt: skip
    phi0 = source * np.pi
    way = np.array([-sine * np.cos(phi0), -sine * np.sin(phi0), cosine])

    def soft_and_hard(ray):
        soft = (edge - cosine * ray) / sine
        return np.stack([soft, np.cross(soft, ray)])

    fields = soft_and_hard(way)
    for normal in normals if first == 0 else normals[::-1]:
        te, tm = stack.fresnel(3.0, abs(way @ normal))
        across = np.cross(way, normal)
        across /= np.linalg.norm(across)
        out = way - 2 * (way @ normal) * normal
        fields = te * np.outer(fields @ across, across) + tm * np.outer(fields @ np.cross(across, way), np.cross(across, out))
        way = out
    exact = soft_and_hard(way) @ fields.T
    te, tm = (np.ascontiguousarray(values[None, :, None], complex) for values in stack.fresnel(3.0, np.linspace(0, 1, 4001)))
    there = np.arctan2(way[1], way[0])
    matrix = np.reshape(doubled(wedge, te, tm, there, phi0, sine, cosine), (2, 2))
    np.testing.assert_allclose(matrix, exact, atol=1e-4)
    back = np.reshape(doubled(wedge, te, tm, phi0, there, sine, -cosine), (2, 2))
    np.testing.assert_allclose(np.abs(back), np.abs(matrix.T), atol=1e-9)


@pytest.mark.slow
def test_no_path_along_a_motion_is_listed_in_both_directions():
    """The search orders arrivals at an edge by their strength, which differs from place to place."""
    drives = Track.of_drives(
        list(rooms.lab(detail="furnished")), RADAR, placed(np.linspace((0.4, -0.15, 0.4), (0.4, 0.15, 0.4), 4)), TraceSettings()
    )
    searched = drives.searched
    assert searched is not None
    every = searched.sequences
    listed = set()
    for count, edge, chain in zip(every.count, every.edge, every.chain, strict=True):
        faces = chain[: count.sum()].tolist()
        listed.add((tuple(count), tuple(edge), tuple(faces)))
        if edge[0] >= 0 and edge[1] < 0 and (count[0], faces) != (count[2], faces[::-1]):
            assert ((count[2], count[1], count[0]), tuple(edge), tuple(faces[::-1])) not in listed
    assert len(listed) == len(every) > 500
