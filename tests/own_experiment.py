"""Define a small deterministic experiment, as a user would write it, for tests of parameter sweeps. Files in its folder make it fail.

HOLD_n     the job of seed n waits while this file exists
BREAK_n    the job of seed n fails with a defect
REFUSE_n   the job of seed n is refused
STOP_n     the job of seed n is interrupted
KILL_n     the job of seed n kills its own process, as the kernel does when memory runs out
EAT_n      the job of seed n asks for more memory than the machine has
DRAW       each job draws a figure
"""

from __future__ import annotations

import csv
from pathlib import Path

MODULE = """
import os
import signal
import time
from pathlib import Path

import numpy as np

from radartwin.errors import MissingError
from radartwin.runs.experiment import Result
from radartwin.store.products import save_arrays

HERE = Path(os.environ["OWN_EXPERIMENT"])


def run(config, store, progress):
    seed = config.seed
    while (HERE / f"HOLD_{seed}").exists():
        time.sleep(0.05)
    if (HERE / f"BREAK_{seed}").exists():
        raise RuntimeError("the solver broke")
    if (HERE / f"REFUSE_{seed}").exists():
        raise MissingError("there are no recorded answers")
    if (HERE / f"STOP_{seed}").exists():
        raise KeyboardInterrupt
    if (HERE / f"KILL_{seed}").exists():
        os.kill(os.getpid(), signal.SIGKILL)
    if (HERE / f"EAT_{seed}").exists():
        np.ones(1 << 50)
    product = store.fetch("recording", {"seed": seed % 5}, ["radartwin.constants"], lambda f: save_arrays(f, {"iq": np.ones(3)}))
    peak = -((config.trajectory.height_m - 1.2) ** 2)
    row = {
        "run_keys": product.key, "metric": "correlation", "paper": "0.42", "value": seed / 1000,
        "low": 0.0, "high": 1.0, "n": 3, "domain": "testbed", "verdict": "holds",
    }
    figures = {"curve": draw} if (HERE / "DRAW").exists() else {}
    return Result("mine", [row], figures, {"correlation": row["value"], "peak": peak}, [product.key])


def draw():
    from radartwin.plotting import style

    figure, axes = style.figure()
    axes.plot([0, 1], [1, 0])
    return figure
"""
YAML = "# @package _global_\nexperiment:\n  name: mine\n  module: my_experiment\n"
SAME = ("job", "seed", "run_key", "correlation", "peak")  # columns of the table of jobs that no launcher and no kill may change


def write(folder: Path) -> tuple[list[str], dict[str, str]]:
    """Write the experiment into the folder. Returns the arguments of `radartwin` that run the experiment, and the environment that it
    needs.
    """
    (folder / "experiment").mkdir(parents=True)
    (folder / "experiment" / "mine.yaml").write_text(YAML)
    (folder / "my_experiment.py").write_text(MODULE)
    return ["run", "experiment=mine", "--config-dir", str(folder)], {"OWN_EXPERIMENT": str(folder)}


def tables(output: Path) -> list[list[dict[str, str]]]:
    """Return the job tables of all sweeps in an output folder, oldest first."""
    written = sorted((output / "sweeps").glob("*/jobs.csv"), key=lambda path: path.stat().st_mtime_ns)
    return [list(csv.DictReader(path.read_text().splitlines())) for path in written]


def same(table: list[dict[str, str]]) -> list[tuple[str, ...]]:
    """Return the columns of a job table that do not depend on launcher, kills and times, in the order of the table."""
    return [tuple(row[column] for column in SAME) for row in table]
