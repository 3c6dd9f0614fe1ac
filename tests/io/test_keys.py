"""An API key from the environment is sent only to its own server, and appears in no message, stored answer or configuration."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from chat_server import ChatServer, Reply

from radartwin.config.compose import Composer
from radartwin.config.study import TrackingConfig
from radartwin.errors import BackendError, ConfigError
from radartwin.io import secret
from radartwin.io.chat import Endpoint
from radartwin.runs.tracking import Tracker

Command = Callable[..., subprocess.CompletedProcess[str]]
KEY = "s3cr3t-w0rd-of-the-test"


@pytest.fixture
def echo() -> Iterator[Callable[..., ChatServer]]:
    """Start a server that repeats the received API key in its error or in its answer; the call is echo(status, location)."""
    servers: list[ChatServer] = []

    def start(status: int = 401, location: str = "") -> ChatServer:
        def reply(number: int, body: dict[str, Any]) -> Reply:
            key = server.headers[-1].get("Authorization", "")
            answer = {"choices": [{"message": {"content": f"{{key: {key}}}"}}], "error": f"Incorrect API key provided: {key}"}
            return status, {"Location": location} if location else {}, json.dumps(answer)

        server = ChatServer(reply)
        servers.append(server)
        return server

    yield start
    for server in servers:
        server.stop()


def test_a_key_that_the_server_repeats_is_hidden_in_messages_and_answers(echo, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RADARTWIN_VLM_KEY", f"{KEY}\r\n")  # white space around a key is not sent
    with pytest.raises(BackendError, match="401") as caught:
        Endpoint(echo().url, "m").complete([], {}, "x")
    assert KEY not in str(caught.value)
    assert secret.HIDDEN in str(caught.value)
    assert Endpoint(echo(200).url, "m").complete([], {}, "x") == "{key: Bearer ***}"


def test_the_key_is_not_sent_to_the_target_of_a_redirection(echo, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RADARTWIN_VLM_KEY", KEY)
    elsewhere = echo()
    with pytest.raises(BackendError, match="307"):
        Endpoint(echo(307, f"{elsewhere.url}/chat/completions").url, "m").complete([], {}, "x")
    assert elsewhere.requests == []


@pytest.mark.parametrize("bad", [KEY[:8] + "\n" + KEY[8:], KEY + "é", KEY + "\x07"])
def test_an_invalid_key_is_refused_and_not_printed(bad: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("RADARTWIN_VLM_KEY", bad)
    with pytest.raises(ConfigError, match="RADARTWIN_VLM_KEY") as caught:
        Endpoint("http://127.0.0.1:9/v1", "m").complete([], {}, "x")
    assert KEY[:8] not in str(caught.value)


@pytest.mark.parametrize(("token", "status"), [(KEY, 401), (f"{KEY}\n", 401), (KEY, 307)])
def test_the_token_of_the_tracking_server_is_in_no_message_and_not_sent_elsewhere(
    echo, token: str, status: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("MLFLOW_TRACKING_TOKEN", token)
    elsewhere = echo()
    server = echo(status, elsewhere.url if status == 307 else "")
    with pytest.raises(BackendError, match=f"^tracking store {server.url}") as caught:
        Tracker(TrackingConfig(uri=server.url), tmp_path).prepare()
    assert KEY not in str(caught.value)
    assert elsewhere.requests == []


@pytest.mark.parametrize("source", ["file", "override"])
def test_configurations_and_messages_cannot_carry_a_key(source: str, inside: Command, tmp_path: Path, monkeypatch) -> None:
    monkeypatch.setenv("RADARTWIN_VLM_KEY", KEY)
    (tmp_path / "experiment").mkdir()
    (tmp_path / "experiment" / "evil.yaml").write_text(
        "# @package _global_\nexperiment: {name: '${oc.env:RADARTWIN_VLM_KEY}', module: evil}\n"
    )
    overrides = ["experiment=evil"] if source == "file" else [f"output=runs-{KEY}"]
    with pytest.raises(ConfigError, match="contains the secret of an environment variable") as caught:
        Composer([tmp_path]).compose(overrides)
    assert KEY not in str(caught.value)
    done = inside("process", f"{KEY}.bin")
    assert done.returncode == 2
    assert KEY not in done.stdout + done.stderr
