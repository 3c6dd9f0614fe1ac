"""Tests of scenes: refused input with its error messages, saving and loading, and allowed positions of the sensor."""

import numpy as np
import pytest
import trimesh

from radartwin.errors import MaterialError, MeshError, MissingError, OutputError, SceneError
from radartwin.materials import Layered
from radartwin.scene.objects import joined
from radartwin.scene.scene import Scene, Surface


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
    scene.save(tmp_path / "a")
    assert sorted(p.name for p in (tmp_path / "a").iterdir()) == ["manifest.json", "scene.glb"]


@pytest.mark.parametrize("part", ["scene.glb", "manifest.json"])
def test_either_file_of_the_folder_loads_the_scene(tmp_path, part):
    labelled_scene().save(tmp_path)
    assert Scene.load(tmp_path / part).names == ("target", "floor", "window", "")
    with pytest.raises(SceneError, match="has its own materials"):
        Scene.load(tmp_path / part, material="concrete")


DAMAGES = {  # {damage: (function that changes the manifest's text, exception, part of the message)}
    "not json": (lambda text: "{", SceneError, r"manifest\.json is not a radartwin-scene"),
    "another document": (lambda text: "[]", SceneError, r"manifest\.json is not a radartwin-scene"),
    "another format": (lambda text: text.replace("radartwin-scene", "other"), SceneError, r"manifest\.json is not a radartwin-scene"),
    "another geometry": (lambda text: text.replace('"sha256": "', '"sha256": "0'), SceneError, r"scene\.glb is not the geometry"),
    "an unknown material": (lambda text: text.replace('"metal"', '"unobtainium"'), MaterialError, "unobtainium"),
    "a surface without mesh": (lambda text: text.replace('"geometry": "s00000"', '"geometry": "s9"'), SceneError, "geometry 's9', which"),
}


@pytest.mark.parametrize(("change", "error", "words"), DAMAGES.values(), ids=DAMAGES)
def test_a_damaged_folder_is_refused_with_the_reason(tmp_path, change, error, words):
    labelled_scene().save(tmp_path)
    manifest = tmp_path / "manifest.json"
    manifest.write_text(change(manifest.read_text()))
    with pytest.raises(error, match=words):
        Scene.load(tmp_path)
    (tmp_path / "scene.glb").unlink()
    with pytest.raises(MissingError, match=r"has no scene\.glb"):
        Scene.load(tmp_path)


@pytest.mark.parametrize("suffix", [".glb", ".ply", ".obj"])
def test_a_plain_mesh_needs_one_material(tmp_path, suffix):
    path = tmp_path / f"room{suffix}"
    box(2.0).export(path)
    with pytest.raises(SceneError, match=r"carries no material labels.*--material NAME"):
        Scene.load(path)
    (surface,) = Scene.load(path, material="concrete")
    assert surface.material == "concrete"
    assert np.allclose(surface.mesh.bounds, [[-1, -1, -1], [1, 1, 1]])


NAN = (
    "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\nnan 0 0\n0 1 0\n3 0 1 2\n"
)
UNUSABLE = {  # {file: (content, message)}
    "broken.glb": ("glTF but not really", r"broken\.glb cannot be read"),
    "room.dwg": ("AC1032", r"room\.dwg"),
    "nan.ply": (NAN, r"nan\.ply.*NaN"),
    "points.obj": ("v 0 0 0\nv 1 0 0\nv 0 1 0\n", r"points\.obj"),
}


@pytest.mark.parametrize("name", UNUSABLE)
def test_missing_and_unusable_meshes_are_refused(tmp_path, name):
    content, message = UNUSABLE[name]
    with pytest.raises(MissingError, match=name):
        Scene.load(tmp_path / name, material="metal")
    (tmp_path / name).write_text(content)
    with pytest.raises(MeshError, match=message):
        Scene.load(tmp_path / name, material="metal")
    mesh = box()
    mesh.vertices[3, 1] = np.nan
    for wrong, words in ((mesh, r"'lid'.*1 of 8 vertices are NaN"), (trimesh.Trimesh(), "empty")):
        with pytest.raises(MeshError, match=words):
            Surface(wrong, "metal", "lid")


@pytest.mark.parametrize(("size", "hint"), [(6400.0, "millimetres"), (250.0, "centimetres"), (5e7, "convert the coordinates to metres")])
def test_an_extent_over_100_m_is_refused_with_a_hint_at_the_unit(size, hint):
    with pytest.raises(MeshError, match=f"over the limit of 100 m; .*{hint}"):
        Surface(box(size), "metal", "hall")
    Surface(box(100.0), "metal")


@pytest.mark.parametrize(
    ("kwargs", "error", "words"),
    [
        ({"material": "plasterbord"}, MaterialError, "plasterboard"),
        ({"roughness_m": -1e-3}, SceneError, "roughness_m"),
        ({"roughness_m": np.nan}, SceneError, "roughness_m"),
        ({"correlation_m": 0.0}, SceneError, "correlation_m"),
        ({"correlation_m": np.inf}, SceneError, "correlation_m"),
        ({"role": "furniture"}, SceneError, "auto, object or room"),
    ],
)
def test_invalid_fields_of_a_surface_are_refused(kwargs, error, words):
    with pytest.raises(error, match=words):
        Surface(box(), **{"material": "metal", **kwargs})


def test_size_determines_the_kind_unless_the_role_is_given():
    assert Surface(box(0.5), "metal").kind == "object"
    assert Surface(box(0.51), "metal").kind == "room"
    assert Surface(box(3.0), "metal", role="object").kind == "object"


def test_a_sensor_inside_a_solid_is_refused_and_inside_a_room_is_accepted():
    position = np.array([[5.0, 0, 0], [0.1, 0.2, 0.3]])
    solid = Scene([Surface(box(2.0), "concrete", "pillar")])
    with pytest.raises(SceneError, match="frame 1, is inside surface 'pillar'"):
        solid.check_sensor(position)
    solid.check_sensor(position[:1])

    inward = box(2.0)
    inward.invert()
    Scene([Surface(inward, "concrete", "room")]).check_sensor(position)
    open_room = box(2.0)
    open_room.update_faces(np.arange(len(open_room.faces)) > 1)
    Scene([Surface(open_room, "concrete")]).check_sensor(position)
    shell = joined([box(2.4), inward])  # walls with thickness: the sensor is in the cavity
    Scene([Surface(shell, "concrete")]).check_sensor(position)


def test_a_solid_with_doubled_vertices_stays_closed():
    soup = box(2.0)
    soup = trimesh.Trimesh(soup.vertices[soup.faces.reshape(-1)], np.arange(36).reshape(-1, 3), process=False)
    with pytest.raises(SceneError):
        Scene([Surface(soup, "metal")]).check_sensor(np.zeros(3))


def test_without_refuses_an_unknown_name():
    scene = labelled_scene()
    assert scene.without(["floor"]).names == ("target", "window", "")
    with pytest.raises(SceneError, match="no surface 'flor'"):
        scene.without(["flor"])


def test_a_failed_save_leaves_no_files(tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(OutputError, match="file"):
        labelled_scene().save(tmp_path / "file" / "room")
    assert [p.name for p in tmp_path.iterdir()] == ["file"]
    with pytest.raises(SceneError, match="nothing to save"):
        Scene([]).save(tmp_path / "empty")
    assert not (tmp_path / "empty").exists()
