"""Answer the newest setting of the live page: first by a draft, then completely when its search has finished.

One thread computes the answers, and a second thread searches. A newer setting replaces an older one that has not been answered, so that
the page does not fall behind a drag.
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable

from radartwin.compiled import own_threads
from radartwin.errors import UserError
from radartwin.live.setting import LiveSetting
from radartwin.live.tracing import LiveAnswer, LiveTracer
from radartwin.simulation.flat.room import Searched
from radartwin.simulation.flat.search import Sequences

RESTS_S = 0.4  # a setting that has not changed for this time is searched completely
NICENESS = 4  # by which the search gives way to the drafts; with 10, other programs at full load would starve it


class Session:
    """Compute answers in threads.

    Args:
        tracer: scene and radar.
        answered: function that receives each answer. failed: function that receives the message of a setting that cannot be simulated.
        crashed: function that receives an exception that is a defect of the program; the thread ends after it.
    """

    def __init__(
        self,
        tracer: LiveTracer,
        answered: Callable[[LiveAnswer], object],
        failed: Callable[[str], object],
        crashed: Callable[[BaseException], object],
    ) -> None:
        self._tracer, self._answered, self._failed, self._crashed = tracer, answered, failed, crashed
        self._changed = threading.Condition()
        self._wanted: LiveSetting | None = None  # newest setting
        self._pending = False  # whether the newest setting has not been answered
        self._searching: LiveSetting | None = None  # setting of the search that runs
        self._results: list[tuple[LiveSetting, Searched | None, Sequences]] = []  # results of searches that no answer has used
        self._draft = False  # whether the last answer was a draft
        self._open = False  # whether to complete the last answer when its setting has not changed for RESTS_S
        self._ended = False
        targets = {"live answers": self._run_answers, "live search": self._run_search}
        self._threads = [threading.Thread(target=target, name=name, daemon=True) for name, target in targets.items()]

    def start(self) -> None:
        for thread in self._threads:
            thread.start()

    def request(self, setting: LiveSetting) -> None:
        """Answer this setting next."""
        with self._changed:
            self._wanted, self._pending = setting, True
            self._changed.notify_all()

    def end(self) -> None:
        """Give no more answers. A search that runs in compiled code cannot be interrupted."""
        with self._changed:
            self._ended = True
            self._changed.notify_all()

    def _run_answers(self) -> None:
        self._run(self._step)

    def _run_search(self) -> None:
        if sys.platform == "linux":
            os.nice(NICENESS)  # on Linux, of this thread and of those that it starts (nice(2)); elsewhere, of the whole process
        own_threads()
        self._run(self._search)

    def _run(self, step: Callable[[], None]) -> None:
        try:
            while not self._ended:
                step()
        except BaseException as error:
            self._crashed(error)

    def _step(self) -> None:
        timeout = RESTS_S if self._open else None
        with self._changed:
            self._changed.wait_for(lambda: self._pending or self._results or self._ended, timeout)
            setting, results, pending = self._wanted, self._results, self._pending
            self._results, self._pending = [], False
        if self._ended or setting is None:
            return
        for place, searched, strong in results:
            self._tracer.learn(place, searched, strong)
            pending = pending or place is setting
        if pending:
            self._draft = self._open = self._answer(setting)
        elif results:  # a search for another setting object, which may have the same values as the newest one
            self._open = self._draft
        else:
            self._open = self._complete(setting)

    def _answer(self, setting: LiveSetting, complete: bool = False) -> bool:
        """Answer a setting. Returns whether the answer is a draft."""
        try:
            answer = self._tracer.answer(setting, complete)
        except UserError as error:
            self._failed(str(error))
            return False
        if self._ended:
            return False
        self._answered(answer)
        return not answer.complete

    def _complete(self, setting: LiveSetting) -> bool:
        """Complete the answer to a setting that has not changed for RESTS_S, or start its search. Returns whether another search runs."""
        if not self._tracer.needs_search(setting):
            self._draft = self._answer(setting, complete=True)
            return False
        with self._changed:
            busy = self._searching is not None
            self._searching = self._searching or setting
            self._changed.notify_all()
        return busy

    def _search(self) -> None:
        """Search for the next setting: first for paths of at most one diffraction, then completely."""
        with self._changed:
            self._changed.wait_for(lambda: self._searching or self._ended)
            setting = self._searching
        if self._ended or setting is None:
            return
        self._learned(setting, None, self._tracer.sketch(setting))
        result = self._tracer.search(setting)
        with self._changed:
            self._searching = None
            self._learned(setting, *result)

    def _learned(self, setting: LiveSetting, searched: Searched | None, strong: Sequences) -> None:
        with self._changed:
            self._results.append((setting, searched, strong))
            self._changed.notify_all()
