"""`radartwin dashboard` is MLflow's own server, on loopback, over the runs of the output folder."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Mapping
from pathlib import Path

import pytest

from radartwin.config.study import TrackingConfig
from radartwin.runs.tracking import Tracker

# SQLAlchemy warns mlflow of a loader it will drop; not ours to mend.
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


def test_the_dashboard_shows_the_runs_of_the_output_folder(tmp_path: Path) -> None:
    with Tracker(TrackingConfig(), tmp_path).run("environment", "a" * 32, "materials=void", {}) as record:
        record.metrics = {"correlation_2m": 0.42}
    address = f"http://127.0.0.1:{(port := free_port())}"
    command = [sys.executable, "-m", "radartwin", "dashboard", "--output", str(tmp_path), "--port", str(port)]
    server = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True)
    try:
        for _ in range(240):
            try:
                assert answer(f"{address}/health") == "OK"
                break
            except (urllib.error.URLError, ConnectionError):
                assert server.poll() is None, "the server stopped"
                time.sleep(0.25)
        assert "mlflow" in answer(address).lower()
        assert listening(port) == {"127.0.0.1"}
        with pytest.raises(urllib.error.HTTPError, match="403"):  # a page elsewhere whose name leads here
            answer(address, headers={"Host": "attacker.example"})
        experiments = json.loads(answer(f"{address}/api/2.0/mlflow/experiments/search?max_results=10"))["experiments"]
        chosen = [e["experiment_id"] for e in experiments if e["name"] == "environment"]
        query = json.dumps({"experiment_ids": chosen}).encode()
        runs = json.loads(answer(f"{address}/api/2.0/mlflow/runs/search", query))["runs"]
        assert [(m["key"], m["value"]) for m in runs[0]["data"]["metrics"]] == [("correlation_2m", 0.42)]
    finally:
        os.killpg(server.pid, signal.SIGINT)
        server.wait(20)
