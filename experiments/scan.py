"""From a scan to surfaces: how near the reconstruction is to the truth, and whether every surface is found as one.

A phone with LiDAR is walked through a procedural room (radartwin.reconstruct.scanner; its noise, dropouts and drift are from published
evaluations, `strength` scales them all), and its frames go the way a user's go: fused, segmented, outlined. Scored against the room itself,
which the reconstruction never sees. Targets are the project's own; the paper gives no figures for its scan.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from radartwin.config import Config
from radartwin.experiment import Result
from radartwin.plotting import PAGE_WIDTH_IN, PALETTE, figure
from radartwin.progress import Progress
from radartwin.scene import rooms
from radartwin.scene.scene import Scene
from radartwin.store import Product, Store, save_json

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ROOTS = ["experiments.scan"]
SCORES = "scores"
FOLDER = "scene"
SHELL = re.compile("floor|ceiling|wall_[a-z]+")  # names of the true surfaces that are the room's shell
SHELL_IOU = 0.8  # of a wall, floor or ceiling that is one segment
# metric -> (what it says, limit, whether it is a least value)
TARGETS: dict[str, tuple[str, float, bool]] = {
    "median_mm": ("half of the surface is this near the truth", 15.0, False),
    "p95_mm": ("95 % of the surface are this near the truth", 50.0, False),
    "coverage": ("of what the sensor saw is in the mesh", 0.9, True),
    "shell_single": ("walls, floor and ceiling that are one segment", 1.0, True),
    "precision": ("of a surface's segment lies on it", 0.9, True),
    "recall": ("of a surface is in its segment", 0.9, True),
    "glass_recall": ("of glass and mirrors is in segments of glass or mirror, completed where nothing was seen", 0.5, True),
}


def run(config: Config, store: Store, progress: Progress) -> Result:
    """Score a scan of every room at every strength of the scanner's errors."""
    cases = [(room, strength) for room in config.profile.scan_rooms for strength in config.profile.scan_strengths]
    rows: list[dict[str, Any]] = []
    scores: dict[tuple[str, float], dict[str, Any]] = {}
    keys = []
    for room, strength in progress.over(cases, "scans"):
        product = fetch(config, store, room, strength)
        found = product.read_json(SCORES)
        scores[room, strength] = found
        keys.append(product.key)
        measured = [metric for metric in TARGETS if found["n"][metric]]  # a room without glass has no glass to find
        rows += [_row(room, strength, metric, found[metric], int(found["n"][metric]), product.key) for metric in measured]
    figures: dict[str, Callable[[], Figure]] = {"scan_surfaces": lambda: _figure(scores)}
    metrics = {
        f"{metric}_{room}_{strength:g}": found[metric]
        for (room, strength), found in scores.items()
        for metric in TARGETS
        if found["n"][metric]
    }
    return Result("scan", rows, figures, dict(list(metrics.items())[:30]), keys)


def fetch(config: Config, store: Store, room: str, strength: float) -> Product:
    """A scanned and reconstructed room with its scores, from the store or made now.

    At strength 0 nothing is lost: the room itself, without the clutter that a scan may miss, and no scores.
    """
    spec = {"room": room, "strength": strength, "seed": config.seed}

    def build(folder: Path) -> None:
        if strength == 0:
            rooms.room(room, detail="furnished").save(folder / FOLDER)
        else:
            save_json(folder, SCORES, _scanned(folder / FOLDER, room, strength, config.seed))

    return store.fetch("scan", spec, ROOTS, build)


def _scanned(out: Path, room: str, strength: float, seed: int) -> dict[str, Any]:
    """Scan, reconstruct into `out`, and score."""
    import trimesh

    from radartwin.reconstruct.accuracy import accuracy
    from radartwin.reconstruct.build import reconstruct
    from radartwin.reconstruct.scanner import scan
    from radartwin.reconstruct.score import score_scene

    truth = rooms.room(room, detail="cluttered")
    frames, seen = scan(truth, seed, strength)
    with tempfile.TemporaryDirectory() as folder:
        frames.save(Path(folder) / room)
        scene = reconstruct(Path(folder) / room, out)
    mesh = trimesh.load(out / "scan.ply", process=False)
    near = accuracy(mesh, truth, seen, frames)  # type: ignore[arg-type]
    score = score_scene(scene, truth)
    shell = [s for s in score.surfaces if SHELL.fullmatch(s.name)]
    single = [s.iou > SHELL_IOU for s in shell]
    return {
        "median_mm": 1e3 * near.median_m, "p95_mm": 1e3 * near.p95_m, "coverage": near.coverage,
        "shell_single": float(np.mean(single)) if single else float("nan"),
        "precision": score.precision, "recall": score.recall,
        "glass_recall": score.clear_recall,
        "n": {
            "median_mm": 1, "p95_mm": 1, "coverage": 1, "shell_single": len(shell), "precision": len(score.surfaces),
            "recall": len(score.surfaces), "glass_recall": len(score.clear),
        },
        "surfaces": [[s.name, s.area_m2, s.segment, s.recall, s.precision, s.iou, s.clear] for s in [*score.surfaces, *score.clear]],
        "boundary_median_mm": 1e3 * score.boundary_median_m, "boundary_p95_mm": 1e3 * score.boundary_p95_m, "frames": len(frames),
    }  # fmt: skip


def scene_of(product: Product) -> Scene:
    """The reconstructed scene of a product."""
    return Scene.load(product.path / FOLDER)


def _row(room: str, strength: float, metric: str, value: float, n: int, key: str) -> dict[str, Any]:
    """One line; every limit is checked at the strength the sources give, and shown at the others."""
    claim, limit, least = TARGETS[metric]
    holds = value >= limit if least else value <= limit
    verdict = "untestable" if strength != 1 else "holds" if holds else "fails"
    return {
        "room": room, "strength": strength, "claim": claim, "limit": f"{'>=' if least else '<='} {limit:g}", "metric": metric,
        "run_keys": key[:8], "paper": "", "value": value, "low": value, "high": value, "n": n, "domain": "virtual scan", "verdict": verdict,
    }  # fmt: skip


def _figure(scores: dict[tuple[str, float], dict[str, Any]]) -> Figure:
    """Recall of every true surface against its area, by room."""
    drawing, axes = figure(1, 1, width_in=PAGE_WIDTH_IN, height_in=3.0)
    for colour, room in zip(PALETTE, dict.fromkeys(room for room, _ in scores), strict=False):
        strength = min((s for r, s in scores if r == room), key=lambda s: abs(s - 1))
        areas, overlaps = np.array([[row[1], row[5]] for row in scores[room, strength]["surfaces"]]).T
        axes.scatter(areas, overlaps, s=14, color=colour, label=f"{room} ({len(areas)} surfaces)")
    axes.set_xscale("log")
    axes.set_xlabel("area of the true surface (m²)")
    axes.set_ylabel("intersection over union with its segment")
    axes.set_ylim(0, 1.02)
    axes.legend(loc="lower right")
    return drawing
