"""MLflow's pages show our runs in a real browser. Screenshots are written to outputs/screenshots of the checkout."""

from __future__ import annotations

import contextlib
import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator, Sequence
from pathlib import Path
from urllib.parse import quote_plus

import browser
import numpy as np
import own_experiment
import pytest

from radartwin.config.study import TrackingConfig
from radartwin.plotting import style
from radartwin.runs.tracking import Tracker

# SQLAlchemy warns about a loader that mlflow uses.
pytestmark = pytest.mark.filterwarnings("ignore:The .*noload.* loader strategy")

SCREENSHOTS = Path(__file__).resolve().parents[2] / "outputs" / "screenshots"
MATERIALS = ("void", "uniform", "vlm")


@contextlib.contextmanager
def serving(output: Path) -> Iterator[str]:
    """Run `radartwin dashboard` on the folder. Yields the server's address."""
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


def record(tracker: Tracker, number: int, artifacts: Path) -> str:
    """Track a run as the runner does, with parameters, metrics, a table, input data and pictures."""
    source = MATERIALS[number % len(MATERIALS)]
    params = {"materials": source, "seed": str(number)}
    with tracker.run("environment", f"{number:032x}", f"materials={source},seed={number}", params) as run:
        run.metrics = {"correlation_2m": 0.1 * (number % 10), "correlation_1m": 0.5}
        run.artifacts = [artifacts]
        run.rows = [{"distance_m": 2.0, "metric": "correlation", "value": 0.1 * (number % 10), "verdict": "holds"}]
        run.inputs = {"campaign": [f"{number % 3:032x}"]}
    return run.run_id


