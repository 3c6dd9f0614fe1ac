"""Measure how the store and an MLflow server behave when many processes write at the same time.

    python -m experiments.speed.writers [--parts store server] [--writers 1 10 100] [--bytes 6000000] [--folder FOLDER]

Each writer is a process. It writes results of `--bytes` into one store, and then logs runs to one MLflow server on this machine, which
`radartwin dashboard` starts on an SQLite database. A measurement has the parts `store` and `server`. In each part, all writers start to
write at the same time. For each number of writers, the script prints the median and the 95 % quantile of the time of one write, and the
number of writes per second. A write that has not ended after LIMIT_S counts as failed. The script deletes what it wrote.
"""

from __future__ import annotations

import argparse
import contextlib
import multiprocessing
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
import urllib.request
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from queue import Empty
from typing import Any

import numpy as np

from radartwin.config.study import TrackingConfig
from radartwin.errors import UserError
from radartwin.runs.tracking import Tracker
from radartwin.store.products import Store

WRITES = 100  # number of writes of all writers together; one writer makes at most MOST of them
MOST = 20
LIMIT_S = 40.0  # longest time in seconds for all writes with one number of writers
STARTS_WITHIN_S = 60
HOST = "127.0.0.1"
os.environ["MLFLOW_SUPPRESS_PRINTING_URL_TO_STDOUT"] = "true"
METRICS = 10  # number of metrics of a run; the tables log up to 40
MODULES = ["radartwin.constants"]  # the source code that is part of the key of the written results


def main() -> None:
    parser = argparse.ArgumentParser(description="Measure how the store and an MLflow server behave when many processes write at once.")
    parser.add_argument("--writers", type=int, nargs="+", default=[1, 10, 100], metavar="N")
    parser.add_argument("--parts", nargs="+", default=["store", "server"], choices=["store", "server"])
    parser.add_argument("--bytes", type=int, default=6_000_000, help="size of one stored result (default: 6 MB, as a campaign recording)")
    parser.add_argument("--folder", type=Path, help="folder for the store and the database (default: the system's temporary folder)")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(dir=options.folder) as place, server(Path(place)) as uri:
        print("part writers writes failed median_s p95_s writes_per_s")
        writes = {"store": stored(Path(place), options.bytes), "server": tracked(Path(place), uri)}
        for part in options.parts:
            for writers in options.writers:
                seconds, wall_s, failed = together(writes[part], writers)
                median, high = np.quantile(seconds, [0.5, 0.95]) if len(seconds) else (np.nan, np.nan)
                print(f"{part} {writers} {len(seconds)} {failed} {median:.3f} {high:.3f} {len(seconds) / wall_s:.1f}", flush=True)


def stored(place: Path, size: int) -> Callable[[str], None]:
    """Return a function that writes a result of `size` bytes into the store of the folder `place`, under a key of its own."""
    content = os.urandom(size)

    def write(name: str) -> None:
        store.fetch("recording", {"name": name}, MODULES, lambda folder: (folder / "recording.bin").write_bytes(content))

    store = Store(place / "cache")
    return write


def tracked(place: Path, uri: str) -> Callable[[str], None]:
    """Return a function that logs a run to the MLflow server with the address `uri`."""

    def write(name: str) -> None:
        with Tracker(TrackingConfig(uri=uri), place).run("writers", name, name, {"name": name}) as record:
            record.metrics = {f"metric_{k}": float(k) for k in range(METRICS)}
            record.inputs = {"recording": [name]}

    Tracker(TrackingConfig(uri=uri), place).prepare()  # imports MLflow before the writers are forked
    write("first")  # creates the MLflow experiment
    return write


def together(write: Callable[[str], None], writers: int) -> tuple[np.ndarray, float, int]:
    """Return the seconds of each write of `writers` processes, the wall time of all writes together in seconds, and the number of writes
    that failed or were not complete after LIMIT_S.
    """
    context: Any = multiprocessing.get_context("fork")  # a forked process has imported everything
    start, queue = context.Barrier(writers), context.Queue()
    each = min(MOST, max(1, WRITES // writers))

    def run(number: int) -> None:
        start.wait()
        warnings.simplefilter("error")  # the tracker warns about a run that is not complete
        for turn in range(each):
            began, good = time.monotonic(), True
            try:
                write(f"{writers}-{number}-{turn}")
            except (UserError, Warning):
                good = False
            queue.put((began, time.monotonic(), good))

    processes = [context.Process(target=run, args=(number,)) for number in range(writers)]
    for process in processes:
        process.start()
    end, told = time.monotonic() + LIMIT_S, []
    with contextlib.suppress(Empty):
        while len(told) < writers * each:
            told.append(queue.get(timeout=max(0.0, end - time.monotonic())))
    for process in processes:
        process.kill()
        process.join()
    times = np.array([(began, ended) for began, ended, good in told if good]).reshape(-1, 2)
    return np.diff(times, axis=1).ravel(), float(np.ptp(times)) if len(times) else LIMIT_S, writers * each - len(times)


@contextlib.contextmanager
def server(place: Path) -> Iterator[str]:
    """Within the `with` block, run an MLflow server for the folder `place`. Yield its address."""
    with socket.socket() as probe:
        probe.bind((HOST, 0))
        port = probe.getsockname()[1]
    uri, log = f"http://{HOST}:{port}", place / "server.log"
    with log.open("w") as stream:
        command = [sys.executable, "-m", "radartwin", "dashboard", "--output", str(place), "--port", str(port)]
        process = subprocess.Popen(command, stdout=stream, stderr=subprocess.STDOUT)
    try:
        end = time.monotonic() + STARTS_WITHIN_S
        while True:
            with contextlib.suppress(OSError), urllib.request.urlopen(f"{uri}/health", timeout=5):
                break
            if process.poll() is not None or time.monotonic() > end:
                raise RuntimeError(f"the MLflow server does not answer\n{log.read_text()}")
            time.sleep(0.2)
        yield uri
    finally:
        process.send_signal(signal.SIGTERM)
        process.wait()


if __name__ == "__main__":
    main()
