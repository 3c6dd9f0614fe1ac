"""A set of recordings on disk: what an experiment is scored against.

    SET/
      card.yaml                  name, licence, units, sensor, who, when, notes
      index.csv                  recording, object, distance_m, room, motion, repetition, trajectory, split; further columns are kept
      recordings/NAME.bin        DCA1000 samples (radartwin/radar/dca1000.py)
      recordings/NAME.json       radar, scale, poses and provenance (radartwin/radar/recording.py)
      trajectories/FILE          the radar's poses, TUM text or CSV; times in seconds from the first frame, or from -start_s
                                 where the index has a column start_s

A folder with a card is a set; all recordings in it are of one radar, at any frame rate. The index is written last: a recording that is in
no row is not part of the set, so a writer may be killed at any moment, and adding the same name again finishes its work.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Collection, Iterator
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from radartwin.errors import InputError, MissingError, OutputError, RecordingError
from radartwin.io import files
from radartwin.recordings.card import CARD, Card
from radartwin.recordings.index import COLUMNS, INDEX, Row, describe, index_text, read_index

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from radartwin.io.progress import Progress
    from radartwin.radar.chirp import Radar
    from radartwin.radar.recording import Recording
    from radartwin.recordings.checks import Problem

RECORDINGS, TRAJECTORIES, LOCK = "recordings", "trajectories", "index.lock"
_SAME_DISTANCE_M = 1e-4  # text rounds


class RecordingSet:
    """A set that can be read and added to; `load` and `create` make one.

    Attributes:
        folder, card: where it is and what it says of itself.
        rows: in the order of the index.

    >>> mugs = RecordingSet.load("set").recordings(object="mug", distance_m=[1.0, 2.0])   # doctest: +SKIP
    """

    def __init__(self, folder: Path, card: Card, rows: list[Row]) -> None:
        self.folder, self.card, self.rows = folder, card, rows

    @classmethod
    def create(cls, folder: str | Path, card: Card) -> RecordingSet:
        """A new set, or the one that is there if it has this very card: the same call continues an interrupted one.

        Raises:
            OutputError: the folder cannot be written, or it holds something else.
            RecordingError: a card with problems, or a set with another card.
        """
        folder, card = Path(folder), Card.of(card.values())  # as it will be read again
        if (folder / CARD).exists():
            found = cls.load(folder)
            if found.card != card:
                keys = [key for key, value in vars(card).items() if getattr(found.card, key) != value]
                raise RecordingError(f"{folder / CARD}: it differs in {', '.join(keys)}; choose another folder, or the same card")
        else:
            if folder.is_dir() and any(not path.name.startswith(".") for path in folder.iterdir()):
                raise OutputError(f"{folder}: it is not empty and no recording set; choose another folder")
            card.save(folder)
        files.drop_stale(folder / LOCK)
        for part in (folder, files.make_folder(folder / RECORDINGS), files.make_folder(folder / TRAJECTORIES)):
            files.sweep(part)
        return cls.load(folder)

    @classmethod
    def load(cls, folder: str | Path) -> RecordingSet:
        """Read card and index; recordings are read when they are asked for.

        Raises:
            MissingError: the folder is missing or no set.
            RecordingError: a card or an index that cannot be used; `radartwin doctor --data FOLDER` lists everything.
        """
        folder = Path(folder)
        if not folder.is_dir():
            raise MissingError(f"{folder}: no such folder; give a recording set")
        card = Card.load(folder)
        rows, found = read_index(folder / INDEX)
        wrong = [f"{folder / CARD}: {line}" for line in card.problems()] + [f"{folder / INDEX}: {line}" for line in found]
        if wrong:
            more = f" (and {len(wrong) - 1} more: radartwin doctor --data {folder})" if len(wrong) > 1 else ""
            raise RecordingError(f"{wrong[0]}{more}")
        return cls(folder, card, rows)

    def __len__(self) -> int:
        return len(self.rows)

    def __iter__(self) -> Iterator[Row]:
        return iter(self.rows)

    def __contains__(self, name: object) -> bool:
        return any(row.recording == name for row in self.rows)

    @property
    def columns(self) -> list[str]:
        """Of the index, the further ones last."""
        return [*COLUMNS, *dict.fromkeys(key for row in self.rows for key in row.extra)]

    @property
    def radar(self) -> Radar:
        """Of all its recordings. Raises MissingError for a set without recordings."""
        if not self.rows:
            raise MissingError(f"{self.folder}: the set has no recordings yet; add some with radartwin import")
        return read_radar_of(self.path(self.rows[0]))

    def path(self, row: Row) -> Path:
        """Of a recording, without suffix."""
        return self.folder / RECORDINGS / row.recording

    def select(self, **wanted: Any) -> list[Row]:
        """Rows with these values: select(object="mug", distance_m=[0.5, 1.0], split="test"); a collection offers alternatives.

        Raises:
            InputError: a column that the index does not have.
        """
        for column in wanted:
            if column not in self.columns:
                raise InputError(f"{self.folder / INDEX}: it has no column {column!r}; columns: {', '.join(self.columns)}")
        return [row for row in self.rows if all(_matches(row.value(column), value) for column, value in wanted.items())]

    def recordings(self, **wanted: Any) -> Iterator[tuple[Row, Recording]]:
        """The selected rows with their recordings, each read when its turn comes. Errors as `select` and `read`.

        Raises:
            MissingError: no recording is of these conditions.
        """
        rows = self.select(**wanted)
        if wanted and not rows:
            conditions = ", ".join(f"{column}={value}" for column, value in wanted.items())
            raise MissingError(f"{self.folder}: it has no recording of {conditions}; see radartwin doctor --data {self.folder}")
        return ((row, self.read(row)) for row in rows)

    def read(self, row: Row) -> Recording:
        """The recording of a row; where its file has no sensor poses, they are those of the row's trajectory.

        Raises:
            MissingError, RecordingError: files that are missing or do not fit together.
        """
        from radartwin.radar.recording import Recording
        from radartwin.recordings.trajectory import course_poses

        recording = Recording.load(self.path(row))
        if recording.sensor_poses is None and row.trajectory:
            path = self.folder / TRAJECTORIES / row.trajectory
            recording.sensor_poses = course_poses(path, row.start_s, recording.num_frames, recording.radar.frame_rate_hz)
        return recording

    def digest(self, row: Row) -> str:
        """32 hexadecimal digits that change with the recording's content, for run keys."""
        from radartwin.radar.recording import recording_files

        total = hashlib.sha256()
        for path in recording_files(self.path(row)):
            with path.open("rb") as stream:
                total.update(hashlib.file_digest(stream, "sha256").digest())
        return total.hexdigest()[:32]

    def course(self, row: Row) -> tuple[Radar, int, NDArray[np.float64] | None]:
        """(radar, frames, poses (F, 4, 4) of a radar that moves or None) of a row, without reading its samples. Errors as `read`."""
        from radartwin.radar.dca1000 import frame_bytes
        from radartwin.radar.description_files import read_json
        from radartwin.radar.recording import recording_files
        from radartwin.recordings.trajectory import course_poses

        radar, (samples, described) = read_radar_of(self.path(row)), recording_files(self.path(row))
        if not samples.is_file():
            raise MissingError(f"{samples}: no such file; a recording is a .bin with its .json beside it")
        frames = samples.stat().st_size // frame_bytes(radar)
        poses = read_json(described).get("sensor_poses")
        if poses is None and row.trajectory:
            return radar, frames, course_poses(self.folder / TRAJECTORIES / row.trajectory, row.start_s, frames, radar.frame_rate_hz)
        return radar, frames, np.asarray(poses, float) if poses is not None and len(poses) == frames > 1 else None

    def add(self, recording: Recording, row: Row, trajectory: str | Path | None = None) -> Row:
        """Write a recording, then its row: whole or not at all. Several processes may add to one set.

        Args:
            trajectory: a file with the radar's poses, copied to trajectories/NAME.suffix.
        Returns:
            The row as it stands in the index.
        Raises:
            InputError: values that no experiment could use, a name or a condition that the set already has, another radar.
            OutputError: the set cannot be written.
        """
        if trajectory is not None:
            trajectory = Path(trajectory)
            row = replace(row, trajectory=f"{row.recording}{trajectory.suffix}")
        if problems := row.problems():
            raise InputError(f"{self.folder}: {problems[0]}")
        with files.lock(self.folder / LOCK):
            current = RecordingSet.load(self.folder)
            for other in current:
                if other.recording.casefold() == row.recording.casefold():
                    raise InputError(f"{self.folder}: it has a recording {other.recording} already; choose another name")
                if other.condition == row.condition:
                    raise InputError(f"{self.folder}: {row.recording} repeats {other.recording} ({describe(row)}); count the repetitions")
            if current.rows and not same_radar(recording.radar, current.radar):
                what = difference(recording.radar, current.radar)
                raise RecordingError(f"{self.folder}: the radar of {row.recording} is not that of the set: {what}; make a set of its own")
            if not (self.folder / INDEX).exists():
                files.write_atomically(self.folder / INDEX, index_text([]))
            if trajectory is not None:
                if not trajectory.is_file():
                    raise MissingError(f"{trajectory}: no such trajectory file")
                files.write_atomically(self.folder / TRAJECTORIES / row.trajectory, trajectory.read_bytes())
            recording.save(self.path(row))
            files.sync(self.folder / RECORDINGS, deep=False)
            self.rows = [*current.rows, row]
            files.write_atomically(self.folder / INDEX, index_text(self.rows))
        return row

    def problems(self, progress: Progress | None = None) -> list[Problem]:
        """Everything that is wrong with the set as it is on disk now, samples included; empty for a good one."""
        from radartwin.recordings.checks import examine

        return examine(self.folder, progress).problems


