"""Work in several processes gives the results of work in a single process, and the parent process reports a failing worker."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import numpy as np
import pytest
from processes import runs

from radartwin.errors import BackendError, ConfigError
from radartwin.runs import workers
from radartwin.store import products
from radartwin.store.products import Store, save_arrays

ITEMS = [(number, number + 1) for number in range(6)]


def product(one: int, other: int) -> tuple[int, int]:
    return one * other, os.getpid()


def failing(one: int, how: str) -> int:
    if one == 3:
        raise {"refused": ConfigError("number 3 is refused"), "hungry": MemoryError("unable to allocate 8 TiB")}[how]
    return one


def broken(one: int, zero: int) -> float:
    return one / zero


def killed(one: int, number: int) -> None:
    os.kill(os.getpid(), number)


def pids() -> set[int]:
    return {pid for _, pid in workers.each(product, ITEMS, 2)}


def test_results_come_in_the_order_of_the_items_from_one_process_or_several() -> None:
    counted = []
    alone = workers.each(product, ITEMS, 1, lambda: counted.append(1))
    shared = workers.each(product, ITEMS, 2, lambda: counted.append(1))
    assert [value for value, _ in shared] == [value for value, _ in alone] == [one * other for one, other in ITEMS]
    assert {pid for _, pid in alone} == {os.getpid()}
    assert os.getpid() not in {pid for _, pid in shared}
    assert len(counted) == 2 * len(ITEMS)


def test_few_items_start_no_worker() -> None:
    assert {pid for _, pid in workers.each(product, ITEMS[: workers.FEWEST_ITEMS - 1], 2)} == {os.getpid()}
    assert workers.each(product, [], 2) == []


def test_reused_workers_do_the_next_task_and_end_afterwards() -> None:
    with workers.reused():
        both = pids() | pids()
        assert len(both) <= 2
        assert all(runs(pid) for pid in both)
    assert not any(runs(pid) for pid in both)
    assert pids().isdisjoint(both)


def test_workers_that_hold_much_memory_are_not_reused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workers, "IDLE_BYTES", 1.0)
    with workers.reused():
        assert pids().isdisjoint(pids())


def test_workers_that_died_while_they_waited_are_replaced() -> None:
    with workers.reused():
        for pid in pids():
            os.kill(pid, signal.SIGKILL)
        time.sleep(0.2)
        assert [value for value, _ in workers.each(product, ITEMS, 2)] == [one * other for one, other in ITEMS]


def test_run_times_are_measured_in_fresh_workers() -> None:
    def used(fresh: bool) -> set[int]:
        found: set[int] = set()
        waiting = iter([()] * 4)
        workers.run(slow_pid, lambda _: next(waiting, None), found.add, 2, fresh)
        return found

    with workers.reused():
        before = used(False)
        assert used(True).isdisjoint(before)


def slow_pid() -> int:
    time.sleep(0.1)
    return os.getpid()


def test_each_worker_gets_calls_by_its_number() -> None:
    waiting, found = {0: [(0, 0)] * 3, 1: [(1, 0)] * 3}, []
    workers.run(product_slowly, lambda worker: waiting[worker].pop() if waiting[worker] else None, found.append, 2)
    assert sorted(found) == [0, 0, 0, 1, 1, 1]


def product_slowly(one: int, other: int) -> int:
    time.sleep(0.05)
    return one


def build(root: Path, seed: int) -> bool:
    return Store(root).fetch("recording", {"seed": seed}, ["radartwin.constants"], lambda f: save_arrays(f, {"x": np.ones(3)})).reused


def test_products_that_workers_build_are_counted_in_the_parent(tmp_path: Path) -> None:
    items = [(tmp_path, seed) for seed in range(4)]
    with products.counting() as counts:
        workers.each(build, items, 2)
        build(tmp_path, 0)
    assert str(counts) == "simulated 4, reused 0, scored 0"
    with products.counting() as counts:
        workers.each(build, items, 2)
    assert str(counts) == "simulated 0, reused 4, scored 0"


@pytest.mark.parametrize(
    ("function", "argument", "error", "message"),
    [
        (failing, "refused", ConfigError, "^number 3 is refused$"),
        (broken, 0, ZeroDivisionError, "^division by zero$"),
        (killed, signal.SIGKILL, BackendError, r"worker process ended unexpectedly, perhaps because memory ran out.*jobs=1"),
        (failing, "hungry", BackendError, r"ran out of memory \(unable to allocate 8 TiB\).*jobs=1"),
    ],
)
def test_an_error_in_a_worker_is_raised_in_the_parent_and_ends_all_workers(function, argument, error, message: str) -> None:
    with workers.reused():
        before = pids()
        with pytest.raises(error, match=message) as raised:
            workers.each(function, [(number, argument) for number in range(6)], 2)
        if error is ZeroDivisionError:
            assert "in broken" in str(raised.value.__cause__), "the worker's traceback is lost"
        assert pids().isdisjoint(before)
