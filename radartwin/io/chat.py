"""Ask a language model on an OpenAI-compatible server: vLLM, Ollama, LM Studio or a commercial service.

The client sends POST URL/chat/completions with a JSON schema that the model's answer must follow. After a time-out or an HTTP status code
in RETRIED, the client sends the request again, with growing pauses or with the pause in the server's Retry-After header. If the server
returns any other error, the client does not try again. The API key comes from an environment variable and is never written to a file.
docs/decisions/012-own-or-library.md explains why the openai package is not used.
"""

from __future__ import annotations

import contextlib
import os
import threading
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from email.utils import parsedate_to_datetime
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit, urlunsplit

from radartwin.errors import BackendError, ConfigError
from radartwin.io.secret import hidden

if TYPE_CHECKING:
    import httpx

RETRIED = {408, 409, 425, 429, 500, 502, 503, 504, 529}
LONGEST_PAUSE_S = 120.0


class NoAnswerInTime(BackendError):
    """Raised if every try of a request timed out. Later requests may still succeed, unlike after any other error."""


@dataclass
class Endpoint:
    """Hold the URL of a chat server and the name of a language model on this server, and send requests to the server. Several threads may
    share the object.

    Args:
        url: base URL of the server's API, including /v1.
        timeout_s: time limit in seconds of a single try to get an answer.
        requests: largest number of tries to get an answer to a request.
        pause_s: pause in seconds before the second try; each further pause is twice as long.
        key_variable: name of the environment variable that contains the API key (bearer token); the variable may be unset.
        max_tokens: maximum length of the model's answer in tokens.
        key: API key (bearer token) sent to the server; None takes the value of the environment variable `key_variable`.
    Raises:
        ConfigError: the URL is not valid. A request also raises ConfigError if the API key contains characters that cannot be sent.
    """

    url: str = field(repr=False)  # not printed, because a URL may contain a password
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
        self.down = threading.Event()  # when this event is set, waiting requests give up instead of trying again
        self._plain = False

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
        key = (self.key if self.key is not None else os.environ.get(self.key_variable, "")).strip()
        if not (key.isascii() and key.isprintable()):
            raise ConfigError(f"{self.key_variable} holds characters that no key has; copy the key again")
        return key

    def complete(
        self, messages: Sequence[Mapping[str, Any]], schema: Mapping[str, Any], name: str, client: httpx.Client | None = None
    ) -> str:
        """Send the messages to the language model and return the text of the model's answer.

        Args:
            messages: dictionaries with the keys "role" and "content", as in the OpenAI API.
            schema: JSON schema that the model's answer must follow. The client sends it in the field response_format. If the server
                refuses this field, the client sends the request without the schema, so the caller must check the answer.
            client: HTTP client from `client()` that several requests share; None creates a new client for this request.
        Raises:
            NoAnswerInTime: the server did not answer the last try within `timeout_s`.
            BackendError: the server cannot be reached, refuses the request, or is not OpenAI-compatible.
        """
        if client is None:
            with self.client() as client:
                return self.complete(messages, schema, name, client)
        body: dict[str, Any] = {"model": self.model, "messages": list(messages), "temperature": 0, "max_tokens": self.max_tokens}
        if not self._plain:
            body["response_format"] = {"type": "json_schema", "json_schema": {"name": name, "strict": True, "schema": schema}}
        response = self._post(client, body)
        if response.status_code in (400, 422) and "response_format" in body and "response_format" in response.text:
            self._plain = True  # an old server refuses response_format; the prompt asks for JSON as well
            del body["response_format"]
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
                pause = min(_retry_after(response, pause), LONGEST_PAUSE_S)
            if attempt + 1 < self.requests and self.down.wait(pause):
                break
        raise error_type(f"{self.public_url}: {problem} after {self.requests} tries; see that the server runs and serves {self.model}")

    def _refusal(self, response: httpx.Response) -> str:
        remedy = {
            401: f"set {self.key_variable} to the key of the server",
            403: f"set {self.key_variable} to a key that may use the model",
            404: f"check the address and that it serves {self.model}",
        }.get(response.status_code, "see the server's log")
        text = hidden(" ".join(response.text.split()), self._secret)[:200]
        return f"{self.public_url} refuses with status {response.status_code} ({text}); {remedy}"


def _retry_after(response: httpx.Response, otherwise: float) -> float:
    """Return the waiting time in seconds from the Retry-After header (a number or a date), or `otherwise`."""
    header = response.headers.get("retry-after", "").strip()
    with contextlib.suppress(ValueError):
        return max(0.0, float(header))
    with contextlib.suppress(ValueError, TypeError):
        return max(0.0, (parsedate_to_datetime(header) - datetime.now(UTC)).total_seconds())
    return otherwise
