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

        remaining: returns the remaining work in any unit, for the estimate of the remaining time; None: all steps take the same time.
        """
        if self._quiet:
            yield lambda: None
        elif self._terminal:
            with _bar(f"{self._label}{label}", total, remaining) as advance:
                yield advance
        else:
            with self._lines(label, total, remaining) as advance:
                yield advance

    @contextlib.contextmanager
    def _lines(self, label: str, total: int | None, remaining: Callable[[], float] | None) -> Iterator[Callable[[], None]]:
        done, started, work = 0, time.monotonic(), remaining() if remaining else 0.0
        last = started

        def advance() -> None:
            nonlocal done, last
            done += 1
            if time.monotonic() - last >= PLAIN_INTERVAL_S:
                last = time.monotonic()
                share = 1 - remaining() / work if remaining and work else done / total if total else 0.0
                left = f", {_duration((last - started) * (1 / share - 1))} left" if share else ""
                self.say(f"{label}: {done}{f'/{total}' if total else ''}{left}")

        yield advance
        self.say(f"{label}: {done} done in {time.monotonic() - started:.1f} s")


def _duration(seconds: float) -> str:
    """Format a duration in seconds if it is below two minutes, else in minutes.

    >>> _duration(99.6), _duration(119.7), _duration(3601)
    ('100 s', '2 min', '60 min')
    """
    return f"{seconds:.0f} s" if seconds < 119.5 else f"{seconds / 60:.0f} min"


@contextlib.contextmanager
def _bar(label: str, total: int | None, remaining: Callable[[], float] | None) -> Iterator[Callable[[], None]]:
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
    from rich.progress import Progress as Bar

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.fields[steps]}"),
        TimeElapsedColumn(),
        TimeRemainingColumn(),
    )
    with Bar(*columns, console=Console(stderr=True)) as bar:
        done, work = 0, remaining() if remaining else total
        task = bar.add_task(label, total=work, steps="")

        def advance() -> None:
            nonlocal done
            done += 1
            completed = work - remaining() if remaining and work else done
            bar.update(task, completed=completed, steps=f"{done}/{total}" if total else str(done))

        yield advance
