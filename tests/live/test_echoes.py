"""What the live page computes: complete answers against `radartwin.simulate`, levels, delays and directions against closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh

import radartwin as rt
from radartwin.errors import PoseError, SceneError
from radartwin.live.echoes import surfaces_at
from radartwin.live.setting import LiveSetting, free_name, split
from radartwin.live.tracing import LiveTracer
from radartwin.scene import objects, rooms
from radartwin.scene.scene import Scene, Surface
from radartwin.scene.trajectories.trajectory import look_at, pose

C = 299_792_458.0
RADAR = rt.Radar.iwr1843(element="isotropic")


def wall(y: float, name: str) -> Surface:
    """Return a metal wall in the plane of this y, whose edges are 20 m away, so that they do not matter."""
    return square([-20, y, -20], [40, 0, 0], [0, 0, 40], name)


def square(corner: list[float], first: list[float], second: list[float], name: str) -> Surface:
    a, u, v = (np.array(values, float) for values in (corner, first, second))
    return Surface(trimesh.Trimesh([a, a + u, a + u + v, a + v], [[0, 1, 2], [0, 2, 3]]), "metal", name, role="room")


def reflector(at: list[float], leg_m: float = 0.1) -> Surface:
    """Return a corner reflector that opens towards -x, with its apex at a point."""
    mesh = objects.trihedral(leg_m).apply_transform(np.diag([-1.0, -1.0, 1.0, 1.0])).apply_translation(at)
    return Surface(mesh, "metal", "reflector", role="object")


def answer(scene: Scene, radar_pose: np.ndarray, radar: rt.Radar = RADAR, **choices):
    room, movables = split(scene)
    tracer = LiveTracer(room, radar, movables)
    setting = LiveSetting(radar_pose, {m.name: m.pose for m in movables}, **choices)
    return tracer, setting, tracer.answer(setting, complete=True)


def test_a_wall_has_the_level_the_delay_and_the_surface_of_its_mirror_image() -> None:
    distance = 3.0
    tracer, setting, complete = answer(Scene([wall(distance, "mirror")]), look_at([0, 0, 0], [0, 1, 0]))
    strongest = complete.paths[0]
    # Friis to the mirror image, lambda / (4 pi 2 d), in the middle of the sampled sweep of 256 / 5.21 MHz x 70 MHz/us.
    wavelength = C / (77e9 + 256 / 5.21e6 * 70e12 / 2)
    # The rough bound of 0.1 dB covers the wall's edges, which are 20 m away, and its finite conductivity.
    assert strongest.level_db == pytest.approx(20 * np.log10(wavelength / (4 * np.pi * 2 * distance)), abs=0.1)
    assert strongest.delay_s == pytest.approx(2 * distance / C, rel=1e-6)
    assert strongest.bounces == 1
    assert np.allclose(strongest.points, [[0, 0, 0], [0, distance, 0], [0, 0, 0]], atol=0.005)  # the elements are within 5 mm
    assert surfaces_at(strongest, tracer.scene(setting)) == ["mirror"]
    # the nearest bin of a grid of half the range resolution
    peak = complete.spectra.range_m[np.argmax(complete.spectra.profile_db)]
    assert peak == pytest.approx(distance, abs=RADAR.range_resolution_m / 2)


def test_a_symmetric_room_lists_the_echo_of_each_corner_once_with_both_walls() -> None:
    # A room of 4 x 3 m, 2.4 m high, without floor and ceiling, whose axis goes through the radar.
    turns = [([-2, -1.5], [4, 0]), ([2, -1.5], [0, 3]), ([2, 1.5], [-4, 0]), ([-2, 1.5], [0, -3])]
    walls = [square([*at, -1.2], [*along, 0], [0, 0, 2.4], f"wall {n}") for n, (at, along) in enumerate(turns)]
    tracer, setting, complete = answer(Scene(walls), pose([0.3, 0, 0]), max_bounces=2)
    # The image of the radar in two walls at right angles lies behind their corner, so that both reflections are at the corner.
    for n, (corner, _) in enumerate(turns):
        away = np.linalg.norm(np.array(corner) - [0.3, 0])
        (listed,) = (p for p in complete.paths if p.bounces == 2 and np.allclose(p.points[1:-1], [*corner, 0], atol=0.01))
        assert listed.length_m == pytest.approx(2 * away, abs=1e-3)  # the elements are within 5 mm
        both = {f"wall {n}", f"wall {n - 1 if n else 3}"}
        assert all(both & set(name.split(" and ")) for name in surfaces_at(listed, tracer.scene(setting)))


def test_a_path_of_two_bounces_without_stored_points_gets_both_corners() -> None:
    dihedral = objects.dihedral(0.1, 0.1).apply_transform(np.diag([-1.0, -1.0, 1.0, 1.0]))  # it opens towards the radar
    _, _, complete = answer(Scene([Surface(dihedral.apply_translation([2, 0, 0]), "metal", "dihedral", role="object")]), np.eye(4))
    double = next(p for p in complete.paths if p.bounces == 2)
    legs = np.linalg.norm(np.diff(double.points, axis=0), axis=1)
    assert not double.partial
    assert len(double.points) == 4
    assert legs.sum() == pytest.approx(double.length_m, abs=1e-6)


@pytest.fixture(scope="module")
def shell():
    """Return the empty laboratory with a reflector, a tracer of it, and a setting with two bounces."""
    room, movables = split(rooms.lab(detail="shell") + Scene([reflector([3.0, 0.4, 1.0])]))
    tracer = LiveTracer(room, rt.Radar.iwr1843(), movables)
    return room, movables[0], tracer, LiveSetting(rooms.lab_bench().sensor_pose, {"reflector": movables[0].pose}, max_bounces=2)


def simulated(room: Scene, movable, setting: LiveSetting) -> np.ndarray:
    scene = room + Scene(movable.surfaces)
    motion = {movable.name: setting.object_poses[movable.name]}
    return rt.simulate(scene, rt.Radar.iwr1843(), setting.radar_pose, motion=motion, max_bounces=setting.max_bounces).iq[0]


def test_complete_answers_equal_the_simulation_and_a_moved_object_needs_no_search(shell) -> None:
    room, movable, tracer, setting = shell
    moved = replace(setting, object_poses={"reflector": pose([0.2, -0.3, 0.1]) @ movable.pose})
    for asked, complete in ((setting, True), (moved, False)):
        answered = tracer.answer(asked, complete=complete)
        wanted = simulated(room, movable, asked)
        assert answered.complete
        # 1e-6: the fast synthesis rounds in single precision, and depends on the number of chirps
        assert np.abs(answered.iq[0] - wanted).max() <= 1e-6 * np.abs(wanted).max()


def test_a_draft_at_a_new_place_is_near_the_simulation_and_says_that_it_is_a_draft(shell) -> None:
    room, movable, tracer, setting = shell
    tracer.answer(setting, complete=True)
    moved = replace(setting, radar_pose=pose([0.05, 0.1, 0]) @ setting.radar_pose)
    draft = tracer.answer(moved)
    assert not draft.complete
    wanted = simulated(room, movable, moved)
    # a draft has neither new paths with two diffractions nor paths between object and room; measured error 0.01
    assert np.linalg.norm(draft.iq[0] - wanted[0]) < 0.1 * np.linalg.norm(wanted[0])


def test_no_room_leaves_the_objects_and_one_material_changes_the_echo(shell) -> None:
    _, movable, tracer, setting = shell
    void = tracer.answer(replace(setting, materials="void"))
    assert void.complete
    assert {p.owner for p in void.paths} == {"reflector"}
    alone = rt.simulate(Scene(movable.surfaces), rt.Radar.iwr1843(), setting.radar_pose, motion={"reflector": movable.pose}, max_bounces=2)
    assert np.abs(void.iq[0] - alone.iq[0]).max() <= 1e-6 * np.abs(alone.iq).max()
    labelled, uniform = (tracer.answer(replace(setting, materials=m), complete=True) for m in ("labelled", "uniform"))
    assert np.linalg.norm(labelled.iq - uniform.iq) > 0.01 * np.linalg.norm(labelled.iq)
    block = Scene([Surface(objects.box([0, 0, 0], [1, 1, 1]), "concrete", "block", role="room")])
    with pytest.raises(SceneError, match="inside surface 'block'"):
        LiveTracer(block, RADAR).check(LiveSetting(pose([0.5, 0.5, 0.5])))
    with pytest.raises(PoseError, match="radar_pose"):
        tracer.answer(replace(setting, radar_pose=2 * np.eye(4)))


def test_objects_are_split_from_the_room_with_their_own_frames() -> None:
    mug = [surface.moved(pose([2, 1, 0.7])) for surface in objects.entry("mug").surfaces()]
    plate = objects.plate(0.2, 0.2).apply_translation([1, 0, 1])
    nameless = [Surface(plate, "metal", role="object"), Surface(plate.copy().apply_translation([0, 1, 0]), "metal", role="object")]
    room, movables = split(Scene([wall(3, "wall"), *mug, *nameless]))
    assert room.names == ("wall",)
    assert [m.name for m in movables] == ["mug", "object", "object 2"]
    for movable in movables:
        centre = Scene(movable.surfaces).bounds.mean(axis=0)
        assert np.allclose(centre, 0, atol=1e-9)
    back = Scene(s.moved(movables[0].pose) for s in movables[0].surfaces)
    assert np.allclose(back.bounds, Scene(mug).bounds)
    assert free_name("mug", ["mug"]) == "mug 2"
