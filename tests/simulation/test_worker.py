"""A child process that answers arrays with arrays, refuses, prints, and dies, without taking its parent along."""

from __future__ import annotations

import io
import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from radartwin.errors import BackendError
from radartwin.simulation.backends import child_process

CHILD = """
import os, sys
from radartwin.errors import BackendError
print("loud on import")
def answer(message):
    print("loud")
    os.write(1, b"from a library\\n")
    what = str(message["what"])
    if what == "refuse":
        raise BackendError("not this one")
    if what == "defect":
        raise ZeroDivisionError("a defect")
    if what == "end":
        print("last words", file=sys.stderr, flush=True)
        os._exit(3)
    return {"twice": 2 * message["values"], "pid": os.getpid()}
"""


@pytest.fixture
def child(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[child_process.Worker]:
    (tmp_path / "told.py").write_text(CHILD)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=os.pathsep)
    one = child_process.shared("told", "the child")
    yield one
    child_process.shared("told", "the child").close()


def test_a_message_comes_out_as_it_went_in() -> None:
    stream = io.BytesIO()
    message = {"a": np.arange(6.0).reshape(2, 3), "b": np.zeros((0, 4), complex), "c": 3, "d": "text", "allow_pickle": True}
    child_process.send(stream, {name: value for name, value in message.items() if name != "allow_pickle"})
    stream.seek(0)
    again = child_process.receive(stream)
    assert again is not None
    assert np.array_equal(again["a"], message["a"])
    assert again["b"].shape == (0, 4)
    assert again["b"].dtype == complex
    assert (int(again["c"]), str(again["d"])) == (3, "text")
    assert child_process.receive(stream) is None


@pytest.mark.parametrize("kept", [0, 5, 20])
def test_a_message_that_breaks_off_is_none(kept: int) -> None:
    stream = io.BytesIO()
    child_process.send(stream, {"a": np.arange(100)})
    assert child_process.receive(io.BytesIO(stream.getvalue()[:kept])) is None


def test_it_answers_whatever_it_prints(child: child_process.Worker) -> None:
    for values in (np.arange(5), np.ones((2, 2)) * 1j, np.zeros(0)):
        answer = child.ask({"what": "answer", "values": values})
        assert np.array_equal(answer["twice"], 2 * values)
    assert int(answer["pid"]) != os.getpid()
    assert child_process.shared("told", "the child") is child


def test_what_it_refuses_is_one_line_and_it_goes_on(child: child_process.Worker) -> None:
    with pytest.raises(BackendError, match=r"^the child: not this one$"):
        child.ask({"what": "refuse"})
    assert int(child.ask({"what": "answer", "values": np.array(2)})["twice"]) == 4


@pytest.mark.parametrize(("what", "words"), [("end", "last words"), ("defect", "ZeroDivisionError: a defect")])
def test_a_child_that_ends_says_why_and_is_started_again(child: child_process.Worker, what: str, words: str) -> None:
    with pytest.raises(BackendError, match=rf"the child: its process ended \({words}\)"):
        child.ask({"what": what})
    assert not child.usable
    other = child_process.shared("told", "the child")
    assert other is not child
    assert int(other.ask({"what": "answer", "values": np.array(2)})["twice"]) == 4


def test_a_fork_starts_its_own(child: child_process.Worker, monkeypatch: pytest.MonkeyPatch) -> None:
    first = int(child.ask({"what": "answer", "values": np.array(1)})["pid"])
    with monkeypatch.context() as other_process:
        other_process.setattr(os, "getpid", lambda: -1)
        assert not child.usable
        child.close()  # not its to end
    assert int(child.ask({"what": "answer", "values": np.array(1)})["pid"]) == first


def test_closing_ends_the_child(child: child_process.Worker) -> None:
    pid = int(child.ask({"what": "answer", "values": np.array(1)})["pid"])
    child.close()
    child.close()
    assert not child.usable
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)
