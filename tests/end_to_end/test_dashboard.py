"""`radartwin dashboard` runs MLflow's server on loopback and ends it with all its processes."""

from __future__ import annotations

import contextlib
import json
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator, Mapping
from pathlib import Path

import pytest

from radartwin.config.study import TrackingConfig
from radartwin.runs.tracking import Tracker

# SQLAlchemy warns about a loader that mlflow uses.
pytestmark = pytest.mark.filterwarnings("ignore:The .*noload.* loader strategy")


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def answer(url: str, content: bytes | None = None, headers: Mapping[str, str] | None = None) -> str:
    request = urllib.request.Request(url, content, {"Content-Type": "application/json", **(headers or {})})
    with urllib.request.urlopen(request, timeout=10) as response:
        return response.read().decode()


def listening(port: int) -> set[str]:
    """Addresses on which this machine listens at the port, of either family."""
    found = set()
    for family, table in ((socket.AF_INET, "tcp"), (socket.AF_INET6, "tcp6")):
        for line in Path(f"/proc/net/{table}").read_text().splitlines()[1:]:
            local, state = line.split()[1], line.split()[3]
            address, _, number = local.partition(":")
            if state == "0A" and int(number, 16) == port:
                words = b"".join(bytes.fromhex(address[i : i + 8])[::-1] for i in range(0, len(address), 8))
                found.add(socket.inet_ntop(family, words))
    return found


@contextlib.contextmanager
def serving(output: Path, port: int) -> Iterator[subprocess.Popen[str]]:
    """The running command, after it has printed its address."""
    command = [sys.executable, "-m", "radartwin", "dashboard", "--output", str(output), "--port", str(port)]
    server = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, start_new_session=True)
    assert server.stdout is not None
    try:
        line = next((line for line in server.stdout if "dashboard:" in line), "")
        assert f"http://127.0.0.1:{port}/#/experiments " in line, "the server stopped before it answered"
        yield server
    finally:
        server.terminate()
        server.wait(20)
        server.stdout.close()


def test_the_dashboard_shows_the_runs_of_the_output_folder(tmp_path: Path) -> None:
    with Tracker(TrackingConfig(), tmp_path).run("environment", "a" * 32, "materials=void", {}) as record:
        record.metrics = {"correlation_2m": 0.42}
    address = f"http://127.0.0.1:{(port := free_port())}"
    with serving(tmp_path, port):
        assert answer(f"{address}/health") == "OK"
        assert "mlflow" in answer(address).lower()
        assert listening(port) == {"127.0.0.1"}
        with pytest.raises(urllib.error.HTTPError, match="403"):  # a foreign page whose host name leads here
            answer(address, headers={"Host": "attacker.example"})
        experiments = json.loads(answer(f"{address}/api/2.0/mlflow/experiments/search?max_results=10"))["experiments"]
        chosen = [e["experiment_id"] for e in experiments if e["name"] == "environment"]
        query = json.dumps({"experiment_ids": chosen}).encode()
        runs = json.loads(answer(f"{address}/api/2.0/mlflow/runs/search", query))["runs"]
        assert [(m["key"], m["value"]) for m in runs[0]["data"]["metrics"]] == [("correlation_2m", 0.42)]


def descendants(pid: int) -> list[int]:
    """Processes that a process started, directly or indirectly."""
    children = [int(word) for path in Path(f"/proc/{pid}/task").glob("*/children") for word in path.read_text().split()]
    return children + [grandchild for child in children for grandchild in descendants(child)]


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_the_server_with_all_its_processes_and_frees_the_port(tmp_path: Path, number: signal.Signals) -> None:
    port = free_port()
    with serving(tmp_path, port) as command:
        started = descendants(command.pid)
        assert len(started) >= 1
        command.send_signal(number)
        assert command.wait(20) == 0
        assert listening(port) == set()
        end = time.monotonic() + 10
        while any(Path(f"/proc/{pid}").exists() and " Z " not in Path(f"/proc/{pid}/stat").read_text() for pid in started):
            assert time.monotonic() < end, "a process of the server lives on"
            time.sleep(0.1)
