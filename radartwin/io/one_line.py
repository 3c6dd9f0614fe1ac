"""Print messages and warnings in one line each."""

from __future__ import annotations

import sys
from typing import Any

from radartwin.io.secret import hidden


def one_line(message: object) -> str:
    """Return a message as one line, without secrets from environment variables and without control characters, which a file name may
    contain.
    """
    return "".join(sign if sign.isprintable() else "?" for sign in " ".join(hidden(str(message)).split()))


def show_warning(message: Warning | str, category: type[Warning], *_: Any, **__: Any) -> None:
    """Print a warning as one line, in the place of `warnings.showwarning`."""
    print(f"radartwin: warning: {one_line(message)}", file=sys.stderr)
