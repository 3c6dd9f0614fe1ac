"""`radartwin dashboard` serves MLflow's web pages of our runs on the loopback interface, and ends with all its processes.

A slow test opens the pages in a real browser and writes screenshots to outputs/screenshots of the checkout.
"""

from __future__ import annotations

import contextlib
import json
import re
import signal
import socket
import subprocess
import urllib.error
import urllib.request
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import browser
import own_experiment
import pytest
from processes import descendants, listening, runs, serving, wait_until

from radartwin.config.study import TrackingConfig
from radartwin.errors import BackendError
from radartwin.io.serving import HOST
from radartwin.runs.dashboard import USUAL_PORT, dashboard
from radartwin.runs.tracking import Tracker

# SQLAlchemy warns about a loader that mlflow uses.
pytestmark = pytest.mark.filterwarnings("ignore:The .*noload.* loader strategy")

MATERIALS = ("void", "uniform", "vlm")


def served(output: Path) -> contextlib.AbstractContextManager[tuple[str, subprocess.Popen[str]]]:
    return serving(output, r"dashboard:.*(http://127\.0\.0\.1:\d+)/start ", "dashboard", "--output", output)


def ask(url: str, headers: Mapping[str, str] | None = None, **query: Any) -> str:
    """Return the server's answer to a GET request, or to a POST request if there is a query."""
    content = json.dumps(query).encode() if query else None
    request = urllib.request.Request(url, content, {"Content-Type": "application/json", **(headers or {})})
    with urllib.request.urlopen(request, timeout=60) as response:
        return response.read().decode()


def experiment_id(address: str, table: str = "environment") -> str:
    answer = ask(f"{address}/api/2.0/mlflow/experiments/get-by-name?experiment_name={table}")
    return json.loads(answer)["experiment"]["experiment_id"]


def runs_of(address: str, table: str = "environment", words: str = "") -> list[Any]:
    """Ask the server for the runs of a table that match a text filter."""
    url = f"{address}/api/2.0/mlflow/runs/search"
    return json.loads(ask(url, experiment_ids=[experiment_id(address, table)], filter=words, max_results=10))["runs"]


def assert_ends(command: subprocess.Popen[str], number: signal.Signals, port: int) -> None:
    """Send a signal to the command, and check that the server ends with all its processes and that the port becomes free."""
    started = descendants(command.pid)
    assert len(started) >= 1
    command.send_signal(number)
    assert command.wait(20) == 0
    assert listening(port) == set()
    wait_until(lambda: not any(map(runs, started)), 10)


def test_the_dashboard_shows_the_runs_of_the_output_folder_at_a_free_port_until_ctrl_c(tmp_path: Path) -> None:
    with Tracker(TrackingConfig(), tmp_path).run("environment", "a" * 32, "materials=void", {}) as record:
        record.metrics = {"correlation_2m": 0.42}
    with socket.socket() as taken:
        taken.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        with contextlib.suppress(OSError):  # another program now uses the port
            taken.bind((HOST, USUAL_PORT))
            taken.listen()
        with pytest.raises(BackendError, match=f"port {USUAL_PORT} is taken"):
            dashboard(TrackingConfig(), tmp_path, USUAL_PORT)
        with served(tmp_path) as (address, command):
            port = int(address.rpartition(":")[2])
            assert port != USUAL_PORT
            assert ask(f"{address}/health") == "OK"
            assert "mlflow" in ask(address).lower()
            assert listening(port) == {"127.0.0.1"}
            # request of a foreign web page whose host name resolves to this machine
            for page in (address, f"{address}/start"):
                with pytest.raises(urllib.error.HTTPError, match="403"):
                    ask(page, {"Host": "attacker.example"})
            assert re.search(r"#/experiments/\d+/runs\">environment</a>", ask(f"{address}/start"))
            (run,) = runs_of(address)
            assert [(m["key"], m["value"]) for m in run["data"]["metrics"]] == [("correlation_2m", 0.42)]
            assert_ends(command, signal.SIGINT, port)


