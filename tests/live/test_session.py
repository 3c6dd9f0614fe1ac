"""The threads that answer settings: the newest wins, a resting setting is completed, errors reach the page, defects end the session."""

from __future__ import annotations

import threading
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from radartwin.errors import SceneError
from radartwin.live import session as module
from radartwin.live.session import Session
from radartwin.live.setting import LiveSetting

PLACE = LiveSetting(np.eye(4))


class Fake:
    """Stand for the tracer, and record what the session asks of it."""

    def __init__(self, error: Exception | None = None) -> None:
        self.asked: list[tuple[LiveSetting, bool]] = []
        self.searched: list[LiveSetting] = []
        self.known: set[int] = set()
        self.shown: list[Any] = []
        self.messages: list[str] = []
        self.crashes: list[BaseException] = []
        self.error = error
        self.hold = threading.Event()
        self.hold.set()
        self.news = threading.Semaphore(0)

    def answer(self, setting: LiveSetting, complete: bool = False) -> Any:
        self.asked.append((setting, complete))
        assert self.hold.wait(10)
        if self.error:
            raise self.error
        return SimpleNamespace(setting=setting, complete=complete or id(setting) in self.known)

    def needs_search(self, setting: LiveSetting) -> bool:
        return id(setting) not in self.known

    def sketch(self, setting: LiveSetting) -> None:
        pass

    def search(self, setting: LiveSetting) -> None:
        self.searched.append(setting)
        self.known.add(id(setting))

    def show(self, answer: Any) -> None:
        self.shown.append(answer)
        self.news.release()

    def fail(self, message: str) -> None:
        self.messages.append(message)
        self.news.release()

    def crash(self, error: BaseException) -> None:
        self.crashes.append(error)
        self.news.release()

    def session(self) -> Session:
        session = Session(self, self.show, self.fail, self.crash)  # type: ignore[arg-type]
        session.start()
        return session

    def wait(self, count: int = 1) -> None:
        for _ in range(count):
            assert self.news.acquire(timeout=10)


@pytest.fixture(autouse=True)
def short_rest(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "RESTS_S", 0.02)


def test_a_setting_at_rest_is_answered_by_a_draft_and_then_completely() -> None:
    fake = Fake()
    session = fake.session()
    session.request(PLACE)
    fake.wait(2)
    while not fake.shown[-1].complete:
        fake.wait()
    session.end()
    assert all(a.setting is PLACE for a in fake.shown)
    assert [a.complete for a in fake.shown] in ([False, True], [False, False, True]), "a better draft may come between"
    assert fake.searched == [PLACE]


def test_a_search_also_completes_an_equal_setting_that_came_while_it_ran() -> None:
    again = replace(PLACE)

    class Interrupted(Fake):
        def search(self, setting: LiveSetting) -> None:
            session.request(again)
            self.known.add(id(again))
            super().search(setting)

    fake = Interrupted()
    session = fake.session()
    session.request(PLACE)
    fake.wait(2)
    while fake.shown[-1].complete is False:
        fake.wait()
    session.end()
    assert fake.shown[-1].setting is again


def test_only_the_newest_of_several_settings_is_answered() -> None:
    fake = Fake()
    fake.hold.clear()
    session = fake.session()
    settings = [replace(PLACE, max_bounces=n) for n in (1, 2, 3)]
    session.request(settings[0])
    while not fake.asked:
        threading.Event().wait(0.005)
    session.request(settings[1])
    session.request(settings[2])
    fake.hold.set()
    fake.wait(2)
    session.end()
    assert [setting.max_bounces for setting, _ in fake.asked][:2] == [1, 3]


def test_a_setting_that_cannot_be_simulated_gives_its_message_and_the_next_one_is_answered() -> None:
    fake = Fake(SceneError("the sensor is inside surface 'cabinet'"))
    session = fake.session()
    session.request(PLACE)
    fake.wait()
    assert fake.messages == ["the sensor is inside surface 'cabinet'"]
    fake.error = None
    session.request(replace(PLACE, max_bounces=1))
    fake.wait()
    session.end()
    assert fake.shown[0].setting.max_bounces == 1
    assert not fake.crashes


@pytest.mark.parametrize("of", ["answer", "search"])
def test_a_defect_ends_the_session_with_its_exception(of: str) -> None:
    class Broken(Fake):
        def search(self, setting: LiveSetting) -> None:
            raise ZeroDivisionError

    fake = Broken(ZeroDivisionError() if of == "answer" else None)
    session = fake.session()
    session.request(PLACE)
    while not fake.crashes:
        fake.wait()
    assert isinstance(fake.crashes[0], ZeroDivisionError)
    session.end()
