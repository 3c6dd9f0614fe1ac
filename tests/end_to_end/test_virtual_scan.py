"""Reconstructions of virtual scans of the three rooms meet the limits of the scan table, or recorded values where they miss them, and equal
the shipped rooms.
"""

import functools
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from experiments.scans.accuracy import accuracy
from experiments.scans.scan import FEWEST, TARGETS, case_rows, scores
from experiments.scans.virtual_scan import SHIPPED_SEED, SHIPPED_STRENGTH, scanned, shipped_file, unpack
from experiments.speed.bench import reconstruction
from radartwin.reconstruct.fusion.fusion import fuse
from radartwin.scene import rooms
from radartwin.scene.scene import Scene
from radartwin.testbed.scanner import scan

pytestmark = pytest.mark.slow
# (room, strength) -> lowest accepted recall and precision, a little below the values of seed 0. Other metrics use the limits of the table.
LEAST = {
    ("lab", 0.5): (0.95, 0.95), ("lab", 1.0): (0.95, 0.95), ("lab", 2.0): (0.95, 0.95),
    ("squash_court", 0.5): (0.90, 0.95), ("squash_court", 1.0): (0.92, 0.95), ("squash_court", 2.0): (0.88, 0.91),
    ("atrium", 0.5): (0.78, 0.94), ("atrium", 1.0): (0.79, 0.93), ("atrium", 2.0): (0.70, 0.90),
}  # fmt: skip
BY_AREA = 0.9


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str, float], Path]:
    """Return a function that scans a room once with a strength, and returns the scene folder."""

    @functools.cache
    def folder(room: str, strength: float) -> Path:
        path = tmp_path_factory.mktemp(room) / "scene"
        scanned(path, room, strength, SHIPPED_SEED)
        return path

    return folder


@pytest.mark.filterwarnings("ignore:surfaces around the radar")  # the profile error in the reconstructed room traces its clutter by tubes
@pytest.mark.parametrize(("room", "strength"), LEAST)
def test_scan_scores_stay_within_recorded_bounds(room: str, strength: float, made: Callable[[str, float], Path]) -> None:
    case = scores(made(room, strength), room, strength, SHIPPED_SEED)
    rows = {row["metric"]: row for row in case_rows(room, strength, [case], 1000, 0, "")}
    recall, precision = LEAST[room, strength]
    assert rows["recall"]["value"] >= recall
    assert rows["precision"]["value"] >= precision
    assert min(rows["area_recall"]["value"], rows["area_precision"]["value"]) >= BY_AREA
    for metric in ("median_mm", "p95_mm", "coverage", "glass_recall"):
        if metric in rows:
            few = metric == "glass_recall" and rows[metric]["n"] < FEWEST
            assert rows[metric]["verdict"] == ("" if few else "holds"), metric
    if strength <= 1:
        assert rows["shell_single"]["verdict"] == "holds"
    assert set(rows) >= set(TARGETS) - {"glass_recall"}


@pytest.mark.parametrize("room", sorted({room for room, _ in LEAST}))
def test_a_shipped_room_is_the_room_that_is_scanned_today(room: str, made: Callable[[str, float], Path], tmp_path: Path) -> None:
    """After a change of scanner or reconstruction, run: python -m experiments.generators.scanned_rooms.

    Processors round differently. Without AVX-512, one of the 31 surfaces of the laboratory has another outline, and its area differs by
    0.15 per mille.
    """
    unpack(shipped_file(room), tmp_path)
    shipped, today = Scene.load(tmp_path), Scene.load(made(room, SHIPPED_STRENGTH))
    assert [(s.name, s.material, s.kind) for s in shipped] == [(s.name, s.material, s.kind) for s in today]
    meshes = [(old.mesh, new.mesh) for old, new in zip(shipped, today, strict=True)]
    np.testing.assert_allclose(*np.transpose([(old.area, new.area) for old, new in meshes]), rtol=0.01)
    equal = [old.vertices.shape == new.vertices.shape and np.abs(old.vertices - new.vertices).max() < 1e-6 for old, new in meshes]
    assert np.mean(equal) > 0.9


def test_fusion_of_the_largest_room_needs_less_than_a_minute_on_two_cores_and_four_gigabytes():
    code = (
        "import time; from experiments.speed.machine import peak_gib; from radartwin.reconstruct.fusion.fusion import fuse\n"
        "from radartwin.scene import rooms; from radartwin.testbed.scanner import scan\n"
        "frames = scan(rooms.atrium(), seed=0, colour_every=0)[0]\n"
        "start = time.process_time()\n"
        "fuse(frames)\n"
        "print(time.process_time() - start, peak_gib())"
    )
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    core_seconds, gibibytes = map(float, done.stdout.split())
    assert core_seconds < 120
    assert gibibytes < 4.0


def test_half_a_million_triangles_need_less_than_four_gigabytes():
    cost = reconstruction()
    assert cost["faces"] >= 500_000
    assert cost["peak_gib"] < 4.0
    assert cost["core_seconds"] < 120  # limit in core seconds; two cores need 60 s


def test_drift_correction_halves_the_error():
    """The same virtual scan is reconstructed with and without drift correction; the correction must halve the geometric error."""
    scene = rooms.lab()
    frames, truth = scan(scene, seed=1, colour_every=0)
    refined, rough = (accuracy(fuse(frames, refine=refine)[0], scene, truth, frames) for refine in (True, False))
    assert refined.median_m < 0.5 * rough.median_m
    assert refined.p95_m < 0.5 * rough.p95_m
