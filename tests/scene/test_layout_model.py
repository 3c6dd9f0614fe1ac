"""Sentences read by a model behind a real HTTP server on loopback: good answers, bad ones, and no server."""

import json
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import pytest

from radartwin.errors import BackendError, ConfigError, LayoutError
from radartwin.io.chat import Endpoint
from radartwin.scene import objects
from radartwin.scene.layouts.model import read_sentence
from radartwin.scene.scene import Scene, Surface

HARD = "kindly see to it that a mug ends up somewhere on the desk"
SCENE = Scene([Surface(objects.box([0, 0, 0.7], [1, 1, 0.73]), "wood", "desk", role="room")])
GOOD = {"objects": [{"object": "mug", "on": "desk", "name": None, "relations": None}]}


def said(content: str | dict[str, Any]) -> tuple[int, Any, dict[str, str]]:
    text = content if isinstance(content, str) else json.dumps(content)
    return 200, {"choices": [{"message": {"role": "assistant", "content": text}}]}, {}


@contextmanager
def server(*answers: Any) -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """A server that gives the answers one after the other, the last again and again; its address and the requests it had."""
    requests: list[dict[str, Any]] = []

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            body = json.loads(self.rfile.read(int(self.headers["content-length"])))
            requests.append({"path": self.path, "headers": dict(self.headers), **body})
            answer = answers[min(len(requests), len(answers)) - 1]
            status, payload, headers = answer() if callable(answer) else answer  # type: ignore[misc]
            data = payload if isinstance(payload, bytes) else json.dumps(payload).encode()
            self.send_response(status)
            for key, value in {"content-length": str(len(data)), **headers}.items():
                self.send_header(key, value)
            self.end_headers()
            self.wfile.write(data)

        def log_message(self, format: str, *args: Any) -> None:
            pass

    class Server(ThreadingHTTPServer):
        def handle_error(self, request: Any, client_address: Any) -> None:
            """A client that has stopped waiting is no error here."""

    httpd = Server(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=httpd.serve_forever, kwargs={"poll_interval": 0.02}, daemon=True)
    thread.start()
    try:
        yield f"http://127.0.0.1:{httpd.server_address[1]}/v1", requests
    finally:
        httpd.shutdown()
        httpd.server_close()
        thread.join(5)


def endpoint(url: str, **options: Any) -> Endpoint:
    settings: dict[str, Any] = {"timeout_s": 5.0, "pause_s": 0.01} | options
    return Endpoint(url, "tiny", **settings)


def test_a_simple_sentence_asks_nobody():
    layout = read_sentence("a mug on the desk", SCENE, endpoint=endpoint("http://127.0.0.1:9/v1"))
    assert layout.items[0].on == "desk"


def test_without_a_model_a_hard_sentence_is_refused():
    with pytest.raises(LayoutError, match="language model"):
        read_sentence(HARD, SCENE)


def test_the_model_gets_schema_and_names_and_its_answer_is_the_layout(monkeypatch):
    monkeypatch.setenv("RADARTWIN_LLM_KEY", "a-key")
    with server(said(GOOD)) as (url, requests):
        layout = read_sentence(HARD, SCENE, endpoint=endpoint(url))
    assert layout.to_dict() == {"objects": [{"object": "mug", "on": "desk"}]}
    (request,) = requests
    assert request["path"] == "/v1/chat/completions"
    assert request["headers"]["Authorization"] == "Bearer a-key"
    assert request["response_format"]["json_schema"]["schema"]["required"] == ["objects"]
    assert "desk" in request["messages"][0]["content"]
    assert "corner_reflector" in request["messages"][0]["content"]
    assert request["messages"][1]["content"] == HARD


BAD_FIRST = {
    "no json": "Sure! The mug goes on the desk.",
    "half a json": '{"objects": [{"object": "mug"',
    "another schema": {"items": []},
    "an unknown object": {"objects": [{"object": "teapot", "on": "desk"}]},
    "an unknown anchor": {"objects": [{"object": "mug", "on": "sideboard"}]},
    "nowhere": {"objects": [{"object": "mug"}]},
}


@pytest.mark.parametrize("first", BAD_FIRST.values(), ids=BAD_FIRST)
def test_an_unusable_answer_goes_back_with_the_reason(first):
    with server(said(first), said("```json\n" + json.dumps(GOOD) + "\n```")) as (url, requests):
        assert read_sentence(HARD, SCENE, endpoint=endpoint(url)).items[0].object == "mug"
    assert len(requests) == 2
    assert requests[1]["messages"][-1]["content"].startswith("That cannot be used: ")


def test_answers_that_stay_unusable_are_given_up():
    with server(said("no")) as (url, requests), pytest.raises(BackendError, match="no usable layout in 3 answers") as caught:
        read_sentence(HARD, SCENE, endpoint=endpoint(url))
    assert len(requests) == 3
    assert "\n" not in str(caught.value)


def test_a_busy_server_is_asked_again_and_told_pauses_are_kept():
    busy = (429, {"error": "slow down"}, {"retry-after": "0.2"})
    start = time.monotonic()
    with server((503, {}, {}), busy, said(GOOD)) as (url, requests):
        read_sentence(HARD, SCENE, endpoint=endpoint(url))
    assert len(requests) == 3
    assert time.monotonic() - start > 0.2


def test_an_old_server_is_asked_without_a_schema():
    with server((400, {"error": "unknown field response_format"}, {}), said(GOOD)) as (url, requests):
        read_sentence(HARD, SCENE, endpoint=endpoint(url))
    assert "response_format" not in requests[1]


def slow() -> tuple[int, Any, dict[str, str]]:
    time.sleep(0.6)
    return said(GOOD)


FAILURES = {
    "too slow": (slow, "no answer within 0.2 s after 2 tries"),
    "always busy": ((503, {}, {}), "status 503 after 2 tries"),
    "no key": ((401, {"error": "who are you?"}, {}), "RADARTWIN_LLM_KEY"),
    "not there": ((404, {"error": "no model tiny"}, {}), "serves tiny"),
    "no api": ((200, b"<html>hello</html>", {}), "OpenAI-compatible"),
    "an empty answer": ((200, {"choices": []}, {}), "OpenAI-compatible"),
}


@pytest.mark.parametrize(("answer", "word"), FAILURES.values(), ids=FAILURES)
def test_a_server_that_fails_is_named_in_one_line(answer, word):
    with server(answer) as (url, _), pytest.raises(BackendError, match=word) as caught:
        read_sentence(HARD, SCENE, endpoint=endpoint(url, timeout_s=0.2, requests=2))
    assert url in str(caught.value)
    assert "\n" not in str(caught.value)


def test_nobody_at_the_address_is_said_at_once():
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        url = f"http://127.0.0.1:{free.getsockname()[1]}/v1"
    with pytest.raises(BackendError, match="no connection"):
        read_sentence(HARD, SCENE, endpoint=endpoint(url, pause_s=60))


@pytest.mark.parametrize("url", ["localhost:8000", "ftp://host/v1", "http://", "http://host:port/v1"])
def test_an_address_that_is_none_is_refused(url):
    with pytest.raises(ConfigError, match="http://HOST:PORT/v1"):
        Endpoint(url, "tiny")
