"""Decide in which order the workers simulate the recordings of one or more campaigns.

A track is the path of the radar in one room. Recordings along the same track share a set-up (such as the traced room), so a worker
finishes its track before it helps with another track. The order does not change the results: the store holds the same bytes for any number
of workers, even if workers were killed.
"""

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from experiments.campaign.cases import MEASURED, ROVER, TWIN, Case
from experiments.scans import virtual_scan
from radartwin.config.config import Config

Track = tuple[str, str, str, str, int]  # set-up, domain, room, motion, draw
# Processor time in seconds of a track's first recording, which includes the set-up, and of each further one, in the quick profile on
# 2026-11-29 (two busy cores of an Intel Xeon). Only the ratios count, for the order of the tracks and the remaining time.
SECONDS = {
    (MEASURED, "bench"): (37.0, 6.7), (MEASURED, "depth"): (35.0, 7.8), (MEASURED, "lateral"): (55.0, 7.5),
    (TWIN, "bench"): (30.0, 1.2), (TWIN, "depth"): (95.0, 4.2), (TWIN, "lateral"): (18.0, 4.7),
}  # fmt: skip
OTHERS = 1.0, 1.0
CALL_S = 5.0  # the same time of a further simulation


@dataclass(frozen=True)
class RecordingTask:
    """A task for a worker: one recording that the store lacks and that must be simulated."""

    config: Config
    root: Path  # folder of the store
    domain: str
    case: Case
    clean: bool = False  # whether to make only the recording before receiver effects, not the processed recording
    setup: str = ""  # equal for tasks with one room, radar and simulator, also of several configurations


class Schedule:
    """Assign the missing recordings to workers, track by track (a track is the path of the radar in one room)."""

    def __init__(self, tasks: Iterable[RecordingTask]) -> None:
        self.tracks: dict[Track, list[RecordingTask]] = defaultdict(list)
        self._of_worker: dict[int, Track] = {}
        self._begun: set[Track] = set()
        for task in tasks:
            motion = task.case.motion if task.case.motion in ROVER else "bench"
            self.tracks[task.setup, task.domain, task.case.room, motion, task.case.draw].append(task)
        for track_tasks in self.tracks.values():  # recordings at the same distance share the paths of the stand
            track_tasks.sort(key=lambda task: (task.case.motion, task.case.distance_m))

    def next_task(self, worker: int) -> RecordingTask | None:
        """Return the next recording for a worker, or None if no recording is left for which its set-up would be worth the time.

        A worker first receives recordings along its own track (radar path in a room), then recordings along a track that no other worker
        has. The first worker that needs the simulated phone scan of a room computes the scan, while all other workers that need the same
        scan wait. Tracks of the simulation whose room is not shipped, which need a scan, therefore come first. A track that may have to
        wait for the scan of another worker comes last. Among tracks of equal priority, the track that takes the longest comes first.
        """
        last = self._of_worker.pop(worker, None)
        taken = list(self._of_worker.values())
        tracks = [track for track, left in self.tracks.items() if left and (track == last or track not in taken or self._needs_help(track))]
        if not tracks:
            return None

        def rank(track: Track) -> tuple[bool, bool, bool, bool, float]:
            config = self.tracks[track][0].config
            scanned = track[1] == "twin" and not virtual_scan.ships(track[2], config.measured.gap.geometry, config.seed)
            waits = scanned and any(track[1:3] == other[1:3] for other in taken)
            return track != last, track in taken, waits, not scanned, -self._seconds(track)

        track = self._of_worker[worker] = min(tracks, key=rank)
        self._begun.add(track)
        return self.tracks[track].pop(0)

    def _needs_help(self, track: Track) -> bool:
        """Return whether the recordings that are left of a track take longer than its set-up, which a second worker would repeat."""
        first, further = SECONDS.get((track[1], track[3]), OTHERS)
        return further * len(self.tracks[track]) > first - further

    def remaining(self) -> float:
        """Return the expected processor time in seconds of the recordings that no worker has received."""
        return sum(map(self._seconds, self.tracks))

    def _seconds(self, track: Track) -> float:
        first, further = SECONDS.get((track[1], track[3]), OTHERS)
        left = len(self.tracks[track])
        return further * left + (first - further if left and track not in self._begun else 0.0)