def read_radar_of(path: Path) -> Radar:
    """The radar of a recording, without its samples. Raises MissingError, RecordingError."""
    from radartwin.radar.chirp import Radar
    from radartwin.radar.description_files import read_json
    from radartwin.radar.recording import recording_files

    described = recording_files(path)[1]
    if not described.is_file():
        raise MissingError(f"{described}: no such file; a recording is a .bin with its .json beside it")
    try:
        return Radar.from_dict(read_json(described).get("radar", {}))
    except (ValueError, TypeError) as error:
        raise RecordingError(f"{described}: {error}") from error


def same_radar(radar: Radar, other: Radar) -> bool:
    """Whether two recordings may be in one set: all but the frame rate is the same, and the name, which is that of a file."""
    return replace(radar, frame_rate_hz=other.frame_rate_hz, name=other.name) == other


def difference(radar: Radar, other: Radar) -> str:
    """The fields but the name in which two radars differ, for people."""
    pairs = {key: (value, getattr(other, key)) for key, value in vars(radar).items() if key != "name" and value != getattr(other, key)}
    return ", ".join(key if len(f"{a}{b}") > 60 else f"{key} {a} instead of {b}" for key, (a, b) in pairs.items())


def _matches(value: Any, wanted: Any) -> bool:
    if isinstance(wanted, Collection) and not isinstance(wanted, str):
        return any(_matches(value, one) for one in wanted)
    if isinstance(value, float) and isinstance(wanted, int | float):
        return math.isclose(value, wanted, abs_tol=_SAME_DISTANCE_M)
    return value == wanted or (isinstance(value, str) and value == str(wanted))
