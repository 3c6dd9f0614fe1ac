"""Print the progress of long work on standard error: a bar on a terminal, plain lines elsewhere.

>>> progress = Progress(quiet=True)
>>> [x * x for x in progress.over([1, 2, 3], "squares")]
[1, 4, 9]
"""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sized
from typing import TypeVar

T = TypeVar("T")
PLAIN_INTERVAL_S = 5.0
TRUST_S = 60.0  # work in seconds after which the measured pace has the same weight in the estimate as the expected one


class Progress:
    """Print the progress of long work, unless `quiet`. Each line begins with `label`, because several jobs may share a terminal."""

    def __init__(self, quiet: bool = False, label: str = "") -> None:
        self._quiet, self._label = quiet, f"{label}: " if label else ""
        self._terminal = not quiet and sys.stderr.isatty()

    def say(self, line: str) -> None:
        if not self._quiet:
            print(f"{self._label}{line}", file=sys.stderr, flush=True)

    def over(self, items: Iterable[T], label: str) -> Iterator[T]:
        """Yield the items, and print the progress after each item."""
        total = len(items) if isinstance(items, Sized) else None
        with self.task(label, total) as advance:
            for item in items:
                yield item
                advance()

    @contextlib.contextmanager
    def task(self, label: str, total: int | None = None, remaining: Callable[[], float] | None = None) -> Iterator[Callable[[], None]]:
        """Show the progress of work with `total` steps. The `with` block gets a function to call after each step.

        remaining: returns the expected time in seconds of the remaining work. The estimate of the remaining time starts with it and
            follows the measured pace later. None: all steps take the same time.
        """
        if self._quiet:
            yield lambda: None
            return
        done, started, work = 0, time.monotonic(), remaining() if remaining else total or 0
        with (_bar if self._terminal else _lines)(f"{self._label}{label}", work) as show:

            def advance() -> None:
                nonlocal done
                done += 1
                ahead, trust = (remaining(), TRUST_S) if remaining else (work - done, 0.0)
                pace = (time.monotonic() - started + trust) / (work - ahead + trust)
                left = f", {_duration(ahead * pace)} left" if work else ""
                show(f"{done}{f'/{total}' if total else ''}{left}", work - ahead)

            yield advance
        if not self._terminal:
            self.say(f"{label}: {done} done in {time.monotonic() - started:.1f} s")


@contextlib.contextmanager
def _lines(label: str, work: float) -> Iterator[Callable[[str, float], None]]:
    last = time.monotonic()

    def show(told: str, completed: float) -> None:
        nonlocal last
        if time.monotonic() - last >= PLAIN_INTERVAL_S:
            last = time.monotonic()
            print(f"{label}: {told}", file=sys.stderr, flush=True)

    yield show


def _duration(seconds: float) -> str:
    """Format a duration in seconds if it is below two minutes, else in minutes.

    >>> _duration(99.6), _duration(119.7), _duration(3601)
    ('100 s', '2 min', '60 min')
    """
    return f"{seconds:.0f} s" if seconds < 119.5 else f"{seconds / 60:.0f} min"


@contextlib.contextmanager
def _bar(label: str, work: float) -> Iterator[Callable[[str, float], None]]:
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bar

    columns = TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn(), TextColumn("{task.fields[told]}")
    with Bar(*columns, console=Console(stderr=True)) as bar:
        task = bar.add_task(label, total=work or None, told="")
        yield lambda told, completed: bar.update(task, completed=completed, told=told)
