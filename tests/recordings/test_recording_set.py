"""Tests of recording sets: writing and reading, refused input, and processes that are killed or write at the same time."""

from __future__ import annotations

import dataclasses
import json
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from made_files import CARD, noise, refused

from radartwin.errors import InputError, MissingError, OutputError, PoseError, RecordingError
from radartwin.radar.chirp import Radar
from radartwin.recordings.examine import examine
from radartwin.recordings.index import Row, index_text, read_index
from radartwin.recordings.recording_set import RecordingSet

RADAR = dataclasses.replace(Radar.iwr1843(), num_samples=64, num_chirps=8)


def row(name: str, object: str = "mug", distance_m: float | None = 1.0, repetition: int = 0, **more) -> Row:
    return Row(name, object, distance_m, **{"room": "lab", "motion": "turntable", **more}, repetition=repetition)


def files(folder: Path) -> dict[str, bytes]:
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> RecordingSet:
    """Return a recording set with two objects at two distances, each recorded twice."""
    made = RecordingSet.create(tmp_path_factory.mktemp("written") / "bench", CARD)
    for i, (name, distance, repetition) in enumerate((o, d, n) for o in ("mug", "can") for d in (1.0, 2.0) for n in (0, 1)):
        given = row(f"{name}_{distance:g}m_{repetition}", name, distance, repetition, extra={"operator": "ann" if i % 2 else "bob"})
        made.add(noise(RADAR, i), given)
    return made


@pytest.fixture
def bench(written: RecordingSet, tmp_path: Path) -> RecordingSet:
    return RecordingSet.load(shutil.copytree(written.folder, tmp_path / "bench"))


def test_added_recordings_are_read_back(written: RecordingSet, bench: RecordingSet) -> None:
    assert bench.card == CARD
    assert bench.rows == written.rows
    assert len(bench) == 8
    assert "mug_1m_0" in bench
    assert bench.radar == RADAR
    for i, (given, recording) in enumerate(bench.recordings()):
        assert given.recording == written.rows[i].recording
        np.testing.assert_allclose(recording.iq, noise(RADAR, i).iq, atol=2e-9)
    assert examine(bench.folder).problems == []
    stream = bench.recordings()  # which reads on demand
    next(stream)
    (bench.folder / "recordings" / "mug_1m_1.bin").unlink()
    refused(["mug_1m_1"], next, stream, error=MissingError)


def test_rows_are_selected_by_columns_and_alternatives(bench: RecordingSet) -> None:
    assert [r.recording for r in bench.select(object="can", distance_m=2)] == ["can_2m_0", "can_2m_1"]
    assert len(bench.select(distance_m=[1.0, 2.0], repetition=1)) == 4
    assert len(bench.select(operator="ann", object=("mug", "can"))) == 4
    assert bench.select(object="bottle") == []
    assert len(bench.select(distance_m=1.00001)) == 4  # the index stores rounded distances
    refused(["'colour'", "object", "operator"], bench.select, colour="red", error=InputError)
    refused(["no recording of object=bottle, distance_m=1"], bench.recordings, object="bottle", distance_m=1, error=MissingError)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (row("mug_1m_0"), ("already has a recording mug_1m_0",)),
        (row("MUG_1m_0", repetition=7), ("already has a recording mug_1m_0",)),
        (row("again"), ("again repeats mug_1m_0", "mug, 1 m, lab")),
        (row("a b", repetition=7), ("'a b'", "letters")),
        (row("../a", repetition=7), ("'../a'",)),
        (row("a.bin", repetition=7), ("'a.bin'", "suffix")),
        (row("a", "olive oil"), ("olive oil", "word")),
        (row("a", distance_m=float("nan")), ("distance_m nan",)),
        (row("a", distance_m=-1.0), ("distance_m -1",)),
        (row("a", distance_m=None), ("distance_m is empty", "turntable")),
        (row("a", motion="walking"), ("'walking'", "turntable, radial")),
        (row("a", repetition=-1), ("repetition -1",)),
        (row("a", repetition=7, split="eval"), ("'eval'", "train, validation, test")),
        (row("a", repetition=7, trajectory="../x.csv"), ("../x.csv", "trajectories/")),
        (row("a", repetition=7, extra={"start_s": "noon"}), ("start_s 'noon'",)),
        (row("a", repetition=7, extra={"object": "x"}), ("column object",)),
    ],
)
def test_invalid_row_is_refused_without_writing(bench: RecordingSet, given: Row, words: tuple[str, ...]) -> None:
    before = files(bench.folder)
    refused(words, bench.add, noise(RADAR), given, error=InputError)
    assert files(bench.folder) == before


