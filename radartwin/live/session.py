"""Answer the newest setting of the live page: first by a draft, then completely when its search, in a second thread, has finished."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable

from radartwin.compiled import own_threads
from radartwin.errors import UserError
from radartwin.live.setting import LiveSetting
from radartwin.live.tracing import LiveAnswer, LiveTracer

RESTS_S = 0.4  # a setting that has not changed for this time is searched completely
NICENESS = 4  # by which the search gives way to the drafts; with 10, other programs at full load would starve it


class Session:
    """Compute answers in threads, and give them, messages of settings that cannot be simulated, and defects to three functions."""

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
        self._news = False  # whether the newest setting, or a search for it, waits for an answer
        self._searching: LiveSetting | None = None  # setting of the search that runs
        self._draft = False  # whether the last answer was a draft
        self._ended = False

    def start(self) -> None:
        for name, step in {"live answers": self._answer_newest, "live search": self._search}.items():
            threading.Thread(target=self._run, args=(step,), name=name, daemon=True).start()

    def request(self, setting: LiveSetting) -> None:
        """Answer this setting next."""
        with self._changed:
            self._wanted, self._news = setting, True
            self._changed.notify_all()

    def end(self) -> None:
        """Give no more answers. A search that runs in compiled code cannot be interrupted."""
        with self._changed:
            self._ended = True
            self._changed.notify_all()

    def _run(self, step: Callable[[], None]) -> None:
        if step == self._search:
            own_threads()
            if sys.platform == "linux":
                os.nice(NICENESS)  # on Linux, of this thread and of those that it starts (nice(2)); elsewhere, of the whole process
        try:
            while not self._ended:
                step()
        except BaseException as error:
            self._crashed(error)

    def _answer_newest(self) -> None:
        """Answer the newest setting. Start the search for a setting that has not changed for RESTS_S since its draft."""
        with self._changed:
            news = self._changed.wait_for(lambda: self._news or self._ended, RESTS_S if self._draft else None)
            setting, self._news = self._wanted, False
        if self._ended or setting is None:
            return
        if news or not self._tracer.needs_search(setting):
            self._draft = self._answer(setting, complete=not news)
            return
        with self._changed:
            self._searching = self._searching or setting
            self._changed.notify_all()

    def _answer(self, setting: LiveSetting, complete: bool) -> bool:
        """Answer a setting. Returns whether the answer is a draft."""
        try:
            answer = self._tracer.answer(setting, complete)
        except UserError as error:
            self._failed(str(error))
            return False
        if not self._ended:
            self._answered(answer)
        return not answer.complete

    def _search(self) -> None:
        """Search for the next setting: first for paths of at most one diffraction, then completely."""
        with self._changed:
            self._changed.wait_for(lambda: self._searching or self._ended)
        for search in (self._tracer.sketch, self._tracer.search):
            if (setting := self._searching) is None or self._ended:
                return
            search(setting)
            with self._changed:
                self._news |= setting is self._wanted and self._draft
                self._changed.notify_all()
        self._searching = None
