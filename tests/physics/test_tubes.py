"""Tests of ray tubes: their spreading after curved surfaces, energy, polarisation and reciprocity."""

from typing import Any

import numpy as np
import pytest
import trimesh
from physics_helpers import FREQUENCY, UP, WAVELENGTH, K, coherent, geometric_optics_of_a_sphere

import radartwin as rt
from radartwin.scene import objects
from radartwin.simulation import geometry, reflection_table, variant
from radartwin.simulation.curved import tube_grid, tubes
from radartwin.simulation.hits import Antennas, TraceOptions


@pytest.mark.parametrize(
    ("density", "bound_db"),
    [(4.0, {"S": 0.1, "S W": 0.5, "W S": 0.2, "W S W": 0.5}), (16.0, {"S": 0.1, "S W": 0.25, "W S": 0.1, "W S W": 0.2})],
)
def test_sphere_and_wall_match_geometric_optics(density, bound_db):
    """The fields of paths over a sphere and a wall agree with geometric optics for three orders of reflection: sphere - wall, wall -
    sphere and wall - sphere - wall.

    A sphere of 5 cm, 30 cm from a wall, is seen from the side, where the reflections on the sphere are far from its shadow line.
    """
    variant.activate()
    sensor, centre, radius, wall_x = np.zeros(3), np.array([0.3, 1.0, 0.0]), 0.05, 0.6
    image = np.array([2 * wall_x, 0, 0])
    wall, ball = objects.plate(3, 3).apply_translation([wall_x, 0, 0]), objects.sphere(radius, 5).apply_translation(centre)
    built = geometry.build([wall, ball])
    table = reflection_table.build([("metal", 0.0)] * 2, FREQUENCY)
    antenna = Antennas(sensor[None], UP)
    hits = {}  # by the first letter of the names in `bound_db`
    for letter, first, at in (("S", 1, centre), ("W", 0, centre * [-1, 1, 1] + [2 * wall_x, 0, 0])):
        target = geometry.build([objects.sphere(radius, 4).apply_translation(at)])
        grid = tube_grid.towards(target.hull_points(), sensor[None], target.centre, WAVELENGTH / np.sqrt(density), (0.14, 0.95))
        assert grid is not None
        hits[letter] = tubes.trace(built, table, grid, antenna, antenna, TraceOptions(3, built.surface, first))
    for name, bound in bound_db.items():
        source, receiver = (image if name[end] == "W" else sensor for end in (0, -1))
        level, length, _ = geometric_optics_of_a_sphere(centre, radius, source, receiver)
        # every reflection on metal changes the sign of the vertical field
        expected = -((-1) ** name.count("W")) * level * np.exp(1j * K * length)
        # Neither the sphere nor the wall reflects a tube twice in a row, so that the first surface and the number of bounces give the path.
        found = hits[name[0]]
        value = coherent(found, found.bounce == len(name.split()))
        assert abs(20 * np.log10(abs(value / expected))) < bound, name
        assert abs(np.degrees(np.angle(value / expected))) < 20, name


def carried(mesh, reflectance, bounces):
    """Return the power that the ray tubes carry after 0, 1, 2, ... bounces, summed tube by tube, for tubes from the middle of a closed
    mesh.
    """
    variant.activate()
    import drjit as dr
    import mitsuba as mi

    from radartwin.simulation.curved import contact as contacts
    from radartwin.simulation.curved import flight, scatter
    from radartwin.simulation.curved.device import Device
    from radartwin.simulation.drjit_arrays import upload, vectors

    built = geometry.build([mesh])
    device = Device.of(built, TraceOptions(bounces, hats=True))
    power = np.zeros(bounces + 1)
    source = np.array([[0.11, -0.07, 0.05]])
    for grid in tube_grid.all_around(source, np.eye(3)[None], 20_000):
        index = upload(mi.UInt32, np.arange(grid.per_pose))
        lanes = flight.start(flight.on_device(grid), vectors(UP), False, index, None)
        active = contacts.cast(device, lanes, True)
        for bounce in range(bounces + 1):
            te, tm = np.ones(dr.width(lanes.index)), 0j
            for _, _, turn_cos, turn_sin in lanes.encounters:
                c, s = turn_cos.numpy(), turn_sin.numpy()
                te, tm = -np.sqrt(reflectance) * (te * c + tm * s), 1j * np.sqrt(reflectance) * (tm * c - te * s)
            power[bounce] += float((lanes.weight.numpy().astype(float) * (np.abs(te) ** 2 + np.abs(tm) ** 2)).sum())
            contact, active = contacts.meet(device, lanes, bounce == 0, active)
            reception = scatter.Reception(-lanes.direction, dr.full(type(lanes.weight), 1.0), -lanes.direction, False)
            scatter.scatter(device, lanes, contact, reception, 1600.0, active)
            active = contacts.bounce(device, lanes, contact, active)
            dr.eval(lanes, active)
            lanes = lanes.compacted(dr.compress(active))
            active = dr.full(type(active), True, dr.width(lanes.index))
    return power


