"""Scenes: refused input, saving and loading, allowed positions and paths of the sensor, and overlaps of meshes."""

import numpy as np
import pytest
import trimesh

from radartwin.errors import MissingError, OutputError, SceneError
from radartwin.materials import Layered
from radartwin.scene import objects
from radartwin.scene.collision import check_path, overlap_m
from radartwin.scene.objects import joined
from radartwin.scene.scene import Scene, Surface
from radartwin.scene.trajectories import trajectory


def box(size=0.2, at=(0, 0, 0)):
    return trimesh.creation.box((size, size, size)).apply_translation(at)


def labelled_scene():
    pane = Layered([("glass", 0.004), ("air", 0.016), ("glass", 0.004)], backing="air")
    floor = trimesh.creation.box((4, 4, 0.1)).apply_translation([0.123456789, 0, -1])
    return Scene(
        [
            Surface(box(), "metal", "target", roughness_m=2e-4, correlation_m=7e-3, role="object", provenance={"source": "true"}),
            Surface(floor, Layered([("floorboard", 0.008)], backing="concrete"), "floor"),
            Surface(box(0.4, (2, 0, 0)), pane, "window", role="room"),
            Surface(box(0.1, (0, 2, 0)), "wood"),
        ],
        {"room": "test", "scan": {"faces": 3}},
    )


def test_a_scene_round_trips_with_the_same_bytes_and_without_temporary_files(tmp_path):
    scene = labelled_scene()
    scene.save(tmp_path / "a")
    again = Scene.load(tmp_path / "a")
    again.save(tmp_path / "b")
    assert again.provenance == scene.provenance
    for a, b in zip(scene, again, strict=True):
        assert (a.material, a.name, a.roughness_m, a.role, a.provenance) == (b.material, b.name, b.roughness_m, b.role, b.provenance)
        assert a.correlation_m == b.correlation_m
        assert np.array_equal(a.mesh.faces, b.mesh.faces)
        assert np.abs(a.mesh.vertices - b.mesh.vertices).max() < 1e-6  # float32 in glTF
        assert np.abs(a.mesh.vertex_normals - b.mesh.vertex_normals).max() < 1e-6
    for name in ("scene.glb", "manifest.json"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes()
    assert scene.without(["floor"]).names == ("target", "window", "")
    scene.save(tmp_path / "a")
    assert sorted(p.name for p in (tmp_path / "a").iterdir()) == ["manifest.json", "scene.glb"]
    for part in (tmp_path / "a").iterdir():
        assert Scene.load(part).names == ("target", "floor", "window", "")
        with pytest.raises(SceneError, match="has its own materials"):
            Scene.load(part, material="concrete")


@pytest.mark.parametrize("suffix", [".glb", ".ply", ".obj"])
def test_a_plain_mesh_needs_one_material_and_its_size_determines_its_kind(tmp_path, suffix):
    path = tmp_path / f"room{suffix}"
    box(2.0).export(path)
    with pytest.raises(SceneError, match=r"carries no material labels.*--material NAME"):
        Scene.load(path)
    (surface,) = Scene.load(path, material="concrete")
    assert surface.material == "concrete"
    assert np.allclose(surface.mesh.bounds, [[-1, -1, -1], [1, 1, 1]])
    kinds = [Surface(box(size), "metal").kind for size in (0.5, 0.51, 100.0)]
    assert kinds == ["object", "room", "room"]
    assert Surface(box(3.0), "metal", role="object").kind == "object"


def test_a_sensor_inside_a_solid_is_refused_and_inside_a_room_is_accepted():
    position = np.array([[5.0, 0, 0], [0.1, 0.2, 0.3]])
    solid = Scene([Surface(box(2.0), "concrete", "pillar")])
    with pytest.raises(SceneError, match="frame 1, is inside surface 'pillar'"):
        solid.check_sensor(position)
    solid.check_sensor(position[:1])
    doubled = trimesh.Trimesh(box(2.0).vertices[box(2.0).faces.reshape(-1)], np.arange(36).reshape(-1, 3), process=False)
    with pytest.raises(SceneError):
        Scene([Surface(doubled, "metal")]).check_sensor(np.zeros(3))
    inward = box(2.0)
    inward.invert()
    Scene([Surface(inward, "concrete", "room")]).check_sensor(position)
    open_room = box(2.0)
    open_room.update_faces(np.arange(len(open_room.faces)) > 1)
    Scene([Surface(open_room, "concrete")]).check_sensor(position)
    front = Scene([Surface(wall(1.43), "concrete", "front")])
    check_path(front, trajectory.depth_sweep(trajectory.look_at([0.5, 1, 0.4], [9, 1, 0.4]), 0.9))  # ends before the wall
    shell = joined([box(2.4), inward])  # walls with thickness: the sensor is in the cavity
    Scene([Surface(shell, "concrete")]).check_sensor(position)


def test_a_failed_save_leaves_no_files(tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(OutputError, match="file"):
        labelled_scene().save(tmp_path / "file" / "room")
    assert [p.name for p in tmp_path.iterdir()] == ["file"]
    labelled_scene().save(tmp_path / "room")
    (tmp_path / "room" / "scene.glb").unlink()
    with pytest.raises(MissingError, match=r"has no scene\.glb"):
        Scene.load(tmp_path / "room")


UNIT = objects.box([0, 0, 0], [1, 1, 1])
CAN = objects.cylinder(0.04, 0.1)


def wall(x=1.0):
    corners = np.array([[x, 0, 0], [x, 3, 0], [x, 3, 2.5], [x, 0, 2.5]])
    return trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], process=False)


OVERLAPS = {
    "a corner": (UNIT, objects.box([0.97, 0.2, 0.2], [2, 0.8, 0.8]), 0.03),
    "one inside the other": (UNIT, objects.box([0.4, 0.4, 0.4], [0.5, 0.5, 0.5]), 0.1),
    "through a board, no vertex inside": (CAN.copy().apply_translation([0.5, 0.5, 1]), objects.box([0, 0, 0.9875], [1, 1, 1.0125]), 0.025),
    "through a wall without thickness": (CAN.copy().apply_translation([1.01, 1, 1]), wall(), 0.03),
    "two spheres": (objects.sphere(0.1, 3), objects.sphere(0.1, 3).apply_translation([0.15, 0, 0]), 0.05),
    "a reflector in a box": (objects.trihedral(0.1).apply_translation([0.97, 0.5, 0.5]), UNIT, 0.03),
    "a reflector's tips in a rug": (objects.trihedral(0.1), objects.box([-1, -1, -0.05], [1, 1, -0.035]), 0.0058),
    "face to face": (UNIT, objects.box([1, 0, 0], [2, 1, 1]), 0.0),
    "a millimetre of contact": (UNIT, objects.box([0.999, 0.2, 0.2], [2, 0.8, 0.8]), 0.0),
    "boxes meet, meshes do not": (objects.sphere(0.1, 3), objects.sphere(0.1, 3).apply_translation([0.15, 0.15, 0.0]), 0.0),
}


@pytest.mark.parametrize(("a", "b", "depth"), OVERLAPS.values(), ids=OVERLAPS)
def test_overlap_is_the_shortest_side_of_the_common_box(a, b, depth):
    tolerance = 0.04 * depth + 1e-6  # the tolerance covers the facets of cans and spheres
    assert overlap_m(a, b) == pytest.approx(depth, abs=tolerance)
    assert overlap_m(b, a) == pytest.approx(depth, abs=tolerance)
