"""A process of its own that answers questions made of arrays: what must not share this process, such as a second Mitsuba variant.

Both ends speak messages of named arrays: eight bytes of length, then an npz without pickle. The child reads its standard input and ends
with it, so it outlives no parent; what it prints goes to standard error, of which an error shows the last line.
"""

import atexit
import contextlib
import functools
import importlib
import io
import os
import struct
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Mapping
from typing import IO, Any

import numpy as np

from radartwin.errors import BackendError

Message = Mapping[str, Any]
_LENGTH = struct.Struct("<Q")
_ERROR = "error"  # the one name an answer must not use for itself
_PATIENCE_S = 5.0  # for a child to end by itself


def send(stream: IO[bytes], message: Message) -> None:
    """Write one message. Raises OSError (BrokenPipeError) where the other end is gone."""
    packed = io.BytesIO()
    arrays: dict[str, Any] = {name: np.asarray(value) for name, value in message.items()}
    np.savez(packed, **arrays)
    stream.write(_LENGTH.pack(packed.tell()))
    stream.write(packed.getbuffer())
    stream.flush()


def receive(stream: IO[bytes]) -> dict[str, np.ndarray] | None:
    """Read one message, or None where the other end is gone."""
    head = stream.read(_LENGTH.size)
    if len(head) < _LENGTH.size:
        return None
    (length,) = _LENGTH.unpack(head)
    content = stream.read(length)
    if len(content) < length:
        return None
    with np.load(io.BytesIO(content), allow_pickle=False) as stored:
        return dict(stored)


class Worker:
    """A child that runs `module`, which has a function `answer(message) -> message`.

    Args:
        module: dotted name; imported in the child alone.
        title: what error messages call it.
    """

    def __init__(self, module: str, title: str) -> None:
        self._title = title
        self._owner = os.getpid()
        self._lock = threading.Lock()
        self._log = tempfile.TemporaryFile()  # noqa: SIM115 - closed with the child
        self._child = subprocess.Popen(
            [sys.executable, "-m", __name__, module], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self._log
        )
        atexit.register(self.close)

    @property
    def usable(self) -> bool:
        """Whether it is this process's child and runs; a fork of the parent shares its pipes, and must not use them."""
        return self._owner == os.getpid() and self._child.poll() is None

    def ask(self, message: Message) -> dict[str, np.ndarray]:
        """The child's answer.

        Raises:
            BackendError: the child refused the message, or ended; with its last words.
        """
        assert self._child.stdin is not None
        assert self._child.stdout is not None
        with self._lock:
            try:
                send(self._child.stdin, message)
                answer = receive(self._child.stdout)
            except OSError:
                answer = None
        if answer is None:
            raise BackendError(f"{self._title}: its process ended ({self._last_words()})")
        if _ERROR in answer:
            raise BackendError(f"{self._title}: {answer[_ERROR]}")
        return answer

    def close(self) -> None:
        """End the child, by itself or else by force. A fork leaves it alone."""
        if self._owner != os.getpid() or self._log.closed:
            return
        assert self._child.stdin is not None
        assert self._child.stdout is not None
        with contextlib.suppress(OSError):
            self._child.stdin.close()
        try:
            self._child.wait(_PATIENCE_S)
        except subprocess.TimeoutExpired:
            self._child.kill()
            self._child.wait()
        self._child.stdout.close()
        self._log.close()
        atexit.unregister(self.close)

    def _last_words(self) -> str:
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._child.wait(_PATIENCE_S)
        self._log.seek(0)
        lines = self._log.read().decode(errors="replace").strip().splitlines()
        return lines[-1] if lines else f"exit status {self._child.returncode}"


@functools.cache
def _kept(module: str) -> dict[str, Worker]:
    return {}


def shared(module: str, title: str) -> Worker:
    """The worker of this process for a module: started on first use and again after it ended."""
    kept = _kept(module)
    if "worker" not in kept or not kept["worker"].usable:
        if "worker" in kept:
            kept["worker"].close()
        kept["worker"] = Worker(module, title)
    return kept["worker"]


def serve(module: str) -> None:
    """Answer messages of standard input on standard output until the input ends; whatever prints meanwhile goes to standard error."""
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)
    answer: Callable[[dict[str, np.ndarray]], Message] = importlib.import_module(module).answer
    while (message := receive(sys.stdin.buffer)) is not None:
        try:
            reply = answer(message)
        except (BackendError, MemoryError) as error:  # what the user can mend; all else ends the child with its traceback
            reply = {_ERROR: str(error) or type(error).__name__}
        send(out, reply)


if __name__ == "__main__":
    serve(sys.argv[1])
