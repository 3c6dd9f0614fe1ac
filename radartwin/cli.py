"""Run the command line, and turn errors into an exit status and a one-line message.

The exit status is 0 if the command finished, 1 if a run failed, and 2 with one line on standard error if the user's input is wrong. A
command that a signal ends has the status 128 plus the signal's number: 130 after Ctrl-C.
"""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import warnings
from collections.abc import Sequence

from radartwin.commands.arguments import parse
from radartwin.errors import CrashError, UserError
from radartwin.io.one_line import one_line, show_warning
from radartwin.io.serving import interrupted_by_signals


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command with these arguments, by default sys.argv[1:]. Returns the exit status."""
    options = parse(sys.argv[1:] if arguments is None else arguments)
    try:
        with interrupted_by_signals(), warnings.catch_warnings():
            warnings.showwarning = show_warning
            return options.verb(options)
    except UserError as error:
        return _fail(one_line(error), 1 if isinstance(error, CrashError) else 2)
    except MemoryError as error:
        detail = f" ({one_line(error)})" if str(error) else ""
        return _fail(f"out of memory{detail}; finished results are stored; ask for less, such as fewer frames or jobs=1", 1)
    except KeyboardInterrupt as interrupt:
        status = 128 + (interrupt.args[0] if interrupt.args else signal.SIGINT)
        signal.signal(signal.SIGINT, lambda *_: os._exit(status))  # a second Ctrl-C ends the process without clean-up
        return _fail(f"interrupted; the same command {'resumes where it stopped' if options.resumes else 'starts over'}", status)
    except BrokenPipeError:  # the reader of the output, such as `head`, has closed it
        with contextlib.suppress(OSError):
            _fail("the program that reads the output has closed the pipe, so the command stopped", 1)
        with contextlib.suppress(OSError):  # Python would complain about unwritten output at its end
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except OSError as error:
        if error.filename is None:  # an error without the path of a file is a defect of the program, so the traceback is shown
            raise
        return _fail(f"{one_line(error.filename)}: {error.strerror}; choose another path", 2)


def _fail(message: str, status: int) -> int:
    print(f"radartwin: {message}", file=sys.stderr)
    return status
