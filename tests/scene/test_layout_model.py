"""Sentences read by a language model behind an HTTP server on loopback: usable and unusable answers."""

import json
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import pytest

from radartwin.errors import BackendError, LayoutError
from radartwin.io.chat import Endpoint
from radartwin.scene import objects
from radartwin.scene.layouts.model import read_sentence
from radartwin.scene.scene import Scene, Surface

HARD = "kindly see to it that a mug ends up somewhere on the desk"
SCENE = Scene([Surface(objects.box([0, 0, 0.7], [1, 1, 0.73]), "wood", "desk", role="room")])
GOOD = {"objects": [{"object": "mug", "on": "desk", "name": None, "relations": None}]}


def answer(content: str | dict[str, Any]) -> dict[str, Any]:
    text = content if isinstance(content, str) else json.dumps(content)
    return {"choices": [{"message": {"role": "assistant", "content": text}}]}


@contextmanager
def server(*answers: Any) -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """A server that gives the answers in turn and repeats the last one; yields its address and the received requests."""
    requests: list[dict[str, Any]] = []

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            body = json.loads(self.rfile.read(int(self.headers["content-length"])))
            requests.append({"path": self.path, "headers": dict(self.headers), **body})
            data = json.dumps(answers[min(len(requests), len(answers)) - 1]).encode()
            self.send_response(200)
            self.send_header("content-length", str(len(data)))
            self.end_headers()
            self.wfile.write(data)

        def log_message(self, format: str, *args: Any) -> None:
            pass

    httpd = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
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


def test_a_simple_sentence_needs_no_server():
    layout = read_sentence("a mug on the desk", SCENE, endpoint=endpoint("http://127.0.0.1:9/v1"))
    assert layout.items[0].on == "desk"


def test_without_a_model_a_hard_sentence_is_refused():
    with pytest.raises(LayoutError, match="language model"):
        read_sentence(HARD, SCENE)


def test_the_request_has_schema_and_names_and_the_answer_becomes_the_layout(monkeypatch):
    monkeypatch.setenv("RADARTWIN_LLM_KEY", "a-key")
    with server(answer(GOOD)) as (url, requests):
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
def test_an_unusable_answer_is_returned_with_the_reason(first):
    with server(answer(first), answer("```json\n" + json.dumps(GOOD) + "\n```")) as (url, requests):
        assert read_sentence(HARD, SCENE, endpoint=endpoint(url)).items[0].object == "mug"
    assert len(requests) == 2
    assert requests[1]["messages"][-1]["content"].startswith("That cannot be used: ")


def test_repeated_unusable_answers_raise_an_error():
    with server(answer("no")) as (url, requests), pytest.raises(BackendError, match="no usable layout in 3 answers") as caught:
        read_sentence(HARD, SCENE, endpoint=endpoint(url))
    assert len(requests) == 3
    assert "\n" not in str(caught.value)


def test_an_unreachable_server_is_reported():
    with pytest.raises(BackendError, match="no connection"):
        read_sentence(HARD, SCENE, endpoint=endpoint("http://127.0.0.1:9/v1", pause_s=60))