def test_create_opens_an_existing_set_and_refuses_another_card_radar_or_folder(bench: RecordingSet, tmp_path: Path) -> None:
    assert len(RecordingSet.create(bench.folder, CARD)) == 8
    noted = dataclasses.replace(CARD, name="007", when="2026-03-01 ", notes="two\nlines: # \n", extra={"room_height_m": 2.7})
    for _ in range(2):
        assert RecordingSet.create(tmp_path / "noted", noted).card.notes == "two\nlines: #"
    create = RecordingSet.create
    refused(["differs in licence"], create, bench.folder, dataclasses.replace(CARD, licence="private"), error=RecordingError)
    refused(["not empty"], create, tmp_path, CARD, error=OutputError)
    refused(["licence is missing"], create, tmp_path / "new", dataclasses.replace(CARD, licence=""), error=RecordingError)
    assert not (tmp_path / "new" / "card.yaml").exists()
    bench.add(noise(dataclasses.replace(RADAR, name="run_7")), row("b", repetition=8))  # as mmWave Studio names it after the capture
    assert not [problem for problem in examine(bench.folder).problems if "radar" in str(problem)]
    other = noise(dataclasses.replace(RADAR, num_chirps=4))
    refused(["radar of a ", "num_chirps 4 instead of 8"], bench.add, other, row("a", repetition=7), error=RecordingError)
    folder = tmp_path / "wrong"
    refused(["no such folder"], RecordingSet.load, folder, error=MissingError)
    folder.mkdir()
    refused(["not a recording set, because it has no card.yaml"], RecordingSet.load, folder, error=MissingError)
    for text, message in (("- 1\n", "mapping"), ("name: [\n", "line 2")):
        (folder / "card.yaml").write_text(text)
        refused([message], RecordingSet.load, folder, error=RecordingError)
    CARD.save(folder)
    refused(["no recordings yet"], lambda: RecordingSet.load(folder).radar, error=MissingError)
    (folder / "index.csv").write_text("recording,object\n")
    refused(["no column distance_m"], RecordingSet.load, folder, error=RecordingError)


def test_index_round_trips(tmp_path: Path) -> None:
    rows = [
        row("b", extra={"note": 'a "quoted", word'}),
        row("a", "none", None, motion="static", split="test"),
        row("c", distance_m=0.1 + 0.2, extra={"start_s": "-0.25"}),
    ]
    path = tmp_path / "index.csv"
    path.write_text(index_text(rows))
    assert read_index(path) == (rows, [])
    # the index file with the byte order mark and line ends of a spreadsheet program
    path.write_bytes(b"\xef\xbb\xbf" + index_text(rows).replace("\n", "\r\n").encode())
    assert read_index(path) == (rows, [])


