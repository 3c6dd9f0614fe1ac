"""Furniture layouts: objects by name and from mesh files, relations as geometry, and sentences read by the grammar."""

import time
from pathlib import Path

import numpy as np
import pytest
import trimesh

from radartwin.materials import Layered
from radartwin.scene import objects, rooms
from radartwin.scene.layouts.anchor import find
from radartwin.scene.layouts.grammar import parse
from radartwin.scene.layouts.layout import Layout
from radartwin.scene.layouts.place import GAP_M, furnish
from radartwin.scene.layouts.stock import stock
from radartwin.scene.rooms.parts import Shell
from radartwin.scene.scene import Scene, Surface
from radartwin.scene.trajectories.trajectory import look_at

SENSOR = look_at([0.5, 0, 0.4], [3, 0, 0.4])
THINGS = {
    "mug": objects.cylinder(0.04, 0.1),
    "can": objects.cylinder(0.033, 0.12),
    "crate": objects.box([-0.15, -0.15, -0.15], [0.15, 0.15, 0.15]),
    "ball": objects.sphere(0.1, 3),
}


def make(name):
    return [Surface(THINGS[name], "metal", name, role="object")]


def sheet(corners):
    return trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], process=False)


def room(*more):
    """Return a room of 4 x 4 x 2.5 m (x in 0..4, y in -2..2) with a door in the +x wall, two tables, and a cabinet at the -y wall."""
    shell = Shell(4, 4, 2.5)
    parts = {
        **{side: shell.wall(side) for side in ("floor", "ceiling", "wall_front", "wall_right")},
        "door": shell.filling("wall_front", (1.6, 0, 2.5, 2)),
        "table_left_top": objects.box([2, 0.2, 0.7], [3, 1.2, 0.73]),
        "table_left_legs": objects.joined(
            [objects.box([x, y, 0.01], [x + 0.04, y + 0.04, 0.69]) for x in (2.05, 2.9) for y in (0.25, 1.1)]
        ),
        "table_right_top": objects.box([1, -1.6, 0.7], [2, -0.9, 0.73]),
        "cabinet": objects.box([3, -1.99, 0.01], [3.8, -1.5, 1.8]),
    }
    return Scene([*(Surface(mesh, "wood", name, role="room") for name, mesh in parts.items()), *more])


def placed(scene=None, **item):
    """Return the bounds (2, 3) of a placed object, and the name of the surface on which the object stands."""
    layout = Layout.from_dict({"objects": [{"object": "mug"} | item]})
    surface = furnish(room() if scene is None else scene, layout, SENSOR, make).surfaces[-1]
    return surface.mesh.bounds, str(surface.provenance["layout"]).rpartition(" on ")[2]


def related(relation, anchor, distance_m=None, **item):
    return placed(relations=[{"relation": relation, "anchor": anchor, "distance_m": distance_m}], **item)


def middle(bounds):
    return bounds.mean(axis=0)[:2]


def test_anchors_are_found_by_words_and_parts_are_grouped():
    names = [a.name for a in find("the Left Table", room(), None)]
    assert names == ["table_left_legs and table_left_top"]
    assert [a.name for a in find("table_left_top", room(), None)] == ["table_left_top"]
    assert len(find("table", room(), None)) == 2


def test_relations_determine_the_place_with_distances_from_the_front_to_the_centre():
    bounds, on = related("in front of", "door", 1.5, on="table")
    assert on == "table_left_top"  # the other table is not in front of the door
    assert middle(bounds)[0] == pytest.approx(2.5)
    assert -0.5 <= middle(bounds)[1] <= 0.4
    assert bounds[0, 2] == pytest.approx(0.73 + GAP_M)
    assert np.allclose(middle(related("in front of", "radar", 1.0)[0]), [1.5, 0])
    assert middle(related("left of", "radar", 0.7)[0])[1] == pytest.approx(0.7)
    assert middle(related("right of", "door", 0.3)[0])[1] == pytest.approx(-0.8)
    assert middle(related("in front of", "cabinet", 0.5)[0])[1] == pytest.approx(-1.0)
    bounds, on = related("beside", "cabinet")
    assert on == "floor"
    assert 0.04 < max(3 - bounds[1, 0], bounds[0, 0] - 3.8) < 0.15
    bounds, on = related("under", "left table")
    assert on == "floor"
    assert np.allclose(middle(bounds), [2.5, 0.7], atol=0.03)


