"""Serve the live page on this machine until Ctrl-C, SIGTERM or SIGHUP (`radartwin view SCENE --live`)."""

from __future__ import annotations

import contextlib
import io
import os
import sys
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from radartwin.errors import BackendError, SceneError
from radartwin.io.serving import HOST, STEP_S, free_port, ignore_signals
from radartwin.live.live_page import Page
from radartwin.live.playback import Playback
from radartwin.live.session import Session
from radartwin.live.setting import split
from radartwin.live.tracing import LiveTracer
from radartwin.radar.chirp import Radar
from radartwin.scene.scene import Scene

USUAL_PORT = 8080


def serve(scene: Scene, radar: Radar, start: np.ndarray, port: int | None = None, playback: Playback | None = None) -> int:
    """Serve the live page of a scene, and end with status 0 after Ctrl-C, SIGTERM or SIGHUP.

    Args:
        start: sensor-to-world pose (4, 4) of the radar at the start.
        port: port on the loopback address; None means 8080, or another free port if 8080 is taken.
    Raises BackendError if viser is absent or cannot be secured or the port is taken, and SceneError for an empty scene.
    """
    with contextlib.suppress(KeyboardInterrupt), running(scene, radar, start, port, playback) as live:
        try:
            print(f"live: http://{HOST}:{live.port}", flush=True)
            while not live.finished.wait(STEP_S):
                pass
        except KeyboardInterrupt:
            ignore_signals()
            sys.stdout.flush()
            os._exit(0)  # a regular end would unload the compiled code that a search still runs
        raise live.crash[0]
    return 0


@dataclass(frozen=True, eq=False)
class Live:
    """Hold a running live page. After a defect of the program, `crash` holds the exception, and the event `finished` is set."""

    port: int
    server: Any
    page: Page
    finished: threading.Event
    crash: list[BaseException]


@contextlib.contextmanager
def running(scene: Scene, radar: Radar, start: np.ndarray, port: int | None = None, playback: Playback | None = None) -> Iterator[Live]:
    """Run the live page within the `with` block. The arguments and errors are those of `serve`."""
    if not len(scene):
        raise SceneError("the scene has no surfaces, so there is nothing to view; reconstruct a scan or add surfaces")
    room, movables = split(scene)
    tracer, crash, finished = LiveTracer(room, radar, movables), [], threading.Event()

    def crashed(error: BaseException) -> None:
        crash.append(error)
        finished.set()

    session = Session(tracer, lambda answer: page.show(answer), lambda text: page.controls.fail(text), crashed)
    server = _server(free_port(port, USUAL_PORT))
    try:
        page = Page(server, scene, start, tracer, session.request, playback)
        session.start()
        page.ask()
        yield Live(server.get_port(), server, page, finished, crash)
    finally:
        session.end()
        _quietly(server.stop)


def _server(port: int) -> Any:
    """Start a viser server that accepts connections only from its own pages and only on this machine."""
    try:
        import viser
    except ImportError as error:
        raise BackendError("view --live needs viser: pip install 'radartwin[live]'") from error

    class Loopback(viser.ViserServer):
        """A server that opens no tunnel to the internet, although a page may ask for one."""

        def request_share_url(self, verbose: bool = True) -> str | None:
            return None

    with _only_own_pages(port) as checked, contextlib.redirect_stdout(io.StringIO()):
        server = Loopback(host=HOST, port=port, verbose=False)  # returns after its web server has started
    if not checked:
        _quietly(server.stop)
        raise BackendError("view --live cannot check which pages connect to this version of viser: pip install 'radartwin[live]'")
    if server.get_port() != port:  # viser takes the next port if another program has just taken this one
        _quietly(server.stop)
        raise BackendError(f"port {port} is taken; leave --port out and a free one is found")
    return server


@contextlib.contextmanager
def _only_own_pages(port: int) -> Iterator[list[int]]:
    """Make viser's web server refuse web sockets of pages of other addresses, which a browser would let through (viser does not check).

    Yields a list, which gets the port when the web server starts with this check.
    """
    import websockets.asyncio.server as module

    before = module.serve
    origins = [f"http://{HOST}:{port}", f"http://localhost:{port}", None]  # None: a program that is not a browser
    checked: list[int] = []

    def serve_own(*arguments: Any, **options: Any) -> Any:
        checked.append(port)
        return before(*arguments, **options, origins=origins)

    module.serve = serve_own  # type: ignore[assignment, misc]
    try:
        yield checked
    finally:
        module.serve = before  # type: ignore[misc]


def _quietly(stop: Any) -> None:
    """Stop the server without the message that viser prints."""
    with contextlib.redirect_stdout(io.StringIO()):
        stop()
