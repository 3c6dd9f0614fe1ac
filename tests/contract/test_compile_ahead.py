"""`make setup` compiles the simulator by a command, whose workers must find the functions that they compile."""

from __future__ import annotations

import os
import pickle
import runpy
from typing import ClassVar

import pytest

from radartwin.io import process_pool
from radartwin.simulation import compile_ahead


class Future:
    def result(self) -> None:
        """Return at once, as after a compilation."""


class Pool:
    """Take the tasks of a pool as a worker would receive them: pickled by the name of their module."""

    tasks: ClassVar[list[bytes]] = []

    def __init__(self, *_: object, **__: object) -> None: ...

    def submit(self, function: object, *arguments: object) -> Future:
        self.tasks.append(pickle.dumps((function, arguments)))
        return Future()

    def end(self) -> None: ...


def test_the_command_gives_its_workers_functions_that_they_can_import(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(process_pool, "ProcessPool", Pool)
    monkeypatch.setattr(compile_ahead, "ProcessPool", Pool)
    monkeypatch.setattr(Pool, "tasks", [])
    runpy.run_path(os.fspath(compile_ahead.__file__), run_name="__main__")
    assert [pickle.loads(task) for task in Pool.tasks] == [(compile_ahead.compile_all, (False,)), (compile_ahead.compile_all, (True,))]
    assert all(b"__main__" not in task for task in Pool.tasks)
