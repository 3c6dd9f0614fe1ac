"""Mesh files of scans: units, axes and defects, the files of ../shared/field, and a hall with other numbers that this file writes."""

import io
import struct
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from made_files import glb
from PIL import Image

from radartwin.builders.trajectory import build_course, build_start
from radartwin.config.trajectory import FileTrajectory, StaticTrajectory
from radartwin.errors import PoseError
from radartwin.radar.chirp import Radar
from radartwin.reconstruct.build import reconstruct
from radartwin.reconstruct.scan_file import ScanWarning, load_scan
from radartwin.scene.mesh_file import MeshWarning, read_meshes
from radartwin.scene.scene import Scene, Surface


def room(length=6.0, width=5.0, height=2.8):
    mesh = trimesh.creation.box((length, width, height))
    mesh.invert()
    return mesh


def write_obj(path, vertices, faces):
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in vertices] + [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in faces]
    path.write_text("\n".join(lines) + "\n")
    return path


def in_frame(vertices, up):
    """Return z-up coordinates as they are in a file with another up axis, with the same handedness."""
    x, y, z = vertices.T if up[0] != "-" else (np.diag([1, -1, -1]) @ vertices.T)
    return {"z": np.stack([x, y, z], 1), "y": np.stack([x, z, -y], 1), "x": np.stack([z, x, y], 1)}[up[-1]]


@pytest.mark.parametrize(("up", "suffix"), [("x", ".glb"), ("y", ".ply"), ("z", ".obj"), ("-x", ".stl"), ("-y", ".glb"), ("-z", ".ply")])
def test_up_axis_is_found_or_given_and_handedness_kept(tmp_path, up, suffix):
    mesh = room()
    path = tmp_path / f"room{suffix}"
    trimesh.Trimesh(in_frame(mesh.vertices, up), mesh.faces, process=False).export(path)
    loaded, report = load_scan(path, up=up)
    assert (report.up, report.up_from) == (up, "as given")
    guess = load_scan(path)[1]  # a negative axis is not found, because a room has as much floor as ceiling
    assert (guess.up, guess.up_from) == (up[-1], "found from the horizontal area")
    assert np.allclose(loaded.bounds, mesh.bounds, atol=1e-6)
    floor = loaded.triangles_center[:, 2] < loaded.bounds[0, 2] + 0.01
    assert (loaded.face_normals[floor, 2] > 0.99).all()
    assert loaded.volume == pytest.approx(-6.0 * 5.0 * 2.8)
    assert (report.watertight, report.components) == (True, 1)
    assert (report.degenerate_faces, report.duplicate_faces, report.non_manifold_edges, report.boundary_edges) == (0,) * 4
    assert report.area_m2 == pytest.approx(2 * (30 + 16.8 + 14))


def test_a_cube_in_a_glb_has_the_up_axis_of_gltf(tmp_path):
    mesh = room(3, 3, 3).apply_translation([0, 0, 1.5])
    trimesh.Trimesh(in_frame(mesh.vertices, "y"), mesh.faces, process=False).export(tmp_path / "cube.glb")
    loaded, report = load_scan(tmp_path / "cube.glb")
    assert np.allclose(loaded.vertices, mesh.vertices, atol=1e-6)
    assert any("up axis y (glTF 2.0 defines +Y as up" in line for line in report.lines())


def test_objects_show_their_outside_and_rooms_their_inside(tmp_path):
    can, shell = trimesh.creation.cylinder(0.04, 0.12), trimesh.creation.box((6.0, 5.0, 2.8))
    for name, mesh, sign in (("can", can, 1), ("shell", shell, -1)):
        for turned in (False, True):
            if turned:
                mesh.invert()
            path = write_obj(tmp_path / f"{name}{turned}.obj", mesh.vertices, mesh.faces)
            loaded, report = load_scan(path, up="z")
            assert np.sign(loaded.volume) == sign
            assert report.turned == (np.sign(mesh.volume) != sign)
            assert any("turned" in line for line in report.lines()) == report.turned
            assert report.is_object == (name == "can")
    cabinet = write_obj(tmp_path / "cabinet.obj", *(lambda m: (m.vertices, m.faces))(trimesh.creation.box((2, 1, 0.6))))
    assert load_scan(cabinet, up="z", is_object=True)[0].volume > 0
    assert load_scan(cabinet, up="z")[0].volume < 0


