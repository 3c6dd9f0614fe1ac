"""Score methods on the problems of the benchmark and write the leaderboard, which several runs may write at once."""

from __future__ import annotations

import csv
import io
import os
import platform
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from radartwin.benchmark import entrants, entry_folder, frozen_problems
from radartwin.benchmark.frozen_problems import Problem
from radartwin.benchmark.signal_error import Errors, compare
from radartwin.compiled import cores
from radartwin.errors import InputError
from radartwin.io import files
from radartwin.io.one_line import plural
from radartwin.simulation.backends.backend import names as simulator_names

FOLDER, NAME = "benchmark", "leaderboard.csv"
COLUMNS = (
    "method", "problem", "profile_error_db", "signal_error", "seconds_per_frame", "answers_version", "profile_error_after_gain_db",
    "level_db", "frames", "answer_error", "answer_rests_on", "machine",
)  # fmt: skip
Row = dict[str, Any]


def score(problem: Problem, signals: Mapping[str, np.ndarray]) -> Errors:
    """Return the errors of the signals, by scenario (S frames, N samples), of a problem; all scenarios have equal weight."""
    pairs = [(signals[scenario.name][:, None, None, None], scenario.answer[:, None, None, None]) for scenario in problem.scenarios]
    return compare(pairs, problem.radar, gate_m=problem.gate_m)


def row(method: str, problem: Problem, signals: Mapping[str, np.ndarray], seconds: float, machine: str) -> Row:
    errors = score(problem, signals)
    frames = sum(scenario.scored for scenario in problem.scenarios)
    values = (
        method, problem.name, f"{errors.profile_db:.3f}", f"{errors.signal:.4f}", f"{seconds:.3g}", frozen_problems.version(),
        f"{errors.free_db:.3f}", f"{errors.offset_db:.2f}", frames, problem.known_error, problem.rests_on, machine,
    )  # fmt: skip
    return dict(zip(COLUMNS, values, strict=True))


def benchmark(output: Path, methods: Sequence[str], problem_names: Sequence[str], say: Callable[[str], None]) -> tuple[Path, list[Row]]:
    """Score methods, each a folder of signals or the name of a simulator, and write the leaderboard after each method.

    Args:
        methods: names or folders; an empty list means all of `entrants.METHODS`. If a name is both a known method and a folder, it means
            the method; give the folder as ./NAME.
        problem_names: an empty list means all. A folder is scored on those of these problems that it contains.
    Returns: the path of the leaderboard and its rows.
    Raises:
        InputError, MissingError: a method or problem is unknown, or a folder is wrong. All arguments are checked before the first run.
        OutputError: the leaderboard cannot be written.
    """
    path = output / FOLDER / NAME
    files.sweep(files.check_folder(path.parent))
    lock = path.with_name(f".{NAME}.lock")
    files.drop_stale(lock)
    kept = _read(path)  # before the first run, so that a file with other columns is refused early
    problems = [frozen_problems.problem(name) for name in dict.fromkeys(problem_names or frozen_problems.names())]
    entered = [_entered(name, problems) for name in dict.fromkeys(methods or [entrant.name for entrant in entrants.METHODS])]
    for score_method in entered:
        rows = score_method(say)
        replaced = {(new["method"], new["problem"]) for new in rows}
        with files.lock(lock):
            stored = _read(path)  # again, because another run may have added rows while the method ran
            kept = [old for old in stored if (old["method"], old["problem"]) not in replaced] + rows
            kept = [old for old in kept if old["answers_version"] == frozen_problems.version()]
            files.write_atomically(path, files.csv_text(kept, COLUMNS))
    return path, kept


def machine() -> str:
    """Return the processor, the operating system, and the load of other programs, which makes the times longer."""
    load = f", load {os.getloadavg()[0]:.0f} on {plural(cores(), 'core')}" if hasattr(os, "getloadavg") else ""
    return f"{processor()}, {platform.system()}{load}"


def processor() -> str:
    """Return the name of the processor."""
    lines = Path("/proc/cpuinfo").read_text().splitlines() if Path("/proc/cpuinfo").is_file() else []
    named = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return named[0] if named else platform.processor() or platform.machine()


def _entered(name: str, problems: Sequence[Problem]) -> Callable[[Callable[[str], None]], list[Row]]:
    """Check a method and return the function that scores it on the problems."""
    folder, known = Path(name), {entrant.name for entrant in entrants.METHODS} | set(simulator_names())
    if name not in known and (folder.is_dir() or "/" in name):
        described, entries = entry_folder.read(folder)
        if described["method"] in known:
            raise InputError(
                f"{folder / entry_folder.DESCRIPTION}: the name '{described['method']}' belongs to a shipped method or an installed "
                "simulator; give your method another name"
            )

        submitted = [(problem, *entries[problem.name]) for problem in problems if problem.name in entries]
        if not submitted:
            raise InputError(f"{folder} has none of the chosen problems; choose --problem from {', '.join(entries)}")
        return lambda _: [row(described["method"], *solution, described.get("machine") or "") for solution in submitted]
    method = entrants.method(name)

    def simulated(say: Callable[[str], None]) -> list[Row]:
        out = []
        for problem in problems:
            out.append(row(name, problem, *entrants.solve(method, problem), machine()))
            say(f"{name}, {problem.name}: profile error {out[-1]['profile_error_db']} dB, {out[-1]['seconds_per_frame']} s per frame")
        return out

    return simulated


def _read(path: Path) -> list[Row]:
    """Read an earlier leaderboard. Raises InputError if the file has other columns."""
    if not path.is_file():
        return []
    reader = csv.DictReader(io.StringIO(path.read_text(encoding="utf-8", errors="replace")))
    if tuple(reader.fieldnames or ()) != COLUMNS:
        raise InputError(f"{path} has other columns than a leaderboard of this version; move the file or choose another --output")
    return list(reader)


def table(rows: Sequence[Row]) -> str:
    """Return the main columns of the leaderboard as text."""
    columns = COLUMNS[:5]
    lines = [columns, *([str(entry[column]) for column in columns] for entry in rows)]
    widths = [max(len(line[i]) for line in lines) for i in range(len(columns))]
    return "\n".join("  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip() for line in lines)
