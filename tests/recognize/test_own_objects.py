"""The list of a user's objects is read with their materials, and every mistake in it is named in one line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from radartwin.errors import InputError, MissingError, OutputError, UserError
from radartwin.materials import Layered
from radartwin.recognize import text
from radartwin.recognize.own.object_list import anchors, read_objects
from radartwin.recognize.own.stored import check_model_folder
from radartwin.scene.objects import catalogue

PLATE = "name: plate, mesh: meshes/plate.stl, unit: mm, material: metal"
MUG = "name: mug, catalogue: mug"


def written(folder: Path, *entries: str) -> Path:
    """Write a list of objects, and beside it a plate of 2 x 120 x 80 mm in millimetres."""
    (folder / "meshes").mkdir(exist_ok=True)
    trimesh.creation.box((2, 120, 80)).export(folder / "meshes" / "plate.stl")
    path = folder / "objects.yaml"
    path.write_text("objects:\n" + "".join(f"  - {{{entry}}}\n" for entry in entries))
    return path


def test_meshes_and_catalogue_objects_stand_on_the_turntable(tmp_path: Path) -> None:
    """Objects stand on z = 0, with the axis in the middle of a mesh, and are sorted by name. The radar aims at half the height."""
    bottle = "name: bottle, mesh: meshes/plate.stl, unit: mm, up: y, material: {layers: [[pet, 0.0005]], backing: water}"
    first, mug, plate = read_objects(written(tmp_path, PLATE, MUG, bottle))
    assert [entry.name for entry in (first, mug, plate)] == ["bottle", "mug", "plate"]
    np.testing.assert_allclose(plate.size_m, [0.002, 0.12, 0.08], atol=1e-7)
    np.testing.assert_allclose(plate.surfaces[0].mesh.bounds, [[-0.001, -0.06, 0], [0.001, 0.06, 0.08]], atol=1e-7)
    assert (plate.aim_m, plate.radius_m) == pytest.approx((0.04, np.hypot(0.06, 0.001)))
    np.testing.assert_allclose(first.size_m, [0.002, 0.08, 0.12], atol=1e-7)
    assert first.surfaces[0].material == Layered([("pet", 0.0005)], backing="water")
    assert (first.material, mug.material, plate.material) == ("pet 0.5 mm on water", "glass 4 mm, glass", "metal")
    assert (mug.origin, mug.aim_m, plate.origin) == ("mug", catalogue()["mug"].aim_m, "plate.stl")


MISTAKES: dict[str, tuple[tuple[str, ...], str]] = {
    "missing mesh": ((MUG, "name: a, mesh: gone.stl, material: metal"), r"objects\[1\] \(a\): mesh .*gone\.stl is not there"),
    "mesh in millimetres": ((MUG, "name: a, mesh: meshes/plate.stl, material: metal"), r"\(a\): .*120 m long in unit=m.*unit=mm"),
    "unknown material": ((MUG, PLATE.replace("metal", "cheese")), r"\(plate\): unknown material 'cheese'"),
    "unknown wall": ((MUG, PLATE.replace("metal", "{layers: [[cheese, 0.1]]}")), r"\(plate\): unknown material 'cheese'"),
    "wall without thickness": ((MUG, PLATE.replace("metal", "{layers: [[pet]]}")), r"objects\[1\]\.material"),
    "no material": ((MUG, "name: a, mesh: meshes/plate.stl, unit: mm"), r"\(a\): a mesh has no material; give material"),
    "one object": ((MUG,), r"1 entry; a recogniser needs at least 2 objects"),
    "duplicate name": ((MUG, PLATE.replace("plate,", "mug,")), r"objects\[1\] \(mug\): two objects have this name"),
    "unknown catalogue object": ((PLATE, "name: a, catalogue: teapot"), r"\(a\): the catalogue has no object 'teapot'; choose"),
    "material of a catalogue object": ((PLATE, f"{MUG}, material: metal"), r"\(mug\): the catalogue defines the material"),
    "neither mesh nor catalogue": ((MUG, "name: a, material: metal"), r"\(a\): an object has either the key mesh or the key catalogue"),
    "name with a line break": ((MUG, PLATE.replace("plate,", '"a\\nb",')), r"change the name"),
    "name that is a number": ((MUG, PLATE.replace("name: plate", "name: 211")), r"objects\[1\]\.name: 211 is not of type 'string'"),
    "unknown key": ((MUG, f"{PLATE}, colour: red"), r"objects\[1\]: .*'colour'"),
    "unknown unit": ((MUG, PLATE.replace("mm", "furlong")), r"objects\[1\]\.unit"),
    "some descriptions": ((f"{MUG}, description: a mug", PLATE), r"objects\[1\] \(plate\) has no description, but other objects have one"),
}


@pytest.mark.parametrize(("entries", "message"), MISTAKES.values(), ids=MISTAKES)
def test_a_mistake_in_the_list_is_named(entries: tuple[str, ...], message: str, tmp_path: Path) -> None:
    with pytest.raises(UserError, match=message) as caught:
        read_objects(written(tmp_path, *entries))
    assert "\n" not in str(caught.value)
    assert "objects.yaml" in str(caught.value)


@pytest.mark.parametrize(
    "content", ["- {name: a, catalogue: mug}\n", "objects: mug\n", "objects: [\n", "objects:\n", "a text\n", "", "[]\n"]
)
def test_a_file_without_a_list_of_objects_is_refused(content: str, tmp_path: Path) -> None:
    (tmp_path / "objects.yaml").write_text(content)
    with pytest.raises(InputError, match=r"objects\.yaml") as caught:
        read_objects(tmp_path / "objects.yaml")
    assert "\n" not in str(caught.value)
    with pytest.raises(MissingError, match="no such file"):
        read_objects(tmp_path / "absent.yaml")


def test_objects_without_descriptions_have_orthonormal_vectors(tmp_path: Path) -> None:
    vectors = anchors(read_objects(written(tmp_path, PLATE, MUG)))
    assert list(vectors) == ["mug", "plate"]
    np.testing.assert_array_equal(np.stack(list(vectors.values())), np.eye(2))


def test_described_objects_have_their_text_embeddings(tmp_path: Path) -> None:
    """Shipped embeddings need no text model. A catalogue object without a description has the catalogue's description."""
    known = catalogue()["mustard"].description
    vectors = anchors(read_objects(written(tmp_path, f"{PLATE}, description: '{known}'", MUG)))
    expected = text.embed([catalogue()["mug"].description, known])
    np.testing.assert_array_equal(np.stack([vectors["mug"], vectors["plate"]]), expected)
    with pytest.raises(InputError, match="mug and plate have the same description"):
        anchors(read_objects(written(tmp_path, f"{PLATE}, description: a thing", f"{MUG}, description: a thing")))


def test_only_a_model_folder_may_be_replaced(tmp_path: Path) -> None:
    """A folder of another model with the same file names is not replaced. A folder that an interrupted save left is replaced."""
    for name, files, accepted in (
        ("new", {}, True),
        ("model", {"model.json": '{"format": "radartwin recogniser 1"}', "model.safetensors": "", "README.md": ""}, True),
        ("interrupted", {"model.safetensors": ""}, True),
        ("notes", {"README.md": "mine"}, False),
        ("foreign", {"model.json": "{}", "model.safetensors": ""}, False),
        ("language", {"model.safetensors": "", "README.md": "", "config.json": "{}"}, False),
    ):
        folder = tmp_path / name
        folder.mkdir()
        for file, content in files.items():
            (folder / file).write_text(content)
        if accepted:
            check_model_folder(folder)
        else:
            with pytest.raises(OutputError, match="no recogniser; choose a new or empty folder"):
                check_model_folder(folder)
    check_model_folder(tmp_path / "absent")
    assert not (tmp_path / "absent").exists()
