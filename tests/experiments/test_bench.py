"""Tests of the benchmark figures: targets, the last comparable run, and the history file. No test measures run times."""

from __future__ import annotations

import csv
from pathlib import Path

from experiments.speed import bench

MACHINE = {"processor": "a, b", "cores": 2, "variant": "llvm"}


def test_table_shows_target_verdict_and_last_comparable_run(tmp_path: Path) -> None:
    path = tmp_path / "history.csv"
    for other, value in (({}, 100.0), ({}, 120.0), ({"processor": "c"}, 1.0), ({"cores": "16"}, 2.0), ({"variant": "cuda"}, 3.0)):
        bench.append(MACHINE | other, {"drive frame": value}, path)
    values = {
        "object only, 100 frames in one call": 999.0,
        "one frame in one call, sphere": 3.0,
        "drive frame": 130.0,
        "track set-up": 7.25,
    }
    _, *rows = bench.table(values, bench.read(path), MACHINE).splitlines()
    assert [[cell.strip() for cell in row.split("  ") if cell.strip()] for row in rows] == [
        ["object only, 100 frames in one call, frames/s", "999", "at least 1000", "miss", "-"],
        ["one frame in one call, sphere, ms", "3", "at most 3", "pass", "-"],
        ["drive frame, ms/frame", "130", "at most 30", "miss", "120"],
        ["track set-up, s", "7.25", "-", "-", "-"],
    ]
    assert "miss" in bench.table({"drive frame": 31.0}, bench.read(tmp_path / "absent.csv"), MACHINE)


def test_history_gets_a_line_of_figures_and_a_column_for_a_new_figure(tmp_path: Path) -> None:
    path = tmp_path / "history.csv"
    bench.append(MACHINE, {"direct sum to gridding at 0.0 m/s": 812.345}, path)
    bench.append(MACHINE | {"variant": "cuda"}, {"moving, tubes alone to flat faces": 12.0, "drive frame": 25.0}, path)
    first, second = csv.DictReader(path.read_text().splitlines())
    assert (first["processor"], first["direct sum to gridding at 0.0 m/s"], first["drive frame, ms/frame"]) == ("a, b", "812.3", "")
    assert (second["variant"], second["moving, tubes alone to flat faces"], second["drive frame, ms/frame"]) == ("cuda", "12", "25")
