"""Every metric of the scan table, room by room at half, stated and double errors of the phone, against what they were when written.

A limit that the table reports as failing (recall of the atrium, whose small things are lost) is held near its figure: it may rise.
"""

from pathlib import Path

import pytest

from experiments.scan import TARGETS, case_rows, scanned

# (room, strength) -> least recall and precision, a little below what seed 0 gave; the other limits are the table's own.
LEAST = {
    ("lab", 0.5): (0.94, 0.95), ("lab", 1.0): (0.94, 0.95), ("lab", 2.0): (0.94, 0.95),
    ("squash_court", 0.5): (0.87, 0.95), ("squash_court", 1.0): (0.88, 0.95), ("squash_court", 2.0): (0.87, 0.92),
    ("atrium", 0.5): (0.60, 0.90), ("atrium", 1.0): (0.65, 0.94), ("atrium", 2.0): (0.50, 0.85),
}  # fmt: skip
BY_AREA = 0.9


@pytest.mark.slow
@pytest.mark.parametrize(("room", "strength"), LEAST)
def test_scans_are_as_good_as_the_table_says(room: str, strength: float, tmp_path: Path) -> None:
    found = scanned(tmp_path / "scene", room, strength, 0)
    rows = {row["metric"]: row for row in case_rows(room, strength, [found], 1000, 0, "")}
    for row in rows.values():
        interval = f"{row['low']:.3f} to {row['high']:.3f}, n {row['n']}"
        print(f"{room} x{strength:g} {row['metric']}: {row['value']:.3f} ({interval}) {row['verdict']}")
    recall, precision = LEAST[room, strength]
    assert rows["recall"]["value"] >= recall
    assert rows["precision"]["value"] >= precision
    assert min(rows["area_recall"]["value"], rows["area_precision"]["value"]) >= BY_AREA
    for metric in ("median_mm", "p95_mm", "coverage", "glass_recall"):
        if metric in rows:
            assert rows[metric]["verdict"] == "holds", metric
    if strength <= 1:
        assert rows["shell_single"]["verdict"] == "holds"
    assert set(rows) >= set(TARGETS) - {"glass_recall"}
