"""Implement `radartwin dashboard`: start MLflow's web server on this machine, to show the runs in the output folder."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading
import time
import urllib.request
from pathlib import Path

from radartwin.config.study import TrackingConfig
from radartwin.errors import ConfigError, MissingError
from radartwin.io.serving import HOST, STEP_S, free_port, ignore_signals
from radartwin.runs.start_page import START
from radartwin.runs.tracking import Tracker

USUAL_PORT = 5000
THREADS = 40  # largest number of requests that the server answers at once (the default of AnyIO, which runs its threads)
STARTS_WITHIN_S, ENDS_WITHIN_S = 120, 5


def dashboard(config: TrackingConfig, output: Path, port: int | None = None) -> int:
    """Start MLflow's server and wait until it ends, or until Ctrl-C, SIGTERM or SIGHUP.

    Returns the exit status of the server, or 0 after a signal.

    Args:
        port: port of the web server; None means 5000, or another free port if 5000 is taken.
    Raises:
        ConfigError: tracking is switched off, or uses another MLflow server.
        MissingError: the output folder has no database of runs.
        BackendError: the port given by the user is taken.
    """
    tracker = Tracker(config, output)
    if tracker.off:
        raise ConfigError("tracking=off leaves no runs to show; use tracking=mlflow")
    if tracker.artifacts is None:
        raise ConfigError(f"tracking.uri={tracker.uri} is a server of its own; open it in a browser")
    if not tracker.exists:
        raise MissingError(f"{output}: no run is tracked in this folder; give the output folder of a run with --output")
    port = free_port(port, USUAL_PORT)
    tracker.prepare()
    command = [sys.executable, "-m", "radartwin.runs.start_page", tracker.uri, tracker.artifacts, HOST, str(port)]
    # MLflow's 40 threads by default share 15 connections to the database, and a request that gets no connection for 30 s fails. RadarTwin
    # therefore gives the server one connection per thread, and switches off jobs with language models.
    defaults = {"MLFLOW_SERVER_ENABLE_JOB_EXECUTION": "false", "MLFLOW_SQLALCHEMYSTORE_POOL_SIZE": str(THREADS)}
    environment = {**defaults, **os.environ}
    with contextlib.suppress(KeyboardInterrupt):
        # The server gets a session of its own, so it does not receive Ctrl-C. This process ends the server and the server's children.
        server = subprocess.Popen(command, env=environment, start_new_session=True)
        try:
            threading.Thread(target=_announce, args=(server, port), daemon=True).start()
            while (status := server.poll()) is None:
                time.sleep(STEP_S)
            return status
        finally:
            ignore_signals()
            _end(server)
    return 0


def _end(server: subprocess.Popen[bytes]) -> None:
    """End the MLflow server and the processes that it started: first with SIGTERM, and after some seconds with SIGKILL."""
    for number in (signal.SIGTERM, signal.SIGKILL):
        with contextlib.suppress(ProcessLookupError):
            os.killpg(server.pid, number)
        with contextlib.suppress(subprocess.TimeoutExpired):
            server.wait(ENDS_WITHIN_S)


def _announce(server: subprocess.Popen[bytes], port: int) -> None:
    """Print the address of the start page as soon as the MLflow server answers."""
    address, end = f"http://{HOST}:{port}", time.monotonic() + STARTS_WITHIN_S
    while server.poll() is None and time.monotonic() < end:
        with contextlib.suppress(OSError), urllib.request.urlopen(f"{address}/health", timeout=5):
            print(f"dashboard: {address}{START} (Ctrl-C ends it)", flush=True)
            return
        time.sleep(0.2)
