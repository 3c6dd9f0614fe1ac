"""On a full or read-only disk, every subcommand prints one line that names the file or folder, exits with status 2 and changes no file."""

from __future__ import annotations

import json
import re
import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from disks import Disk
from reported import curve, row

from analysis import main, registry
from radartwin.config.study import TrackingConfig
from radartwin.label.labelling import prepare
from radartwin.radar.chirp import Radar
from radartwin.radar.recording import Recording
from radartwin.runs.experiment import Result
from radartwin.runs.tracking import Tracker
from radartwin.scene import objects, rooms
from radartwin.scene.scene import Scene, Surface

# SQLAlchemy warns about a deprecated loader that mlflow uses.
pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore:The .*noload.* loader strategy")]

Command = Callable[..., subprocess.CompletedProcess[str]]
SMALL = ["trajectory=static", "simulator.rays=1000", "radar.num_chirps=2", "radar.num_samples=32"]


def room() -> Scene:
    x, y, z = np.eye(3)
    parts = {
        "floor": rooms.rectangle([0, 0, 0], x, y, (3, 3)), "wall_1": rooms.rectangle([3, 3, 0], -y, z, (3, 2)),
        "shelf": objects.box([2.0, 1.0, 0.01], [2.6, 2.2, 0.8]),
    }  # fmt: skip
    return Scene([Surface(mesh, "plasterboard", name, role="room") for name, mesh in parts.items()], {"source": "corner.glb"})


@pytest.fixture(scope="module")
def place(shared_disk: Disk) -> Disk:
    """Return a disk with a scene, model answers about its materials, a recording, a results table, a report and a tracked run."""
    folder = shared_disk.folder
    room().save(folder / "scene")
    rooms.lab().surfaces[0].mesh.export(folder / "room.ply")
    radar = replace(Radar.iwr1843(), num_samples=32, num_chirps=2)
    noise = np.random.default_rng(0).standard_normal((3, 2, 2, 4, 32)).astype(np.complex64)
    Recording(noise, radar).save(folder / "recording")
    result = Result("environment", [row()], {"environment": curve}, {}, [], "0" * 32)
    main.write(registry.table("environment"), result, "quick", folder / "out")
    main.write_report(folder / "out", fresh=["environment"])
    with Tracker(TrackingConfig(), folder / "out").run("environment", "a" * 32, "materials=void", {}):
        pass
    asked = prepare(folder / "scene", Scene.load(folder / "scene")).questions
    answers = [{"id": question.id, "material": "wood", "finish": "smooth", "confidence": 0.5, "reason": "grain"} for question in asked]
    (folder / "objects.yaml").write_text("objects: [{name: a, catalogue: corner_reflector}, {name: b, catalogue: mug}]")
    (folder / "answers.jsonl").write_text("".join(json.dumps(answer) + "\n" for answer in answers))
    return shared_disk


VERBS = {
    "run": ["run", "experiment=positioning", "output={d}/out"],
    "sweep": ["run", "-m", "experiment=positioning", "seed=0,1", "output={d}/out"],
    "tables": ["tables", "--only", "positioning", "--output", "{d}/out"],
    "report": ["report", "--output", "{d}/out"],
    "simulate": ["simulate", "scene=plate", *SMALL, "--out", "{d}/recording"],
    "process": ["process", "{d}/recording.bin", "--out", "{d}/processed"],
    "reconstruct": ["reconstruct", "{d}/room.ply", "--out", "{d}/new"],
    "label": ["label", "{d}/scene", "--import", "{d}/answers.jsonl", "--model", "me"],
    "questions": ["label", "{d}/scene", "--export", "{d}/questions"],
    "view": ["view", "{d}/scene"],
    "train": [
        "train", "{d}/objects.yaml", "--out", "{d}/model", "--output", "{d}/out", "--frames", "13", "--distances", "1", "tracking=off",
        "radar.num_chirps=2", "supervision.copies=1", "supervision.encoder.epochs=1",
    ],
    "import": [
        "import", "{d}/recording.bin", "--out", "{d}/set", "object=none", "room=lab", "motion=static", "licence=MIT", "who=a", "sensor=b",
        "when=2026-01-01", "units=amplitude",
    ],
    "dashboard": ["dashboard", "--output", "{d}/out"],
    "doctor": ["doctor", "--output", "{d}/out"],
}  # fmt: skip
NEEDS_NO_SPACE = ("dashboard", "doctor")  # these subcommands work on a full disk


def error_lines(done: subprocess.CompletedProcess[str]) -> list[str]:
    """Return the error lines on standard error, without progress lines and warnings."""
    return [line for line in done.stderr.splitlines() if line.startswith("radartwin: ") and "warning" not in line]


@pytest.mark.parametrize("verb", VERBS)
def test_a_verb_on_a_read_only_disk_prints_one_line(verb: str, place: Disk, inside: Command) -> None:
    before = place.content()
    with place.read_only() as folder:
        done = inside(*(word.format(d=folder) for word in VERBS[verb]))
    assert done.returncode == 2
    if verb == "doctor":
        assert "cannot be written" in done.stdout
    else:
        assert len(error_lines(done)) == 1, done.stderr
        assert str(folder) in error_lines(done)[0]
        assert re.search(r"cannot be written|Read-only", error_lines(done)[0])
    assert place.content() == before


@pytest.mark.parametrize("verb", [verb for verb in VERBS if verb not in NEEDS_NO_SPACE])
def test_a_verb_on_a_full_disk_prints_one_line_and_changes_no_file(verb: str, place: Disk, inside: Command) -> None:
    before = place.content()
    place.fill()
    try:
        done = inside(*(word.format(d=place.folder) for word in VERBS[verb]))
    finally:
        place.empty()
    assert done.returncode == 2, done.stdout + done.stderr
    assert len(error_lines(done)) == 1, done.stderr
    assert "space" in error_lines(done)[0]
    after = place.content()
    assert before.items() <= after.items()
    assert not any(after[name] for name in after.keys() - before.keys()), "half of a file is left"


@pytest.mark.parametrize("verb", ["run", "sweep", "tables", "dashboard"])
def test_a_corrupted_tracking_store_is_named_before_any_work(verb: str, tmp_path: Path, inside: Command) -> None:
    content = b"SQLite format 3\0" + bytes(4096)
    database = tmp_path / "out" / "mlflow.db"
    database.parent.mkdir()
    database.write_bytes(content)
    done = inside(*(word.format(d=tmp_path) for word in VERBS[verb]))
    assert done.returncode == 2
    assert len(error_lines(done)) == 1, done.stderr
    assert str(database) in error_lines(done)[0]
    assert "move the store away" in error_lines(done)[0]
    assert database.read_bytes() == content
    assert not list(tmp_path.rglob("meta.json"))
