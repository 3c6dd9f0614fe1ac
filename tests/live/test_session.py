"""The thread that answers settings: the newest wins, a resting setting is completed, errors reach the page, defects end the session."""

from __future__ import annotations

import threading
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from radartwin.errors import SceneError
from radartwin.io.process_pool import BrokenProcessPool
from radartwin.live import session as module
from radartwin.live.session import Session
from radartwin.live.setting import LiveSetting

PLACE = LiveSetting(np.eye(4))


class Fake:
    """Stand for tracer and searcher, and record what the session asks of them."""

    def __init__(self, error: Exception | None = None) -> None:
        self.asked: list[tuple[LiveSetting, bool]] = []
        self.searched: list[LiveSetting] = []
        self.known: set[int] = set()
        self.shown: list[Any] = []
        self.messages: list[str] = []
        self.crashes: list[BaseException] = []
        self.losses = 0
        self.error, self.busy = error, False
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

    def learn(self, setting: LiveSetting, *found: object) -> None:
        self.known.add(id(setting))

    def submit(self, setting: LiveSetting, done: Any) -> None:
        self.searched.append(setting)
        threading.Thread(target=done, args=(setting, ("searched", "strong"))).start()

    def show(self, answer: Any) -> None:
        self.shown.append(answer)
        self.news.release()

    def fail(self, message: str) -> None:
        self.messages.append(message)
        self.news.release()

    def crash(self, error: BaseException) -> None:
        self.crashes.append(error)
        self.news.release()

    def lose(self) -> None:
        self.losses += 1
        self.news.release()

    def session(self) -> Session:
        session = Session(self, self, self.show, self.fail, self.crash, self.lose)  # type: ignore[arg-type]
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
    assert session.end()
    assert [(a.setting is PLACE, a.complete) for a in fake.shown] == [(True, False), (True, True)]
    assert fake.searched == [PLACE]


def test_a_search_also_completes_an_equal_setting_that_came_while_it_ran() -> None:
    again = replace(PLACE)

    class Interrupted(Fake):
        def submit(self, setting: LiveSetting, done: Any) -> None:
            session.request(again)
            self.known.add(id(again))
            super().submit(setting, done)

    fake = Interrupted()
    session = fake.session()
    session.request(PLACE)
    fake.wait(2)
    while fake.shown[-1].complete is False:
        fake.wait()
    assert session.end()
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
    assert session.end()
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
    assert session.end()
    assert fake.shown[0].setting.max_bounces == 1
    assert not fake.crashes


def test_a_defect_ends_the_session_with_its_exception() -> None:
    fake = Fake(ZeroDivisionError())
    session = fake.session()
    session.request(PLACE)
    fake.wait()
    assert isinstance(fake.crashes[0], ZeroDivisionError)
    assert session.end()


@pytest.mark.parametrize("dies", ["during a search", "before a search"])
def test_drafts_go_on_when_the_search_worker_has_died(dies: str) -> None:
    class Dead(Fake):
        def submit(self, setting: LiveSetting, done: Any) -> None:
            if dies == "before a search":
                raise BrokenProcessPool
            for _ in range(2):
                done(setting, BrokenProcessPool())

    fake = Dead()
    session = fake.session()
    session.request(PLACE)
    fake.wait(2)
    again = replace(PLACE)
    session.request(again)
    fake.wait()
    assert session.end()
    assert (fake.losses, fake.crashes) == (1, [])
    assert [(a.setting, a.complete) for a in fake.shown] == [(PLACE, False), (again, False)]
