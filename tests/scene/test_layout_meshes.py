"""Test furniture layout files that place meshes from other files: file paths relative to the folder of the layout file, length units,
materials and placement.
"""

import time
from pathlib import Path

import numpy as np
import pytest
import trimesh

from radartwin.errors import LayoutError, MaterialError, MeshError, MissingError
from radartwin.materials import Layered
from radartwin.scene import objects, rooms
from radartwin.scene.layouts.layout import Layout
from radartwin.scene.layouts.place import GAP_M, furnish
from radartwin.scene.scene import Scene

TABLE = "table_left_top"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Write a tin of 68 x 102 mm in millimetres, with y up and away from its origin, into a subfolder of the layout's folder."""
    (tmp_path / "meshes").mkdir()
    lying = trimesh.transformations.rotation_matrix(-np.pi / 2, [1, 0, 0])
    objects.cylinder(34, 102).apply_transform(lying).apply_translation([50, 60, 70]).export(tmp_path / "meshes" / "Tin.obj")
    return tmp_path


def furnished(folder: Path, entry: str) -> Scene:
    (folder / "layout.yaml").write_text(f"objects:\n  - {{{entry}}}\n  - {{object: mug, on: {TABLE}, position_m: [4.3, 1.9]}}\n")
    return furnish(rooms.lab(detail="furnished"), Layout.load(folder / "layout.yaml"))


def test_a_mesh_is_placed_on_a_table_beside_a_catalogue_object(folder, monkeypatch):
    monkeypatch.chdir("/")  # the path is from the layout's folder
    entry = f"object: meshes/Tin.obj, material: metal, unit: mm, up: y, on: {TABLE}, position_m: [4.3, 1.2]"
    scene = furnished(folder, entry)
    tin = next(s for s in scene if s.name == "tin")
    top = next(s for s in scene if s.name == TABLE).mesh.bounds[1, 2]
    assert np.allclose(tin.mesh.bounds, [[4.266, 1.166, top + GAP_M], [4.334, 1.234, top + GAP_M + 0.102]], atol=1e-5)
    assert (tin.material, tin.kind, tin.provenance["layout"], tin.provenance["file"]) == (
        "metal",
        "object",
        f"Tin.obj on {TABLE}",
        "Tin.obj",
    )
    assert "mug" in scene.names


def test_a_mesh_may_have_a_layered_material(folder):
    stack = "material: {layers: [[hdpe, 0.001]], backing: water}"
    scene = furnished(folder, f"object: meshes/Tin.obj, {stack}, unit: mm, up: y, on: {TABLE}, name: jug")
    assert next(s for s in scene if s.name == "jug").material == Layered([("hdpe", 0.001)], backing="water")


@pytest.mark.parametrize(
    ("entry", "error", "words"),
    [
        ("object: meshes/Tin.obj, unit: mm", LayoutError, r"objects\[0\] \(meshes/Tin.obj\) is a mesh, .* give material: NAME"),
        ("object: meshes/Tin.obj, material: metal", MeshError, r"102 m long in unit=m; .*give unit=mm$"),
        ("object: meshes/Tin.obj, material: metal, unit: furlong", LayoutError, r"objects\[0\]\.unit: 'furlong'"),
        ("object: meshes/Tin.obj, material: cheese, unit: mm", MaterialError, "unknown material 'cheese'"),
        ("object: meshes/gone.obj, material: metal", MissingError, r"meshes/gone\.obj is not there"),
        ("object: mug, material: metal", LayoutError, r"objects\[0\] \(mug\) is of the catalogue, which defines its material"),
        ("object: meshes/Tin.obj, material: {layers: 3}", LayoutError, r"objects\[0\]\.material"),
        ("object: meshes/Tin.obj, material: {layers: [[hdpe, thick]]}", LayoutError, r"layout\.yaml: objects\[0\]\.material: .*thick"),
        (
            "object: meshes/Tin.obj, material: {layers: [[hdpe, -1]]}",
            LayoutError,
            r"layout\.yaml: objects\[0\]\.material: .*positive metres",
        ),
        ("object: meshes/Tin.obj, material: {layers: [[cheese, 1]]}", LayoutError, r"layout\.yaml: objects\[0\]\.material: .*'cheese'"),
    ],
)
def test_an_invalid_mesh_entry_is_refused_with_its_name(folder, entry, error, words):
    with pytest.raises(error, match=words):
        furnished(folder, f"{entry}, on: {TABLE}")


@pytest.mark.parametrize(("name", "height_m"), [("ycb/MustardBottle.obj", 0.19), ("ycb/TomatoSoupCan.obj", 0.1), ("fuze/fuze.obj", 0.22)])
@pytest.mark.filterwarnings("ignore::radartwin.scene.mesh_file.MeshWarning")
def test_scanned_meshes_are_placed_in_a_room(shared_data, tmp_path, name, height_m):
    mesh = shared_data / "objects" / name
    scene = furnished(tmp_path, f"object: {mesh}, material: hdpe, on: {TABLE}, name: thing")
    thing = next(s for s in scene if s.name == "thing")
    assert thing.mesh.extents[2] == pytest.approx(height_m, rel=0.1)
    assert thing.kind == "object"


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
