"""The checks of a recording set find every planted problem and report no other problem."""

from __future__ import annotations

import dataclasses
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from made_files import CARD, edit_json, noise

from radartwin.radar.chirp import Radar
from radartwin.radar.recording import Recording
from radartwin.recordings.examine import examine, zero_filled_frames
from radartwin.recordings.index import Row
from radartwin.recordings.recording_set import RecordingSet

RADAR = dataclasses.replace(Radar.iwr1843(), num_samples=128, num_chirps=16)
DRIVE = "t,x,y,z,qx,qy,qz,qw\n0,0,0,0,0,0,0,1\n1,1,0,0,0,0,0,1\n"


def row(name: str, repetition: int = 0, **more) -> Row:
    return Row(name, "mug", 1.0, "lab", "depth", repetition, **more)


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a valid recording set with four recordings a0 to a3, of which a3 has a trajectory."""
    base = tmp_path_factory.mktemp("good")
    made = RecordingSet.create(base / "set", CARD)
    (base / "drive.csv").write_text(DRIVE)
    for n in range(4):
        made.add(noise(RADAR, n), row(f"a{n}", n), base / "drive.csv" if n == 3 else None)
    report = examine(made.folder)
    assert (report.problems, report.notes) == ([], [])
    return made.folder


@pytest.fixture
def folder(good: Path, tmp_path: Path) -> Path:
    return shutil.copytree(good, tmp_path / "set")


def problems(folder: Path) -> str:
    return "\n".join(map(str, examine(folder).problems))


def edit(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))


def rewrite(folder: Path, name: str, change: Callable[[np.ndarray], object]) -> None:
    """Change the samples of a stored recording in place."""
    recording = Recording.load(folder / "recordings" / name)
    change(recording.iq)
    recording.save(folder / "recordings" / name)


def silence(frame: int) -> Callable[[np.ndarray], object]:
    """Return the zeros that the capture card writes for a lost packet: 364 complex samples that start within a chirp."""
    return lambda iq: iq[frame].reshape(-1)[3 * iq.shape[-1] + 17 :][:364].fill(0)


def linked(name: str) -> Callable[[Path], object]:
    """Move a file out of the set, and put a link in its place."""
    return lambda folder: (folder / name).symlink_to((folder / name).rename(folder.parent / "moved"))


def scaled(factor: float) -> Callable[[np.ndarray], object]:
    return lambda iq: np.multiply(iq, factor, out=iq)


def filtered(iq: np.ndarray) -> None:
    """Return noise that is 12 dB weaker just above zero beat frequency, as after a receive filter if I and Q are exchanged."""
    spectrum = np.fft.fft(iq, axis=-1)
    spectrum[..., : round(0.1 * iq.shape[-1])] /= 4
    iq[:] = np.fft.ifft(spectrum, axis=-1)


DAMAGE: dict[str, tuple[Callable[[Path], object], tuple[str, ...]]] = {
    "no card": (lambda f: (f / "card.yaml").unlink(), ("card.yaml", "not a recording set")),
    "a card that is no YAML": (lambda f: (f / "card.yaml").write_text("name: [\n"), ("card.yaml", "line 2")),
    "a card without a licence": (lambda f: edit(f / "card.yaml", "licence: CC-BY-4.0", "licence: ''"), ("licence is missing", "CC-BY")),
    "unknown units": (lambda f: edit(f / "card.yaml", "amplitude", "volts"), ("units 'volts'", "counts or amplitude")),
    "units that the scale contradicts": (lambda f: edit(f / "card.yaml", "amplitude", "counts"), ("a0: its scale 2e-09", "counts")),
    "an index without its columns": (lambda f: edit(f / "index.csv", "distance_m", "distance"), ("line 1: it has no column distance_m",)),
    "a column twice": (lambda f: edit(f / "index.csv", "split", "room"), ("line 1: column room occurs twice",)),
    "an index that is not text": (lambda f: (f / "index.csv").write_bytes(b"\xff\xfe\x00r"), ("index.csv", "UTF-8")),
    "an empty index": (lambda f: (f / "index.csv").write_text(""), ("it is empty", "recording,object")),
    "a quote that does not close": (lambda f: edit(f / "index.csv", "a1,mug", 'a1,"mug'), ("index.csv", "CSV")),
    "a row with a value too few": (lambda f: edit(f / "index.csv", "a1,mug,", "a1,"), ("line 3: it has 7 values for 8 columns",)),
    "a name twice": (lambda f: edit(f / "index.csv", "a1,", "a0,"), ("line 3: recording a0 is already in line 2",)),
    "a condition twice": (lambda f: edit(f / "index.csv", "depth,1", "depth,0"), ("line 3: it repeats line 2", "mug, 1 m, lab, depth")),
    "an unknown motion": (lambda f: edit(f / "index.csv", "depth,1", "walk,1"), ("line 3", "'walk'", "turntable")),
    "a distance in words": (lambda f: edit(f / "index.csv", "mug,1.0", "mug,1 m"), ("line 2", "'1 m' is not a number of metres")),
    "a repetition that is no number": (lambda f: edit(f / "index.csv", "depth,1", "depth,1.5"), ("line 3", "'1.5' is not a whole number")),
    "no samples": (lambda f: (f / "recordings/a1.bin").unlink(), ("recordings/a1: a1.bin: no such file",)),
    "no description": (lambda f: (f / "recordings/a1.json").unlink(), ("recordings/a1: a1.json: no such file",)),
    "truncated samples": (lambda f: (f / "recordings/a1.bin").write_bytes(b"\1" * 70000), ("a1: a1.bin: 70000 bytes", "truncated")),
    "empty samples": (lambda f: (f / "recordings/a1.bin").write_bytes(b""), ("recordings/a1", "zero frames")),
    "a frame too few": (lambda f: edit(f / "recordings/a1.json", '"frames": 4', '"frames": 5'), ("a1", "holds 4 frames", "says 5")),
    "a description that is no JSON": (lambda f: (f / "recordings/a1.json").write_text("{"), ("recordings/a1", "write valid JSON")),
    "another radar": (
        lambda f: edit(f / "recordings/a1.json", '"noise_figure_db": 15.0', '"noise_figure_db": 12.0'),
        ("recordings/a1: its radar differs from the other recordings: noise_figure_db 12.0 instead of 15.0",),
    ),
    "all zero": (lambda f: rewrite(f, "a1", scaled(0)), ("recordings/a1: all samples are zero",)),
    "dead receiver": (lambda f: rewrite(f, "a1", lambda x: x[..., 2, :].fill(0)), ("recordings/a1: no samples from tx 0 rx 2, tx 1 rx 2",)),
    "clipped": (lambda f: rewrite(f, "a1", scaled(10)), ("recordings/a1", "% of the samples are at full scale")),
    "a lost packet": (lambda f: rewrite(f, "a1", silence(2)), ("recordings/a1: 1 of 4 frames", "(frame 2)", "packet delay")),
    "I and Q exchanged": (lambda f: rewrite(f, "a1", filtered), ("recordings/a1: I and Q seem exchanged", "set iq_swapped to true")),
    "a trajectory that is a link": (linked("trajectories/a3.csv"), ("recordings/a3:", "trajectories/a3.csv", "outside this folder")),
    "a recording that is a link": (linked("recordings/a1.bin"), ("recordings/a1:", "recordings/a1.bin", "outside this folder")),
    "no trajectory": (lambda f: (f / "trajectories/a3.csv").unlink(), ("recordings/a3: trajectory a3.csv is not there",)),
    "a trajectory that ends early": (
        lambda f: edit(f / "trajectories/a3.csv", "\n1,1", "\n0.2,1"),
        ("recordings/a3: trajectory a3.csv: it covers 0.000 to 0.200 s, the frames are at 0.000 to 0.300 s",),
    ),
    "a trajectory that begins late": (lambda f: edit(f / "trajectories/a3.csv", "\n0,0", "\n0.1,0"), ("it covers 0.100 to 1.000 s",)),
    "a trajectory with a word": (lambda f: edit(f / "trajectories/a3.csv", "1,1,0", "1,one,0"), ("trajectory a3.csv, line 3",)),
}  # fmt: skip


@pytest.mark.parametrize(("damage", "words"), DAMAGE.values(), ids=DAMAGE)
def test_each_problem_is_found_alone(folder: Path, damage: Callable[[Path], object], words: tuple[str, ...]) -> None:
    damage(folder)
    text = problems(folder)
    assert not [word for word in words if word not in text], text
    # all four recordings have the wrong scale, so that there are four problems
    assert len(text.splitlines()) == (4 if "its scale" in text else 1), text


def test_harmless_findings_are_notes(folder: Path) -> None:
    rewrite(folder, "a0", lambda iq: iq[0, 0, 0, 0, :1].fill(1.0))  # one value of 131072 beyond full scale
    noise(RADAR, 9).save(folder / "recordings" / "left")  # a writer was killed before it wrote the row
    report = examine(folder)
    assert report.problems == []
    notes = "\n".join(map(str, report.notes))
    assert "recordings/a0: 0.00076 % of the samples are at full scale" in notes
    assert "recordings/left.bin: index.csv has no row for it" in notes
    assert len(report.notes) == 3
    keys = ("format", "frames", "saturated", "provenance", "sensor_poses", "iq_swapped")
    edit_json(folder / "recordings" / "a0.json", **dict.fromkeys(keys, ...))
    assert problems(folder) == "", "these keys of a recording are optional"
    empty = examine(RecordingSet.create(folder.parent / "empty", CARD).folder)
    assert (empty.problems, "no recordings yet" in empty.notes[0]) == ([], True)


def test_rare_packet_loss_that_the_log_reports_is_a_note(tmp_path: Path) -> None:
    made = RecordingSet.create(tmp_path / "set", CARD)
    small = dataclasses.replace(RADAR, num_chirps=4)
    for n, lost in enumerate((1, 3)):
        recording = noise(small, n, frames=120)
        for frame in range(lost):
            silence(40 + frame)(recording.iq)
        made.add(recording, row(f"a{n}", n, extra={"lost_packets": str(lost)}))
    report = examine(made.folder)
    assert [str(p) for p in report.notes] == ["recordings/a0: 1 of 120 frames have lost samples, filled with zeros (frame 40)"]
    assert ["a1: 3 of 120 frames" in str(p) for p in report.problems] == [True]


def test_zero_packets_are_found_at_any_start_and_shorter_runs_are_not() -> None:
    recording = noise(RADAR)
    samples = recording.iq[1].reshape(-1)
    original = samples.copy()
    for start in (0, 1, 181, 182, 363, 5000):
        for length, frames in ((364, [1]), (150, [])):
            samples[start : start + length] = 0
            assert zero_filled_frames(recording) == frames, start
            samples[:] = original
