"""`make setup` compiles the simulator once, and `radartwin demo` does so in a worker, which must find the function that it calls."""

from __future__ import annotations

import pickle
from pathlib import Path
from types import SimpleNamespace
from typing import ClassVar

import pytest

from radartwin.simulation import compile_ahead


class Pool:
    """Take the tasks of a pool as a worker would receive them: pickled by the name of their module."""

    tasks: ClassVar[list[bytes]] = []

    def __init__(self, *_: object, **__: object) -> None: ...

    def submit(self, function: object, *arguments: object) -> SimpleNamespace:
        self.tasks.append(pickle.dumps((function, arguments)))
        return SimpleNamespace(result=lambda: None)

    def end(self) -> None: ...


def test_the_worker_gets_a_function_that_it_can_import(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compile_ahead, "ProcessPool", Pool)
    monkeypatch.setattr(Pool, "tasks", [])
    with compile_ahead.compiling() as finished:
        finished()
    assert [pickle.loads(task) for task in Pool.tasks] == [(compile_ahead.compile_all, ())]


def test_nothing_is_simulated_again_until_a_source_file_changes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    simulated: list[str] = []
    sources = {"digest": "before"}
    monkeypatch.setattr(compile_ahead, "spread", SimpleNamespace(stats=SimpleNamespace(cache_path=str(tmp_path))))
    monkeypatch.setattr(compile_ahead, "_digest", lambda: sources["digest"])
    monkeypatch.setattr(compile_ahead, "_simulate_scenes", lambda: simulated.append(sources["digest"]))
    for digest in ("before", "before", "after", "after"):
        sources["digest"] = digest
        compile_ahead.compile_all()
    assert simulated == ["before", "after"]
