"""Tests of the benchmark figures: targets, comparison with earlier runs, and the history file. No test measures run times."""

from __future__ import annotations

import csv
from pathlib import Path

import pandas as pd
import pytest

from experiments.speed import bench
from experiments.speed.bench_figures import FEWEST, FIGURES, LAST, Figure, change, earlier, table

MACHINE = {"processor": "a, b", "cores": 2, "variant": "llvm"}
DRIVE = next(figure for figure in FIGURES if figure.name == "drive frame")
SINGLE = next(figure for figure in FIGURES if figure.name == "object only, 100 frames in one call")
DRIVES = [figure.name for figure in FIGURES if figure.benchmark == "drives"]
STEADY = [100.0, 101.0, 99.0, 102.0, 100.0]


def history(values: list[float], **other: str) -> pd.DataFrame:
    """Return a history of drive frames with one run per value, on MACHINE with the cells `other` changed."""
    machine = {name: str(value) for name, value in MACHINE.items()} | other
    return pd.DataFrame([machine | {DRIVE.column: f"{value:.4g}"} for value in values])


MEMORY = next(figure for figure in FIGURES if figure.unit == "GiB")
OUTLIER = [100.0, 101.0, 500.0, 99.0, 100.0]  # which changes neither median nor scatter


@pytest.mark.parametrize(
    ("figure", "before", "value", "expected"),
    [
        (DRIVE, STEADY, 110.0, "+10 %"),  # below 15 %
        (DRIVE, STEADY, 130.0, "+30 % STEP slower"),
        (DRIVE, STEADY, 70.0, "-30 % STEP faster"),
        (DRIVE, [100.0, 130.0, 70.0, 100.0, 60.0, 140.0], 150.0, "+50 %"),  # within 3 median absolute deviations of 30
        (DRIVE, OUTLIER, 102.0, "+2 %"),
        (DRIVE, OUTLIER, 130.0, "+30 % STEP slower"),
        (DRIVE, [100.0, 100.0, 100.0], 114.9, "+15 %"),  # equal runs have no scatter
        (DRIVE, STEADY[: FEWEST - 1], 500.0, "no history yet"),
        (SINGLE, STEADY, 70.0, "-30 % STEP slower"),  # better if larger
        (SINGLE, STEADY, 130.0, "+30 % STEP faster"),
        (MEMORY, STEADY, 130.0, "+30 % STEP larger"),
        (MEMORY, STEADY, 70.0, "-30 % STEP smaller"),
    ],
)
def test_step_is_a_change_beyond_scatter_and_15_percent(figure: Figure, before: list[float], value: float, expected: str) -> None:
    assert change(figure, value, before) == expected


@pytest.mark.parametrize("other", [{"processor": "c"}, {"cores": "16"}, {"variant": "cuda"}])
def test_runs_of_another_machine_are_ignored(other: dict[str, str]) -> None:
    runs = pd.concat([history([100.0, 101.0, 99.0]), history([500.0] * 9, **other)])
    assert earlier(runs, MACHINE, DRIVE.column) == [100.0, 101.0, 99.0]


def test_last_runs_with_a_value_are_compared() -> None:
    runs = pd.concat([history([1.0, *map(float, range(100, 100 + LAST))]), history([1.0]).drop(columns=DRIVE.column)])
    assert earlier(runs, MACHINE, DRIVE.column) == list(range(100, 100 + LAST))
    assert earlier(runs, MACHINE, "a new column") == []


def test_table_shows_target_verdict_and_change(tmp_path: Path) -> None:
    values = {"drive frame": 130.0, "track set-up": 7.25, "one frame in one call, sphere": 3.0}
    values["object only, 100 frames in one call"] = 999.0
    head, *rows = table(values, history(STEADY), MACHINE).splitlines()
    assert head.startswith("figure")
    assert "no history yet" in table({"drive frame": 20.0}, bench.read(tmp_path / "absent.csv"), MACHINE)
    printed = [[cell.strip() for cell in row.split("  ") if cell.strip()] for row in rows]
    assert printed == [
        ["object only, 100 frames in one call, frames/s", "999", "at least 1000", "miss", "no history yet"],
        ["one frame in one call, sphere, ms", "3", "at most 3", "pass", "no history yet"],
        ["drive frame, ms/frame", "130", "at most 30", "miss", "+30 % STEP slower"],
        ["track set-up, s", "7.25", "-", "-", "no history yet"],
    ]


@pytest.mark.parametrize(
    ("found", "message"),
    [
        ({"drive frame": 1.0}, "drive frame past a can, .*track set-up, clutter: measured or declared"),
        (dict.fromkeys([*DRIVES, "drive frames"], 1.0), "^drive frames: measured or declared"),
    ],
)
def test_a_benchmark_measures_its_declared_figures(monkeypatch: pytest.MonkeyPatch, found: dict[str, float], message: str) -> None:
    monkeypatch.setitem(bench.BENCHMARKS, "drives", lambda repeats, variant: found)
    with pytest.raises(RuntimeError, match=message):
        bench.measured(["drives"], 1, "llvm")
    monkeypatch.setitem(bench.BENCHMARKS, "drives", lambda repeats, variant: dict.fromkeys(DRIVES, 1.0))
    assert bench.measured(["drives"], 1, "llvm") == dict.fromkeys(DRIVES, 1.0)


def test_history_gets_a_line_of_figures_and_a_column_for_a_new_figure(tmp_path: Path) -> None:
    path = tmp_path / "history.csv"
    bench.append(MACHINE, {"direct sum to gridding at 0.0 m/s": 812.345}, path)
    bench.append(MACHINE | {"variant": "cuda"}, {"moving, tubes alone to flat faces": 12.0, "drive frame": 25.0}, path)
    first, second = csv.DictReader(path.read_text().splitlines())
    assert (first["processor"], first["direct sum to gridding at 0.0 m/s"], first["drive frame, ms/frame"]) == ("a, b", "812.3", "")
    assert (second["variant"], second["moving, tubes alone to flat faces"], second["drive frame, ms/frame"]) == ("cuda", "12", "25")
