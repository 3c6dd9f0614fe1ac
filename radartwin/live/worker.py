"""Search sequences of faces and edges in a process of its own, so that a search of some seconds does not delay the answer to a drag."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import Future
from functools import partial

from radartwin.io.process_pool import ProcessPool
from radartwin.live.setting import LiveSetting
from radartwin.live.tracing import LiveTracer
from radartwin.radar.chirp import Radar
from radartwin.scene.scene import Scene
from radartwin.simulation.flat.room import Searched
from radartwin.simulation.flat.search import Sequences

NICENESS = 4  # the search gives way to the drafts; with 10, other programs at full load would starve it

Found = tuple[Searched | None, Sequences]  # complete search, or None after a first search; strongest sequences for drafts
_tracer: LiveTracer | None = None


class Searcher:
    """Start one worker process that searches for the paths of a room.

    Args:
        room: the room without movable objects. radar: radar whose antenna array and sweep the search uses.
    """

    def __init__(self, room: Scene, radar: Radar) -> None:
        self._pool = ProcessPool(1, import_main=False)
        self._room: tuple[Scene, Radar] | None = (room, radar)  # until the first call sends it to the worker
        self.busy = False

    def submit(self, setting: LiveSetting, done: Callable[[LiveSetting, Found | BaseException], object]) -> None:
        """Search for one setting: first for paths of at most one diffraction, then completely. The caller must wait until `busy` is False
        before the next call.

        Another thread calls `done` with each of the two results, or with an exception.

        Raises:
            BrokenProcessPool: the worker has died.
        """
        self.busy = True
        # The objects do not change the search, and their poses need not be sent.
        bare = LiveSetting(setting.radar_pose, {}, setting.materials, setting.max_bounces)

        def finish(future: Future[Found], last: bool) -> None:
            if last:
                self.busy = False
            if not future.cancelled():
                done(setting, future.exception() or future.result())

        # The room is an argument of the first call. As an argument of the worker's start, the room would block this thread until the worker
        # reads it.
        room, self._room = self._room, None
        self._pool.submit(_sketch, bare, room).add_done_callback(partial(finish, last=False))
        self._pool.submit(_search, bare).add_done_callback(partial(finish, last=True))

    def end(self) -> None:
        """End the worker process, even if it searches."""
        self._pool.end()


def _prepare(room: Scene, radar: Radar) -> None:
    global _tracer
    os.nice(NICENESS)
    _tracer = LiveTracer(room, radar)


def _sketch(setting: LiveSetting, room: tuple[Scene, Radar] | None) -> Found:
    if room is not None:
        _prepare(*room)
    assert _tracer is not None
    return None, _tracer.sketch(setting)


def _search(setting: LiveSetting) -> Found:
    assert _tracer is not None
    return _tracer.search(setting)