def test_objects_stand_on_and_beside_earlier_objects():
    layout = [
        {"object": "crate", "on": "table left"},
        {"object": "can", "on": "crate"},
        {"object": "mug", "relations": [{"relation": "beside", "anchor": "crate"}]},
        {"object": "mug", "on": "table left"},
    ]
    crate, can, mug, second = furnish(room(), Layout.from_dict({"objects": layout}), SENSOR, make).surfaces[-4:]
    assert can.mesh.bounds[0, 2] == pytest.approx(crate.mesh.bounds[1, 2] + GAP_M)
    assert mug.mesh.bounds[0, 2] == pytest.approx(0.73 + GAP_M)
    assert [s.name for s in (crate, can, mug, second)] == ["crate", "can", "mug", "mug_2"]
    assert "table_left_top" in str(second.provenance["layout"])  # the search places the second object where the table is free


def test_a_given_position_is_used_with_a_gap_to_the_support():
    bounds, on = placed(position_m=[2.5, 0.7, 0.73], yaw_deg=45)
    assert on == "table_left_top"
    assert np.allclose(bounds[0], [2.46, 0.66, 0.73 + GAP_M], atol=1e-6)
    assert placed(position_m=[2.5, 0.7, 0.742])[0][0, 2] == pytest.approx(0.742)
    assert placed(position_m=[1.0, 1.0])[1] == "floor"
    assert placed(position_m=[1, 1, 0.9], held=True)[0][0, 2] == pytest.approx(0.9)
    assert placed(Scene(), position_m=[1, 1, 0.9])[0][0, 2] == pytest.approx(0.9), "free space has no floor"
    assert placed(position_m=[1.5, -1.2], on="table right")[1] == "table_right_top"


def ramp(degrees):
    rotation = trimesh.transformations.rotation_matrix(np.radians(degrees), [0, 1, 0], [1, 1, 0.5])
    mesh = sheet([[0.6, 0.6, 0.5], [1.4, 0.6, 0.5], [1.4, 1.4, 0.5], [0.6, 1.4, 0.5]]).apply_transform(rotation)
    return Surface(mesh, "wood", "ramp", role="room")


def test_an_object_stands_upright_on_a_ramp_below_the_sliding_angle():
    bounds, on = placed(room(ramp(10)), on="ramp", position_m=[1, 1])
    assert on == "ramp"
    assert np.allclose(bounds[1] - bounds[0], [0.08, 0.08, 0.1], atol=1e-6)
    assert bounds[0, 2] == pytest.approx(0.5 + 0.04 * np.tan(np.radians(10)) + GAP_M)


def test_only_true_and_false_are_booleans_in_a_file(tmp_path):
    (tmp_path / "layout.yaml").write_text(
        "objects:\n"
        "  - {object: mug, name: on, on: off, position_m: [1, 1]}\n"
        "  - {object: mug, name: yes, held: true, position_m: [1, 1, 1]}\n"
        "  - {object: can, relations: [{relation: behind, anchor: no}]}\n"
    )
    first, second, third = Layout.load(tmp_path / "layout.yaml").items
    assert (first.name, first.on) == ("on", "off")
    assert (second.name, second.held) == ("yes", True)
    assert third.relations[0].anchor == "no"


def test_objects_stand_on_top_of_flat_covers():
    rug = Surface(objects.box([1.2, 0.5, 0.01], [1.9, 1.5, 0.022]), "wood", "rug", role="room")
    bounds, on = placed(room(rug), position_m=[1.5, 1.0])
    assert on == "floor"
    assert bounds[0, 2] == pytest.approx(0.022 + GAP_M)
    thin = Surface(objects.box([1.45, 0.5, 0.005], [1.46, 1.5, 0.012]), "wood", "cable", role="room")  # between a reflector's tips
    layout = Layout.from_dict({"objects": [{"object": "corner_reflector", "position_m": [1.5, 1.0], "yaw_deg": 90}]})
    reflector = furnish(room(thin), layout).surfaces[-1]
    assert reflector.mesh.bounds[0, 2] > GAP_M


def test_all_parts_of_a_catalogue_object_are_placed():
    items = [{"object": "mug", "on": "left table"}, {"object": "corner reflector", "position_m": [1.0, 1.0]}]
    added = furnish(room(), Layout.from_dict({"objects": items})).surfaces[len(room()) :]
    for name, base in (("mug", 0.73), ("corner_reflector", 0.0)):
        parts = [s for s in added if s.name == name]
        assert len(parts) == len(stock(name))
        assert min(s.mesh.bounds[0, 2] for s in parts) == pytest.approx(base + GAP_M, abs=1e-6)
        assert all(s.provenance["layout"] and s.provenance["object"] == name for s in parts)


MUG = {"object": "mug"}


def at(relation, anchor, distance_m=None):
    return {"relation": relation, "anchor": anchor} | ({} if distance_m is None else {"distance_m": distance_m})


