"""Work in several processes gives the results of work in a single process, and the parent process reports a failing worker."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

import pytest
from processes import runs
from worker_calls import broken, build, failing, killed, product, product_slowly, slow_pid

from radartwin.errors import BackendError, ConfigError
from radartwin.runs import workers
from radartwin.store import products

ITEMS = [(number, number + 1) for number in range(6)]


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
    assert {pid for _, pid in workers.each(product, ITEMS[: workers.FEWEST_ITEMS - 1], 2)} == {os.getpid()}, "few items start no worker"
    assert workers.each(product, [], 2) == []
    waiting, numbers = {0: [(0, 0)] * 3, 1: [(1, 0)] * 3}, []
    workers.run(product_slowly, lambda worker: waiting[worker].pop() if waiting[worker] else None, numbers.append, 2)
    assert sorted(numbers) == [0, 0, 0, 1, 1, 1], "each worker gets calls by its number"


def test_reused_workers_do_the_next_task_unless_they_died_hold_much_memory_or_have_old_run_times(monkeypatch: pytest.MonkeyPatch) -> None:
    def slow_pids(fresh: bool) -> set[int]:
        worker_pids: set[int] = set()
        waiting = iter([()] * 4)
        workers.run(slow_pid, lambda _: next(waiting, None), worker_pids.add, 2, fresh)
        return worker_pids

    with workers.reused():
        both = pids() | pids()
        assert len(both) <= 2
        assert all(map(runs, both))
        for pid in both:
            os.kill(pid, signal.SIGKILL)
        time.sleep(0.2)
        assert [value for value, _ in workers.each(product, ITEMS, 2)] == [one * other for one, other in ITEMS]
        before = slow_pids(fresh=False)
        assert slow_pids(fresh=True).isdisjoint(before), "run times are measured in fresh workers"
        with monkeypatch.context() as patched:
            patched.setattr(workers, "IDLE_BYTES", 1.0)
            assert pids().isdisjoint(pids())
        both = pids()
    assert not any(map(runs, both))
    assert pids().isdisjoint(both)


def test_products_that_workers_build_are_counted_in_the_parent(tmp_path: Path) -> None:
    items = [(tmp_path, seed) for seed in range(4)]
    with products.counting() as counts:
        workers.each(build, items, 2)
        build(tmp_path, 0)
    assert str(counts) == "simulated 4, reused 0, scored 0"
    with products.counting() as counts:
        workers.each(build, items, 2)
    assert str(counts) == "simulated 0, reused 4, scored 0"


ERRORS = (
    (failing, "refused", ConfigError, "^number 3 is refused$"),
    (broken, 0, ZeroDivisionError, "^division by zero$"),
    (killed, signal.SIGKILL, BackendError, r"worker process ended unexpectedly, perhaps because memory ran out.*jobs=1"),
    (failing, "hungry", BackendError, r"ran out of memory \(unable to allocate 8 TiB\).*jobs=1"),
)


def test_an_error_in_a_worker_is_raised_in_the_parent_and_ends_all_workers() -> None:
    with workers.reused():
        before = pids()
        for function, argument, error, message in ERRORS:
            with pytest.raises(error, match=message) as raised:
                workers.each(function, [(number, argument) for number in range(6)], 2)
            if error is ZeroDivisionError:
                assert "in broken" in str(raised.value.__cause__), "the worker's traceback is lost"
            after = pids()
            assert after.isdisjoint(before)
            before = after
