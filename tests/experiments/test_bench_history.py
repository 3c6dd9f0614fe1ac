"""The history of benchmarks keeps every line and every ratio."""

from __future__ import annotations

from pathlib import Path

from experiments.speed import bench_history

MACHINE = {"processor": "a, b", "cores": 2, "load": "0.1", "python": "3.11.7", "repeats": 5, "variant": "llvm"}


def test_append_adds_a_line_and_a_column_for_a_new_ratio(tmp_path: Path) -> None:
    history = tmp_path / "history.csv"
    bench_history.append(MACHINE, {"direct sum to gridding": 812.345}, history)
    bench_history.append(MACHINE | {"variant": "cuda"}, {"moving, tubes alone to panel images": 12.0}, history)
    first, second = bench_history.read(history)
    assert first["processor"] == "a, b"
    assert first["direct sum to gridding"] == "812.3"
    assert first["moving, tubes alone to panel images"] == ""
    assert (second["variant"], second["moving, tubes alone to panel images"]) == ("cuda", "12")
    assert list(tmp_path.iterdir()) == [history]


def test_committed_history_has_ratios_of_a_named_machine() -> None:
    for line in bench_history.read():
        assert line["commit"]
        assert line["processor"]
        ratios = [value for name, value in line.items() if name not in bench_history.FIXED and value]
        assert ratios
        assert all(float(value) > 0 for value in ratios)
    assert bench_history.read()
