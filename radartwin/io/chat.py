"""A language model behind an OpenAI-compatible endpoint: vLLM, Ollama, LM Studio, or a service.

POST URL/chat/completions with the answer's JSON schema as response_format. What may pass is tried again with growing pauses (time-outs,
408, 409, 425, 429 and 5xx; Retry-After is obeyed); what cannot is one line. The key is read from the environment and written nowhere.
Layouts ask it one sentence at a time, labels (radartwin.label.server) many questions at once over one client.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from email.utils import parsedate_to_datetime
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit, urlunsplit

from radartwin.errors import BackendError, ConfigError
from radartwin.io.secret import hidden

if TYPE_CHECKING:
    import httpx

PASSING = {408, 409, 425, 429, 500, 502, 503, 504, 529}
LONGEST_PAUSE_S = 120.0


class NoAnswerInTime(BackendError):
    """One request took too long each time: its own trouble, while any other error is every request's."""


@dataclass
class Endpoint:
    """Where a model answers. One may serve several threads.

    Args:
        url: base of the API, with its /v1.
        timeout_s: of one request.
        requests: tries of one request.
        pause_s: before the second try; doubled each time.
        key_variable: the environment variable that holds the bearer token, if there is one.
        max_tokens: of an answer.
        key: bearer token, instead of the variable's.
    Raises:
        ConfigError: an address that is none; when it is asked, a key that cannot be sent.
    """

    url: str = field(repr=False)  # it may hold a password
    model: str
    timeout_s: float = 120.0
    requests: int = 4
    pause_s: float = 1.0
    key_variable: str = "RADARTWIN_LLM_KEY"
    max_tokens: int = 1000
    key: str | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        try:
            parts = urlsplit(self.url)
            good = parts.scheme in ("http", "https") and bool(parts.hostname) and (parts.port or 1) > 0
        except ValueError:
            good = False
        if not good:
            raise ConfigError(f"{self.url.rpartition('@')[2]} is not the address of a server; give http://HOST:PORT/v1")
        self.down = threading.Event()  # whoever sets it ends the waiting of all
        self._plain = False

    @property
    def shown(self) -> str:
        """The address without user, password and query."""
        parts = urlsplit(self.url)
        return urlunsplit((parts.scheme, parts.netloc.rpartition("@")[2], parts.path.rstrip("/"), "", ""))

    def client(self) -> httpx.Client:
        """For several requests; close it."""
        import httpx

        return httpx.Client(timeout=self.timeout_s, headers={"Authorization": f"Bearer {key}"} if (key := self._secret) else {})

    @property
    def _secret(self) -> str:
        """The bearer token, or "". Raises ConfigError for one that cannot be sent, without repeating it."""
        key = (self.key if self.key is not None else os.environ.get(self.key_variable, "")).strip()
        if not (key.isascii() and key.isprintable()):
            raise ConfigError(f"{self.key_variable} holds signs that no key has; copy the key again")
        return key

    def complete(
        self, messages: Sequence[Mapping[str, Any]], schema: Mapping[str, Any], name: str, client: httpx.Client | None = None
    ) -> str:
        """The model's next words.

        Args:
            messages: {"role", "content"} in the API's form.
            schema: JSON schema of the answer; a server that refuses response_format is asked without, so check the answer.
            client: one of `client`, where several requests share it.
        Raises:
            NoAnswerInTime: the last try timed out.
            BackendError: no connection, a refusal, or a server that is none of these.
        """
        if client is None:
            with self.client() as client:
                return self.complete(messages, schema, name, client)
        body: dict[str, Any] = {"model": self.model, "messages": list(messages), "temperature": 0, "max_tokens": self.max_tokens}
        if not self._plain:
            body["response_format"] = {"type": "json_schema", "json_schema": {"name": name, "strict": True, "schema": schema}}
        response = self._post(client, body)
        if response.status_code in (400, 422) and "response_format" in body and "response_format" in response.text:
            self._plain = True  # an old server; the prompt must ask for JSON anyway
            del body["response_format"]
            response = self._post(client, body)
        if response.status_code != 200:
            raise BackendError(self._refusal(response))
        try:
            text = response.json()["choices"][0]["message"]["content"]
        except (ValueError, KeyError, IndexError, TypeError) as error:
            raise BackendError(f"{self.shown} does not answer as an OpenAI-compatible server ({error}); check its address") from error
        return hidden(text, self._secret) if isinstance(text, str) else ""

    def _post(self, client: httpx.Client, body: Mapping[str, Any]) -> httpx.Response:
        """The response to a request that was tried until it was none of PASSING."""
        import httpx

        problem, error_type = "", BackendError
        for attempt in range(self.requests):
            pause = min(self.pause_s * 2**attempt, LONGEST_PAUSE_S)
            error_type = BackendError
            try:
                response = client.post(f"{self.url.rstrip('/')}/chat/completions", json=body)
            except httpx.TimeoutException:
                problem, error_type = f"no answer within {self.timeout_s:g} s", NoAnswerInTime
            except httpx.ConnectError as error:  # nobody there: waiting does not start a server
                raise BackendError(f"{self.shown}: no connection ({error}); start the server, or correct its address") from error
            except httpx.TransportError as error:
                problem = f"the connection broke ({hidden(str(error), self._secret) or type(error).__name__})"
            else:
                if response.status_code not in PASSING:
                    return response
                problem = f"status {response.status_code}"
                pause = min(_retry_after(response, pause), LONGEST_PAUSE_S)
            if attempt + 1 < self.requests and self.down.wait(pause):
                break
        raise error_type(f"{self.shown}: {problem} after {self.requests} tries; see that the server runs and serves {self.model}")

    def _refusal(self, response: httpx.Response) -> str:
        remedy = {
            401: f"set {self.key_variable} to the key of the server",
            403: f"set {self.key_variable} to a key that may use the model",
            404: f"check the address and that it serves {self.model}",
        }.get(response.status_code, "see the server's log")
        said = hidden(" ".join(response.text.split()), self._secret)[:200]
        return f"{self.shown} refuses with status {response.status_code} ({said}); {remedy}"


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