READ = {
    "a mug on the table 1.5 m in front of the door": [MUG | {"on": "table", "relations": [at("in front of", "door", 1.5)]}],
    "Put the mug 30 cm to the left of the radar.": [MUG | {"relations": [at("left of", "radar", 0.3)]}],
    "a mug half a metre behind the sofa": [MUG | {"relations": [at("behind", "sofa", 0.5)]}],
    "a mug one and a half metres in front of the sensor": [MUG | {"relations": [at("in front of", "sensor", 1.5)]}],
    "mug 1,2m in front of the left table": [MUG | {"relations": [at("in front of", "left table", 1.2)]}],
    "a mug next to the shelf, and a can under the table": [
        MUG | {"relations": [at("beside", "shelf")]},
        {"object": "can", "relations": [at("under", "table")]},
    ],
    "a mug on the table and 1 m in front of the door": [MUG | {"on": "table", "relations": [at("in front of", "door", 1.0)]}],
    "a box on the floor. a can on it and a mug beside it": [
        {"object": "box", "name": "box", "on": "floor"},
        {"object": "can", "name": "can", "on": "box"},
        MUG | {"relations": [at("beside", "can")]},
    ],
    "the can_355 on table 2 turned by 45 degrees": [{"object": "can_355", "on": "table 2", "yaw_deg": 45.0}],
    "a can_211_300 on the desk": [{"object": "can_211_300", "on": "desk"}],
    "a corner reflector 2 m in front of the radar 500 mm right of the cabinet": [
        {"object": "corner reflector", "relations": [at("in front of", "radar", 2.0), at("right of", "cabinet", 0.5)]}
    ],
}


@pytest.mark.parametrize(("sentence", "layout"), READ.items(), ids=READ)
def test_a_simple_sentence_is_read(sentence, layout):
    assert parse(sentence) == Layout.from_dict({"objects": layout})


TABLE = "table_left_top"


def write_tin(folder: Path) -> Path:
    """Write a tin of 68 x 102 mm in millimetres, with y up and away from its origin, into a subfolder of the layout's folder."""
    (folder / "meshes").mkdir()
    lying = trimesh.transformations.rotation_matrix(-np.pi / 2, [1, 0, 0])
    objects.cylinder(34, 102).apply_transform(lying).apply_translation([50, 60, 70]).export(folder / "meshes" / "Tin.obj")
    return folder


def furnished(folder: Path, entry: str) -> Scene:
    (folder / "layout.yaml").write_text(f"objects:\n  - {{{entry}}}\n  - {{object: mug, on: {TABLE}, position_m: [4.3, 1.9]}}\n")
    return furnish(rooms.lab(detail="furnished"), Layout.load(folder / "layout.yaml"))


def test_a_mesh_is_placed_on_a_table_beside_a_catalogue_object(tmp_path, monkeypatch):
    monkeypatch.chdir("/")  # the path is from the layout's folder
    entry = f"object: meshes/Tin.obj, material: metal, unit: mm, up: y, on: {TABLE}, position_m: [4.3, 1.2]"
    scene = furnished(write_tin(tmp_path), entry)
    tin = next(s for s in scene if s.name == "tin")
    top = next(s for s in scene if s.name == TABLE).mesh.bounds[1, 2]
    assert np.allclose(tin.mesh.bounds, [[4.266, 1.166, top + GAP_M], [4.334, 1.234, top + GAP_M + 0.102]], atol=1e-5)
    assert (tin.material, tin.kind) == ("metal", "object")
    assert (tin.provenance["layout"], tin.provenance["file"]) == (f"Tin.obj on {TABLE}", "Tin.obj")
    assert "mug" in scene.names
    stack = "material: {layers: [[hdpe, 0.001]], backing: water}"
    scene = furnished(tmp_path, f"object: meshes/Tin.obj, {stack}, unit: mm, up: y, on: {TABLE}, name: jug")
    assert next(s for s in scene if s.name == "jug").material == Layered([("hdpe", 0.001)], backing="water")


def test_a_place_beside_a_fine_mesh_is_found_quickly(tmp_path):
    """A test whether a point is inside a mesh of 20,000 faces takes a second, so the search tries positions beside the mesh first."""
    objects.sphere(0.05, 5).apply_translation([0, 0, 0.05]).export(tmp_path / "ball.ply")
    entries = f"[{{object: ball.ply, material: metal, on: {TABLE}}}, {{object: mug, on: {TABLE}}}]"
    (tmp_path / "layout.yaml").write_text(f"objects: {entries}\n")
    start = time.process_time()
    scene = furnish(rooms.lab(), Layout.load(tmp_path / "layout.yaml"))
    ball = next(s for s in scene if s.name == "ball").mesh.bounds
    mug = np.array([s.mesh.bounds for s in scene if s.name == "mug"])
    apart = np.maximum(ball[0] - mug[:, 1].max(axis=0), mug[:, 0].min(axis=0) - ball[1])[:2].max()
    assert 0 <= apart < 0.3
    assert time.process_time() - start < 20
