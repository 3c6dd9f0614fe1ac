"""Start an OpenAI-compatible chat server on the loopback interface; the test defines the replies of the server."""

from __future__ import annotations

import contextlib
import json
import threading
import time
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

Reply = tuple[int, dict[str, str], str]  # status, headers, body


def completion(content: object) -> Reply:
    """Return the HTTP reply of a model that answers with this text, or with this object as JSON."""
    text = content if isinstance(content, str) else json.dumps(content)
    return 200, {}, json.dumps({"choices": [{"message": {"role": "assistant", "content": text}}]})


class ChatServer:
    """This class starts a chat server for a test and records the requests that the server receives.

    Args:
        reply: function that computes the reply from the number of the request (the first is 0) and the body of the request.
    """

    def __init__(self, reply: Callable[[int, dict[str, Any]], Reply]) -> None:
        self.requests: list[dict[str, Any]] = []
        self.headers: list[dict[str, str]] = []
        self.times: list[float] = []
        self.paths: list[str] = []
        self.max_parallel = self._running = 0
        guard = threading.Lock()
        outer = self

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                body = json.loads(self.rfile.read(int(self.headers.get("Content-Length", 0))) or "{}")
                with guard:
                    number = len(outer.requests)
                    outer.requests.append(body)
                    outer.headers.append(dict(self.headers))
                    outer.times.append(time.monotonic())
                    outer.paths.append(self.path)
                    outer._running += 1
                    outer.max_parallel = max(outer.max_parallel, outer._running)
                try:
                    status, headers, text = reply(number, body)
                finally:
                    with guard:
                        outer._running -= 1
                self.send_response(status)
                for name, value in {"Content-Type": "application/json", "Content-Length": str(len(text.encode())), **headers}.items():
                    self.send_header(name, value)
                self.end_headers()
                with contextlib.suppress(BrokenPipeError):  # the client timed out
                    self.wfile.write(text.encode())

            do_GET = do_POST

            def log_message(self, *_: object) -> None: ...

        self._server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self._server.daemon_threads = True
        self.url = f"http://127.0.0.1:{self._server.server_address[1]}/v1"
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.01,), daemon=True)
        self._thread.start()

    def stop(self) -> None:
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()
