"""The scanned rooms that ship with the study: which scans they replace, their keys, their labels, and how their files are written."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from experiments.generators import scanned_rooms
from experiments.scans import virtual_scan
from radartwin.config.compose import compose
from radartwin.label.material_sources import Vlm
from radartwin.scene import rooms
from radartwin.scene.scene import Scene
from radartwin.scene.storage import GEOMETRY, MANIFEST
from radartwin.store.products import Store

CONFIG = compose(["profile=quick"])


def test_the_study_reads_the_shipped_room_at_its_strength_and_seed_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = []
    monkeypatch.setattr(virtual_scan, "scanned", lambda out, *arguments: made.append(arguments))
    store = Store(tmp_path)
    for room in scanned_rooms.ROOMS:
        assert len(virtual_scan.scene_of(virtual_scan.fetch(CONFIG, store, room, 1.0))) > 20
    assert made == []
    for strength, seed, anew in ((0.5, 0, False), (1.0, 1, False), (1.0, 0, True)):
        virtual_scan.fetch(CONFIG, store, "lab", strength, seed, anew)
        assert made.pop() == ("lab", strength, seed)


def test_a_changed_file_changes_the_key(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store, content = Store(tmp_path / "cache"), virtual_scan.shipped_file("lab").read_bytes()
    monkeypatch.setattr(virtual_scan, "SHIPPED", tmp_path)
    keys = [virtual_scan.key(CONFIG, store, "lab", 1.0)]  # without a file, the room is scanned
    for change in (b"", b"x"):
        (tmp_path / "lab.zip").write_bytes(content + change)
        keys.append(virtual_scan.key(CONFIG, store, "lab", 1.0))
    assert len(set(keys)) == 3


@pytest.mark.parametrize("room", scanned_rooms.ROOMS)
def test_every_surface_of_a_shipped_room_has_a_recorded_answer(room: str, tmp_path: Path) -> None:
    virtual_scan.unpack(virtual_scan.shipped_file(room), tmp_path)
    scene = Scene.load(tmp_path)
    assert {surface.provenance["source"] for surface in Vlm()(scene)} == {"vlm"}, "a surface without an answer is an error"


def test_a_shipped_file_keeps_the_geometry_bit_by_bit(tmp_path: Path) -> None:
    scene = rooms.room("lab", detail="furnished")
    scene = Scene(scene, {"source": "lab", "scan": {"source": "/tmp/random/lab"}})
    scene.save(tmp_path / "made")
    glb, manifest = (tmp_path / "made" / GEOMETRY).read_bytes(), json.loads((tmp_path / "made" / MANIFEST).read_text())
    content = scanned_rooms.pack(glb, manifest)
    assert content == scanned_rooms.pack(glb, manifest), "the same scene gives the same bytes"
    virtual_scan.unpack(_written(tmp_path / "lab.zip", content), tmp_path / "unpacked")
    before, after = Scene.load(tmp_path / "made"), Scene.load(tmp_path / "unpacked")
    assert after.provenance["scan"] == {"source": "lab"}
    for old, new in zip(before, after, strict=True):
        assert (old.name, old.material, old.roughness_m) == (new.name, new.material, new.roughness_m)
        for part in ("vertices", "faces", "vertex_normals"):
            assert np.array_equal(getattr(old.mesh, part), getattr(new.mesh, part))
    assert {_format(surface) for surface in after} == {"JPEG"}


def _written(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


def _format(surface) -> str | None:
    image = getattr(getattr(surface.mesh.visual, "material", None), "baseColorTexture", None)
    return image.format if isinstance(image, Image.Image) else None