@pytest.mark.parametrize("reflectance", [1.0, 0.3])
def test_closed_rooms_conserve_the_energy_of_tubes(reflectance):
    """In a box and in a ball, lossless walls keep all power, and lossy walls keep |Gamma|^2 at every bounce. No ray tube
    escapes from the room through the seam between two triangles of the mesh.
    """
    box = trimesh.creation.box((1.0, 0.8, 0.9))
    for mesh in (box, objects.sphere(0.5, 3)):
        power = carried(mesh, reflectance, 5)
        assert power[0] == pytest.approx(4 * np.pi, rel=1e-3)
        np.testing.assert_allclose(power / power[0], reflectance ** np.arange(6), rtol=2e-4)


@pytest.mark.parametrize(("angle_deg", "co", "cross"), [(0.0, 1.0, 0.0), (22.5, 0.5, 0.5), (45.0, 0.0, 1.0)])
def test_dihedral_turns_polarisation_by_twice_its_own_angle(angle_deg, co, cross):
    mesh = objects.dihedral(0.1, 0.1).apply_transform(trimesh.transformations.rotation_matrix(np.radians(angle_deg), [1, 0, 0]))
    whole = 8 * np.pi * 0.1**4 / WAVELENGTH**2
    levels = {p: rt.rcs(mesh, [1, 0, 0], polarization=p, rays_per_wavelength2=4) / whole for p in ("VV", "VH", "HV", "HH")}
    assert levels["VV"] == pytest.approx(co, abs=0.02)
    assert levels["HH"] == pytest.approx(co, abs=0.02)
    assert levels["VH"] == pytest.approx(cross, abs=0.02)
    assert levels["HV"] == pytest.approx(levels["VH"], rel=1e-3, abs=1e-6)


