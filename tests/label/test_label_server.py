"""The server provider against a real HTTP server on loopback: what it sends, what it survives, what it says when it cannot go on."""

from __future__ import annotations

import base64
import contextlib
import hashlib
import json
import socket
import threading
import time
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import pytest

from radartwin.errors import BackendError, ConfigError
from radartwin.io.chat import _retry_after
from radartwin.label.questions import Question, questions
from radartwin.label.server import KEY_VARIABLE, Server
from radartwin.scene import objects
from radartwin.scene.scene import Scene, Surface

GOOD = {"material": "wood", "confidence": 0.8, "reason": "grain"}
Reply = tuple[int, dict[str, str], str]


def words(content: object) -> Reply:
    """A chat completion that says this."""
    text = content if isinstance(content, str) else json.dumps(content)
    return 200, {}, json.dumps({"choices": [{"message": {"role": "assistant", "content": text}}]})


class Model:
    """An OpenAI-compatible server whose replies a test writes: a function of the request's number and body."""

    def __init__(self, reply: Callable[[int, dict[str, Any]], Reply]) -> None:
        self.requests: list[dict[str, Any]] = []
        self.headers: list[dict[str, str]] = []
        self.times: list[float] = []
        self.paths: list[str] = []
        self.most_at_once = self._now = 0
        guard = threading.Lock()
        model = self

        class Handler(BaseHTTPRequestHandler):
            def do_POST(self) -> None:
                body = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
                with guard:
                    number = len(model.requests)
                    model.requests.append(body)
                    model.headers.append(dict(self.headers))
                    model.times.append(time.monotonic())
                    model.paths.append(self.path)
                    model._now += 1
                    model.most_at_once = max(model.most_at_once, model._now)
                try:
                    status, headers, text = reply(number, body)
                finally:
                    with guard:
                        model._now -= 1
                self.send_response(status)
                for name, value in {"Content-Type": "application/json", "Content-Length": str(len(text.encode())), **headers}.items():
                    self.send_header(name, value)
                self.end_headers()
                with contextlib.suppress(BrokenPipeError):  # the client timed out
                    self.wfile.write(text.encode())

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


@pytest.fixture
def model() -> Iterator[Callable[[Callable[[int, dict[str, Any]], Reply]], Model]]:
    started = []

    def start(reply: Callable[[int, dict[str, Any]], Reply]) -> Model:
        started.append(Model(reply))
        return started[-1]

    yield start
    for one in started:
        one.stop()


@pytest.fixture(scope="module")
def asked() -> list[Question]:
    plates = [Surface(objects.plate(2, 1 + k / 10), "concrete", f"plate{k}", role="room") for k in range(3)]
    can = Surface(objects.cylinder(0.05, 0.1), "metal", "can")
    return [questions(Scene([surface]), views=1)[0] for surface in (*plates, can)]


def server(url: str, **options: Any) -> Server:
    return Server("tiny", url, **{"pause_s": 0.01, "timeout_s": 5.0, **options})


def test_a_good_answer_is_asked_for_once_with_pictures_schema_and_key(model, asked, monkeypatch) -> None:
    monkeypatch.setenv(KEY_VARIABLE, "secret-word")
    one = model(lambda number, body: words(GOOD))
    [(question, record)] = server(one.url).answers(asked[:1])
    assert question is asked[0]
    assert (record.answer.material, record.answer.confidence, record.answer.reason) == ("wood", 0.8, "grain")
    assert (record.model, record.provider, record.answer.attempts) == ("tiny", "server", 1)
    [body] = one.requests
    assert one.paths == ["/v1/chat/completions"]
    assert body["model"] == "tiny"
    assert body["temperature"] == 0
    form = body["response_format"]["json_schema"]["schema"]
    assert len(form["properties"]["material"]["enum"]) == 23
    picture, text = body["messages"][0]["content"]
    assert text == {"type": "text", "text": question.text}
    prefix = "data:image/jpeg;base64,"
    assert picture["image_url"]["url"].startswith(prefix)
    jpeg = base64.b64decode(picture["image_url"]["url"].removeprefix(prefix))
    assert hashlib.sha256(jpeg).hexdigest() == question.images[0]
    assert one.headers[0]["Authorization"] == "Bearer secret-word"
    assert "secret-word" not in json.dumps(record.to_dict()) + repr(server(one.url, key="secret-word"))


