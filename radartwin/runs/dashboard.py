"""`radartwin dashboard`: MLflow's own server on loopback, over the runs of the output folder."""

from __future__ import annotations

import contextlib
import os
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from pathlib import Path

from radartwin.config.study import TrackingConfig
from radartwin.errors import BackendError, ConfigError
from radartwin.runs.tracking import Tracker

HOST, USUAL_PORT = "127.0.0.1", 5000
STARTS_WITHIN_S, ENDS_WITHIN_S = 120, 5


def dashboard(config: TrackingConfig, output: Path, port: int | None = None) -> int:
    """Serve until interrupted; the exit status of the server.

    Args:
        port: None: 5000, or a free one if that is taken.
    Raises:
        ConfigError: tracking goes to a server of its own, or is off.
        BackendError: the port asked for is taken.
    """
    tracker = Tracker(config, output)
    if tracker.off:
        raise ConfigError("tracking=off leaves no runs to show; use tracking=mlflow")
    if tracker.artifacts is None:
        raise ConfigError(f"tracking.uri={tracker.uri} is a server of its own; open it in a browser")
    if port and not _free(port):
        raise BackendError(f"port {port} is taken; leave --port out and a free one is found")
    port = port or next((p for p in (USUAL_PORT,) if _free(p)), 0) or _any_port()
    tracker.prepare()
    command = [sys.executable, "-m", "mlflow", "server", "--backend-store-uri", tracker.uri, "--host", HOST]
    command += ["--port", str(port), "--workers", "1", "--artifacts-destination", tracker.artifacts]
    with contextlib.suppress(KeyboardInterrupt):
        # Without the runners of MLflow's own jobs, seven processes for language models. Ctrl-C reaches us alone; we end the server,
        # whatever it waits for.
        environment = {"MLFLOW_SERVER_ENABLE_JOB_EXECUTION": "false", **os.environ}
        server = subprocess.Popen(command, env=environment, start_new_session=True)
        try:
            threading.Thread(target=_announce, args=(server, port), daemon=True).start()
            return server.wait()
        finally:
            _end(server)
    return 0


def _end(server: subprocess.Popen[bytes]) -> None:
    """End the server and its workers: asked first, then not."""
    for sign in (signal.SIGTERM, signal.SIGKILL):
        with contextlib.suppress(ProcessLookupError):
            os.killpg(server.pid, sign)
        with contextlib.suppress(subprocess.TimeoutExpired):
            server.wait(ENDS_WITHIN_S)
            return


def _announce(server: subprocess.Popen[bytes], port: int) -> None:
    """Say the address once the server answers."""
    address, end = f"http://{HOST}:{port}", time.monotonic() + STARTS_WITHIN_S
    while server.poll() is None and time.monotonic() < end:
        if _answers(f"{address}/health"):
            print(f"dashboard: {address} (Ctrl-C ends it)", flush=True)
            return
        time.sleep(0.2)


def _answers(url: str) -> bool:
    try:
        with urllib.request.urlopen(url, timeout=5):
            return True
    except (urllib.error.URLError, ConnectionError, TimeoutError):
        return False


def _free(port: int) -> bool:
    with socket.socket() as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((HOST, port))
        except OSError:
            return False
    return True


def _any_port() -> int:
    with socket.socket() as probe:
        probe.bind((HOST, 0))
        return probe.getsockname()[1]
