"""Import captures from other tools into a recording set.

A capture is a raw .bin file of the DCA1000 (with .mmwave.json and LogFile.csv beside it, possibly in several parts), a .npy or .npz cube,
the radar of a roverd trace (radartwin/radar/roverd.py), or a recording of this package. The recording conditions of a capture (object,
distance and so on) come from values that hold for all captures, from a mapping file (radartwin/recordings/mapping.py), or from both.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from radartwin.errors import InputError, MissingError, RecordingError
from radartwin.io.files import inside
from radartwin.io.progress import Progress
from radartwin.radar import dca1000, roverd
from radartwin.radar.captures import CUBES, few, load_capture
from radartwin.radar.chirp import Radar
from radartwin.radar.description_files import present
from radartwin.radar.recording import Recording
from radartwin.radar.word_order import FULL_SCALE
from radartwin.recordings.card import CARD, KEYS, Card
from radartwin.recordings.index import Row, describe, row_of
from radartwin.recordings.mapping import CaptureMap, columns_of
from radartwin.recordings.recording_set import RecordingSet
from radartwin.scene.trajectories.file import read_track


@dataclass(frozen=True)
class Plan:
    """One capture to import: its first file, the index row with its recording conditions, and its trajectory file."""

    capture: Path
    row: Row
    trajectory: Path | None


def import_captures(
    source: str | Path,
    out: str | Path,
    values: Mapping[str, Any] | None = None,
    mapping: CaptureMap | None = None,
    *,
    radar: Radar | str | Path | None = None,
    frames: slice = slice(None),
    progress: Progress | None = None,
    say: Callable[[str], None] = lambda line: None,
    **options: Any,
) -> tuple[RecordingSet, list[Row]]:
    """Import every capture of a file or folder into a new or existing recording set. Captures whose name and conditions are already in the
    set are skipped.

    Index rows and data card are checked before the first capture is read. A new recording set is created after the first capture is read.

    Args:
        source: a capture file, or a folder of captures.
        out: folder of the recording set.
        values: values for the data card of a new set, and values of index columns that hold for all captures. Entries of the mapping
            file override these columns.
        mapping: content of the mapping file, see `radartwin.recordings.mapping`.
        radar: radar or radar file of all captures; None reads the radar description file beside each capture.
        frames: the frames of each capture to import, as a slice without a step.
        progress: progress display.
        say: function that receives notes on a capture as text, such as the board, lost packets, missing frames or a missing log.
        options: board, iq_swapped and cut, as for `load_capture`.
    Returns:
        The recording set, and the rows that were added to its index.
    Raises:
        MissingError: a capture or a radar description is missing, or an entry of the mapping file matches no capture.
        PoseError: a trajectory file is unreadable.
        InputError: an index row is invalid, a trajectory of the mapping file is outside the source folder, the set holds a recording of the
            same name with other conditions, or the data card is incomplete.
        RecordingError: a capture cannot be read, or has another radar or other units than the recording set. The recording set then
            contains all captures that were imported before the wrong capture.
    """
    source, out, mapping, values = Path(source), Path(out), mapping or CaptureMap(), dict(values or {})
    shared = {key: value for key, value in values.items() if key not in KEYS}
    target = RecordingSet.load(out) if (out / CARD).exists() else None
    plans = plan(source, shared, mapping, say)
    card = _card(out, {**mapping.card, **{key: value for key, value in values.items() if key in KEYS}}, target)
    stored = {row.recording: row for row in target or ()}
    for item in plans:
        row = stored.get(item.row.recording, item.row)
        if row.condition != item.row.condition:
            held = f"{out} holds another recording {row.recording} ({describe(row)})"
            raise InputError(f"{item.capture}: {held}; add recording=NAME to the command or to a mapping file")
    missing = [item for item in plans if item.row.recording not in stored]
    if len(missing) < len(plans):
        say(f"{len(plans) - len(missing)} of {len(plans)} captures are already in {out}")
    added, said = [], set()
    for item in (progress or Progress(quiet=True)).over(missing, "captures"):
        recording, columns, notes = read_capture(item.capture, radar, frames=frames, **options)
        for note in notes:
            line = note if note.startswith("board: ") else f"{item.row.recording}: {note}"
            if line not in said:
                say(line)
            said.add(line)
        if (card.units == "counts") != (recording.scale == 1.0):
            kind = "counts of an ADC" if recording.scale == 1.0 else "amplitudes"
            raise RecordingError(f"{item.capture}: its samples are {kind}, but the card has units={card.units}; make a separate set")
        target = target or RecordingSet.create(out, card)
        extra = {**columns, **item.row.extra}
        if item.trajectory and frames.start:
            extra["start_s"] = repr(item.row.start_s + frames.start / recording.radar.frame_rate_hz)
        added.append(target.add(recording, replace(item.row, extra=extra), item.trajectory))
    assert target is not None  # the recording set existed before, or the first capture created it
    return target, added


def key_values(words: Iterable[str]) -> dict[str, str]:
    """Return KEY=VALUE words as a mapping. Raise InputError for a word of another form, or for a key that is given twice."""
    out: dict[str, str] = {}
    for word in words:
        key, separator, value = word.partition("=")
        if not (separator and key.isidentifier()):
            raise InputError(f"'{word}' is not KEY=VALUE; write object=mug or licence=CC-BY-4.0, for example")
        if key in out:
            raise InputError(f"{key} is given twice, as {out[key]} and {value}; give it once")
        out[key] = value
    return out


def plan(source: Path, shared: Mapping[str, Any], mapping: CaptureMap, say: Callable[[str], None] = lambda line: None) -> list[Plan]:
    """List the captures to import. Missing repetition numbers are assigned by counting in the order of the file names.

    The function `plan` raises the same errors as `import_captures`.
    """
    captures, root = find_captures(source), source if source.is_dir() else source.parent
    columns_per_capture = columns_of(captures, root, mapping.entries)
    if skipped := [capture for capture, columns in zip(captures, columns_per_capture, strict=True) if columns is None]:
        say(f"{len(skipped)} of {len(captures)} captures match no entry of the mapping and are skipped: {few([p.name for p in skipped])}")
    plans: list[Plan] = []
    counted: Counter[tuple[Any, ...]] = Counter()
    for capture, columns in zip(captures, columns_per_capture, strict=True):
        if columns is None:
            continue
        given = {"recording": _name(capture, root), "distance_m": "", **shared, **columns}
        trajectory = given.pop("trajectory", "")
        try:
            row = row_of(given)
        except InputError as error:
            raise InputError(f"{capture}: {error}; give it as COLUMN=VALUE or in a mapping file") from error
        if "repetition" not in given:
            condition = row.condition
            row = replace(row, repetition=counted[condition])
            counted[condition] += 1
        for other in plans:
            if row.recording == other.row.recording or row.condition == other.row.condition:
                same = "name" if row.recording == other.row.recording else "object, distance, room, motion and repetition"
                raise InputError(f"{capture}: it has the same {same} as {other.capture}; give different values in a mapping file")
        if "trajectory" in columns:
            inside(root, trajectory)
        if trajectory:
            read_track(present(root / trajectory, f"give the path of a trajectory relative to {root}"))
        plans.append(Plan(capture, row, root / trajectory if trajectory else None))
    return plans


def find_captures(source: Path) -> list[Path]:
    """Find the captures in a folder and its subfolders. A capture in several parts is listed as its first part.

    If `source` is a file, the list contains only this file. MissingError is raised if there is no capture.
    """
    if not source.is_dir():
        if not source.is_file():
            raise MissingError(f"{source}: no such capture; give a .bin, .npy or .npz file, or a folder of them")
        return [dca1000.parts(source)[0]]
    names = ("*.bin", *(f"*{suffix}" for suffix in CUBES), roverd.CHANNEL)
    files = sorted(path for name in names for path in source.rglob(name) if not _hidden(path.relative_to(source)))
    if not files:
        raise MissingError(f"{source}: the folder has no .bin and no .npy, .npz or roverd channel iq; give a folder of captures")
    return list(dict.fromkeys(dca1000.parts(path)[0] for path in files))


def read_capture(
    capture: Path, radar: Radar | str | Path | None = None, *, frames: slice = slice(None), **options: Any
) -> tuple[Recording, dict[str, str], list[str]]:
    """Read the frames `frames` of a capture. Return the recording, further index columns for it, and notes on it (one line of text each).

    The arguments `options` are those of `load_capture` (board, iq_swapped, cut), and the function raises its errors.
    """
    notes: list[str] = []
    recording = load_capture(capture, radar, frames=frames, say=notes.append, **options)
    provenance = recording.provenance
    if not {"frames", "log"} & provenance.keys() or capture.suffix in CUBES:
        if recording.scale == 1.0 and not _whole(recording):
            recording.scale = None  # with None, saving scales the samples to their peak, so that rounding to int16 loses little
        return recording, {}, notes
    if (log := provenance.get("log")) is None:
        return recording, {}, ["it has no LogFile.csv, so the number of lost packets is unknown", *notes]
    return recording, {"started": log["started"] or "", "lost_packets": str(log["lost"])}, notes


def _card(out: Path, values: Mapping[str, Any], target: RecordingSet | None) -> Card:
    """Return the data card: that of the existing recording set, if `values` do not contradict it, or a new data card from `values`."""
    if target is not None:
        for key in sorted(values.keys() & KEYS):
            value = values[key]
            if (has := getattr(target.card, key)) != getattr(Card.of({key: value}), key):
                raise InputError(f"{out / CARD} has {key}={has}, not {value}; change the card, or choose another folder")
        return target.card
    card = Card.of({"name": out.name, "units": "counts", **values})
    if problems := card.problems():
        raise InputError(f"{out / CARD}: {'; '.join(problems)}; give it as KEY=VALUE or under card in a mapping file")
    return card


def _whole(recording: Recording) -> bool:
    """Return whether all samples are whole numbers in the int16 range, like the counts of an ADC."""
    blocks = (recording.iq[block].view(np.float32) for block in recording.frame_blocks())
    return all(np.array_equal(part, np.rint(part)) and np.abs(part).max() <= FULL_SCALE + 1 for part in blocks)


def _hidden(relative: Path) -> bool:
    """Return whether a path names a hidden file, or a file in a folder of processed data of a roverd trace, whose name begins with _."""
    return relative.name.startswith(".") or (relative.suffix == ".npz" and any(part.startswith("_") for part in relative.parent.parts))


def _name(capture: Path, root: Path) -> str:
    """Make a valid recording name from the capture's path relative to the folder `root`, or from the path of the roverd trace."""
    relative = capture.relative_to(root).with_name(dca1000.capture_prefix(capture))
    if capture.name == roverd.CHANNEL:
        trace = capture.resolve().parent.parent
        relative = Path(trace.name) if trace in (root.resolve(), *root.resolve().parents) else trace.relative_to(root.resolve())
    return re.sub(r"[^A-Za-z0-9._-]+", "_", "_".join(relative.parts)).lstrip("._-")
