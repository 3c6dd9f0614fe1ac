"""Worker processes end when their parent process or the pool ends. If a worker dies during a call, the pool reports it."""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import time
from pathlib import Path

import pytest
from processes import ROOT, runs, started, wait_until
from threadpoolctl import threadpool_info

from radartwin.compiled import cores
from radartwin.io import process_pool
from radartwin.io.process_pool import BrokenProcessPool, ProcessPool, in_worker

PATHS = os.pathsep.join((str(ROOT), str(ROOT / "tests")))  # the worker imports this test module, which imports tests/processes.py


def hold(folder: Path) -> None:
    """Keep a worker process busy for a long time. The function removes its file when the process is ended."""
    mine = folder / f"{os.getpid()}.pid"
    mine.touch()
    try:
        time.sleep(600)
    finally:
        mine.unlink()


def hold_the_interpreter(folder: Path) -> None:
    """Keep a worker process busy in compiled code, which runs no signal handler and no other thread of Python."""
    (folder / f"{os.getpid()}.pid").touch()
    ctypes.PyDLL(None).sleep(60)


def die() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def cores_beside(others: int, folder: Path) -> int:
    """Return the cores of a worker while so many other workers of the pool compute."""

    def together(step: str) -> None:
        (folder / f"{os.getpid()}.{step}").touch()
        wait_until(lambda: len(list(folder.glob(f"*.{step}"))) == 1 + others)

    together("begun")
    count = cores()
    together("counted")
    return count


def blas_threads() -> set[int]:
    return {library["num_threads"] for library in threadpool_info() if library["user_api"] == "blas"}


def mark() -> None:
    os.environ["PREPARED"] = "1"


def test_a_worker_is_prepared_and_knows_that_it_is_a_worker_and_its_death_breaks_the_pool() -> None:
    pool = ProcessPool(1, mark)
    assert pool.submit(os.getenv, "PREPARED").result() == "1"
    assert pool.submit(in_worker).result()
    assert not in_worker()
    pids = pool.pids
    assert pids == {pool.submit(os.getpid).result()}
    for call in (die, os.getpid):
        with pytest.raises(BrokenProcessPool):
            pool.submit(call).result()
    pool.end()
    assert not any(map(runs, pids))


def test_workers_that_compute_at_the_same_time_share_the_cores(tmp_path: Path) -> None:
    pool = ProcessPool(2)
    both = [pool.submit(cores_beside, 1, tmp_path) for _ in range(2)]
    assert [call.result() for call in both] == [max(1, cores() // 2)] * 2
    (tmp_path / "alone").mkdir()
    assert pool.submit(cores_beside, 0, tmp_path / "alone").result() == cores()
    pool.end()


def test_a_pool_that_ends_interrupts_its_calls_which_clean_up(tmp_path: Path) -> None:
    pool = ProcessPool(2)
    calls = [pool.submit(hold, tmp_path) for _ in range(2)]
    wait_until(lambda: len(list(tmp_path.iterdir())) == 2)
    pids = [int(path.stem) for path in tmp_path.iterdir()]
    pool.end()
    assert not any(map(runs, pids))
    assert list(tmp_path.iterdir()) == []
    assert all(isinstance(call.exception(), BrokenProcessPool) for call in calls)


def test_a_pool_that_ends_kills_a_worker_in_compiled_code(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(process_pool, "ENDS_WITHIN_S", 0.5)
    pool = ProcessPool(1)
    pool.submit(hold_the_interpreter, tmp_path)
    wait_until(lambda: len(list(tmp_path.iterdir())) == 1)
    start = time.monotonic()
    pool.end()
    assert time.monotonic() - start < 20, "the call takes 60 s"
    assert not runs(int(next(tmp_path.iterdir()).stem))


BUSY = """
import sys
from pathlib import Path
from radartwin.io.process_pool import ProcessPool
sys.path.insert(0, sys.argv[1])
from test_process_pool import hold
if __name__ == "__main__":
    pool = ProcessPool(2)
    calls = [pool.submit(hold, Path(sys.argv[2])) for _ in range(2)]
    calls[0].result()
"""


def test_workers_end_with_a_parent_that_is_killed_during_their_calls(tmp_path: Path) -> None:
    script, folder = tmp_path / "busy.py", tmp_path / "pids"
    script.write_text(BUSY)
    folder.mkdir()
    parent = started([sys.executable, str(script), str(Path(__file__).parent), str(folder)], tmp_path, PYTHONPATH=PATHS)
    wait_until(lambda: len(list(folder.iterdir())) == 2)
    pids = [int(path.stem) for path in folder.iterdir()]
    parent.kill()
    parent.communicate()
    wait_until(lambda: not any(map(runs, pids)))


PLAIN = """
import os
from radartwin.io.process_pool import ProcessPool
pool = ProcessPool(1, import_main=False)
print(pool.submit(len, "four").result(), __file__)
"""


def test_a_script_without_main_guard_can_use_a_pool_that_does_not_import_it(tmp_path: Path) -> None:
    (tmp_path / "plain.py").write_text(PLAIN)
    said, complained = started([sys.executable, str(tmp_path / "plain.py")], tmp_path).communicate(timeout=60)
    assert said == f"4 {tmp_path / 'plain.py'}\n", complained


def test_blas_has_one_thread_in_workers_that_share_the_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "2")
    for size, threads in ((1, 2), (2, 1)):
        pool = ProcessPool(size)
        try:
            assert pool.submit(blas_threads).result() == {threads}
        finally:
            pool.end()