@pytest.mark.slow
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_other_signals_end_the_server_too(tmp_path: Path, number: signal.Signals) -> None:
    Tracker(TrackingConfig(), tmp_path).prepare()
    with served(tmp_path) as (address, command):
        assert_ends(command, number, int(address.rpartition(":")[2]))


def visit(page: browser.Page, url: str, *words: str, seconds: float = 150) -> None:
    """Load a page and wait until it shows all the words."""
    page.call("Emulation.setDeviceMetricsOverride", width=1500, height=950, deviceScaleFactor=1, mobile=False)
    page.call("Page.navigate", url="about:blank")  # another fragment of the same page would not load anew
    page.call("Page.navigate", url=url)
    page.until(f"document.body !== null && {_shows(words)}", seconds)


def _shows(words: Sequence[str]) -> str:
    return " && ".join(f"document.body.innerText.includes({json.dumps(word)})" for word in words)


@pytest.mark.slow
def test_the_start_page_opens_the_runs_of_a_sweep_in_a_new_browser(chromium, tmp_path: Path) -> None:
    tracker = Tracker(TrackingConfig(), tmp_path)
    parent = tracker.sweep("environment", f"materials={','.join(MATERIALS)}", "1" * 32)
    for number, source in enumerate(MATERIALS):
        params = {"profile": "quick", "materials": source, "seed": str(number)}
        job = Tracker(TrackingConfig(parent_run_id=parent), tmp_path)
        with job.run("environment", f"{number:032x}", f"{source}, seed {number}", params, "Does the room matter?") as run:
            run.metrics = {"correlation_2m": 0.1 * number, "correlation_1m": 0.5, "samples": 3.0, "angle": 1.0}
    tracker.end_sweep(parent, "FINISHED")
    with served(tmp_path) as (address, _):
        page = chromium()
        visit(page, f"{address}/start", "environment", "Does the room matter?", "materials, seed, correlation_2m, correlation_1m, samples")
        page.screenshot("start")
        page.click("a[href$='/runs']")
        page.until(_shows(("4 matching runs", *(f"{source}, seed {number} 00000000" for number, source in enumerate(MATERIALS)))), 150)
        page.screenshot("start-runs")
        text = page.run("document.body.innerText")
        heads = ["Run Name", "Created", "Parameters", "Metrics", "Duration", "materials", "seed"]
        assert [line for line in text.splitlines() if line in heads] == heads
        for column, shown in {"correlation_2m": True, "samples": True, "angle": False, "profile": False, "Source": False}.items():
            assert (f"\n{column}\n" in text) is shown, column
        assert page.run("document.querySelector('[data-assistant-ui] textarea') === null"), "the assistant is closed"
        assert page.run("localStorage.getItem('mlflow.workflowType_v1')") == '"machine_learning"'


@pytest.mark.slow
def test_a_tracking_server_holds_a_sweep_of_another_folder(inside, here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """On a cluster, the jobs reach MLflow's store and its artifacts only over HTTP; the test reproduces this situation."""
    arguments, own = own_experiment.write(here / "mine")
    Tracker(TrackingConfig(), here / "served").prepare()
    with served(here / "served") as (address, _):
        monkeypatch.setenv("OWN_EXPERIMENT", own["OWN_EXPERIMENT"])
        done = inside(*arguments, "-m", "seed=0,1", "--output", here / "out", f"tracking.uri={address}")
        assert "sweep: 2 done" in done.stdout, done.stderr
        (parent,) = [run["info"]["run_id"] for run in runs_of(address, "mine") if not run["inputs"].get("dataset_inputs")]
        jobs = runs_of(address, "mine", f"tags.`mlflow.parentRunId` = '{parent}'")
        assert len(jobs) == 2
        for run, name in ((jobs[0]["info"]["run_id"], "table.csv"), (parent, "jobs.csv")):
            files = json.loads(ask(f"{address}/api/2.0/mlflow/artifacts/list?run_id={run}"))["files"]
            assert name in {entry["path"] for entry in files}
    assert not (here / "out" / "mlflow.db").exists()
