"""Answer the newest setting of the live page: first by a draft, then completely when its search has finished.

One thread computes the answers. A newer setting replaces an older one that has not been answered, so that the page does not fall behind a
drag.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

from radartwin.errors import UserError
from radartwin.io.process_pool import BrokenProcessPool
from radartwin.live.setting import LiveSetting
from radartwin.live.tracing import LiveAnswer, LiveTracer
from radartwin.live.worker import Found, Searcher

ENDS_WITHIN_S = 1.0
RESTS_S = 0.4  # a setting that has not changed for this time is searched completely


class Session:
    """Compute answers in a thread.

    Args:
        tracer: scene and radar.
        searcher: worker that searches for complete answers; None computes drafts only.
        answered: function that receives each answer. failed: function that receives the message of a setting that cannot be simulated.
        crashed: function that receives an exception that is a defect of the program; the thread ends after it.
        lost: function that is called when the worker has died. The session then gives drafts, and no new complete answers.
    """

    def __init__(
        self,
        tracer: LiveTracer,
        searcher: Searcher | None,
        answered: Callable[[LiveAnswer], object],
        failed: Callable[[str], object],
        crashed: Callable[[BaseException], object],
        lost: Callable[[], object],
    ) -> None:
        self._tracer, self._searcher = tracer, searcher
        self._answered, self._failed, self._crashed, self._lost = answered, failed, crashed, lost
        self._changed = threading.Condition()
        self._wanted: LiveSetting | None = None  # newest setting
        self._pending = False  # whether the newest setting has not been answered
        self._found: list[tuple[LiveSetting, Found | BaseException]] = []  # finished searches that the thread has not used
        self._draft = False  # whether the last answer was a draft
        self._open = False  # whether to complete the last answer when its setting has not changed for RESTS_S
        self._ended = False
        self._thread = threading.Thread(target=self._run, name="live answers", daemon=True)

    def start(self) -> None:
        self._thread.start()

    def request(self, setting: LiveSetting) -> None:
        """Answer this setting next."""
        with self._changed:
            self._wanted, self._pending = setting, True
            self._changed.notify()

    def end(self) -> bool:
        """Give no more answers. Returns whether the thread has ended within ENDS_WITHIN_S; compiled code cannot be interrupted."""
        with self._changed:
            self._ended = True
            self._changed.notify()
        if self._thread.is_alive():
            self._thread.join(ENDS_WITHIN_S)
        return not self._thread.is_alive()

    def _run(self) -> None:
        try:
            while not self._ended:
                self._step()
        except BaseException as error:
            self._crashed(error)

    def _step(self) -> None:
        timeout = RESTS_S if self._open else None
        with self._changed:
            self._changed.wait_for(lambda: self._pending or self._found or self._ended, timeout)
            setting, found, pending = self._wanted, self._found, self._pending
            self._found, self._pending = [], False
        if self._ended:
            return
        for place, result in found:
            if isinstance(result, BrokenProcessPool):
                self._lose_searcher()
                continue
            if isinstance(result, BaseException):
                raise result
            self._tracer.learn(place, *result)
            pending = pending or place is setting
        if setting is None:
            return
        if pending:
            self._draft = self._open = self._answer(setting)
        elif found:  # a search for another setting object, which may have the same values as the newest one
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
        """Start the search for a setting that has not changed for RESTS_S. Returns whether the search could not start, because the worker
        is busy.
        """
        if not self._tracer.needs_search(setting):
            self._draft = self._answer(setting, complete=True)
            return False
        if self._searcher is None:
            return False
        if self._searcher.busy:
            return True
        try:
            self._searcher.submit(setting, self._finished)
        except BrokenProcessPool:
            self._lose_searcher()
        return False

    def _lose_searcher(self) -> None:
        if self._searcher is not None and not self._ended:
            self._searcher = None
            self._lost()

    def _finished(self, setting: LiveSetting, found: Found | BaseException) -> None:
        with self._changed:
            self._found.append((setting, found))
            self._changed.notify()
