"""Every metric of the scan table stays within recorded bounds, for each room at half, full and double scan errors.

In the table, the segmentation recall of the atrium fails its limit because small objects are lost. Here it must not fall below its
recorded value.
"""

from pathlib import Path

import numpy as np
import pytest

from experiments.scans.accuracy import sighted
from experiments.scans.scan import TARGETS, case_rows, scores
from experiments.scans.segment_score import score_segments
from experiments.scans.true_surfaces import Truth
from experiments.scans.virtual_scan import scanned
from radartwin.reconstruct.fusion.fusion import fuse
from radartwin.reconstruct.segmentation.faces import Segment
from radartwin.reconstruct.segmentation.segment import segmented
from radartwin.scene import rooms
from radartwin.testbed.scanner import scan

# (room, strength) -> lowest accepted recall and precision, a little below the values of seed 0. Other metrics use the limits of the table.
LEAST = {
    ("lab", 0.5): (0.95, 0.95), ("lab", 1.0): (0.95, 0.95), ("lab", 2.0): (0.95, 0.95),
    ("squash_court", 0.5): (0.90, 0.95), ("squash_court", 1.0): (0.92, 0.95), ("squash_court", 2.0): (0.88, 0.91),
    ("atrium", 0.5): (0.78, 0.94), ("atrium", 1.0): (0.79, 0.93), ("atrium", 2.0): (0.70, 0.90),
}  # fmt: skip
BY_AREA = 0.9


@pytest.mark.slow
@pytest.mark.parametrize(("room", "strength"), LEAST)
def test_scan_scores_stay_within_recorded_bounds(room: str, strength: float, tmp_path: Path) -> None:
    scanned(tmp_path / "scene", room, strength, 0)
    found = scores(tmp_path / "scene", room, strength, 0)
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


@pytest.mark.slow
def test_atrium_mesh_bounds_the_possible_recall() -> None:
    """Assign each face to the true surface on which it lies. An ideal segmentation then misses only surfaces that the fusion lost."""
    room = rooms.room("atrium", detail="cluttered")
    frames, seen = scan(room, 0, 1.0)
    mesh, _ = fuse(frames)
    look = sighted(seen, frames)
    truth = Truth.of(room, look)
    owner = truth.owners()(np.asarray(mesh.triangles_center), np.asarray(mesh.face_normals))
    ideal = [Segment(np.flatnonzero(owner == k), float(mesh.area_faces[owner == k].sum())) for k in range(len(truth.scene))]
    ceiling = score_segments(mesh, [s for s in ideal if s.faces.size], room, look)
    found = score_segments(mesh, segmented(mesh), room, look)
    lost = {s.name: round(s.recall, 2) for s in sorted(ceiling.surfaces, key=lambda s: s.recall) if s.recall < 0.8}
    print(f"recall {found.recall:.3f} of at most {ceiling.recall:.3f}; of the mesh itself {lost}")
    assert ceiling.recall > 0.87
    assert found.recall > 0.9 * ceiling.recall
