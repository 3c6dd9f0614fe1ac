"""The scanned rooms that ship with the study: which scans they replace, their keys, and their labels."""

from __future__ import annotations

from pathlib import Path

import pytest

from experiments.generators import scanned_rooms
from experiments.scans import virtual_scan
from radartwin.config.compose import compose
from radartwin.label.material_sources import Vlm
from radartwin.scene.scene import Scene
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
