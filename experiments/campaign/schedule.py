"""The order in which workers make the recordings of campaigns.

Recordings on one track share what is set up along it, so a worker stays on its track before it helps on another. The order does not change
what is stored: the store holds the same bytes for any number of workers, also after kills.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from experiments.campaign.cases import ROVER, Case
from radartwin.config.config import Config

Track = tuple[str, str, str, str]  # setup, domain, room, motion


@dataclass(frozen=True)
class RecordingTask:
    """A recording that is missing in a store.

    Attributes:
        root: folder of the store.
        clean: make only the recording without its receiver, not the processed one.
        setup: name of a setup that several configurations share; without it each configuration has its own.
    """

    config: Config
    root: Path
    domain: str
    case: Case
    clean: bool = False
    setup: str = ""


class Schedule:
    """The recordings still to be made, by track, and the track of each worker."""

    def __init__(self, tasks: Iterable[RecordingTask]) -> None:
        configs: list[Config] = []
        self.tracks: dict[Track, list[RecordingTask]] = defaultdict(list)
        self._of_worker: dict[int, Track] = {}
        for task in tasks:
            if task.config not in configs:
                configs.append(task.config)
            motion = task.case.motion if task.case.motion in ROVER else "bench"
            setup = task.setup or str(configs.index(task.config))
            self.tracks[setup, task.domain, task.case.room, motion].append(task)

    def next_task(self, worker: int) -> RecordingTask | None:
        """The next recording for a worker: from its own track, else from a track without a worker; None at the end.

        The first worker that needs a twin's room scans it while others wait, so tracks with scans come first, one room per worker, and
        among equals the track with the most recordings.
        """
        last = self._of_worker.pop(worker, None)
        tracks = [track for track, tasks in self.tracks.items() if tasks]
        if not tracks:
            return None
        taken = list(self._of_worker.values())

        def rank(track: Track) -> tuple[bool, bool, bool, bool, int]:
            scanned = track[1] == "twin"
            waits = scanned and any(track[1:3] == other[1:3] for other in taken)
            return track != last, track in taken, waits, not scanned, -len(self.tracks[track])

        track = self._of_worker[worker] = min(tracks, key=rank)
        return self.tracks[track].pop(0)