def test_objects_are_asked_for_their_wall_and_contents(model, asked) -> None:
    can = {**GOOD, "material": "plastic", "wall_thickness_mm": 1.0, "contents": "water-like liquid"}
    one = model(lambda number, body: words(can))
    [(_, record)] = server(one.url).answers(asked[3:])
    assert (record.answer.wall_thickness_mm, record.answer.contents) == (1.0, "water-like liquid")
    assert "wall_thickness_mm" in one.requests[0]["response_format"]["json_schema"]["schema"]["required"]


@pytest.mark.parametrize(
    ("bad", "complaint"),
    [
        ("I think it is wood.", "no JSON object"),
        ('{"material": "wood", ', "not valid JSON"),
        ({**GOOD, "material": "cheese"}, "'cheese' is not one of"),
        ({**GOOD, "confidence": 7}, "confidence: 7 is greater than the maximum of 1"),
        ({"material": "wood"}, "'confidence' is a required property"),
        ({**GOOD, "colour": "brown"}, "'colour' was unexpected"),
    ],
)
def test_an_invalid_answer_is_asked_again_with_what_is_wrong(model, asked, bad, complaint) -> None:
    one = model(lambda number, body: words(bad if number == 0 else GOOD))
    [(_, record)] = server(one.url).answers(asked[:1])
    assert (record.answer.material, record.answer.attempts) == ("wood", 2)
    turns = one.requests[1]["messages"]
    assert [turn["role"] for turn in turns] == ["user", "assistant", "user"]
    assert complaint in turns[2]["content"]


def test_an_answer_that_stays_outside_the_list_becomes_other_and_a_known_name_its_closest_row(model, asked) -> None:
    one = model(lambda number, body: words({**GOOD, "material": "cheese"}))
    [(_, record)] = server(one.url).answers(asked[:1])
    assert (record.answer.material, record.answer.invalid, record.answer.attempts) == ("other", True, 3)
    assert "cheese" in record.answer.reason
    assert len(one.requests) == 3
    other = model(lambda number, body: words({**GOOD, "material": "porcelain"}))
    [(_, record)] = server(other.url).answers(asked[:1])
    assert (record.answer.named, record.answer.invalid) == ("porcelain", False)


def test_rate_limits_are_obeyed(model, asked) -> None:
    one = model(lambda number, body: (429, {"Retry-After": "0.6"}, "{}") if number == 0 else words(GOOD))
    [(_, record)] = server(one.url).answers(asked[:1])
    assert record.answer.material == "wood"
    assert one.times[1] - one.times[0] >= 0.6


def test_retry_after_is_read_as_seconds_or_as_a_date() -> None:
    import httpx

    def pause(header: str | None) -> float:
        return _retry_after(httpx.Response(429, headers={} if header is None else {"Retry-After": header}), 3.0, lambda: 784111700.0)

    assert pause("7") == 7
    assert pause("Sun, 06 Nov 1994 08:49:37 GMT") == pytest.approx(77)
    assert pause("soon") == pause(None) == 3.0


def test_server_errors_and_time_outs_pass(model, asked) -> None:
    def reply(number: int, body: dict[str, Any]) -> Reply:
        if number == 1:
            time.sleep(0.8)
        return (500, {}, "boom") if number == 0 else (503, {}, "busy") if number == 2 else words(GOOD)

    one = model(reply)
    [(_, record)] = server(one.url, timeout_s=0.3).answers(asked[:1])
    assert record.answer.material == "wood"
    assert len(one.requests) == 4