@pytest.mark.parametrize("bounces", [1, 2])
def test_divided_tubes_sum_to_one(bounces):
    """The weights of whole tubes, of narrow tubes and of the pieces along the rims sum to one at random points of the ray grid on a can, of
    which the radar sees the side and the upper end.
    """
    variant.activate()
    from radartwin.simulation.curved import borders, division
    from radartwin.simulation.curved.borders import PIECES
    from radartwin.simulation.curved.device import Device
    from radartwin.simulation.curved.flight import WHOLE

    built = geometry.build([objects.cylinder(0.02, 0.05)])
    source = np.array([[1.0, 0.2, 0.7], [0.8, -0.1, 0.9]])
    grid = tube_grid.towards(built.hull_points(), source, built.centre, WAVELENGTH, (0.25, 0.25))
    assert grid is not None
    options = TraceOptions(bounces)
    device, poses = Device.of(built, options), (0, 2)
    sequences = division.patch_sequences(device, grid, poses, options, None) if bounces > 1 else None
    index, share, cut = division.divided(borders.cut(built, grid, poses), sequences, grid, poses, True, True)
    at = np.random.default_rng(1).uniform(1, np.array([grid.count_u, grid.count_v]) - 3, (500, 2))
    if sequences is not None:  # cells beside the body have no tubes
        met = sequences[1, : grid.per_pose].reshape(grid.count_v, grid.count_u) > 0
        i, j = np.floor(at).astype(int).T
        at = at[met[j, i] & met[j + 1, i] & met[j, i + 1] & met[j + 1, i + 1]]
    total, kinds = np.zeros(len(at)), set()
    for i, s in zip(index, share, strict=True):
        if i // grid.per_pose != 1:
            continue
        number = s // (WHOLE + 1) - 1
        cell = i - grid.per_pose
        centre = np.array([cell % grid.count_u, cell // grid.count_u]) if number < 0 else cut.centre[number]
        off = at - centre
        if s & WHOLE:
            off *= PIECES if number >= 0 else 1
            square = (off[:, 0] > 0) + 2 * (off[:, 1] > 0)
            total += np.clip(1 - np.abs(off), 0, None).prod(axis=1) * (s >> square & 1)
        else:
            a, b = cut.corner[number], np.roll(cut.corner[number], -1, axis=0)
            total += ((b - a)[:, 0] * (off[:, None] - a)[..., 1] - (b - a)[:, 1] * (off[:, None] - a)[..., 0] >= 0).all(axis=1)
        kinds.add((number >= 0, bool(s & WHOLE)))
    np.testing.assert_allclose(total, 1, atol=1e-5)
    assert len(kinds) == bounces + 1


@pytest.mark.parametrize("foci_m", [(np.inf, np.inf), (1.0, np.inf), (3.0, 1.0), (1.0, 1.5), (1.0, 1.0), (3.0, 4.0), (-1.0, 1.0)])
def test_field_advances_a_quarter_cycle_at_each_focal_line(foci_m):
    """The phase of the tubes after a focal line agrees with the diffraction integral of a converging wave along each axis in closed form,
    exp(-j k x^2 (1/z - 1/f)/2).

    The test compares the difference between the phase of the field far behind the focus and its phase before the focus, under exp(+j omega
    t).
    """
    variant.activate()
    import mitsuba as mi

    from radartwin.simulation.curved import contact, flight

    way = 2.0
    expected = np.prod([np.sqrt(1 / (1e-9 + 1j * (1 / way - 1 / f))) / np.sqrt(1 / (1e-9 + 1j * (1 / 1e-3 - 1 / f))) for f in foci_m])
    expected /= abs(expected)
    turn = np.radians(25.0)  # angle between the focal lines and the axes of the ray grid
    axes = np.array([[np.cos(turn), np.sin(turn), 0.0], [-np.sin(turn), np.cos(turn), 0.0]])
    foot_u, foot_v = (-(axes.T / np.array(foci_m)) @ axes)[:2].tolist()
    names = "index", "pose", "origin", "weight", "share", "departure", "across", "encounters", "length", "first"
    none: Any = {name: None for name in names}
    tube = flight.Tubes(
        **none, direction=mi.Vector3f(0, 0, 1), position_du=mi.Vector3f(1, 0, 0), position_dv=mi.Vector3f(0, 1, 0),
        direction_du=mi.Vector3f(*foot_u), direction_dv=mi.Vector3f(*foot_v),
        caustics=mi.UInt32(0),
    )  # fmt: skip
    contact.count_caustics(tube, mi.Float(way))
    assert 1j ** int(tube.caustics.numpy()[0]) == pytest.approx(expected, abs=1e-5)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_diverging_tube_passes_no_caustic_within_nanometres(sign):
    """A diverging tube has no caustic ahead, even if its next facet is a few nanometres away, as at the edge of two faces. The numbers are
    those of a tube at the edge of the rover's block: its cross-section has terms of 1e-6 and 1e-22, whose product is subnormal.
    """
    variant.activate()
    import mitsuba as mi

    from radartwin.simulation.curved import contact, flight

    names = "index", "pose", "origin", "weight", "share", "departure", "across", "encounters", "length", "first"
    none: Any = dict.fromkeys(names)
    tube = flight.Tubes(
        **none, direction=mi.Vector3f(0, 1, 0), position_du=mi.Vector3f(sign * 0.00230769, 0, sign * 0.00386094),
        position_dv=mi.Vector3f(0.00153846, 0, -1.7e-10), direction_du=mi.Vector3f(sign * 0.0009777, 0, sign * 0.00163578),
        direction_dv=mi.Vector3f(0.00475697, 0, -0.00245366), caustics=mi.UInt32(0),
    )  # fmt: skip
    contact.count_caustics(tube, mi.Float(3.6e-9))
    assert int(tube.caustics.numpy()[0]) == 0


def test_received_power_is_below_the_transmitted_power():
    """The received power of the radar stays below its transmitted power for a corner reflector and for a concave mirror, at the sensor
    positions of their strongest echo.
    """
    bowl = objects.sphere(0.2, 4)
    bowl = trimesh.Trimesh(bowl.vertices, bowl.faces[bowl.triangles_center[:, 0] < -0.1], process=False)
    for mesh, distance in ((objects.trihedral(0.1), 0.5), (bowl, 0.02), (bowl, 0.1)):
        sigma = rt.rcs(mesh, [1, 0, 0], distance=distance, rays_per_wavelength2=4)
        received = sigma * WAVELENGTH**2 / ((4 * np.pi) ** 3 * distance**4)
        assert 0 < received < 1


@pytest.mark.parametrize("material", ["metal", rt.Layered([("glass", 0.003)], "water"), rt.Layered([("pet", 0.001)])])
def test_poses_of_a_grid_are_independent(material):
    """The fields at a sensor pose must not depend on the other poses in the same call of the tracer, also with pruning, several frequency
    nodes and hollow objects.
    """
    variant.activate()
    built = geometry.build([objects.cylinder(0.033, 0.12)])
    table = reflection_table.build([(material, 0.0)], 77e9, 80.4e9)
    at = np.random.default_rng(0).normal([1.5, 0, 0], 0.3, (6, 3))
    values = []
    for poses in ([0, 1, 2, 3, 4, 5], [4]):
        antenna = Antennas(at[poses], np.repeat(UP, len(poses), axis=0))
        grid = tube_grid.towards(built.hull_points(), at[poses], built.centre, WAVELENGTH, built.grid_shift)
        assert grid is not None
        hits = tubes.trace(built, table, grid, antenna, antenna, TraceOptions(3, prune=1e-4))
        assert set(hits.pose) == set(range(len(poses)))
        values.append(coherent(hits, hits.pose == len(poses) - 2 if len(poses) > 1 else slice(None)))
    assert values[0] == pytest.approx(values[1], rel=2e-2)
