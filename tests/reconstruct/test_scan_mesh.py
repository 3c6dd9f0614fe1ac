"""Read mesh files of scans: units and axes are converted or refused, and the number of mesh defects is reported, for meshes with known
defects.
"""

import numpy as np
import pytest
import trimesh

from radartwin.reconstruct.scan_file import ScanWarning, load_scan


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


@pytest.mark.parametrize("up", ["x", "y", "z", "-x", "-y", "-z"])
@pytest.mark.parametrize("suffix", [".glb", ".ply", ".obj", ".stl"])
def test_up_axis_is_found_or_given_and_handedness_kept(tmp_path, up, suffix):
    mesh = room()
    path = tmp_path / f"room{suffix}"
    trimesh.Trimesh(in_frame(mesh.vertices, up), mesh.faces, process=False).export(path)
    loaded, report = load_scan(path, up=up)
    assert (report.up, report.up_from) == (up, "as given")
    found = load_scan(path)[1]  # a negative axis is not found, because a room has as much floor as ceiling
    assert (found.up, found.up_from) == (up[-1], "found from the horizontal area")
    assert np.allclose(loaded.bounds, mesh.bounds, atol=1e-6)
    floor = loaded.triangles_center[:, 2] < loaded.bounds[0, 2] + 0.01
    assert (loaded.face_normals[floor, 2] > 0.99).all()
    assert loaded.volume == pytest.approx(-6.0 * 5.0 * 2.8)
    assert (report.watertight, report.components) == (True, 1)
    assert (report.degenerate_faces, report.duplicate_faces, report.non_manifold_edges, report.boundary_edges) == (0,) * 4
    assert report.area_m2 == pytest.approx(2 * (30 + 16.8 + 14))


def test_only_a_cube_in_a_glb_has_an_up_axis(tmp_path):
    mesh = room(3, 3, 3).apply_translation([0, 0, 1.5])
    path = write_obj(tmp_path / "cube.obj", mesh.vertices, mesh.faces)
    assert load_scan(path, up="z")[1].up == "z"
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
