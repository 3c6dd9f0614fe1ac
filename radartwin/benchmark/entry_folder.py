"""Write and read a folder of signals, with which a method outside RadarTwin enters the benchmark (docs/benchmark.md).

    FOLDER/method.json     name of the method; for each problem: file, SHA-256, frequency grid, seconds per frame
    FOLDER/PROBLEM.npz     one complex array (S, N) per scenario: S frames with N samples

A folder may leave out problems, but not single scenarios of a problem.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np

from radartwin.benchmark import frozen_problems
from radartwin.benchmark.frozen_problems import Problem
from radartwin.errors import InputError
from radartwin.io import files
from radartwin.radar.chirp import Radar

DESCRIPTION, FORMAT = "method.json", "radartwin benchmark entry 1"
SAME_HZ = 1e3  # a frequency that is wrong by this much changes the phase at a range of 11 m by 0.7e-4 of a cycle
REMEDY = "write the folder with radartwin.benchmark.entry_folder.write"
Signals = Mapping[str, np.ndarray]


def frequency_grid(radar: Radar) -> dict[str, float | int]:
    """Return the frequencies of the samples of a chirp: the first in Hz, the step in Hz, and their number."""
    step = radar.slope_hz_per_s / radar.sample_rate_hz
    return {"start_hz": radar.start_frequency_hz, "step_hz": step, "samples": radar.num_samples}


def write(
    folder: str | Path, method: str, signals: Mapping[str, Signals], seconds_per_frame: Mapping[str, float], machine: str = ""
) -> Path:
    """Write the signals of a method. All arguments are checked before the first file is written. The file method.json is written last.

    Args:
        signals: by problem and scenario, complex samples (S, N) in amplitude units.
        seconds_per_frame: by problem, wall seconds per frame of the method.
    Raises:
        InputError: a problem or scenario is unknown or absent, or has a wrong shape, or a problem has no seconds per frame above 0, or the
            name of the method or machine has other than printable characters.
        OutputError: the folder cannot be written.
    """
    _check_names(method, machine, str(folder))
    folder, contents, entries = Path(folder), {}, {}
    for name, given in signals.items():
        where, problem = f"{method}: problem {name}", frozen_problems.problem(name)
        arrays = _checked(problem, {key: np.asarray(value) for key, value in given.items()}, where)
        if name not in seconds_per_frame:
            raise InputError(f"{where} has no entry in seconds_per_frame; give the wall seconds per frame of each problem")
        seconds = _checked_seconds(seconds_per_frame[name], where)
        content = contents[f"{name}.npz"] = frozen_problems.packed(arrays)
        digest, grid = hashlib.sha256(content).hexdigest(), frequency_grid(problem.radar)
        entries[name] = {"file": f"{name}.npz", "sha256": digest, "frequencies": grid, "seconds_per_frame": seconds}
    for name, content in contents.items():
        files.write_atomically(folder / name, content)
    described = {"format": FORMAT, "method": method, "machine": machine, "answers_version": frozen_problems.version(), "problems": entries}
    files.write_atomically(folder / DESCRIPTION, json.dumps(described, indent=1) + "\n")
    return folder


def read(folder: Path) -> tuple[dict[str, Any], dict[str, tuple[dict[str, np.ndarray], float]]]:
    """Return the content of method.json, and by problem the signals (S, N) of each scenario and the seconds per frame.

    Raises MissingError or InputError for an absent or damaged file, or a wrong version, checksum, frequency grid or shape.
    """
    path = folder / DESCRIPTION
    described = frozen_problems.described(path, FORMAT, REMEDY)
    _check_names(described.get("method"), described.get("machine") or "", str(path))
    if described.get("answers_version") != frozen_problems.version():
        raise InputError(
            f"{path}: answers_version is {described.get('answers_version')!r}, but this benchmark has version "
            f"{frozen_problems.version()!r}; run the method on the problems of this version"
        )
    problems = described.get("problems")
    if not isinstance(problems, dict) or not problems:
        raise InputError(f"{path}: 'problems' must list at least one of {', '.join(frozen_problems.names())}")
    return described, {name: _problem(folder, name, entry) for name, entry in problems.items()}


def _check_names(method: Any, machine: Any, where: str) -> None:
    """Check that the names of a method and of its machine have only printable characters, and that the method has a name."""
    for key, text in (("method", method), ("machine", machine)):
        if not isinstance(text, str) or not text.isprintable():
            raise InputError(f"{where}: '{key}' must be a text of printable characters on one line")
    if not method.strip():
        raise InputError(f"{where}: 'method' must be the name of the method")


def _problem(folder: Path, name: str, entry: Any) -> tuple[dict[str, np.ndarray], float]:
    where = f"{folder / DESCRIPTION}, problem {name}"
    if name not in frozen_problems.names():
        raise InputError(f"{where}: this problem is not known; choose one of {', '.join(frozen_problems.names())}")
    if not isinstance(entry, dict) or not isinstance(entry.get("file"), str):
        raise InputError(f"{where}: 'file' must name the .npz file; {REMEDY}")
    problem = frozen_problems.problem(name)
    _check_frequencies(problem.radar, entry.get("frequencies"), where)
    seconds = _checked_seconds(entry.get("seconds_per_frame"), where)
    arrays = frozen_problems.checked_arrays(folder, entry, where, "write the folder again")
    return _checked(problem, arrays, str(folder / entry["file"])), seconds


def _check_frequencies(radar: Radar, given: Any, where: str) -> None:
    wanted = frequency_grid(radar)
    if not isinstance(given, dict) or set(given) != set(wanted):
        raise InputError(f"{where}: 'frequencies' must hold the numbers {', '.join(wanted)}; give {_grid(wanted)}")
    grid = {name: _number(given[name]) for name in wanted}
    start_hz, step_hz = (grid[name] - wanted[name] for name in ("start_hz", "step_hz"))
    apart_hz = (start_hz, start_hz + wanted["samples"] * step_hz)  # at both ends of the grid; NaN is not below SAME_HZ
    if grid["samples"] != wanted["samples"] or not all(abs(hz) < SAME_HZ for hz in apart_hz):
        raise InputError(f"{where}: the frequency grid is {_grid(grid)}, but the problem has {_grid(wanted)}; compute at these frequencies")


def _grid(grid: Mapping[str, float]) -> str:
    return f"{grid['samples']:.0f} samples from {grid['start_hz']:.0f} Hz in steps of {grid['step_hz']:.3f} Hz"


def _number(value: Any) -> float:
    """Return a number as a float: infinity for an integer that no float can hold, and NaN for all that is no number."""
    try:
        return float(value) if isinstance(value, Real) and not isinstance(value, bool) else math.nan
    except OverflowError:
        return math.inf


def _checked_seconds(value: Any, where: str) -> float:
    seconds = _number(value)
    if not 0 < seconds < math.inf:
        raise InputError(f"{where}: seconds_per_frame is {seconds}; give the wall seconds per frame, above 0")
    return seconds


def _checked(problem: Problem, arrays: dict[str, np.ndarray], where: str) -> dict[str, np.ndarray]:
    """Return the arrays in the order of the problem's scenarios. Raises InputError for a missing or unknown scenario or a wrong array."""
    wanted = {scenario.name: scenario.answer.shape for scenario in problem.scenarios}
    for key in (*wanted, *arrays):
        if key not in arrays:
            raise InputError(f"{where}: the array of scenario '{key}' is missing; the problem has {', '.join(wanted)}")
        if key not in wanted:
            raise InputError(f"{where}: there is no scenario '{key}'; the problem has {', '.join(wanted)}")
        array = arrays[key]
        if array.shape != wanted[key]:
            frames, samples = wanted[key]
            raise InputError(f"{where}: scenario '{key}' has the shape {array.shape}, but needs ({frames}, {samples}), frames by samples")
        if array.dtype.kind not in "fc" or not np.isfinite(array).all():
            raise InputError(f"{where}: scenario '{key}' has samples that are not finite numbers; give finite complex samples")
    return {key: arrays[key] for key in wanted}
