"""The command `radartwin label` asks a server, exports questions, imports answers, reports errors, and continues after it was killed."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from chat_server import ChatServer, Reply, completion
from numpy import eye

from radartwin.scene import objects, rooms
from radartwin.scene.scene import Scene, Surface


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Return a scene folder with a scanned corner of a room, a shelf and an object on the shelf."""
    x, y, z = eye(3)
    parts = {
        "floor": rooms.rectangle([0, 0, 0], x, y, (3, 3)),
        "wall_1": rooms.rectangle([3, 3, 0], -y, z, (3, 2)),
        "wall_2": rooms.rectangle([0, 3, 0], x, z, (3, 2)),
        "plane_1": objects.box([2.0, 1.0, 0.01], [2.6, 2.2, 0.8]),
        "part_1": objects.cylinder(0.06, 0.2).apply_translation([2.3, 1.6, 0.92]),
    }
    facts = {"source": "uniform", "planar": False, "segment": 3}
    surfaces = [
        Surface(mesh, "plasterboard", name, role="object" if "part" in name else "room", provenance=facts) for name, mesh in parts.items()
    ]
    return Scene(surfaces, {"source": "corner.glb"}).save(tmp_path / "scene")


class Model(ChatServer):
    """This slow substitute of a language model answers "wood" for surfaces and "plastic with water" for objects."""

    pause_s = 0.0

    def __init__(self) -> None:
        super().__init__(self._answer)

    def _answer(self, number: int, body: dict) -> Reply:
        time.sleep(self.pause_s)
        answer = {"material": "wood", "finish": "smooth", "confidence": 0.8, "reason": "grain"}
        if "contents" in json.dumps(body["response_format"]):
            answer |= {"material": "plastic", "wall_thickness_mm": 1.0, "contents": "water-like liquid"}
        return completion(answer)


@pytest.fixture
def model() -> Iterator[Model]:
    model = Model()
    yield model
    model.stop()


def manifest(folder: Path) -> dict[str, dict]:
    return {entry["name"]: entry for entry in json.loads((folder / "manifest.json").read_text())["surfaces"]}


def test_server_labels_a_scene_and_its_manifest_round_trips(inside, folder: Path, model: Model) -> None:
    geometry = (folder / "scene.glb").read_bytes()
    done = inside("label", folder, "--provider", "server", "--url", model.url, "--model", "tiny", "--views", "2")
    assert done.returncode == 0, done.stderr
    header, *rows, last = done.stdout.splitlines()
    assert header.split() == ["surface", "material", "MINC", "confidence", "substitute", "from"]
    assert [row.split()[0] for row in rows] == ["floor", "wall_1", "wall_2", "plane_1", "part_1"]
    assert last == "5 surfaces labelled, 1 with a substitute, 0 without an answer, 0 with an invalid answer"
    assert "asking server tiny: 5 done" in done.stderr
    entries = manifest(folder)
    assert entries["floor"]["material"] == {"layers": [["wood", 0.02]], "backing": "air"}
    assert entries["part_1"]["material"] == {"layers": [["hdpe", 0.001]], "backing": "water"}
    provenance = entries["floor"]["provenance"]
    assert provenance | {"key": ""} == {
        "planar": False, "segment": 3, "source": "vlm", "confidence": 0.8, "stand_in": False, "minc": "wood", "model": "tiny",
        "reason": "grain", "provider": "server", "key": "", "finish": "smooth",
    }  # fmt: skip
    assert (folder / "scene.glb").read_bytes() == geometry
    scene = Scene.load(folder)
    assert scene.surfaces[0].roughness_m > 0
    assert scene.provenance["materials"] == "vlm"
    again = inside("label", folder, "--model", "tiny", "--views", "2")
    assert again.returncode == 0, again.stderr
    assert len(model.requests) == 5, "the answers are stored with the scene"


def test_killed_labelling_continues(inside, folder: Path, model: Model, tmp_path: Path) -> None:
    before = (folder / "manifest.json").read_bytes()
    model.pause_s = 0.4
    asking = ["label", str(folder), "--provider", "server", "--url", model.url, "--model", "tiny", "--views", "1", "--concurrency", "1"]
    process = subprocess.Popen([sys.executable, "-m", "radartwin", *asking], cwd=tmp_path, stderr=subprocess.DEVNULL)
    journal = folder / "labels" / "answers.jsonl"
    waiting = time.monotonic() + 60
    while (not journal.exists() or journal.read_text().count("\n") < 2) and time.monotonic() < waiting:
        time.sleep(0.02)
    process.kill()
    process.wait()
    assert (folder / "manifest.json").read_bytes() == before
    stored = journal.read_text().count("\n")
    assert 2 <= stored < 5
    time.sleep(model.pause_s)  # wait until the server has answered the request of the killed process
    model.pause_s, already = 0.0, len(model.requests)
    done = inside(*asking)
    assert done.returncode == 0, done.stderr
    assert f"{stored} of 5 answers are already stored" in done.stderr
    assert len(model.requests) - already == 5 - stored, "only open questions are asked"
    assert {entry["provenance"]["source"] for entry in manifest(folder).values()} == {"vlm"}


def test_exported_questions_are_answered_by_import(inside, folder: Path, tmp_path: Path) -> None:
    exported = inside("label", folder, "--export", "out", "--views", "1")
    assert exported.stdout == "out: 5 questions\n", exported.stderr
    asked = [json.loads(line) for line in (tmp_path / "out" / "questions.jsonl").read_text().splitlines()]
    answer = {"material": "stone", "finish": "sandy", "confidence": 0.6, "reason": "grey"}
    lines = [json.dumps({"id": q["id"], **answer}) for q in asked if q["kind"] != "object"]
    (tmp_path / "answers.jsonl").write_text("\n".join(lines[:3]))
    before = (folder / "manifest.json").read_bytes()
    answered = ("label", folder, "--import", "answers.jsonl", "--model", "someone", "--views", "1")
    partial = inside(*answered)
    assert partial.returncode == 2
    assert "2 of 5 surfaces have no answer" in partial.stderr
    assert (folder / "manifest.json").read_bytes() == before
    rest = inside(*answered, "--missing", "uniform:concrete")
    assert rest.returncode == 0, rest.stderr
    assert "2 without an answer" in rest.stdout
    sources = [(e["provenance"]["source"], e["provenance"].get("missing", False)) for e in manifest(folder).values()]
    assert sorted(sources) == [("uniform", True)] * 2 + [("vlm", False)] * 3


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--missing", "concrete"], "give uniform:MATERIAL"),
        (["--missing", "uniform:cheese"], "unknown material 'cheese'"),
        (["--provider", "server", "--url", "nowhere"], "nowhere is not the address of a server"),
        (["--provider", "local"], "--provider local needs --model"),
        (["--import", "none.jsonl"], "--import needs --model NAME, the model or person that answered"),
        (["--import", "none.jsonl", "--model", "x"], "none.jsonl is missing"),
        (["--views", "0"], "--views 0 is below 1"),
        (["--concurrency", "0"], "--concurrency 0 is below 1"),
        (["--timeout", "inf"], "--timeout inf is not a time limit"),
        ([], "no recorded answers for corner;"),
    ],
)
def test_user_error_is_one_line_and_changes_nothing(inside, folder: Path, arguments: list[str], words: str) -> None:
    before = {p: p.read_bytes() for p in folder.rglob("*") if p.is_file()}
    done = inside("label", folder, *arguments)
    assert done.returncode == 2
    assert words in done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert {p: p.read_bytes() for p in folder.rglob("*") if p.is_file()} == before
