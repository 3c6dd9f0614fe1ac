"""What an experiment is scored against, wherever it comes from.

An experiment asks for rows and recordings by object, distance, room, motion and the other columns of the index, and never learns whether
people or the virtual testbed made them. Both providers read a recording set (radartwin/measured/recording_set.py); the testbed writes
its own first.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

from radartwin.errors import MissingError
from radartwin.measured.index import Row
from radartwin.measured.recording_set import RecordingSet

if TYPE_CHECKING:
    from radartwin.radar.chirp import Radar
    from radartwin.radar.recording import Recording


@runtime_checkable
class Measured(Protocol):
    """One measured domain."""

    @property
    def domain(self) -> str:
        """For the tables' column of that name: recordings, testbed."""
        ...

    @property
    def radar(self) -> Radar:
        """Of all recordings; what the twin simulates with."""
        ...

    def rows(self, **wanted: Any) -> list[Row]:
        """What was recorded under these conditions, e.g. rows(object="mug", distance_m=1.0, room="lab", motion="turntable").

        Raises:
            InputError: a column that the set does not have.
        """
        ...

    def recordings(self, **wanted: Any) -> Iterator[tuple[Row, Recording]]:
        """The same rows with their recordings, one in memory at a time.

        Raises:
            MissingError: no recording is of these conditions.
        """
        ...

    def key(self, row: Row) -> str:
        """32 hexadecimal digits that change with the recording's content, for run keys."""
        ...


class SetProvider:
    """A recording set on disk as a measured domain."""

    def __init__(self, folder: str | Path, domain: str = "recordings") -> None:
        """Raises MissingError, RecordingError where the folder is no set that can be used."""
        self.set = RecordingSet.load(folder)
        self.domain = domain

    @property
    def radar(self) -> Radar:
        return self.set.radar

    def rows(self, **wanted: Any) -> list[Row]:
        return self.set.select(**wanted)

    def recordings(self, **wanted: Any) -> Iterator[tuple[Row, Recording]]:
        rows = self.rows(**wanted)
        if not rows:
            conditions = ", ".join(f"{column}={value}" for column, value in wanted.items()) or "any condition"
            raise MissingError(f"{self.set.folder}: it has no recording of {conditions}; see radartwin doctor --data {self.set.folder}")
        return ((row, self.set.read(row)) for row in rows)

    def key(self, row: Row) -> str:
        from radartwin.radar.recording import recording_files

        total = hashlib.sha256()
        for path in recording_files(self.set.path(row)):
            with path.open("rb") as stream:
                total.update(hashlib.file_digest(stream, "sha256").digest())
        return total.hexdigest()[:32]
