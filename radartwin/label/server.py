"""Answer material questions with a vision-language model behind an OpenAI-compatible endpoint: vLLM, Ollama, LM Studio, or a service.

Several questions are sent in parallel through `radartwin.io.chat`, with their pictures as data URIs. If the request of one question fails,
the answers to all other questions are still returned. After a timeout of one request, only its question has no answer. If the server
refuses a request or is unreachable, no further requests are sent.
"""

from __future__ import annotations

import base64
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from typing import TYPE_CHECKING

from radartwin.errors import BackendError
from radartwin.io.chat import Endpoint, NoAnswerInTime
from radartwin.label.answers import schema
from radartwin.label.journal import Record
from radartwin.label.questions import Message, Question, ask

if TYPE_CHECKING:
    import httpx

DEFAULT_MODEL = "OpenGVLab/InternVL2_5-8B"
DEFAULT_URL = "http://127.0.0.1:8000/v1"  # the default address of the command `vllm serve`
KEY_VARIABLE = "RADARTWIN_VLM_KEY"
MAX_TOKENS = 400


@dataclass
class Server:
    """A provider that answers material questions with the model of a server.

    Args:
        concurrency: number of requests that are sent in parallel.
        url, timeout_s, requests, pause_s: see `radartwin.io.chat.Endpoint`.
        key: access token sent to the server; None takes the value of the environment variable RADARTWIN_VLM_KEY.
    """

    model: str = DEFAULT_MODEL
    url: str = DEFAULT_URL
    timeout_s: float = 120.0
    requests: int = 5
    concurrency: int = 4
    pause_s: float = 1.0
    key: str | None = None
    name = "server"

    def __post_init__(self) -> None:
        self._endpoint = Endpoint(self.url, self.model, self.timeout_s, self.requests, self.pause_s, KEY_VARIABLE, MAX_TOKENS, self.key)

    def __repr__(self) -> str:
        return f"Server(model={self.model!r}, url={self._endpoint.shown!r})"

    def answers(self, questions: Sequence[Question]) -> Iterator[tuple[Question, Record]]:
        """Yield each material question with the record of its answer as soon as the answer arrives, in any order.

        Raises:
            BackendError: some questions have no answer. The error is raised after `answers` has yielded all answers that arrived. If the
                server refuses a request or is unreachable, the error is raised at once.
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
                        running[pool.submit(self._record, client, question)] = question
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
            finally:  # this block also runs if the caller stops the iteration
                down.set()
        if failed:
            unanswered = len(failed) + len(waiting)
            raise BackendError(
                f"{failed[0]}; {unanswered} of {len(questions)} questions are unanswered; run the same command again to ask only these "
                "questions"
            )

    def _record(self, client: httpx.Client, question: Question) -> Record:
        pictures = [f"data:image/jpeg;base64,{base64.b64encode(crop.jpeg).decode()}" for crop in question.crops]
        shown = [{"type": "image_url", "image_url": {"url": picture}} for picture in pictures]

        def complete(conversation: list[Message]) -> str:
            first, *others = conversation
            messages = [{"role": first["role"], "content": [*shown, {"type": "text", "text": first["content"]}]}, *others]
            try:
                return self._endpoint.complete(messages, schema(question.kind), f"answer_about_{question.kind}", client)
            except NoAnswerInTime:  # the requests of the other questions continue
                raise
            except BackendError:
                self._endpoint.down.set()
                raise

        return Record.of(question, ask(question, complete), self.model, self.name)