def test_pauses_between_tries_grow(model, asked) -> None:
    one = model(lambda number, body: (500, {}, "boom"))
    with pytest.raises(BackendError, match=r"status 500 after 4 tries; .*1 of 1 questions are unanswered"):
        list(server(one.url, pause_s=0.1, requests=4).answers(asked[:1]))
    pauses = [later - earlier for earlier, later in zip(one.times, one.times[1:], strict=False)]
    assert all(pause >= 0.1 * 2**k for k, pause in enumerate(pauses))


def test_what_was_answered_is_kept_when_the_rest_times_out(model, asked) -> None:
    slow = asked[1].images[0]

    def reply(number: int, body: dict[str, Any]) -> Reply:
        jpeg = base64.b64decode(body["messages"][0]["content"][0]["image_url"]["url"].partition(",")[2])
        if hashlib.sha256(jpeg).hexdigest() == slow:
            time.sleep(0.6)
        return words({**GOOD, "wall_thickness_mm": None, "contents": "solid"} if "object" in json.dumps(body["response_format"]) else GOOD)

    one = model(reply)
    kept: list[Question] = []
    answers = server(one.url, timeout_s=0.25, requests=2).answers(asked[:3])
    with pytest.raises(BackendError, match=r"no answer within 0\.25 s after 2 tries; .*1 of 3 questions are unanswered"):
        kept.extend(question for question, _ in answers)
    assert {question.id for question in kept} == {asked[0].id, asked[2].id}


def test_a_server_that_is_not_there_is_named(asked) -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    started = time.monotonic()
    with pytest.raises(
        BackendError, match=rf"http://127.0.0.1:{port}/v1: no connection .* start the server, or correct its address; 4 of 4"
    ):
        list(server(f"http://127.0.0.1:{port}/v1", requests=2).answers(asked))
    assert time.monotonic() - started < 5


@pytest.mark.parametrize(("status", "remedy"), [(401, KEY_VARIABLE), (404, "serves tiny"), (400, "server's log")])
def test_a_refusal_is_not_repeated(model, asked, status, remedy) -> None:
    one = model(lambda number, body: (status, {}, '{"error": "no"}'))
    with pytest.raises(BackendError, match=f"status {status}") as caught:
        list(server(one.url, concurrency=1).answers(asked))
    assert remedy in str(caught.value)
    assert len(one.requests) == 1


def test_a_server_without_schemas_is_asked_without_them(model, asked) -> None:
    def reply(number: int, body: dict[str, Any]) -> Reply:
        return (400, {}, '{"error": "response_format is not supported"}') if "response_format" in body else words(GOOD)

    one = model(reply)
    found = dict(server(one.url, concurrency=1).answers(asked[:2]))
    assert [record.answer.material for record in found.values()] == ["wood", "wood"]
    assert len(one.requests) == 3, "it is tried with a schema once"


def test_requests_at_once_are_bounded(model, asked) -> None:
    def reply(number: int, body: dict[str, Any]) -> Reply:
        time.sleep(0.1)
        return words({**GOOD, "wall_thickness_mm": None, "contents": "solid"} if "object" in json.dumps(body["response_format"]) else GOOD)

    one = model(reply)
    assert len(list(server(one.url, concurrency=2).answers(asked))) == 4
    assert one.most_at_once == 2


def test_an_address_that_is_none_is_refused_without_its_password() -> None:
    with pytest.raises(ConfigError, match="is not the address of a server"):
        Server("tiny", "localhost:8000")
    shown = Server("tiny", "http://user:word@host:1/v1?key=word")
    assert shown.shown_url == "http://host:1/v1"
    assert "word" not in repr(shown)


def test_something_else_than_a_model_is_named(model, asked) -> None:
    one = model(lambda number, body: (200, {}, "<html>hello</html>"))
    with pytest.raises(BackendError, match="does not answer as an OpenAI-compatible server"):
        list(server(one.url).answers(asked[:1]))
