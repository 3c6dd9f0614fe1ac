"""The class `Server`, which asks a language model over HTTP: its requests, its repeated tries and its errors."""

from __future__ import annotations

import base64
import hashlib
import json
import socket
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from chat_server import ChatServer, Reply, completion

from radartwin.errors import BackendError, ConfigError
from radartwin.io.chat import KEY_VARIABLE
from radartwin.label.questions import Question, questions
from radartwin.label.server import Server
from radartwin.scene import objects
from radartwin.scene.scene import Scene, Surface

GOOD = {"material": "wood", "finish": "smooth", "confidence": 0.8, "reason": "grain"}


@pytest.fixture
def model() -> Iterator[Callable[[Callable[[int, dict[str, Any]], Reply]], ChatServer]]:
    started = []

    def start(reply: Callable[[int, dict[str, Any]], Reply]) -> ChatServer:
        started.append(ChatServer(reply))
        return started[-1]

    yield start
    for chat in started:
        chat.stop()


@pytest.fixture(scope="module")
def asked() -> list[Question]:
    plates = [Surface(objects.plate(2, 1 + k / 10), "concrete", f"plate{k}", role="room") for k in range(3)]
    can = Surface(objects.cylinder(0.05, 0.1), "metal", "can")
    return [questions(Scene([surface]), views=1)[0] for surface in (*plates, can)]


def valid(body: dict[str, Any]) -> dict[str, Any]:
    """Return a valid answer of the model to a question about a surface or an object."""
    about_object = "object" in json.dumps(body["response_format"])
    return {**GOOD, "wall_thickness_mm": None, "contents": "solid"} if about_object else GOOD


def server(url: str, **options: Any) -> Server:
    return Server(url, "tiny", **{"pause_s": 0.01, "timeout_s": 5.0, **options})


def test_request_has_pictures_schema_and_key(model, asked, monkeypatch) -> None:
    monkeypatch.setenv(KEY_VARIABLE, "secret-word")
    chat = model(lambda number, body: completion(GOOD))
    [(question, record)] = server(chat.url).answers(asked[:1])
    assert question is asked[0]
    assert (record.answer.material, record.answer.confidence, record.answer.reason) == ("wood", 0.8, "grain")
    assert (record.model, record.provider, record.answer.attempts) == ("tiny", "server", 1)
    [body] = chat.requests
    assert chat.paths == ["/v1/chat/completions"]
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
    assert chat.headers[0]["Authorization"] == "Bearer secret-word"
    secret = Server("http://user:secret-word@host:1/v1?key=secret-word", "tiny", key="secret-word")
    assert "secret-word" not in json.dumps(record.to_dict()) + repr(secret)


@pytest.mark.parametrize(
    ("bad", "complaint"),
    [("I think it is wood.", "no JSON object"), ('{"material": "wood", ', "not valid JSON"), ({**GOOD, "confidence": 7}, "7 is greater")],
)
def test_invalid_answer_is_sent_back_with_its_error(model, asked, bad, complaint) -> None:
    chat = model(lambda number, body: completion(bad if number == 0 else GOOD))
    [(_, record)] = server(chat.url).answers(asked[:1])
    assert (record.answer.material, record.answer.attempts) == ("wood", 2)
    turns = chat.requests[1]["messages"]
    assert [turn["role"] for turn in turns] == ["user", "assistant", "user"]
    assert complaint in turns[2]["content"]


def test_last_invalid_answer_becomes_other_or_the_closest_category(model, asked) -> None:
    chat = model(lambda number, body: completion({**GOOD, "material": "cheese"}))
    [(_, record)] = server(chat.url).answers(asked[:1])
    assert (record.answer.material, record.answer.invalid, record.answer.attempts) == ("other", True, 3)
    assert "cheese" in record.answer.reason
    assert len(chat.requests) == 3
    other = model(lambda number, body: completion({**GOOD, "material": "porcelain"}))
    [(_, record)] = server(other.url).answers(asked[:1])
    assert (record.answer.named, record.answer.invalid) == ("porcelain", False)


def test_retry_after_is_obeyed(model, asked) -> None:
    chat = model(lambda number, body: (429, {"Retry-After": "0.6"}, "{}") if number == 0 else completion(GOOD))
    [(_, record)] = server(chat.url).answers(asked[:1])
    assert record.answer.material == "wood"
    assert chat.times[1] - chat.times[0] >= 0.6


def test_server_errors_and_timeouts_are_retried_after_growing_pauses(model, asked) -> None:
    def reply(number: int, body: dict[str, Any]) -> Reply:
        if number == 1:
            time.sleep(0.8)
        return (500, {}, "boom") if number == 0 else (503, {}, "busy") if number == 2 else completion(GOOD)

    chat = model(reply)
    [(_, record)] = server(chat.url, timeout_s=0.3, pause_s=0.1).answers(asked[:1])
    assert record.answer.material == "wood"
    assert len(chat.requests) == 4
    pauses = [later - earlier for earlier, later in zip(chat.times, chat.times[1:], strict=False)]
    assert all(pause >= 0.1 * 2**k for k, pause in enumerate(pauses))


def test_answers_are_kept_if_another_question_times_out(model, asked) -> None:
    slow = asked[1].images[0]

    def reply(number: int, body: dict[str, Any]) -> Reply:
        jpeg = base64.b64decode(body["messages"][0]["content"][0]["image_url"]["url"].partition(",")[2])
        if hashlib.sha256(jpeg).hexdigest() == slow:
            time.sleep(0.6)
        return completion(valid(body))

    chat = model(reply)
    answered: list[Question] = []
    answers = server(chat.url, timeout_s=0.25, requests=2).answers(asked[:3])
    with pytest.raises(BackendError, match=r"no answer within 0\.25 s after 2 tries; .*1 of 3 questions are unanswered"):
        answered.extend(question for question, _ in answers)
    assert {question.id for question in answered} == {asked[0].id, asked[2].id}


def test_unreachable_server_is_named(asked) -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    started = time.monotonic()
    with pytest.raises(
        BackendError, match=rf"http://127.0.0.1:{port}/v1: no connection .* start the server, or correct its address; 4 of 4"
    ):
        list(server(f"http://127.0.0.1:{port}/v1", requests=2).answers(asked))
    assert time.monotonic() - started < 5


@pytest.mark.parametrize(
    ("status", "remedy"), [(401, KEY_VARIABLE), (404, "serves tiny"), (400, "server's log"), (200, "does not answer as an OpenAI-compat")]
)
def test_refused_request_is_not_repeated(model, asked, status, remedy) -> None:
    with pytest.raises(ConfigError, match="is not the address of a server"):
        Server("localhost:8000", "tiny")
    chat = model(lambda number, body: (status, {}, "<html>" if status == 200 else '{"error": "no"}'))
    with pytest.raises(BackendError, match="OpenAI" if status == 200 else f"status {status}") as caught:
        list(server(chat.url, concurrency=1).answers(asked))
    assert remedy in str(caught.value)
    assert len(chat.requests) == 1


def test_number_of_parallel_requests_is_limited(model, asked) -> None:
    def reply(number: int, body: dict[str, Any]) -> Reply:
        time.sleep(0.1)
        return completion(valid(body))

    chat = model(reply)
    assert len(list(server(chat.url, concurrency=2).answers(asked))) == 4
    assert chat.max_parallel == 2