@pytest.mark.parametrize(("unit", "metres"), [("mm", 1e-3), ("cm", 1e-2), ("ft", 0.3048), ("in", 0.0254), ("m", 1.0)])
def test_units_are_converted_when_given(tmp_path, unit, metres):
    mesh = room()
    path = write_obj(tmp_path / "room.obj", mesh.vertices / metres, mesh.faces)
    loaded, report = load_scan(path, unit=unit)
    assert report.unit == unit
    assert np.allclose([report.extents_m, loaded.extents], (6.0, 5.0, 2.8))
    if unit == "ft":
        size = r"is 19\.7 x 16\.4 x 9\.2 m, large for a room; check --unit; --unit ft would make it 6\.0 x 5\.0 x 2\.8 m"
        with pytest.warns(ScanWarning, match=size):
            load_scan(path)
        load_scan(path, unit="m")  # RadarTwin accepts the unit that the user states


def test_defects_are_counted_and_degenerate_and_duplicate_faces_removed(tmp_path):
    mesh = room()
    vertices = np.vstack([mesh.vertices, [[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 0, 1.0]], mesh.vertices[:1]])
    twin = 12  # the last vertex repeats the first: a seam
    fin = [0, 1, 11] if mesh.edges_sorted.tolist().count([0, 1]) == 2 else [0, 2, 11]
    # a face with another first corner, one with the opposite normal, collinear corners, equal corners, and a third face on an edge
    faces = np.vstack([mesh.faces, mesh.faces[3][[1, 2, 0]], mesh.faces[5][::-1], [[8, 9, 10]], [[8, 8, 9]], [fin]])
    faces[0] = np.where(faces[0] == 0, twin, faces[0])
    loaded, report = load_scan(write_obj(tmp_path / "bad.obj", vertices, faces), up="z")
    assert (report.vertices, report.faces, report.duplicate_faces, report.degenerate_faces) == (13, 17, 2, 2)
    assert (report.non_manifold_edges, report.boundary_edges, report.watertight) == (1, 2, False)  # the two free edges of the third face
    assert len(loaded.faces) == 13
    assert any("2 degenerate and 2 duplicate" in line for line in report.lines())


FIELD = Path(__file__).resolve().parents[3] / "shared" / "field"
# area in m2 of the rooms of 4.00 x 3.00 x 2.50 m
READ = {
    **dict.fromkeys([f"geo/{name}.obj" for name in ("o0", "t2", "o1e4", "o1e5", "o5e5", "m1", "m2", "utm")], 59.0),
    **dict.fromkeys([f"objtex_min/{name}.obj" for name in ("good", "unused_vertex")], 59.0),
    **dict.fromkeys([f"mesh2/{name}.ply" for name in ("mixed", "mixed_tri_first", "mixed_ascii", "quads")], 59.0),
    **dict.fromkeys([f"mesh2/{name}.glb" for name in ("sparse", "ktx2", "strips", "noindex")], 59.0),
    **dict.fromkeys([f"mesh2/{name}" for name in ("concave.obj", "relative.obj", "lines.obj", "bigendian_poly.ply")], 55.0),
    **dict.fromkeys([f"mesh2/{name}.obj" for name in ("doorway", "doorway_tri")], 57.2),
    **dict.fromkeys([f"mesh/{name}.glb" for name in ("plain", "stride", "negscale", "twoscenes", "quant_int", "quant_norm")], 60.87),
    **dict.fromkeys(["mesh/georef.obj", "mesh/quant_int8.glb", "mesh/draco.glb"], 60.87),
}  # fmt: skip
LEFT_OUT = {"mesh2/ktx2.glb": "without its KTX2 pictures, which RadarTwin cannot read", "mesh2/lines.obj": "without 2 lines and 1 point"}


def field(name):
    if not FIELD.is_dir():
        pytest.skip(f"{FIELD} is not here: the meshes of other people are not part of the repository")
    return FIELD / name


