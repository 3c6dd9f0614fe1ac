"""A vision-language model behind an OpenAI-compatible endpoint: vLLM, Ollama, LM Studio, or a service.

POST URL/chat/completions with the pictures as data URIs and the answer's JSON schema as response_format. What may pass is tried again
with growing pauses (time-outs, broken connections, 408, 409, 425, 429 and 5xx; Retry-After is obeyed); what cannot is one line. Answers
that came are kept whatever happens to the others. The key is read from the environment and written nowhere.
"""

from __future__ import annotations

import base64
import os
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from datetime import UTC, datetime
from email.utils import parsedate_to_datetime
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit, urlunsplit

from radartwin.errors import BackendError, ConfigError
from radartwin.label.answers import schema
from radartwin.label.journal import Record
from radartwin.label.provider import Turn, ask
from radartwin.label.questions import Question

if TYPE_CHECKING:
    import httpx

DEFAULT_MODEL = "OpenGVLab/InternVL2_5-8B"
DEFAULT_URL = "http://127.0.0.1:8000/v1"  # where `vllm serve` listens
KEY_VARIABLE = "RADARTWIN_VLM_KEY"
PASSING = {408, 409, 425, 429, 500, 502, 503, 504, 529}
LONGEST_PAUSE_S = 120.0
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
        parts = urlsplit(self.url)
        if parts.scheme not in ("http", "https") or not parts.hostname:
            raise ConfigError(f"{self.shown_url} is not the address of a server; give http://HOST:PORT/v1")
        self._plain_schema = False
        self._down = threading.Event()

    def __repr__(self) -> str:
        return f"Server(model={self.model!r}, url={self.shown_url!r})"

    @property
    def shown_url(self) -> str:
        """The address without user, password and query."""
        parts = urlsplit(self.url)
        return urlunsplit((parts.scheme, parts.netloc.rpartition("@")[2], parts.path.rstrip("/"), "", ""))

    def answers(self, questions: Sequence[Question]) -> Iterator[tuple[Question, Record]]:
        """Records as they arrive, in any order.

        Raises:
            BackendError: after all others have been answered, if some could not be; at once, if the server refuses or is not there.
        """
        import httpx

        key = self.key if self.key is not None else os.environ.get(KEY_VARIABLE)
        headers = {"Authorization": f"Bearer {key}"} if key else {}
        self._down.clear()
        failed: list[BackendError] = []
        with httpx.Client(timeout=self.timeout_s, headers=headers) as client, ThreadPoolExecutor(self.concurrency) as pool:
            waiting = list(reversed(questions))
            running: dict[Future[Record], Question] = {}
            try:
                while waiting or running:
                    while waiting and len(running) < self.concurrency and not self._down.is_set():
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
                self._down.set()
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
        body: dict[str, Any] = {"model": self.model, "messages": messages, "temperature": 0, "max_tokens": MAX_TOKENS}
        if not self._plain_schema:
            form = {"name": f"answer_about_{question.kind}", "strict": True, "schema": schema(question.kind)}
            body["response_format"] = {"type": "json_schema", "json_schema": form}
        response = self._post(client, body)
        if response.status_code in (400, 422) and "response_format" in body and "response_format" in response.text:
            self._plain_schema = True  # an old server; the prompt asks for JSON anyway
            del body["response_format"]
            response = self._post(client, body)
        if response.status_code != 200:
            self._down.set()
            raise BackendError(self._refusal(response))
        try:
            text = response.json()["choices"][0]["message"]["content"]
        except (ValueError, KeyError, IndexError, TypeError) as error:
            self._down.set()
            raise BackendError(f"{self.shown_url} does not answer as an OpenAI-compatible server ({error}); check its address") from error
        return text if isinstance(text, str) else ""

    def _post(self, client: httpx.Client, body: dict[str, Any]) -> httpx.Response:
        """The response to a request that was tried until it was none of PASSING."""
        import httpx

        problem = ""
        for attempt in range(self.requests):
            pause = min(self.pause_s * 2**attempt, LONGEST_PAUSE_S)
            try:
                response = client.post(f"{self.url.rstrip('/')}/chat/completions", json=body)
            except httpx.TimeoutException:
                problem = f"no answer within {self.timeout_s:g} s"
            except httpx.TransportError as error:
                problem = f"no connection ({str(error) or type(error).__name__})"
            else:
                if response.status_code not in PASSING:
                    return response
                problem = f"status {response.status_code}"
                pause = min(_retry_after(response, pause), LONGEST_PAUSE_S)
            if attempt + 1 < self.requests and self._down.wait(pause):
                break
        if not problem.startswith("no answer"):  # a slow answer is one question's trouble, the rest is everybody's
            self._down.set()
        raise BackendError(f"{self.shown_url}: {problem} after {self.requests} tries; see that the server runs and serves {self.model}")

    def _refusal(self, response: httpx.Response) -> str:
        remedy = {
            401: f"set {KEY_VARIABLE} to the key of the server",
            403: f"set {KEY_VARIABLE} to a key that may use the model",
            404: f"check the address and that it serves {self.model}",
        }.get(response.status_code, "see the server's log")
        said = " ".join(response.text.split())[:200]
        return f"{self.shown_url} refuses with status {response.status_code} ({said}); {remedy}"


def _retry_after(response: httpx.Response, otherwise: float, now: Callable[[], float] = time.time) -> float:
    """Seconds that the server asks to wait, as a number or a date; `otherwise` if it does not."""
    header = response.headers.get("retry-after", "").strip()
    try:
        return max(0.0, float(header))
    except ValueError:
        pass
    try:
        return max(0.0, (parsedate_to_datetime(header) - datetime.fromtimestamp(now(), UTC)).total_seconds())
    except (ValueError, TypeError):
        return otherwise


def _data_uri(jpeg: bytes) -> str:
    return "data:image/jpeg;base64," + base64.b64encode(jpeg).decode()
