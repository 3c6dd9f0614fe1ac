"""Run the command line, and turn errors into an exit status and an error line. radartwin/commands holds the arguments and the verbs.

Exit status: 0 done, 1 a run failed, 2 the user's input is wrong (one line on standard error, no traceback).
"""

from __future__ import annotations

import os
import signal
import sys
import warnings
from collections.abc import Sequence
from typing import Any

from radartwin.commands.arguments import parse
from radartwin.errors import UserError
from radartwin.io import secret


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command, by default sys.argv[1:]. Returns the exit status."""
    options = parse(sys.argv[1:] if arguments is None else arguments)
    try:
        with warnings.catch_warnings():
            warnings.showwarning = _show_warning
            return options.verb(options)
    except UserError as error:
        return _fail(_line(error), 2)
    except MemoryError as error:
        detail = f" ({_line(error)})" if str(error) else ""
        return _fail(f"out of memory{detail}; finished results are stored; ask for less, such as fewer frames or jobs=1", 1)
    except KeyboardInterrupt:
        signal.signal(signal.SIGINT, lambda *_: os._exit(1))  # a second Ctrl-C ends the process without clean-up
        return _fail(f"interrupted; the same command {'resumes where it stopped' if options.resumes else 'starts over'}", 1)
    except BrokenPipeError:  # the reader of a pipe has closed it
        sys.stderr.close()
        return 0
    except OSError as error:
        if error.filename is None:  # the error is not about a user's path, so it is a defect and keeps its traceback
            raise
        return _fail(f"{_line(error.filename)}: {error.strerror}; choose another path", 2)


def _fail(message: str, status: int) -> int:
    print(f"radartwin: {message}", file=sys.stderr)
    return status


def _show_warning(message: Warning | str, category: type[Warning], *_: Any, **__: Any) -> None:
    print(f"radartwin: warning: {_line(message)}", file=sys.stderr)


def _line(message: object) -> str:
    """Return a message as one line, without secrets of the environment and without control characters that a file name may contain."""
    return "".join(sign if sign.isprintable() else "?" for sign in " ".join(secret.hidden(str(message)).split()))
