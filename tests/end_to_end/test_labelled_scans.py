"""Recorded answers on the rooms that they ship for: every surface has the source of its label, and the manifest round trips."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from experiments.generators.questions import asked, exact
from radartwin.label.labels import write_labels
from radartwin.label.recorded import shipped, shipped_rooms
from radartwin.label.sources import Vlm
from radartwin.materials.minc import CATEGORIES
from radartwin.reconstruct.build import reconstruct
from radartwin.scene import rooms
from radartwin.scene.scene import Scene

CHAIR = "arkit_lidar_chair_scan"


@pytest.fixture(params=shipped_rooms())
def scan(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[str, Path]:
    """An unlabelled scene folder of a room with shipped answers."""
    if request.param == CHAIR:
        data = request.getfixturevalue("shared_data") / "scans" / CHAIR / "export.obj"
        (tmp_path / f"{CHAIR}.obj").symlink_to(data)
        reconstruct(tmp_path / f"{CHAIR}.obj", tmp_path / "scene")
        return CHAIR, tmp_path / "scene"
    room = rooms.room(request.param, detail="shell")
    bare = Scene([s.replaced(material="plasterboard", provenance={"scanned": True}) for s in room], {"scan_of": request.param})
    return request.param, bare.save(tmp_path / "scene")


def test_recorded_answers_label_the_scan_and_the_manifest_round_trips(scan: tuple[str, Path]) -> None:
    room, folder = scan
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
    answered = area[[s.provenance["source"] == "vlm" for s in scene]].sum() / area.sum()
    print(f"{room}: {answered:.3f} of {area.sum():.1f} m2 answered by {len(shipped(room))} recorded answers")
    assert answered > 0.9

    write_labels(folder, scene)
    again = Scene.load(folder)
    assert [s.material for s in again] == [s.material for s in scene]
    assert [s.roughness_m for s in again] == [s.roughness_m for s in scene]
    assert [dict(s.provenance) for s in again] == [json.loads(json.dumps(dict(s.provenance))) for s in scene]
    assert sum(len(s.mesh.faces) for s in again) == sum(len(s.mesh.faces) for s in before)


@pytest.mark.slow
@pytest.mark.parametrize("room", shipped_rooms())
def test_shipped_answers_match_the_current_questions(room: str, request: pytest.FixtureRequest) -> None:
    """The digests of prompt and pictures match for a new reconstruction of the scan."""
    data = request.getfixturevalue("shared_data") / "scans" / CHAIR if room == CHAIR else Path()
    questions = asked(room, data)
    share = exact(room, questions)
    print(f"{room}: {len(questions)} questions, {share:.3f} of their area answered by the very question")
    assert share > 0.99
