"""A vision-language model behind an OpenAI-compatible endpoint: vLLM, Ollama, LM Studio, or a service.

Questions are asked several at once through `radartwin.io.chat`, their pictures as data URIs. Answers that came are kept whatever happens to
the others: a slow one is one question's trouble, a server that refuses or is not there ends the asking.
"""

from __future__ import annotations

import base64
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from radartwin.errors import BackendError
from radartwin.io.chat import Endpoint, NoAnswerInTime
from radartwin.label.answers import schema
from radartwin.label.journal import Record
from radartwin.label.provider import Turn, ask
from radartwin.label.questions import Question

if TYPE_CHECKING:
    import httpx

DEFAULT_MODEL = "OpenGVLab/InternVL2_5-8B"
DEFAULT_URL = "http://127.0.0.1:8000/v1"  # where `vllm serve` listens
KEY_VARIABLE = "RADARTWIN_VLM_KEY"
MAX_TOKENS = 400


@dataclass
class Server:
    """The provider.

    Args:
        url: base of the API, with its /v1.
        timeout_s: of one request.
        requests: tries of one request before its question is given up.
        concurrency: requests under way at once.
        pause_s: before the second try; doubled each time.
        key: bearer token; from RADARTWIN_VLM_KEY unless given.
    Raises:
        ConfigError: an address that is none.
    """

    model: str = DEFAULT_MODEL
    url: str = DEFAULT_URL
    timeout_s: float = 120.0
    requests: int = 5
    concurrency: int = 4
    pause_s: float = 1.0
    key: str | None = None
    name: str = "server"

    def __post_init__(self) -> None:
        self._endpoint = Endpoint(self.url, self.model, self.timeout_s, self.requests, self.pause_s, KEY_VARIABLE, MAX_TOKENS, self.key)

    def __repr__(self) -> str:
        return f"Server(model={self.model!r}, url={self.shown_url!r})"

    @property
    def shown_url(self) -> str:
        """The address without user, password and query."""
        return self._endpoint.shown

    def answers(self, questions: Sequence[Question]) -> Iterator[tuple[Question, Record]]:
        """Records as they arrive, in any order.

        Raises:
            BackendError: after all others have been answered, if some could not be; at once, if the server refuses or is not there.
        """
        down = self._endpoint.down
        down.clear()
        failed: list[BackendError] = []
        with self._endpoint.client() as client, ThreadPoolExecutor(self.concurrency) as pool:
            waiting = list(reversed(questions))
            running: dict[Future[Record], Question] = {}
            try:
                while waiting or running:
                    while waiting and len(running) < self.concurrency and not down.is_set():
                        question = waiting.pop()
                        running[pool.submit(self._one, client, question)] = question
                    if not running:
                        break
                    for future in wait(running, return_when=FIRST_COMPLETED).done:
                        question = running.pop(future)
                        try:
                            record = future.result()
                        except BackendError as error:
                            failed.append(error)
                        else:
                            yield question, record
            finally:  # whoever stops listening stops the asking
                down.set()
        if failed:
            left = len(failed) + len(waiting)
            raise BackendError(f"{failed[0]}; {left} of {len(questions)} questions are unanswered, the same command asks only those")

    def _one(self, client: httpx.Client, question: Question) -> Record:
        pictures = [_data_uri(crop.jpeg) for crop in question.crops]

        def complete(turns: list[Turn]) -> str:
            return self._complete(client, question, pictures, turns)

        return Record.of(question, ask(question, complete), self.model, self.name)

    def _complete(self, client: httpx.Client, question: Question, pictures: Sequence[str], turns: Sequence[Turn]) -> str:
        """The model's next words."""
        messages: list[dict[str, Any]] = [{"role": turn.role, "content": turn.text} for turn in turns]
        shown = [{"type": "image_url", "image_url": {"url": picture}} for picture in pictures]
        messages[0]["content"] = [*shown, {"type": "text", "text": turns[0].text}]
        try:
            return self._endpoint.complete(messages, schema(question.kind), f"answer_about_{question.kind}", client)
        except NoAnswerInTime:  # one question's trouble, anything else is everybody's
            raise
        except BackendError:
            self._endpoint.down.set()
            raise


def _data_uri(jpeg: bytes) -> str:
    return "data:image/jpeg;base64," + base64.b64encode(jpeg).decode()
