"""Ask a language model on an OpenAI-compatible server: vLLM, Ollama, LM Studio or a commercial service.

The client sends POST URL/chat/completions with a JSON schema that the model's answer must follow. After a time-out or an HTTP status code
in RETRIED, the client sends the request again, with growing pauses or with the seconds in the server's Retry-After header. If the server
returns any other error, the client does not try again. The API key comes from an environment variable and is never written to a file.
docs/decisions/012-own-or-library.md explains why the openai package is not used.
"""

from __future__ import annotations

import contextlib
import os
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit, urlunsplit

from radartwin.errors import BackendError, ConfigError
from radartwin.io.secret import hidden

if TYPE_CHECKING:
    import httpx

RETRIED = {408, 409, 425, 429, 500, 502, 503, 504, 529}
LONGEST_PAUSE_S = 120.0
KEY_VARIABLE = "RADARTWIN_VLM_KEY"  # environment variable of the API key (bearer token), which may be unset


class NoAnswerInTime(BackendError):
    """Raised if every try of a request timed out. Later requests may still succeed, unlike after any other error."""


@dataclass
class Endpoint:
    """Send requests to a language model on a chat server. Several threads may share the object.

    Raises:
        ConfigError: the URL is not valid. A request also raises ConfigError if the API key contains characters that cannot be sent.
    """

    url: str = field(repr=False)  # base URL including /v1; not printed, because it may contain a password
    model: str
    timeout_s: float = 120.0  # of a single try to get an answer
    requests: int = 5  # largest number of tries to get an answer to a request
    pause_s: float = 1.0  # before the second try; each further pause is twice as long
    max_tokens: int = 400  # maximum length of the model's answer
    key: str | None = field(default=None, repr=False)  # API key; None takes that of KEY_VARIABLE

    def __post_init__(self) -> None:
        try:
            parts = urlsplit(self.url)
            good = parts.scheme in ("http", "https") and bool(parts.hostname) and (parts.port or 1) > 0
        except ValueError:
            good = False
        if not good:
            raise ConfigError(f"{self.url.rpartition('@')[2]} is not the address of a server; give http://HOST:PORT/v1")
        self.down = threading.Event()  # when this event is set, waiting requests give up instead of trying again

    @property
    def public_url(self) -> str:
        """Return the URL of the server for messages, without user name, password and query."""
        parts = urlsplit(self.url)
        return urlunsplit((parts.scheme, parts.netloc.rpartition("@")[2], parts.path.rstrip("/"), "", ""))

    def client(self) -> httpx.Client:
        """Create an HTTP client that several requests can share. The caller closes it."""
        import httpx

        return httpx.Client(timeout=self.timeout_s, headers={"Authorization": f"Bearer {key}"} if (key := self._secret) else {})

    @property
    def _secret(self) -> str:
        """Return the API key, or "" if there is none. Raises ConfigError, without the key, for a key that cannot be sent."""
        key = (self.key if self.key is not None else os.environ.get(KEY_VARIABLE, "")).strip()
        if not (key.isascii() and key.isprintable()):
            raise ConfigError(f"{KEY_VARIABLE} holds characters that no key has; copy the key again")
        return key

    def complete(
        self, messages: Sequence[Mapping[str, Any]], schema: Mapping[str, Any], name: str, client: httpx.Client | None = None
    ) -> str:
        """Send the messages to the language model and return the text of the model's answer.

        Args:
            schema: JSON schema of the model's answer, sent in the field response_format. The caller must check the answer.
            client: HTTP client from `client()` that several requests share; None creates a new client for this request.
        Raises:
            NoAnswerInTime: the server did not answer the last try within `timeout_s`.
            BackendError: the server cannot be reached, refuses the request, or is not OpenAI-compatible.
        """
        if client is None:
            with self.client() as client:
                return self.complete(messages, schema, name, client)
        body: dict[str, Any] = {"model": self.model, "messages": list(messages), "temperature": 0, "max_tokens": self.max_tokens}
        body["response_format"] = {"type": "json_schema", "json_schema": {"name": name, "strict": True, "schema": schema}}
        response = self._post(client, body)
        if response.status_code != 200:
            raise BackendError(self._refusal(response))
        try:
            text = response.json()["choices"][0]["message"]["content"]
        except (ValueError, KeyError, IndexError, TypeError) as error:
            raise BackendError(f"{self.public_url} does not answer as an OpenAI-compatible server ({error}); check its address") from error
        return hidden(text, self._secret) if isinstance(text, str) else ""

    def _post(self, client: httpx.Client, body: Mapping[str, Any]) -> httpx.Response:
        import httpx

        problem, error_type = "", BackendError
        for attempt in range(self.requests):
            pause = min(self.pause_s * 2**attempt, LONGEST_PAUSE_S)
            error_type = BackendError
            try:
                response = client.post(f"{self.url.rstrip('/')}/chat/completions", json=body)
            except httpx.TimeoutException:
                problem, error_type = f"no answer within {self.timeout_s:g} s", NoAnswerInTime
            except httpx.ConnectError as error:  # no server is running at the URL, so that another try would fail too
                raise BackendError(f"{self.public_url}: no connection ({error}); start the server, or correct its address") from error
            except httpx.TransportError as error:
                problem = f"the connection broke ({hidden(str(error), self._secret) or type(error).__name__})"
            else:
                if response.status_code not in RETRIED:
                    return response
                problem = f"status {response.status_code}"
                with contextlib.suppress(ValueError):
                    pause = min(max(0.0, float(response.headers.get("retry-after", ""))), LONGEST_PAUSE_S)
            if attempt + 1 < self.requests and self.down.wait(pause):
                break
        raise error_type(f"{self.public_url}: {problem} after {self.requests} tries; see that the server runs and serves {self.model}")

    def _refusal(self, response: httpx.Response) -> str:
        remedy = {
            401: f"set {KEY_VARIABLE} to the key of the server",
            403: f"set {KEY_VARIABLE} to a key that may use the model",
            404: f"check the address and that it serves {self.model}",
        }.get(response.status_code, "see the server's log")
        text = hidden(" ".join(response.text.split()), self._secret)[:200]
        return f"{self.public_url} refuses with status {response.status_code} ({text}); {remedy}"
