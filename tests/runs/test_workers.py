"""Work shared among processes: the answers of one, whoever gives them, and what is told when one of the processes fails."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from radartwin.errors import BackendError, ConfigError
from radartwin.runs import workers

ITEMS = [(number, number + 1) for number in range(6)]


def product(one: int, other: int) -> tuple[int, int]:
    return one * other, os.getpid()


def refused(one: int, other: int) -> int:
    if one == 3:
        raise ConfigError(f"number {one} is refused")
    return other


def broken(one: int, other: int) -> float:
    return one / (other - 4)


def killed(one: int, other: int) -> int:
    if one == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    return other


def hungry(one: int, other: int) -> int:
    if one == 2:
        raise MemoryError("unable to allocate 8 TiB")
    return other


def test_answers_come_in_the_order_of_the_items_from_one_process_or_several() -> None:
    counted = []
    alone = workers.each(product, ITEMS, 1, lambda: counted.append(1))
    shared = workers.each(product, ITEMS, 2, lambda: counted.append(1))
    assert [value for value, _ in shared] == [value for value, _ in alone] == [one * other for one, other in ITEMS]
    assert {pid for _, pid in alone} == {os.getpid()}
    assert os.getpid() not in {pid for _, pid in shared}
    assert len(counted) == 2 * len(ITEMS)


def test_few_pieces_start_no_process() -> None:
    assert {pid for _, pid in workers.each(product, ITEMS[: workers.LEAST - 1], 2)} == {os.getpid()}
    assert workers.each(product, [], 2) == []


def test_processes_that_are_kept_do_the_next_work_too_and_end_with_it() -> None:
    with workers.kept():
        first = {pid for _, pid in workers.each(product, ITEMS, 2)}
        second = {pid for _, pid in workers.each(product, ITEMS, 2)}
        assert first | second == set(map(_alive, first | second))
        assert len(first | second) <= 2
    for pid in first | second:
        with pytest.raises(ProcessLookupError):
            os.kill(pid, 0)
    assert {pid for _, pid in workers.each(product, ITEMS, 2)}.isdisjoint(first)


def test_a_process_that_died_while_it_waited_is_replaced() -> None:
    with workers.kept():
        for pid in {pid for _, pid in workers.each(product, ITEMS, 2)}:
            os.kill(pid, signal.SIGKILL)
        time.sleep(0.2)
        assert [value for value, _ in workers.each(product, ITEMS, 2)] == [one * other for one, other in ITEMS]


def test_work_whose_cost_is_told_finds_no_process_that_was_kept() -> None:
    def pids(fresh: bool) -> set[int]:
        found: set[int] = set()
        left = iter([(0, 0)] * 4)
        workers.run(told_pid, lambda _: next(left, None), found.add, 2, fresh)
        return found

    with workers.kept():
        before = pids(False)
        assert pids(True).isdisjoint(before)


def told_pid(piece: object, tell: workers.Tell) -> None:
    time.sleep(0.1)
    tell(os.getpid())


def test_processes_end_with_a_parent_that_is_killed_in_the_middle_of_their_work(tmp_path: Path) -> None:
    script = tmp_path / "busy.py"
    script.write_text(
        "import os, sys, time\n"
        "from pathlib import Path\n"
        "from radartwin.runs import workers\n"
        "def busy(number):\n"
        "    (Path(sys.argv[1]) / f'{os.getpid()}.pid').touch()\n"
        "    time.sleep(600)\n"
        "if __name__ == '__main__':\n"
        "    workers.each(busy, [(number,) for number in range(4)], 2)\n"
    )
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).resolve().parents[2])}
    parent = subprocess.Popen([sys.executable, str(script), str(tmp_path)], env=environment)
    end = time.monotonic() + 60
    while len(started := list(tmp_path.glob("*.pid"))) < 2:
        assert time.monotonic() < end
        time.sleep(0.1)
    parent.kill()
    parent.wait()
    while any(Path(f"/proc/{one.stem}").exists() and " Z " not in Path(f"/proc/{one.stem}/stat").read_text() for one in started):
        assert time.monotonic() < end, "a process outlives its parent"
        time.sleep(0.1)


def _alive(pid: int) -> int:
    os.kill(pid, 0)
    return pid


@pytest.mark.parametrize(
    ("function", "error", "words"),
    [
        (refused, ConfigError, "^number 3 is refused$"),
        (broken, RuntimeError, "(?m)^ZeroDivisionError: division by zero$"),
        (killed, BackendError, r"ended \(exit status -9\).*jobs=1"),
        (hungry, BackendError, r"ran out of memory \(unable to allocate 8 TiB\).*jobs=1"),
    ],
)
def test_what_goes_wrong_in_a_process_is_told_here_and_ends_them_all(function, error: type[Exception], words: str) -> None:
    with workers.kept():
        before = {pid for _, pid in workers.each(product, ITEMS, 2)}
        with pytest.raises(error, match=words):
            workers.each(function, ITEMS, 2)
        after = {pid for _, pid in workers.each(product, ITEMS, 2)}
        assert after.isdisjoint(before)