def test_recording_without_poses_uses_those_of_its_trajectory(tmp_path: Path) -> None:
    path = tmp_path / "drive.txt"
    path.write_text("# time x y z qx qy qz qw\n9.9 0 0 0.4 0 0 0 1\n10.5 0.6 0 0.4 0 0 0.7071068 0.7071068\n")
    drive = RecordingSet.create(tmp_path / "set", CARD)
    stored = drive.add(noise(RADAR), row("a", motion="depth", extra={"start_s": "10.0"}), path)
    assert stored.trajectory == "a.txt"
    poses = np.asarray(drive.read(stored).sensor_poses)
    np.testing.assert_allclose(poses[:, 0, 3], [0.1, 0.2, 0.3, 0.4], atol=1e-9)  # 1 m/s at 10 Hz, 0.1 s after the start of the file
    np.testing.assert_allclose(np.degrees(np.arctan2(poses[:, 1, 0], poses[:, 0, 0])), [15, 30, 45, 60], atol=1e-4)
    assert examine(drive.folder).problems == []
    copied = drive.folder / "trajectories" / "a.txt"
    copied.unlink()
    copied.symlink_to(path)
    for read in (drive.read, drive.course):
        refused(["'trajectories/a.txt' outside this folder"], read, stored, error=InputError)
    path.write_text("no track\n")
    refused(["drive.txt"], drive.add, noise(RADAR), row("b", repetition=1), path, error=PoseError)
    assert [file.name for file in copied.parent.iterdir()] == ["a.txt"]
    assert not list((drive.folder / "recordings").glob("b.*"))


# In a process of its own, because an audit hook cannot be removed. First, two children add to one set at the same time. Then, for every
# n, one child kills itself at its n-th call of open, rename, remove or mkdir inside a set, and a second child completes the work. Per n,
# the script prints whether the set was valid in between and complete at the end.
_WRITERS = """
import os, signal, sys, json
sys.path[:0] = ["tests", "tests/recordings"]
from test_recording_set import *

os.fsync = lambda descriptor: None  # slow, and without effect on a kill
root = Path(sys.argv[1])
(root / "drive.csv").write_text("t,x,y,z,qx,qy,qz,qw\\n0,0,0,0,0,0,0,1\\n1,1,0,0,0,0,0,1\\n")

def started(body, *arguments):
    child = os.fork()
    if not child:
        body(*arguments)
        os._exit(0)
    return child

def status(child):
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])

def work(folder):
    made = RecordingSet.create(folder, CARD)
    for n in range(2):
        if f"a{n}" not in made:
            made.add(noise(RADAR, n), row(f"a{n}", motion="depth", repetition=n), root / "drive.csv")

def add(name):
    for n in range(8):
        RecordingSet.load(root / "both").add(noise(RADAR, n), row(f"{name}{n}", name, repetition=n))

def killed(folder, moment):
    left = moment
    def hook(event, arguments):
        nonlocal left
        if event in ("open", "os.rename", "os.remove", "os.mkdir") and str(folder) in str(arguments[0]):
            left -= 1
            if left < 0:
                os.kill(os.getpid(), signal.SIGKILL)
    sys.addaudithook(hook)
    work(folder)

RecordingSet.create(root / "both", CARD)
writers = [status(child) for child in [started(add, name) for name in ("can", "mug")]]
work(root / "undisturbed")
moments = []
for moment in range(1000):
    folder = root / f"set{moment}"
    ended = status(started(killed, folder, moment))
    report = examine(folder) if (folder / "card.yaml").exists() else None
    problems, held = ([str(problem) for problem in report.problems], len(report.rows)) if report else ([], 0)
    status(started(work, folder))
    moments.append([ended, problems, held, files(folder) == files(root / "undisturbed")])
    if ended == 0:
        break
print(json.dumps([writers, moments]))
"""


def test_set_of_two_writers_or_of_a_killed_writer_is_valid_and_can_be_completed(tmp_path: Path) -> None:
    root = Path(__file__).resolve().parents[2]
    done = subprocess.run([sys.executable, "-c", _WRITERS, str(tmp_path)], cwd=root, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    writers, moments = json.loads(done.stdout)
    assert writers == [0, 0]
    report = examine(tmp_path / "both")
    assert (report.problems, len(report.rows)) == ([], 16)
    assert len(moments) > 30
    assert [ended for ended, *_ in moments] == [-signal.SIGKILL] * (len(moments) - 1) + [0]
    assert all(problems == [] for _, problems, *_ in moments)
    assert {held for _, _, held, _ in moments} == {0, 1, 2}
    assert all(same for *_, same in moments)
