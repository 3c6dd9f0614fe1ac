"""Read and write a recording set on disk: a folder of recordings that experiments compare with simulations.

    SET/
      card.yaml                  name, licence, units, sensor, who, when, notes
      index.csv                  recording, object, distance_m, room, motion, repetition, trajectory, split, and further columns
      recordings/NAME.bin        DCA1000 samples (radartwin/radar/dca1000.py)
      recordings/NAME.json       radar, scale, poses and provenance (radartwin/radar/recording.py)
      trajectories/FILE          poses of the radar, TUM text or CSV; times in seconds: the first frame is at 0, or at start_s
                                 if the index has a column start_s

A folder is a recording set if it contains a card.yaml. All recordings of a set have the same radar, but may differ in frame rate. A
recording belongs to the set only if the index has a row for it. The row in index.csv is written after the recording's files. If a process
is killed while it writes a recording, the recording's files therefore have no row. To complete the set, add the recording of the same name
again.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Collection, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import InputError, MissingError, OutputError, RecordingError
from radartwin.io import files
from radartwin.radar.chirp import Radar
from radartwin.radar.dca1000 import frame_bytes
from radartwin.radar.description_files import present
from radartwin.radar.recording import Recording, read_described, recording_files
from radartwin.recordings.card import CARD, Card
from radartwin.recordings.examine import difference, frame_poses, same_radar
from radartwin.recordings.index import COLUMNS, INDEX, RECORDINGS, TRAJECTORIES, Row, describe, index_text, read_index
from radartwin.scene.trajectories.file import read_track

LOCK = "index.lock"
_SAME_DISTANCE_M = 1e-4  # distances that differ by at most this count as equal, because the index stores rounded distances


class RecordingSet:
    """A folder of recordings with an index and a data card. Use `load` or `create` to make an instance.

    Attributes:
        folder: folder of the recording set.
        card: data card of the recording set.
        rows: rows of the index, one per recording, in the order of the index.

    >>> mugs = RecordingSet.load("set").recordings(object="mug", distance_m=[1.0, 2.0])   # doctest: +SKIP
    """

    def __init__(self, folder: Path, card: Card, rows: list[Row]) -> None:
        self.folder, self.card, self.rows = folder, card, rows

    @classmethod
    def create(cls, folder: str | Path, card: Card) -> RecordingSet:
        """Create a recording set, or open an existing set with the same data card, so that an interrupted import can continue.

        Raises:
            OutputError: the folder cannot be written, or it contains files that belong to no recording set.
            RecordingError: the data card has invalid values, or the existing set has another data card.
        """
        folder, card = Path(folder), Card.of(card.values())  # convert the values to text, as `load` does
        if (folder / CARD).exists():
            existing = cls.load(folder)
            if existing.card != card:
                keys = [key for key, value in vars(card).items() if getattr(existing.card, key) != value]
                raise RecordingError(f"{folder / CARD}: the card differs in {', '.join(keys)}; choose another folder, or the same card")
        else:
            if folder.is_dir() and any(not path.name.startswith(".") for path in folder.iterdir()):
                raise OutputError(f"{folder}: not empty and not a recording set; choose another folder")
            card.save(folder)
        files.drop_stale(folder / LOCK)
        for part in (folder, files.make_folder(folder / RECORDINGS), files.make_folder(folder / TRAJECTORIES)):
            files.sweep(part)
        return cls.load(folder)

    @classmethod
    def load(cls, folder: str | Path) -> RecordingSet:
        """Open a recording set: read its data card and its index. A recording is read only when it is used.

        Raises:
            MissingError: the folder does not exist or is not a recording set.
            RecordingError: the data card or the index is invalid; `radartwin doctor --data FOLDER` lists all problems.
        """
        folder = Path(folder)
        if not folder.is_dir():
            raise MissingError(f"{folder}: no such folder; give a recording set")
        card = Card.load(folder)
        rows, index_problems = read_index(folder / INDEX)
        problems = [f"{folder / CARD}: {line}" for line in card.problems()] + [f"{folder / INDEX}: {line}" for line in index_problems]
        if problems:
            more = f" (and {len(problems) - 1} more: radartwin doctor --data {folder})" if len(problems) > 1 else ""
            raise RecordingError(f"{problems[0]}{more}")
        return cls(folder, card, rows)

    def __len__(self) -> int:
        return len(self.rows)

    def __iter__(self) -> Iterator[Row]:
        return iter(self.rows)

    def __contains__(self, name: object) -> bool:
        return any(row.recording == name for row in self.rows)

    @property
    def columns(self) -> list[str]:
        """Names of the index columns: first the standard columns, then the further columns."""
        return [*COLUMNS, *dict.fromkeys(key for row in self.rows for key in row.extra)]

    @property
    def radar(self) -> Radar:
        """The radar of all recordings in the set. Raises MissingError if the set contains no recordings."""
        if not self.rows:
            raise MissingError(f"{self.folder}: the set has no recordings yet; add some with radartwin import")
        return read_described(self.path(self.rows[0]))[0]

    def path(self, row: Row) -> Path:
        """Return the path of the files of a row's recording, without the suffix .bin or .json. Raise InputError if a file is a link that
        leads out of the set.
        """
        for suffix in (".bin", ".json"):
            files.inside(self.folder, f"{RECORDINGS}/{row.recording}{suffix}")
        return self.folder / RECORDINGS / row.recording

    def select(self, **conditions: Any) -> list[Row]:
        """Return the index rows that have the given value in each given column; a list of values allows each of them.

        Example: select(object="mug", distance_m=[0.5, 1.0], split="test").

        Raises:
            InputError: the index does not have one of the columns.
        """
        for column in conditions:
            if column not in self.columns:
                raise InputError(f"{self.folder / INDEX}: it has no column {column!r}; columns: {', '.join(self.columns)}")
        return [row for row in self.rows if all(_matches(row.value(column), value) for column, value in conditions.items())]

    def recordings(self, **conditions: Any) -> Iterator[tuple[Row, Recording]]:
        """Yield each selected row with its recording, which is read only when the loop reaches it. Raise the errors of `select` and `read`.

        Raises:
            MissingError: no recording has the given values.
        """
        rows = self.select(**conditions)
        if conditions and not rows:
            given = ", ".join(f"{column}={value}" for column, value in conditions.items())
            raise MissingError(f"{self.folder}: no recording of {given}; see radartwin doctor --data {self.folder}")
        return ((row, self.read(row)) for row in rows)

    def read(self, row: Row) -> Recording:
        """Read the recording of an index row. If its files contain no sensor poses, the poses come from the row's trajectory file.

        Raises:
            MissingError, RecordingError: files of the recording are missing or do not belong together.
        """
        recording = Recording.load(self.path(row))
        if recording.sensor_poses is None and row.trajectory:
            recording.sensor_poses = self._driven(row, recording.radar, recording.num_frames)
        return recording

    def _driven(self, row: Row, radar: Radar, frames: int) -> NDArray[np.float64]:
        """Return the poses (F, 4, 4) of a recording from its trajectory file."""
        path = files.inside(self.folder, f"{TRAJECTORIES}/{row.trajectory}")
        return frame_poses(path, row.start_s, frames, radar.frame_rate_hz)

    def digest(self, row: Row) -> str:
        """Return 32 hexadecimal digits that change with the content of the recording.

        Keys of stored results include the digits of `digest`.
        """
        total = hashlib.sha256()
        for path in recording_files(self.path(row)):
            with path.open("rb") as stream:
                total.update(hashlib.file_digest(stream, "sha256").digest())
        return total.hexdigest()[:32]

    def course(self, row: Row) -> tuple[Radar, int, NDArray[np.float64] | None]:
        """Return the radar, the number of frames, and the radar's poses (F, 4, 4) of a recording, without reading its samples.

        The returned poses are None for a radar at rest. The method `course` raises the same errors as `read`.
        """
        radar, content = read_described(self.path(row))
        frames = present(recording_files(self.path(row))[0]).stat().st_size // frame_bytes(radar)
        poses = content.get("sensor_poses")
        if poses is None and row.trajectory:
            return radar, frames, self._driven(row, radar, frames)
        return radar, frames, np.asarray(poses, float) if poses is not None and len(poses) == frames > 1 else None

    def add(self, recording: Recording, row: Row, trajectory: str | Path | None = None) -> Row:
        """Add a recording and its index row to the set, completely or not at all.

        Several processes may add to one recording set at the same time.

        Args:
            recording: the recording to add.
            row: conditions of the recording.
            trajectory: file with the poses of the radar, which is copied to trajectories/NAME.suffix; None for no file.
        Returns:
            The index row of the recording as index.csv stores it.
        Raises:
            InputError: the row is invalid, another recording of the set has the same name or conditions, or the radar differs.
            MissingError, PoseError: the trajectory file is missing or unreadable.
            OutputError: the recording set cannot be written.
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
                    raise InputError(f"{self.folder}: the set already has a recording {other.recording}; choose another name")
                if other.condition == row.condition:
                    raise InputError(f"{self.folder}: {row.recording} repeats {other.recording} ({describe(row)}); give another repetition")
            if current.rows and not same_radar(recording.radar, current.radar):
                fields = difference(recording.radar, current.radar)
                raise RecordingError(f"{self.folder}: the radar of {row.recording} differs from the set: {fields}; make a separate set")
            if not (self.folder / INDEX).exists():
                files.write_atomically(self.folder / INDEX, index_text([]))
            if trajectory is not None:
                read_track(present(trajectory))
                files.write_atomically(self.folder / TRAJECTORIES / row.trajectory, trajectory.read_bytes())
            recording.save(self.path(row))
            files.sync(self.folder / RECORDINGS, deep=False)
            self.rows = [*current.rows, row]
            files.write_atomically(self.folder / INDEX, index_text(self.rows))
        return row


def _matches(value: Any, condition: Any) -> bool:
    if isinstance(condition, Collection) and not isinstance(condition, str):
        return any(_matches(value, alternative) for alternative in condition)
    if isinstance(value, float) and isinstance(condition, int | float):
        return math.isclose(value, condition, abs_tol=_SAME_DISTANCE_M)
    return value == condition or (isinstance(value, str) and value == str(condition))