@pytest.fixture(scope="module")
def figures(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with figures."""
    folder = tmp_path_factory.mktemp("product") / "figures"
    figure, axes = style.figure()
    axes.plot(np.linspace(0, 1, 50), np.linspace(0, 1, 50) ** 2)
    style.save(figure, folder / "curve")
    return folder


@pytest.fixture(scope="module")
def sweep(tmp_path_factory: pytest.TempPathFactory, figures: Path) -> tuple[Path, str, list[str]]:
    """An output folder with a sweep of three runs, the id of the parent run, and the ids of the three."""
    output = tmp_path_factory.mktemp("output")
    tracker = Tracker(TrackingConfig(), output)
    parent = tracker.sweep("environment", f"materials={','.join(MATERIALS)}")
    assert parent is not None
    table = figures.parent / "jobs.csv"
    table.write_text("job,status\nmaterials=void,done\n")
    runs = [record(Tracker(TrackingConfig(parent_run_id=parent), output), number, figures) for number in range(3)]
    tracker.end_sweep(parent, "FINISHED", table)
    return output, parent, runs


def visit(page: browser.Page, url: str, *words: str, seconds: float = 150) -> float:
    """Load a page and wait until it shows all the words. Returns the time in s."""
    page.call("Emulation.setDeviceMetricsOverride", width=1500, height=950, deviceScaleFactor=1, mobile=False)
    page.call("Page.navigate", url="about:blank")  # another fragment of the same page would not load anew
    started = time.monotonic()
    page.call("Page.navigate", url=url)
    page.until(f"document.body !== null && {_shows(words)}", seconds)
    return time.monotonic() - started


def _shows(words: Sequence[str]) -> str:
    return " && ".join(f"document.body.innerText.includes({json.dumps(word)})" for word in words)


def follow(page: browser.Page, fragment: str, *words: str) -> float:
    """Follow a link inside the open page and wait until it shows all the words. Returns the time in s."""
    started = time.monotonic()
    page.run(f"location.hash = {json.dumps(fragment)}")
    page.until(_shows(words), 150)
    return time.monotonic() - started


def keep(page: browser.Page, name: str) -> np.ndarray:
    SCREENSHOTS.mkdir(parents=True, exist_ok=True)
    return page.screenshot(SCREENSHOTS / f"{name}.png")


def experiment_id(address: str, table: str = "environment") -> str:
    with urllib.request.urlopen(f"{address}/api/2.0/mlflow/experiments/get-by-name?experiment_name={table}", timeout=20) as answer:
        return json.load(answer)["experiment"]["experiment_id"]


@pytest.mark.slow
def test_pages_show_experiments_a_run_with_its_picture_and_the_jobs_of_a_sweep(chromium, sweep) -> None:
    output, parent, runs = sweep
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
        visit(page, f"{address}/#/experiments/{number}/runs/{runs[1]}/artifacts/table.csv", "verdict", "holds")
        keep(page, "run-table")
        visit(page, f"{address}/#/experiments/{number}/runs/{parent}", "Compare its 3 latest jobs")
        keep(page, "sweep")
        link = page.run("[...document.links].find(link => link.innerText.startsWith('Compare its')).href")
        visit(page, link, "Comparing 3 Runs", "correlation_2m")
        page.until("document.querySelector('.js-plotly-plot svg') !== null", 150)
        keep(page, "comparison")


def test_a_free_port_is_found_and_a_taken_port_is_refused(sweep) -> None:
    from radartwin.errors import BackendError
    from radartwin.runs.dashboard import HOST, USUAL_PORT, dashboard

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


@pytest.mark.slow
def test_a_tracking_server_holds_a_sweep_of_another_folder(tmp_path: Path) -> None:
    """This is the situation on a cluster: the jobs reach MLflow's store and its artifacts only over HTTP."""
    arguments, own = own_experiment.write(tmp_path / "mine")
    (tmp_path / "served").mkdir()
    with serving(tmp_path / "served") as address:
        command = [
            sys.executable,
            "-m",
            "radartwin",
            *arguments,
            "-m",
            "seed=0,1",
            "--output",
            str(tmp_path / "out"),
            f"tracking.uri={address}",
        ]
        done = subprocess.run(command, env={**os.environ, **own}, capture_output=True, text=True, timeout=300, check=False)
        assert "sweep: 2 done" in done.stdout, done.stderr
        runs, _ = ask(address, experiment_id(address, "mine"), "", 10)
        (parent,) = [run["info"]["run_id"] for run in runs if not run["inputs"].get("dataset_inputs")]
        jobs, _ = ask(address, experiment_id(address, "mine"), f"tags.`mlflow.parentRunId` = '{parent}'", 10)
        assert len(jobs) == 2
        for run, name in ((jobs[0]["info"]["run_id"], "table.csv"), (parent, "jobs.csv")):
            with urllib.request.urlopen(f"{address}/api/2.0/mlflow/artifacts/list?run_id={run}", timeout=20) as answer:
                assert name in {entry["path"] for entry in json.load(answer)["files"]}
    assert not (tmp_path / "out" / "mlflow.db").exists()


def ask(address: str, experiment: str, words: str, most: int) -> tuple[list, float]:
    """Runs that match the filter, and the time of the search in s."""
    query = json.dumps({"experiment_ids": [experiment], "filter": words, "max_results": most}).encode()
    request = urllib.request.Request(f"{address}/api/2.0/mlflow/runs/search", query, {"Content-Type": "application/json"})
    started = time.monotonic()
    with urllib.request.urlopen(request, timeout=60) as answer:
        return json.load(answer)["runs"], time.monotonic() - started


@pytest.mark.slow
def test_two_thousand_runs_are_listed_and_filtered_in_three_seconds(chromium, tmp_path: Path, figures: Path) -> None:
    """The runner's own tracker writes the runs in one process, each with a picture, a table, a dataset and tags.

    The test lists the runs in a page that is reloaded from the browser's cache, and lists and filters them in a page that is already open.
    """
    tracker, count = Tracker(TrackingConfig(), tmp_path), 2000
    made = [time.monotonic()]
    for number in range(count):
        record(tracker, number, figures)
        made.append(time.monotonic())
    first, last = (float(np.median(np.diff(some))) for some in (made[:100], made[-100:]))
    words = "metrics.correlation_2m > 0.85 and params.materials = 'void'"
    expected = sum(number % 10 == 9 and number % 3 == 0 for number in range(count))
    with serving(tmp_path) as address:
        page, number = chromium(), experiment_id(address)
        runs = f"{address}/#/experiments/{number}/runs"
        visit(page, runs, "100 matching runs", "materials=")  # a first visit compiles the page
        bare = visit(page, f"{address}/#/experiments/{experiment_id(address, 'Default')}/runs", "0 matching runs")
        loaded = visit(page, runs, "100 matching runs", "materials=")
        follow(page, "#/experiments", "Default")
        listed = follow(page, f"#/experiments/{number}/runs", "100 matching runs", "materials=")
        keep(page, "runs-2000")
        chosen = follow(page, f"#/experiments/{number}/runs?searchFilter={quote_plus(words)}", f"{expected} matching runs")
        keep(page, "runs-2000-filtered")
        everything, asked = ask(address, number, "", 1000)
        found, filtered = ask(address, number, words, 1000)
    page_took = f"page loaded in {loaded:.2f} s ({bare:.2f} s without a run), listed in {listed:.2f} s, filtered in {chosen:.2f} s"
    told = f"{page_took}; server listed 1,000 in {asked:.2f} s, filtered in {filtered:.2f} s"
    print(f"2,000 runs: {told}; tracking a run took {first * 1000:.0f} ms at first and {last * 1000:.0f} ms at last")
    assert len(everything) == 1000
    assert len(found) == expected
    assert max(loaded, listed, chosen, asked, filtered) < 3, told
    assert last < 0.3, "tracking slows down with the runs there are"
