"""Answer material questions with a vision-language model behind an OpenAI-compatible endpoint: vLLM, Ollama, LM Studio, or a service.

Several questions are sent in parallel through `radartwin.io.chat`, with their pictures as data URIs. If the request of one question fails,
the answers to all other questions are still returned. After a timeout of one request, only its question has no answer. If the server
refuses a request or is unreachable, no further requests are sent.
"""

from __future__ import annotations

import base64
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
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


@dataclass
class Server(Endpoint):
    """A provider that answers material questions with the model of a server.

    Args:
        concurrency: number of requests that are sent in parallel. All other arguments are those of `radartwin.io.chat.Endpoint`.
    """

    concurrency: int = 4
    name = "server"

    def answers(self, questions: Sequence[Question]) -> Iterator[tuple[Question, Record]]:
        """Yield each material question with the record of its answer as soon as the answer arrives, in any order.

        Raises:
            BackendError: some questions have no answer. The error is raised after `answers` has yielded all answers that arrived. If the
                server refuses a request or is unreachable, the other questions are not sent.
        """
        self.down.clear()
        unanswered, error = len(questions), None
        with self.client() as client, ThreadPoolExecutor(self.concurrency) as pool:
            running = {pool.submit(self._record, client, question): question for question in questions}
            try:
                for future in as_completed(running):
                    try:
                        record = future.result()
                    except BackendError as problem:
                        error = error or problem
                        continue
                    if record is not None:
                        unanswered -= 1
                        yield running[future], record
            finally:  # this block also runs if the caller stops the iteration
                self.down.set()
        if error is not None:
            raise BackendError(
                f"{error}; {unanswered} of {len(questions)} questions are unanswered; run the same command again to ask only these"
            )

    def _record(self, client: httpx.Client, question: Question) -> Record | None:
        """Return the record of the answer to a question; None if no further requests may be sent."""
        if self.down.is_set():
            return None
        pictures = [f"data:image/jpeg;base64,{base64.b64encode(crop.jpeg).decode()}" for crop in question.crops]
        images = [{"type": "image_url", "image_url": {"url": picture}} for picture in pictures]

        def complete(conversation: list[Message]) -> str:
            first, *others = conversation
            messages = [{"role": first["role"], "content": [*images, {"type": "text", "text": first["content"]}]}, *others]
            try:
                return self.complete(messages, schema(question.kind), f"answer_about_{question.kind}", client)
            except NoAnswerInTime:  # the requests of the other questions continue
                raise
            except BackendError:
                self.down.set()
                raise

        return Record.of(question, ask(question, complete), self.model, self.name)
