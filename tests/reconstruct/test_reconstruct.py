"""Test the files that a reconstruction writes, and the error messages for scans that cannot be used."""

import time
from typing import Any

import numpy as np
import pytest
import trimesh
from built_rooms import WINDOW, coloured, modelled, saved, scan, shell, truth, with_door
from made_files import refused
from PIL import Image
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from radartwin.errors import MissingError, OutputError
from radartwin.label.photos import load_textured
from radartwin.reconstruct.build import FACE_SURFACES_FILE, MESH_FILE, ScanOptions, distinct_views, reconstruct, summary
from radartwin.reconstruct.outlines.assembly import assembled
from radartwin.reconstruct.outlines.surfaces import flattened
from radartwin.reconstruct.segmentation.segment import segmented
from radartwin.scene.mesh_file import TO_Z_UP
from radartwin.scene.scene import Scene


def test_scene_folder_holds_the_scan_and_the_surface_of_each_face_and_is_deterministic(tmp_path):
    ball = trimesh.creation.icosphere(3, 0.3).apply_translation([2, 1, 0.4])
    mesh: Any = coloured(scan([*shell(WINDOW), ball], 0.004), with_door)
    path = saved(mesh, tmp_path)
    scene = reconstruct(path, tmp_path / "out")
    reconstruct(path, tmp_path / "two")
    for file in ("scene.glb", "manifest.json", MESH_FILE, FACE_SURFACES_FILE):
        assert (tmp_path / "out" / file).read_bytes() == (tmp_path / "two" / file).read_bytes(), file
    again: Any = trimesh.load(tmp_path / "out" / MESH_FILE, process=False)
    surface_of_face = np.load(tmp_path / "out" / FACE_SURFACES_FILE)
    assert len(surface_of_face) == len(again.faces)
    assert np.array_equal(again.visual.vertex_colors[:, :3], mesh.visual.vertex_colors[:, :3])
    for k, surface in enumerate(scene):
        if not surface.provenance["completed"]:
            assert again.area_faces[surface_of_face == k].sum() == pytest.approx(surface.provenance["area_m2"], rel=0.01)
    loaded = Scene.load(tmp_path / "out")
    assert loaded.names == scene.names
    assert [dict(s.provenance) for s in loaded] == [dict(s.provenance) for s in scene]
    assert {"filled_m2", "flattening_rms_m", "parts_error_m", "scan"} <= set(loaded.provenance)
    assert all(s.provenance["source"] == "uniform" and s.provenance["stand_in"] is False for s in loaded)
    lines = summary(scene)
    assert any("ceiling" in line for line in lines)
    low, high = scene.bounds
    assert lines[-1].startswith(f"the scene extends over x from {low[0]:.2f} to {high[0]:.2f}, y from {low[1]:.2f} to ")


def test_the_pictures_of_a_scan_file_are_kept_in_the_coordinates_of_the_scene(tmp_path):
    room = coloured(scan([*shell(WINDOW)], 0.004), with_door)
    turned = room.vertices @ TO_Z_UP["y"]  # the file has y up
    look = TextureVisuals(uv=np.zeros((len(turned), 2)), material=PBRMaterial(baseColorTexture=Image.new("RGB", (4, 4), "red")))
    trimesh.Trimesh(turned, room.faces, visual=look, process=False).export(tmp_path / "room.glb")
    reconstruct(tmp_path / "room.glb", tmp_path / "out", options=ScanOptions(up="y"))
    textured = load_textured(tmp_path / "out")
    assert textured is not None
    assert np.allclose(textured.bounds, room.bounds, atol=1e-5)
    reconstruct(saved(room, tmp_path), tmp_path / "out")
    assert load_textured(tmp_path / "out") is None, "a scan without pictures leaves no pictures of an earlier scan"


def test_interrupted_write_leaves_no_scene(tmp_path, monkeypatch):
    truth().save(tmp_path / "out")

    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(Scene, "save", interrupted)
    with pytest.raises(KeyboardInterrupt):
        reconstruct(saved(trimesh.creation.box((5, 4, 2.4)), tmp_path), tmp_path / "out")
    refused(["manifest.json"], Scene.load, tmp_path / "out", error=MissingError)
    assert not list((tmp_path / "out").glob(".*"))


def test_saved_photographs_are_the_most_distinct_views():
    poses = np.tile(np.eye(4), (20, 1, 1))
    poses[:, 0, 3] = np.r_[np.zeros(17), 1.0, 2.0, 3.0]
    assert distinct_views(poses, 4) == [0, 17, 18, 19]
    assert distinct_views(poses[16:18], 40) == [0, 1]


def test_only_a_scene_that_radartwin_wrote_is_replaced(tmp_path):
    path, out = saved(trimesh.creation.box((5, 4, 2.4)), tmp_path), tmp_path / "out"
    (out / "sub").mkdir(parents=True)
    for name in ("scan.ply", "scene.glb", "sub/room.ply"):
        inside = saved(trimesh.creation.box((5, 4, 2.4)), out, name)
        content = inside.read_bytes()
        words = [f"out: the folder contains the scan {inside}; choose another folder for --out"]
        refused(words, reconstruct, inside, out, options=ScanOptions(up="z"), error=OutputError)
        assert [file for file in out.rglob("*") if file.is_file()] == [inside]
        assert inside.read_bytes() == content
        inside.unlink()
    (out / "scan.ply").symlink_to(path)
    refused(["the folder contains the scan"], reconstruct, path, out, error=OutputError)
    (out / "scan.ply").unlink()
    for name in ("scan.ply", "manifest.json", "photos"):
        (out / name).write_text("{}")
        refused([f"{name}: RadarTwin did not write this file"], reconstruct, path, out, error=OutputError)
        assert (out / name).read_text() == "{}"
        (out / name).unlink()
    (out / "notes.txt").write_text("a room")
    reconstruct(path, out)
    reconstruct(path, out)
    (out / "manifest.json").unlink()  # as an interrupted reconstruction leaves the folder
    reconstruct(path, out)
    assert Scene.load(out).names


@pytest.mark.slow
def test_room_of_many_planes_takes_at_most_four_minutes_and_says_so_early():
    """The times are of the processor, because the machine may be shared."""
    mesh = modelled()
    began = time.process_time()
    segments = segmented(mesh)
    planes = sum(s.normal is not None for s in segments)
    assert len(mesh.faces) > 65_000
    assert planes > 1300
    times = []

    def over(numbers):
        for number in numbers:
            times.append(time.process_time())
            yield number

    assembled(mesh, flattened(mesh, segments, over=over), "plasterboard")
    assert time.process_time() - began < 240
    early = next(k for k, t in enumerate(times) if t - times[0] > 5)
    estimate = (times[early] - times[0]) / early * len(times)  # as `Progress` computes it
    assert 0.5 < estimate / (times[-1] - times[0]) < 2
