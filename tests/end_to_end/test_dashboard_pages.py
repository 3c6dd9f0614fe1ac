"""MLflow's pages over our runs in a real browser: the list of experiments, a run with its picture, a sweep compared.

The screenshots stay in outputs/screenshots of the checkout.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import signal
import socket
import sqlite3
import subprocess
import sys
import time
import urllib.request
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import browser
import numpy as np
import pytest

from radartwin import plotting
from radartwin.config import TrackingConfig
from radartwin.tracking import Tracker

# SQLAlchemy warns mlflow of a loader it will drop; not ours to mend.
pytestmark = pytest.mark.filterwarnings("ignore:The .*noload.* loader strategy")

SCREENSHOTS = Path(__file__).resolve().parents[2] / "outputs" / "screenshots"
MATERIALS = ("void", "uniform", "vlm")


@contextlib.contextmanager
def serving(output: Path) -> Iterator[str]:
    """`radartwin dashboard` over the folder; its address, read from what it says."""
    command = [sys.executable, "-m", "radartwin", "dashboard", "--output", str(output)]
    server = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, start_new_session=True)
    assert server.stdout is not None
    try:
        line = next((line for line in server.stdout if "dashboard:" in line), "")
        found = re.search(r"http://127\.0\.0\.1:\d+", line)
        assert found, "the server stopped before it answered"
        yield found.group()
    finally:
        os.killpg(server.pid, signal.SIGINT)
        server.wait(30)
        server.stdout.close()


def record(output: Path, number: int, parent: str | None, picture: Path) -> str:
    """A run as the runner leaves it: parameters, metrics and a picture."""
    source = MATERIALS[number % len(MATERIALS)]
    tracker = Tracker(TrackingConfig(parent_run_id=parent), output)
    with tracker.run(
        "environment", f"{number:032x}", f"materials={source},seed={number}", {"materials": source, "seed": str(number)}
    ) as run:
        run.metrics = {"correlation_2m": 0.1 * (number % 10), "correlation_1m": 0.5}
        run.artifacts = [picture.parent]
    return run.run_id


@pytest.fixture(scope="module")
def sweep(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[str]]:
    """An output folder with a sweep of three runs, and their ids."""
    output = tmp_path_factory.mktemp("output")
    figure, axes = plotting.figure()
    axes.plot(np.linspace(0, 1, 50), np.linspace(0, 1, 50) ** 2)
    picture = output / "figures" / "curve.png"
    picture.parent.mkdir()
    plotting.save(figure, picture.with_suffix(""))
    tracker = Tracker(TrackingConfig(), output)
    parent = tracker.sweep("environment", f"materials={','.join(MATERIALS)}")
    runs = [record(output, number, parent, picture) for number in range(3)]
    tracker.end_sweep(parent, "FINISHED")
    return output, runs


@pytest.fixture(scope="module")
def chromium(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[[], browser.Page]]:
    executable = browser.find()
    if executable is None:
        pytest.skip("no Chromium here to open the pages in; on Debian or Ubuntu: apt-get install chromium")
    with browser.browser(executable, tmp_path_factory.mktemp("profile")) as new:
        yield new


def visit(page: browser.Page, url: str, *words: str, seconds: float = 150) -> float:
    """Go to a page and wait until it shows all the words; how long that took in s."""
    page.call("Emulation.setDeviceMetricsOverride", width=1500, height=950, deviceScaleFactor=1, mobile=False)
    page.call("Page.navigate", url="about:blank")  # another fragment of the same page would not load anew
    started = time.monotonic()
    page.call("Page.navigate", url=url)
    shows = " && ".join(f"document.body.innerText.includes({json.dumps(word)})" for word in words)
    page.until(f"document.body !== null && {shows}", seconds)
    return time.monotonic() - started


def keep(page: browser.Page, name: str) -> np.ndarray:
    SCREENSHOTS.mkdir(parents=True, exist_ok=True)
    return page.screenshot(SCREENSHOTS / f"{name}.png")


def experiment_id(address: str) -> str:
    with urllib.request.urlopen(f"{address}/api/2.0/mlflow/experiments/get-by-name?experiment_name=environment", timeout=20) as answer:
        return json.load(answer)["experiment"]["experiment_id"]


@pytest.mark.slow
def test_the_pages_show_the_experiments_a_run_with_its_picture_and_a_sweep_compared(chromium, sweep) -> None:
    output, runs = sweep
    with serving(output) as address:
        page, number = chromium(), experiment_id(address)
        visit(page, f"{address}/#/experiments", "environment")
        keep(page, "experiments")
        visit(page, f"{address}/#/experiments/{number}/runs", "4 matching runs", f"materials={','.join(MATERIALS)}")
        keep(page, "runs")
        visit(page, f"{address}/#/experiments/{number}/runs/{runs[1]}", "correlation_2m", "materials", "run_key")
        keep(page, "run")
        visit(page, f"{address}/#/experiments/{number}/runs/{runs[1]}/artifacts/figures/curve.png", "curve.png")
        page.until("[...document.images].some(i => i.complete && i.naturalWidth > 200 && !i.src.startsWith('data:image/svg'))", 60)
        page.settle()
        shown = keep(page, "run-picture")
        assert len(np.unique(shown.reshape(-1, 3), axis=0)) > 200, "the picture's lines and texts have many shades"
        chosen = f"runs={json.dumps(runs, separators=(',', ':'))}&experiments={json.dumps([number])}"
        visit(page, f"{address}/#/compare-runs?{chosen}", "Comparing 3 Runs", "correlation_2m")
        page.until("document.querySelector('.js-plotly-plot svg') !== null", 150)
        keep(page, "comparison")


def test_without_a_port_the_dashboard_takes_a_free_one_and_one_that_is_taken_is_refused(sweep) -> None:
    from radartwin.dashboard import HOST, USUAL_PORT, dashboard
    from radartwin.errors import BackendError

    with socket.socket() as taken:
        taken.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        with contextlib.suppress(OSError):  # taken already is as good
            taken.bind((HOST, USUAL_PORT))
            taken.listen()
        with pytest.raises(BackendError, match=f"port {USUAL_PORT} is taken"):
            dashboard(TrackingConfig(), sweep[0], USUAL_PORT)
        with serving(sweep[0]) as address, urllib.request.urlopen(f"{address}/health", timeout=20) as answer:
            assert answer.read() == b"OK"
            assert not address.endswith(f":{USUAL_PORT}")


def multiply(database: Path, runs: int) -> None:
    """Copy the first run, with all that belongs to it, until the experiment has so many."""
    with closing(sqlite3.connect(database)) as connection:
        first = connection.execute("SELECT run_uuid FROM tags WHERE key = 'run_key' AND value != 'sweep' LIMIT 1").fetchone()[0]
        have = connection.execute("SELECT count(*) FROM runs").fetchone()[0]
        for table in ("runs", "metrics", "latest_metrics", "params", "tags"):
            columns = [row[1] for row in connection.execute(f"PRAGMA table_info({table})")]
            rows = connection.execute(f"SELECT * FROM {table} WHERE run_uuid = ?", (first,)).fetchall()
            copies = []
            for number in range(runs - have):
                for row in rows:
                    cells = dict(zip(columns, row, strict=True)) | {"run_uuid": f"{number:032x}"}
                    if table == "runs":
                        cells |= {"name": f"copy {number}", "start_time": int(cells["start_time"]) - 1000 * number}
                    if table == "latest_metrics" and cells["key"] == "correlation_2m":
                        cells["value"] = number / runs
                    copies.append(tuple(cells[column] for column in columns))
            connection.executemany(f"INSERT INTO {table} VALUES ({','.join('?' * len(columns))})", copies)
        connection.commit()


def ask(address: str, experiment: str, words: str, most: int) -> tuple[list, float]:
    """Runs that the server finds by the filter, and how long it took in s."""
    query = json.dumps({"experiment_ids": [experiment], "filter": words, "max_results": most}).encode()
    request = urllib.request.Request(f"{address}/api/2.0/mlflow/runs/search", query, {"Content-Type": "application/json"})
    started = time.monotonic()
    with urllib.request.urlopen(request, timeout=60) as answer:
        return json.load(answer)["runs"], time.monotonic() - started


@pytest.mark.slow
def test_two_thousand_runs_are_listed_and_filtered_in_three_seconds(chromium, sweep) -> None:
    output, _ = sweep
    multiply(output / "mlflow.db", 2000)
    with serving(output) as address:
        page, number = chromium(), experiment_id(address)
        visit(page, f"{address}/#/experiments/{number}/runs", "100 matching runs", "materials=")  # a first visit compiles the page
        listed = visit(page, f"{address}/#/experiments/{number}/runs", "100 matching runs", "materials=")
        keep(page, "runs-2000")
        everything, _ = ask(address, number, "", 1000)
        found, filtered = ask(address, number, "metrics.correlation_2m > 0.9 and params.materials = 'void'", 1000)
        assert len(everything) == 1000
        print(f"2,000 runs: listed in {listed:.2f} s, filtered in {filtered:.2f} s ({len(found)} found)")
        assert 150 < len(found) < 250, "a tenth of the runs are above 0.9"
        assert listed < 3
        assert filtered < 3
