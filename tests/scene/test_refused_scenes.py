"""Wrong input to the scene package is refused in one line. Each row is the error, a part of the message, and the call that is refused."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from test_layout import TABLE, furnished, placed, ramp, room, sheet, write_tin
from test_scene import box, labelled_scene, wall
from test_trajectory import TUM
from test_view import scene

from radartwin.errors import LayoutError, MaterialError, MeshError, MissingError, OutputError, PoseError, SceneError
from radartwin.scene import objects, rooms, textures
from radartwin.scene.collision import check_path
from radartwin.scene.layouts.anchor import find
from radartwin.scene.layouts.grammar import parse
from radartwin.scene.layouts.layout import Layout
from radartwin.scene.layouts.stock import stock
from radartwin.scene.objects import assortment, vessels
from radartwin.scene.scene import Scene, Surface
from radartwin.scene.trajectories import trajectory
from radartwin.scene.trajectories.file import parse_track, read_track
from radartwin.scene.viewer.page import view

Row = tuple[type[Exception], str, Callable[[Path], object]]


def of_file(error: type[Exception], name: str, content: str, message: str, read: Callable[[Path], object]) -> Row:  # named in the message
    def call(folder: Path) -> object:
        (folder / name).write_bytes(content.encode("latin-1"))
        return read(folder / name)

    return error, f"{re.escape(name)}.*(?:{message})", call


def of_manifest(error: type[Exception], message: str, change: Callable[[str], str]) -> Row:
    def call(folder: Path) -> object:
        manifest = labelled_scene().save(folder) / "manifest.json"
        manifest.write_text(change(manifest.read_text()))
        return Scene.load(folder)

    return error, message, call


def of_tin(error: type[Exception], message: str, entry: str) -> Row:
    return error, message, lambda folder: furnished(write_tin(folder), f"{entry}, on: {TABLE}")


def surface(**change: Any) -> Callable[[Path], object]:
    return lambda _: Surface(**{"mesh": box(), "material": "metal", "name": "lid"} | change)


def page(**change: Any) -> Callable[[Path], object]:
    return lambda folder: view(**{"scene": scene(), "path": folder / "page.html"} | change)


def metal(path: Path) -> object:
    return Scene.load(path, material="metal")


LAYOUTS = {
    "objects: [": "not YAML",
    "": "None is not of type 'object'",
    "objects: [{object: mug, colour: red}]": r"objects\[0\].*colour",
    "objects: [{object: mug, relations: [{relation: above, anchor: door}]}]": "above",
    "objects: [{object: mug, position_m: [1200, 300, 740]}]": "maximum of 100",
    "objects: [{object: mug}]": "has no place",
    "objects: [{object: mug, position_m: [1, 1], relations: [{relation: behind, anchor: door}]}]": "one of them",
    "objects: [{object: mug, on: table, position_m: [1, 1, 1]}]": "leave the height or on out",
    "objects: [{object: mug, on: table, held: true}]": "held",
}
SENTENCES = {
    "": "empty",
    "a mug": "gives no place",
    "on the table": "names no object",
    "two mugs on the table": "several",
    "a mug 1.5 in front of the door": "no unit",
    "a mug between the door and the window": "'a mug between the door' gives no place",
    "a mug on the table with a lid": "'table with a lid'",
    "a mug on the table on the floor": "two things",
    "a mug 1 m on the table": "'on' takes none",
    "a mug on": "not followed by a name",
    "a mug on it": "refers to no object",
    "is there a mug on the table": "not understood",
}
LINE = "0 0 0 0.4 0 0 0 1\n"
TRACKS = {  # a text that begins with "t," is a CSV file
    bytes(range(128, 256)).decode("latin-1"): "text",
    "t,x,y\n0,0,0\n": "lacks the column z, qx",
    "": "0 poses",
    LINE: "at least two",
    LINE + "1 0 0 x 0 0 0 1\n": "line 2: 8 numbers",
    LINE + "1 0 0 0 0 0 1\n": "line 2: 8 numbers",
    LINE + "1 0 nan 0 0 0 0 1\n": "line 2: NaN",
    LINE + "1 0 0 0 0 0 0 1\n1 1 0 0 0 0 0 1\n": "line 3: its time 1 s equals that of",
    LINE + "# between\n-1 0 0 0 0 0 0 1\n": "line 3: its time -1 s is earlier than",
    LINE + "1 0 0 0.4 0 0 0 2\n": "line 2: the quaternion has length 2",
    LINE + "1 0 0 0.4 0 0 0 0\n": "length 0",
    LINE + "500 900000 0 400 0 0 0 1\n": "convert the coordinates to metres",
    LINE + "1 200 0 0.4 0 0 0 1\n" + "2 0 0 0.4 0 0 0 1\n": "millimetres|metres",
    LINE + "100000000 0.1 0 0.4 0 0 0 1\n": "nanoseconds",
}
NAN = (
    "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
    "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\nnan 0 0\n0 1 0\n3 0 1 2\n"
)
NOT_FINITE = box()
NOT_FINITE.vertices[3, 1] = np.nan
START = trajectory.look_at([0.5, 1, 0.4], [9, 1, 0.4])
PATH = trajectory.depth_sweep(START, 1.2)
CRATE = Scene([Surface(objects.box([1, 0.5, 0], [1.5, 1.5, 1]), "wood", "crate")])
WALLS = Scene([Surface(wall(5.0), "concrete", "back"), Surface(wall(1.43), "concrete", "front")])
COUNTS: Any = (0, -1, 1.5)
JAR = {"kind": "jar", "name": "jam", "material": "glass", "contents": "", "width_mm": "80", "depth_mm": "80", "height_mm": "90"}
DOOR = [{"relation": "in front of", "anchor": "door", "distance_m": 2.0}]
LANDING = Surface(ramp(0).mesh + ramp(25).mesh.apply_translation([0.5, 0, 0]), "wood", "landing", role="room")
SCREEN = Surface(sheet([[1.5, 0.5, 0], [1.5, 1.5, 0], [1.5, 1.5, 1.8], [1.5, 0.5, 1.8]]), "wood", "screen", role="room")

ROWS: list[Row] = [
    (MeshError, "leg_m is 0", lambda _: objects.trihedral(0)),
    (MeshError, "height_m is -0.1", lambda _: objects.plate(0.1, -0.1)),
    (MeshError, "radius_m is nan", lambda _: objects.sphere(np.nan)),
    (MeshError, "revolution: give a profile", lambda _: objects.revolution([(0.1, 0.0)])),
    (MeshError, "radius >= 0", lambda _: objects.revolution([(-0.1, 0.0), (0.1, 0.1)])),
    (MeshError, "box: the corner", lambda _: objects.box([0, 0, 0], [1, 0, 1])),
    (MeshError, "oval: give at least two sections", lambda _: vessels.oval([(0, 1, 1, 2)])),
    (MeshError, "with rising z", lambda _: vessels.oval([(0, 1, 1, 2), (0, 1, 1, 2)])),
    (MeshError, "half width and depth must be positive", lambda _: vessels.oval([(0, 1, 1, 2), (1, -1, 1, 2)])),
    (MeshError, "the exponent at least 1", lambda _: vessels.oval([(0, 1, 1, 0.5), (1, 1, 1, 2)])),
    (SceneError, r"no object .mugg.; choose .*mug", lambda _: objects.make("mugg")),
    (SceneError, "jam is of the unknown kind 'jar'; choose canister, drink can, .*mug", lambda _: assortment._entry(JAR)),
    (SceneError, "no texture 'tweed'", lambda _: textures.textured(box(), "tweed")),
    (SceneError, "choose lab, atrium, squash_court", lambda _: rooms.room("attic")),
    (SceneError, "no option 'back'; it takes size_m, detail", lambda _: rooms.room("lab", back="glass")),
    (SceneError, "at least 10.0 x 8.0 x 3.5", lambda _: rooms.room("atrium", size_m=(3, 3, 3))),
    (SceneError, "2 numbers", lambda _: rooms.room("atrium", size_m=(12, 9))),
    (SceneError, "choose solid or glass", lambda _: rooms.room("squash_court", back="brick")),
    (SceneError, "choose shell, furnished", lambda _: rooms.room("squash_court", detail="messy")),
    (MaterialError, "plasterboard", surface(material="plasterbord")),
    (SceneError, "roughness_m is -0.001", surface(roughness_m=-1e-3)),
    (SceneError, "roughness_m is nan", surface(roughness_m=np.nan)),
    (SceneError, "correlation_m is 0.0", surface(correlation_m=0.0)),
    (SceneError, "correlation_m is inf", surface(correlation_m=np.inf)),
    (SceneError, "auto, object or room", surface(role="furniture")),
    (MeshError, r"'lid'.*1 of 8 vertices are NaN", surface(mesh=NOT_FINITE)),
    (MeshError, "empty", surface(mesh=trimesh.Trimesh())),
    (MeshError, "over the limit of 100 m; .*millimetres", surface(mesh=box(6400.0))),
    (MeshError, "over the limit of 100 m; .*centimetres", surface(mesh=box(250.0))),
    (MeshError, "over the limit of 100 m; .*convert the coordinates to metres", surface(mesh=box(5e7))),
    (SceneError, "no surface 'flor'", lambda _: labelled_scene().without(["flor"])),
    (SceneError, "nothing to save", lambda folder: Scene([]).save(folder / "empty")),
    (MissingError, r"room\.ply", lambda folder: metal(folder / "room.ply")),
    of_file(MeshError, "broken.glb", "glTF but not really", "cannot be read", metal),
    of_file(MeshError, "room.dwg", "AC1032", "not a supported mesh file", metal),
    of_file(MeshError, "nan.ply", NAN, "NaN", metal),
    of_file(MeshError, "points.obj", "v 0 0 0\nv 1 0 0\nv 0 1 0\n", "holds no triangles; give a mesh", metal),
    of_manifest(SceneError, r"manifest\.json is not a radartwin-scene", lambda text: "{"),
    of_manifest(SceneError, r"manifest\.json is not a radartwin-scene", lambda text: "[]"),
    of_manifest(SceneError, r"manifest\.json is not a radartwin-scene", lambda text: text.replace("radartwin-scene", "other")),
    of_manifest(SceneError, r"scene\.glb is not the geometry", lambda text: text.replace('"sha256": "', '"sha256": "0')),
    of_manifest(MaterialError, "unobtainium", lambda text: text.replace('"metal"', '"unobtainium"')),
    of_manifest(SceneError, "geometry 's9', which", lambda text: text.replace('"geometry": "s00000"', '"geometry": "s9"')),
    (SceneError, "frame 26, is inside surface 'crate'", lambda _: check_path(CRATE, trajectory.depth_sweep(START))),
    (PoseError, r"'front' between frames 46 and 47, near \(1\.42, 1\.00, 0\.40\) m", lambda _: check_path(WALLS, PATH)),
    (SceneError, "nothing to view", page(scene=Scene())),
    (SceneError, "material, segment, reflectivity, colour", page(by="colours")),
    (SceneError, "no colours of a scan", page(by="colour")),
    (PoseError, "4, 4", page(poses=np.eye(3))),
    (PoseError, "finite", page(poses=np.full((2, 4, 4), np.nan))),
    (
        OutputError,
        "does not end with .html; give the page a name such as page.html",
        lambda folder: page(path=folder / "page.json")(folder),
    ),
    (PoseError, "look_at: position and target are both", lambda _: trajectory.look_at([1, 1, 1], [1, 1, 1])),
    *((PoseError, f"{count} frames", lambda _, count=count: trajectory.static(np.eye(4), count)) for count in COUNTS),
    (PoseError, "holds 11 frames at 10 Hz, not 12", lambda _: parse_track(TUM, "run", csv=False).frames(10.0, 12)),
    *((PoseError, "covers 0 to 1 s", lambda _, at=at: parse_track(TUM, "run", csv=False).at(at)) for at in ([-0.1], [0.5, 1.2])),
    (PoseError, "optical", lambda _: parse_track(TUM, "run", csv=False).from_axes("camera")),  # type: ignore[arg-type]
    (MissingError, "TUM or CSV", lambda folder: read_track(folder / "none.txt")),
    *(of_file(PoseError, "run.csv" if text[:2] == "t," else "run.tum", text, word, read_track) for text, word in TRACKS.items()),
    *((LayoutError, f"{word}.*supported are 'OBJECT on THING'", lambda _, text=text: parse(text)) for text, word in SENTENCES.items()),
    (MissingError, "YAML", lambda folder: Layout.load(folder / "layout.yaml")),
    *(of_file(LayoutError, "layout.yaml", text, word, Layout.load) for text, word in LAYOUTS.items()),
    of_tin(LayoutError, r"objects\[0\] \(meshes/Tin.obj\) is a mesh, .* give material: NAME", "object: meshes/Tin.obj, unit: mm"),
    of_tin(MeshError, r"102 m long in unit=m; .*give unit=mm$", "object: meshes/Tin.obj, material: metal"),
    of_tin(LayoutError, r"objects\[0\]\.unit: 'furlong'", "object: meshes/Tin.obj, material: metal, unit: furlong"),
    of_tin(MaterialError, "unknown material 'cheese'", "object: meshes/Tin.obj, material: cheese, unit: mm"),
    of_tin(MissingError, r"meshes/gone\.obj is not there", "object: meshes/gone.obj, material: metal"),
    of_tin(LayoutError, r"objects\[0\] \(mug\) is of the catalogue, which defines its material", "object: mug, material: metal"),
    of_tin(LayoutError, r"objects\[0\]\.material", "object: meshes/Tin.obj, material: {layers: 3}"),
    of_tin(LayoutError, r"yaml: objects\[0\]\.material: .*thick", "object: meshes/Tin.obj, material: {layers: [[hdpe, thick]]}"),
    of_tin(LayoutError, r"yaml: objects\[0\]\.material: .*positive metres", "object: meshes/Tin.obj, material: {layers: [[hdpe, -1]]}"),
    of_tin(LayoutError, r"yaml: objects\[0\]\.material: .*'cheese'", "object: meshes/Tin.obj, material: {layers: [[cheese, 1]]}"),
    (LayoutError, r"no object is called 'teapot'.*corner_reflector", lambda _: stock("teapot")),
    (LayoutError, r"'can' may be can_211", lambda _: stock("can")),
    (LayoutError, "layout file", lambda _: parse("kindly see to it that a mug ends up somewhere on the desk")),
    (LayoutError, "nothing called 'sofa'; it has cabinet, ceiling", lambda _: find("sofa", room(), None)),
    (LayoutError, "no sensor pose", lambda _: find("the radar", room(), None)),
    (LayoutError, "no floor", lambda _: placed(Scene(), position_m=[1, 1])),
    (LayoutError, "table_left_top or on table_right_top", lambda _: placed(on="table")),
    (LayoutError, "'table' may be table_left_top or table_right_top", lambda _: placed(on="table", position_m=[2.5, 0.7])),
    (LayoutError, r"floats 0\.300 m above floor; put it at z = 0\.000", lambda _: placed(position_m=[1, 1, 0.3])),
    (LayoutError, "only 4[0-9]% of its base on table_left_top", lambda _: placed(position_m=[3.01, 0.7, 0.73])),
    (LayoutError, r"not over table_left_top, which lies at x 2\.00 to 3\.00", lambda _: placed(position_m=[1, 1], on="left table")),
    (LayoutError, r"0\.020 m beyond its \+x end", lambda _: placed(position_m=[3.98, 1, 0])),
    (LayoutError, "overlaps cabinet by 0.0[34]", lambda _: placed(position_m=[3.0, -1.75, 0.0])),
    (LayoutError, "no place for the mug behind door", lambda _: placed(relations=[{"relation": "behind", "anchor": "door"}])),
    # no position is within the width of both the door and the cabinet
    (LayoutError, "no place", lambda _: placed(relations=[*DOOR, {"relation": "in front of", "anchor": "cabinet", "distance_m": 1.5}])),
    (LayoutError, "'door' is in the scene already", lambda _: placed(position_m=[1, 1], name="door")),
    (LayoutError, "no level side", lambda _: placed(room(ramp(20)), on="ramp")),
    (
        LayoutError,
        r"landing is tilted by 25\.0 degrees at \(1\.7, 1\) m",
        lambda _: placed(room(LANDING), on="landing", position_m=[1.7, 1]),
    ),
    (LayoutError, r"overlaps screen by 0\.030 m", lambda _: placed(room(SCREEN), position_m=[1.51, 1, 0])),
    (LayoutError, r"ramp is tilted by 20\.0 degrees at \(1, 1\) m", lambda _: placed(room(ramp(20)), position_m=[1, 1, 0.51])),
]


@pytest.mark.parametrize(("error", "message", "call"), ROWS, ids=[message for _, message, _ in ROWS])
def test_wrong_input_is_refused_in_one_line(error, message, call, tmp_path):
    with pytest.raises(error, match=message) as caught:
        call(tmp_path)
    assert "\n" not in str(caught.value)
    assert not [path for path in tmp_path.rglob("*") if path.suffix == ".html" or path.name in ("empty", "page.json")]
