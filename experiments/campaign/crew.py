"""Recordings made by several processes at once. Each goes on with what shares a track with its last, then takes over from the others.

What is made does not depend on who makes it, or after what: the store holds the same bytes after any number of processes, kills included.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from experiments.campaign.cases import ROVER, Case
from radartwin.config.config import Config
from radartwin.io.progress import Progress
from radartwin.runs import workers
from radartwin.store.products import Store

if TYPE_CHECKING:
    from experiments.campaign.campaign import Campaign

PIECE = 12  # recordings given out at a time
Track = tuple[str, str, str, str]  # setup, domain, room, motion


@dataclass(frozen=True)
class Wanted:
    """A recording of the campaign of a configuration.

    Attributes:
        root: of the store that it goes to.
        clean: without what features are read from.
        setup: what it sets up, where several configurations set up the same; otherwise each does its own.
    """

    config: Config
    root: Path
    domain: str
    case: Case
    clean: bool = False
    setup: str = ""


class Tracks:
    """What is still to be made, by what shares a track, and who is on which. A `hand` is a process, by whatever names it."""

    def __init__(self, wanted: Sequence[Wanted]) -> None:
        configs: list[Config] = []
        self.left: dict[Track, list[Wanted]] = defaultdict(list)
        self._on: dict[Hashable, Track] = {}
        for one in wanted:
            if one.config not in configs:
                configs.append(one.config)
            motion = one.case.motion if one.case.motion in ROVER else "bench"
            setup = one.setup or str(configs.index(one.config))
            self.left[setup, one.domain, one.case.room, motion].append(one)

    def give(self, hand: Hashable) -> list[Wanted] | None:
        """The next piece of its own track, else of one that nobody is on; None at the end.

        A twin's room is scanned by the first who needs it, and the others wait: so scans come first, each for one process, and what there
        is most of.
        """
        last = self._on.pop(hand, None)
        tracks = [track for track, some in self.left.items() if some]
        if not tracks:
            return None
        taken = list(self._on.values())

        def after(track: Track) -> tuple[bool, bool, bool, bool, int]:
            scanned = track[1] == "twin"
            waits = scanned and any(track[1:3] == other[1:3] for other in taken)
            return track != last, track in taken, waits, not scanned, -len(self.left[track])

        track = self._on[hand] = min(tracks, key=after)
        piece, self.left[track] = self.left[track][:PIECE], self.left[track][PIECE:]
        return piece


def make(wanted: Sequence[Wanted], count: int, made: Callable[[], object], fresh: bool = False) -> None:
    """Make recordings, in `count` processes.

    Args:
        made: called after each recording. fresh: as processes.run.
    Raises:
        as processes.run.
    """
    workers.run(_made, Tracks(wanted).give, lambda _: made(), count, fresh)


def _made(piece: Sequence[Wanted], tell: workers.Tell) -> None:
    for one in piece:
        campaign = _campaign_of(one.config, one.root)
        if one.clean:
            campaign.clean(one.domain, one.case)
        else:
            campaign.process(one.domain, one.case)
        tell(one.case.name)


_last: list[tuple[Config, Path, Campaign]] = []


def _campaign_of(config: Config, root: Path) -> Campaign:
    """The last one again, or a new one."""
    from experiments.campaign.campaign import Campaign

    if not _last or _last[0][:2] != (config, root):
        _last[:] = [(config, root, Campaign(config, Store(root), Progress(quiet=True)))]
    return _last[0][2]
