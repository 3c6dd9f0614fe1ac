"""Serve web pages on this machine only: the loopback address, free ports, and the signals that end a server."""

from __future__ import annotations

import contextlib
import signal
import socket
from collections.abc import Iterator
from typing import NoReturn

from radartwin.errors import BackendError

HOST = "127.0.0.1"
ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
# A server waits in steps of STEP_S seconds. If a signal arrives just before Python begins to wait, Python raises KeyboardInterrupt only
# when the wait is over.
STEP_S = 0.5


@contextlib.contextmanager
def interrupted_by_signals() -> Iterator[None]:
    """Make SIGINT, SIGTERM and SIGHUP raise KeyboardInterrupt(number of the signal). With `nohup`, SIGHUP stays ignored."""

    def interrupt(number: int, _: object) -> NoReturn:
        raise KeyboardInterrupt(number)

    nohup = signal.getsignal(signal.SIGHUP) is signal.SIG_IGN
    before = {number: signal.signal(number, interrupt) for number in ENDING if not (nohup and number == signal.SIGHUP)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def ignore_signals() -> None:
    """Ignore the signals of ENDING from now on, so that a second Ctrl-C does not interrupt the end of a server."""
    for number in ENDING:
        signal.signal(number, signal.SIG_IGN)


def free_port(port: int | None, usual: int) -> int:
    """Return `port`, or `usual` for None, or a free port if that is taken or 0. Raises BackendError if the given port is taken."""
    if port and not _bindable(port):
        raise BackendError(f"port {port} is taken; leave --port out and a free one is found")
    return port or (_bindable(usual) if port is None else 0) or _bindable(0)


def _bindable(port: int) -> int:
    """Return `port` if it is free, else 0. If `port` is 0, return a free port that the operating system chooses."""
    with socket.socket() as probe, contextlib.suppress(OSError):
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        probe.bind((HOST, port))
        return probe.getsockname()[1]
    return 0
