"""A language model behind an HTTP server on the loopback interface reads sentences about furniture; the tests cover usable and unusable
answers of the model.
"""

from collections.abc import Callable, Iterator

import pytest
from chat_server import ChatServer, completion

from radartwin.errors import BackendError
from radartwin.io.chat import Endpoint
from radartwin.scene import objects
from radartwin.scene.layouts.layout import Layout
from radartwin.scene.layouts.model import read_sentence
from radartwin.scene.scene import Scene, Surface

HARD = "kindly see to it that a mug ends up somewhere on the desk"
SCENE = Scene([Surface(objects.box([0, 0, 0.7], [1, 1, 0.73]), "wood", "desk", role="room")])
GOOD = {"objects": [{"object": "mug", "on": "desk", "name": None, "relations": None}]}


def endpoint(url: str, pause_s: float = 0.01) -> Endpoint:
    return Endpoint(url, "tiny", timeout_s=5.0, pause_s=pause_s)


@pytest.fixture
def model() -> Iterator[Callable[..., ChatServer]]:
    """Start a server that sends the given answers one after another and then repeats the last answer."""
    started = []

    def start(*answers: object) -> ChatServer:
        started.append(ChatServer(lambda number, body: completion(answers[min(number, len(answers) - 1)])))
        return started[-1]

    yield start
    for server in started:
        server.stop()


def test_a_simple_sentence_needs_no_server():
    layout = read_sentence("a mug on the desk", SCENE, endpoint=endpoint("http://127.0.0.1:9/v1"))
    assert layout.items[0].on == "desk"


def test_the_request_has_schema_and_names_and_the_answer_becomes_the_layout(model):
    server = model(GOOD)
    layout = read_sentence(HARD, SCENE, endpoint=endpoint(server.url))
    assert layout == Layout.from_dict({"objects": [{"object": "mug", "on": "desk"}]})
    (request,) = server.requests
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
    "an unknown material": {"objects": [{"object": "mug", "on": "desk", "material": {"layers": [["cheese", 0.001]]}}]},
}


def test_surfaces_that_the_question_leaves_out_are_counted(model):
    boxes = [Surface(objects.box([0, 0, k], [0.1, 0.1, k + 0.1]), "wood", f"box {k}") for k in range(300)]
    with pytest.warns(UserWarning, match=r"301 named surfaces.*only the 300 largest ones; use a layout file"):
        read_sentence(HARD, Scene([*SCENE, *boxes]), endpoint=endpoint(model(GOOD).url))


@pytest.mark.parametrize("first", BAD_FIRST.values(), ids=BAD_FIRST)
def test_an_unusable_answer_is_returned_with_the_reason(model, first):
    server = model(first, '```json\n{"objects": [{"object": "mug", "on": "desk"}]}\n```')
    assert read_sentence(HARD, SCENE, endpoint=endpoint(server.url)).items[0].object == "mug"
    assert len(server.requests) == 2
    assert server.requests[1]["messages"][-1]["content"].startswith("That cannot be used: ")


def test_repeated_unusable_answers_raise_an_error(model):
    server = model("no")
    with pytest.raises(BackendError, match="no usable layout in 3 answers") as caught:
        read_sentence(HARD, SCENE, endpoint=endpoint(server.url))
    assert len(server.requests) == 3
    assert "\n" not in str(caught.value)
