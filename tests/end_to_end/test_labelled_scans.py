"""The recorded model answers label every surface of the shipped rooms, and the labels survive saving and loading."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from experiments.generators.label_questions import answered, asked
from radartwin.commands.demo import SCAN
from radartwin.label.material_sources import Vlm
from radartwin.label.questions import prompt_digest
from radartwin.label.recorded import CHAIR, FURNISHED, shipped, shipped_rooms
from radartwin.label.surface_labels import write_labels
from radartwin.materials.minc import CATEGORIES
from radartwin.reconstruct.build import reconstruct
from radartwin.scene import rooms
from radartwin.scene.scene import Scene


@pytest.mark.parametrize("room", shipped_rooms())
def test_recorded_answers_label_the_scan_and_the_manifest_round_trips(room: str, request: pytest.FixtureRequest, tmp_path: Path) -> None:
    folder = tmp_path / "scene"
    if room in (CHAIR, FURNISHED):
        reconstruct(SCAN if room == FURNISHED else request.getfixturevalue("shared_data") / "scans" / CHAIR / "export.obj", folder)
    else:
        bare = [s.replaced(material="plasterboard", provenance={"scanned": True}) for s in rooms.room(room, detail="shell")]
        Scene(bare, {"scan_of": room}).save(folder)
    before = Scene.load(folder)
    scene = Vlm(missing="plasterboard")(before)
    assert scene.names == before.names
    for surface in scene:
        facts = surface.provenance
        assert facts["source"] in ("vlm", "uniform"), surface.name
        assert isinstance(facts["stand_in"], bool)
        if facts["source"] == "vlm":
            assert facts["minc"] in CATEGORIES
            assert 0 <= facts["confidence"] <= 1
    area = np.array([s.mesh.area for s in scene])
    assert area[[s.provenance["source"] == "vlm" for s in scene]].sum() > 0.9 * area.sum()

    write_labels(folder, scene)
    again = Scene.load(folder)
    assert [s.material for s in again] == [s.material for s in scene]
    assert [s.roughness_m for s in again] == [s.roughness_m for s in scene]
    assert [dict(s.provenance) for s in again] == [json.loads(json.dumps(dict(s.provenance))) for s in scene]
    assert sum(len(s.mesh.faces) for s in again) == sum(len(s.mesh.faces) for s in before)


@pytest.mark.slow
@pytest.mark.parametrize("room", shipped_rooms())
def test_shipped_answers_match_the_current_questions(room: str, request: pytest.FixtureRequest) -> None:
    """The answers belong to the current prompt and to a new reconstruction. Digests of pictures depend on the processor."""
    data = request.getfixturevalue("shared_data") / "scans" / CHAIR if room == CHAIR else Path()
    assert {record.prompt for record in shipped(room)} == {prompt_digest()}
    assert answered(room, asked(room, data)) > 0.99, "of the area of all surfaces"