def loaded(path, up):
    """Return the scan, its report, and the lines that say what the reader left out."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        mesh, report = load_scan(path, "m", up)
    assert all(issubclass(w.category, MeshWarning) for w in caught)
    return mesh, report, [str(w.message) for w in caught]


@pytest.mark.parametrize("name", READ)
def test_a_scan_as_people_have_it_is_read(name):
    mesh, report, said = loaded(field(name), "y" if name.endswith("glb") else "z")
    tolerance = 0.02 if "int8" in name else 2e-3  # a step of eight bits is 16 mm
    assert sorted(report.extents_m) == pytest.approx([2.5, 3.0, 4.0], abs=tolerance)
    assert report.area_m2 == pytest.approx(READ[name], abs=30 * tolerance)
    assert np.abs(mesh.bounds).max() < 13  # single precision has steps of at most 1 um there
    assert [LEFT_OUT[name] in line for line in said] == [True] * (name in LEFT_OUT)
    if name.startswith("objtex"):
        visual: Any = mesh.visual
        assert np.unique(visual.vertex_colors, axis=0).tolist() == [[220, 30, 30, 255]]


def test_partly_compressed_scans_are_read_whole_and_survey_coordinates_kept_in_a_saved_scene(tmp_path):
    assert loaded(field("mesh/draco_part.glb"), "y")[1].area_m2 == pytest.approx(2 * 60.87, abs=0.06)
    reconstruct(field("geo/utm.obj"), tmp_path / "utm")
    room = Scene.load(tmp_path / "utm")
    assert room.provenance["offset_m"] == [452317, 5411893, 114]
    for axis, walls in enumerate(([452315.4, 452319.4], [5411891.6, 5411894.6], [113.2, 115.7])):
        planes = [s.mesh.vertices[:, axis].mean() for s in room if np.abs(s.mesh.face_normals[0, axis]) > 0.99]
        assert np.sort(planes) + room.provenance["offset_m"][axis] == pytest.approx(walls, abs=1e-3)


# The second set: a U-shaped hall of other sizes, written by code that shares nothing with the reader.

CORNERS = np.array([[0, 0], [7, 0], [7, 5.5], [4.5, 5.5], [4.5, 1.75], [2, 1.75], [2, 5.5], [0, 5.5]])
HEIGHT = 3.1
POINTS = np.concatenate([np.column_stack([CORNERS, np.full(8, z)]) for z in (0, HEIGHT)]).astype("<f4")
WALLS = [[k, (k + 1) % 8, (k + 1) % 8 + 8, k + 8] for k in range(8)]
POLYGONS = [list(range(8))[::-1], list(range(8, 16)), *WALLS]
FLOOR_M2 = 7 * 5.5 - 2.5 * 3.75
HALL_M2 = 2 * FLOOR_M2 + HEIGHT * (7 + 7 + 5.5 * 2 + 3.75 * 2)
CUT = np.array([(0, 1, 4), (0, 4, 5), (0, 5, 7), (5, 6, 7), (1, 2, 3), (1, 3, 4)])  # the floor cut by hand, for formats without polygons
TRIANGLES = np.concatenate([CUT[:, ::-1], CUT + 8, *[[[a, b, c], [a, c, d]] for a, b, c, d in WALLS]]).astype("<u4")
SURVEY = (-731204.25, 88.5, 4_900_311.5)


def as_obj(path, shift=(0, 0, 0), relative=False):
    """Write a face right after its corners, which `relative` counts backwards from the face."""
    lines, count = [], 0
    for polygon in POLYGONS:
        lines += [f"v {x:.4f} {y:.4f} {z:.4f}" for x, y, z in POINTS[polygon] + np.array(shift)]
        lines.append("f " + " ".join(str(k - len(polygon) if relative else count + k + 1) for k in range(len(polygon))))
        count += len(polygon)
    path.write_text("\n".join(lines) + "\n")


def as_ply(path, order):
    columns = ["uchar red", "uchar green", "uchar blue", "list ushort uint vertex_indices", "float quality"]
    lines = ["ply", f"format binary_{'big' if order == '>' else 'little'}_endian 1.0", "element vertex 16"]
    lines += [f"property double {axis}" for axis in "xyz"] + [f"element face {len(POLYGONS)}", *(f"property {c}" for c in columns)]
    lines += ["element edge 1", "property int vertex1", "property int vertex2", "end_header\n"]
    faces = [struct.pack(f"{order}3BH{len(p)}If", 20 * k, 7, 9, len(p), *p, 0.5) for k, p in enumerate(POLYGONS)]
    path.write_bytes("\n".join(lines).encode() + POINTS.astype(order + "f8").tobytes() + b"".join(faces) + struct.pack(order + "2i", 0, 1))


CODES = {"int8": 5120, "uint8": 5121, "int16": 5122, "uint16": 5123, "uint32": 5125, "float32": 5126}
TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3"}


def write_glb(path, arrays, primitive=None, node=None, changes=None, **more):
    """Write a .glb of one mesh. Each array has a buffer view and an accessor; rows of vertices begin at multiples of four bytes."""
    views, binary, stored = [], b"", []
    for k, array in enumerate(arrays):
        rows = [row.tobytes() + bytes(-row.nbytes % 4) for row in array] if array.ndim == 2 else [array.tobytes()]
        stride = {"byteStride": len(rows[0])} if array.ndim == 2 else {}
        views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": sum(map(len, rows)), **stride})
        binary += b"".join(rows) + bytes(-sum(map(len, rows)) % 4)
        width = array.shape[1] if array.ndim == 2 else 1
        stored.append({"bufferView": k, "componentType": CODES[array.dtype.name], "count": len(array), "type": TYPES[width]})
    for number, change in (changes or {}).items():
        stored[number] |= change
    meshes = [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1} | (primitive or {})]}]
    scene = {"scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"mesh": 0} | (node or {})], "meshes": meshes, "accessors": stored}
    parts = {"asset": {"version": "2.0"}, "bufferViews": views, "buffers": [{"byteLength": len(binary)}]}
    path.write_bytes(glb(parts | scene | more, binary))


def quantised(kind, normalised):
    """Return a writer of integer coordinates, with the node that converts them back to metres."""
    top = np.iinfo(kind).max
    step_m = 7 if normalised else 7 / top
    node = {"scale": [step_m] * 3, "translation": [31, -2.5, 4]}
    arrays = [np.rint(POINTS / 7 * top).astype(kind), TRIANGLES.ravel()]
    names = {"extensionsUsed": ["KHR_mesh_quantization"], "extensionsRequired": ["KHR_mesh_quantization"]}
    return lambda path: write_glb(path, arrays, None, node, {0: {"normalized": normalised}}, **names)


def as_sparse(path):
    """Write a base with wrong upper corners, which the sparse part replaces."""
    base = POINTS + np.repeat([0, 40], 8).astype("<f4")[:, None]
    sparse = {"count": 8, "indices": {"bufferView": 2, "componentType": 5121}, "values": {"bufferView": 3}}
    write_glb(path, [base, TRIANGLES.ravel(), np.arange(8, 16, dtype="u1"), POINTS[8:]], changes={0: {"sparse": sparse}})


def as_draco(path):
    import DracoPy

    blob = np.frombuffer(DracoPy.encode(POINTS, TRIANGLES, quantization_bits=16, preserve_order=True), "u1")
    extension = {"KHR_draco_mesh_compression": {"bufferView": 0, "attributes": {"POSITION": 0}}}
    empty = [{"componentType": 5126, "count": 16, "type": "VEC3"}, {"componentType": 5125, "count": TRIANGLES.size, "type": "SCALAR"}]
    document = {"accessors": empty, "extensionsRequired": [*extension], "bufferViews": [{"buffer": 0, "byteLength": len(blob)}]}
    write_glb(path, [blob], {"extensions": extension}, **document)


HALLS = {
    "polygons.obj": as_obj,
    "relative.obj": lambda path: as_obj(path, relative=True),
    "survey.obj": lambda path: as_obj(path, SURVEY),
    "little.ply": lambda path: as_ply(path, "<"),
    "big.ply": lambda path: as_ply(path, ">"),
    **{f"{kind} {norm}.glb": quantised(kind, norm) for kind in ("int8", "uint8", "int16", "uint16") for norm in (False, True)},
    "sparse.glb": as_sparse,
    "draco.glb": as_draco,
}


@pytest.mark.parametrize("name", HALLS)
def test_a_hall_with_other_numbers_is_read(name, tmp_path):
    HALLS[name](tmp_path / name)
    mesh, report, said = loaded(tmp_path / name, "z")
    tolerance = 0.03 if "int8" in name else 1e-3
    assert report.extents_m == pytest.approx([7, 5.5, HEIGHT], abs=tolerance)
    assert report.area_m2 == pytest.approx(HALL_M2, abs=30 * tolerance)
    assert (report.watertight, report.turned) == (True, True)
    low = mesh.triangles_center[:, 2] < mesh.bounds[0, 2] + 0.1
    assert mesh.area_faces[low].sum() == pytest.approx(FLOOR_M2, abs=10 * tolerance)
    corner = SURVEY if name == "survey.obj" else (31, -2.5, 4) if "int" in name else (0, 0, 0)
    assert mesh.bounds[0] + report.offset_m == pytest.approx(corner, abs=tolerance)
    assert [line.endswith("is read without 1 row of edge") for line in said] == [True] * name.endswith("ply")


def test_fans_are_read_and_deformed_and_hidden_parts_named(tmp_path):
    write_glb(tmp_path / "fan.glb", [POINTS[[0, 1, 2, 7]], np.arange(4, dtype="u1")], {"mode": 6})
    assert next(iter(read_meshes(tmp_path / "fan.glb").values())).area == pytest.approx(38.5)
    write_glb(tmp_path / "a.glb", HALL, {"targets": [{"POSITION": 0}]}, extensionsUsed=["KHR_node_visibility"])
    with pytest.warns(MeshWarning, match=r"morph targets.*KHR_node_visibility"):
        read_meshes(tmp_path / "a.glb")


RED, GREEN, BLUE = (200, 0, 0), (0, 200, 0), (0, 0, 200)


def picture(file, left, right):
    image = np.zeros((4, 4, 3), np.uint8)
    image[:, :2], image[:, 2:] = left, right
    Image.fromarray(image).save(file, "PNG")


def shown_m2(path):
    """Return the area of the faces in each colour, after checking that each face has one colour."""
    areas: dict[tuple[int, ...], float] = {}
    for mesh in read_meshes(path).values():
        visual: Any = mesh.visual
        corners = visual.to_color().vertex_colors[mesh.faces]
        assert (corners == corners[:, :1]).all()
        for colour, area in zip(corners[:, 0, :3].tolist(), mesh.area_faces, strict=True):
            areas[tuple(colour)] = areas.get(tuple(colour), 0) + float(area)
    return areas


def test_faces_keep_the_colours_of_two_pictures_and_at_a_seam(tmp_path):
    picture(tmp_path / "first page.png", RED, GREEN)
    picture(tmp_path / "second.png", BLUE, BLUE)
    (tmp_path / "a.mtl").write_text("newmtl one\nmap_Kd first page.png\nnewmtl two\nmap_Kd -clamp on -s 1 1 1 second.png\n")
    corners = [(9, 9, 9), (0, 0, 0), (3, 0, 0), (3, 2, 0), (0, 2, 0), (4, 0, 0), (4, 2, 0), (8, 8, 8), (3, 0, 1.5), (3, 2, 1.5)]
    lines = ["mtllib a.mtl", *(f"v {x} {y} {z}" for x, y, z in corners), "vt 0.2 0.5", "vt 0.8 0.5"]
    lines += ["usemtl one", "f 2/1 3/1 4/1 5/1", "f 3/2 6/2 7/2 4/2", "usemtl two", "f 3/1 4/1 10/1 9/1"]
    (tmp_path / "a.obj").write_text("\n".join(lines) + "\n")
    assert shown_m2(tmp_path / "a.obj") == pytest.approx({RED: 6, GREEN: 2, BLUE: 3})


def test_normals_continue_across_the_seam_of_a_picture(tmp_path):
    picture(tmp_path / "a.png", RED, GREEN)
    (tmp_path / "a.mtl").write_text("newmtl m\nmap_Kd a.png\n")
    angles = 2 * np.pi * np.arange(36) / 36
    lines = ["mtllib a.mtl", *(f"v {np.cos(t):.6f} {np.sin(t):.6f} {z}" for z in (0, 2) for t in angles)]
    lines += [*(f"vt {k / 36:.6f} {v}" for v in (0, 1) for k in range(37)), "usemtl m"]
    lines += [f"f {k + 1}/{k + 1} {(k + 1) % 36 + 1}/{k + 2} {(k + 1) % 36 + 37}/{k + 39} {k + 37}/{k + 38}" for k in range(36)]
    (tmp_path / "a.obj").write_text("\n".join(lines) + "\n")
    (mesh,) = read_meshes(tmp_path / "a.obj").values()
    assert len(mesh.vertices) == 74
    assert np.einsum("ki,ki->k", mesh.vertex_normals[:, :2], mesh.vertices[:, :2]).min() > 0.9999


def test_normalised_texture_coordinates_find_their_colours(tmp_path):
    picture(stream := io.BytesIO(), RED, GREEN)
    points = np.array([[0, 0, 0], [3, 0, 0], [3, 2, 0], [0, 2, 0], [3, 0, 0], [4, 0, 0], [4, 2, 0], [3, 2, 0]], "<f4")
    index = np.array([0, 1, 2, 0, 2, 3, 4, 5, 6, 4, 6, 7], "<u2")
    across = np.column_stack([np.repeat([13107, 52428], 4), np.full(8, 32768)]).astype("<u2")  # 0.2 and 0.8 of 65535
    looks = {"materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}], "textures": [{"source": 0}]}
    looks["images"] = [{"bufferView": 3, "mimeType": "image/png"}]
    primitive = {"attributes": {"POSITION": 0, "TEXCOORD_0": 2}, "material": 0}
    arrays = [points, index, across, np.frombuffer(stream.getvalue(), np.uint8)]
    write_glb(tmp_path / "a.glb", arrays, primitive, changes={2: {"normalized": True}}, **looks)
    assert shown_m2(tmp_path / "a.glb") == pytest.approx({RED: 6, GREEN: 2})
    visual: Any = load_scan(tmp_path / "a.glb", up="z")[0].visual
    assert np.unique(visual.vertex_colors[:, :3], axis=0).tolist() == [list(GREEN), list(RED)]


HALL = [POINTS, TRIANGLES.ravel()]


# Poses in the coordinates of the scan.

ROOM = Scene([Surface(trimesh.creation.box((6, 4, 3)), "wood", "room")], {"offset_m": [-80_300.0, 0.0, 512.0]})
PLACES = np.array([[-1, 0.5, 0.25], [-0.98, 0.5, 0.25], [-0.96, 0.5, 0.25]])


def course(path, positions):
    path.write_text("".join(f"{k / 10} {x} {y} {z} 0 0 0 1\n" for k, (x, y, z) in enumerate(positions)))
    return build_course(FileTrajectory(path=str(path)), Radar.iwr1843(), ROOM)


@pytest.mark.parametrize("shift", [(0, 0, 0), (-80_300, 0, 512)])
def test_a_track_is_read_in_the_coordinates_of_the_room_and_of_the_scan(shift, tmp_path):
    assert course(tmp_path / "a.txt", PLACES + shift).sensor_poses[:, :3, 3] == pytest.approx(PLACES, abs=1e-6)
    start = build_start(StaticTrajectory(position_m=(PLACES[0] + shift).tolist()), ROOM)
    assert start[:3, 3] == pytest.approx(PLACES[0], abs=1e-6)


def test_a_track_far_from_the_room_is_refused_with_both_positions(tmp_path):
    message = r"a\.txt: \(-80301\.00, 700\.50, 512\.25\) m is 698 m from the room at \(-80300\.00, 0\.00, 512\.00\) m"
    with pytest.raises(PoseError, match=message):
        course(tmp_path / "a.txt", PLACES + np.array([-80_300, 700, 512]))
