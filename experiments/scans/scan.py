"""Measure the accuracy of reconstructed scans, and whether every true surface becomes one segment.

Scans of procedural rooms (experiments/scans/virtual_scan.py) are compared with the true room, which the reconstruction never reads. The
limits are the project's own, because the paper gives no accuracy of its scan. A wall counts as one segment if the intersection over union
exceeds 0.8: one cut at a door or merged with a neighbour stays below, one partly hidden by furniture can exceed it, because area that the
phone did not see does not count. Of glass only half of the area must be found, because a depth sensor measures nothing on it, and the pane
is completed from its frame.
"""

import dataclasses
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from experiments import statistics, verdicts
from experiments.drawing import PAGE_WIDTH_IN, PALETTE, Figure, figure
from experiments.interface import Config, Progress, Result, Table
from experiments.scans import virtual_scan
from radartwin.scene import rooms
from radartwin.scene.scene import Scene
from radartwin.store.products import Product, Store, save_json

TABLE = Table(
    name="scan",
    title="From a scan to surfaces",
    caption="A virtual phone with LiDAR moves through each procedural room. Its frames are fused, segmented and outlined like those of "
    "a user, and scored against the true room. The strength scales every error of the phone. The project chose the targets, and "
    "checks them at every strength. A limit holds if the whole interval keeps it; the score of a single scan has no interval. "
    "n counts scans, or true surfaces of which the phone saw at least 0.25 m2, including surfaces without a segment. Intervals are "
    "bootstraps over the scans or surfaces.",
)

ROOTS = ["experiments.scans.scan"]
SCORES = "scan_scores"
SHELL = re.compile("floor|ceiling|wall_[a-z]+")  # names of the true surfaces that are the room's shell
SHELL_IOU = 0.8  # a wall, floor or ceiling is one segment above this intersection over union
# metric -> (claim, limit or None, whether the limit is a minimum)
TARGETS: dict[str, tuple[str, float | None, bool]] = {
    "median_mm": ("half of the surface is within this distance of the true surface", 15.0, False),
    "p95_mm": ("95 % of the surface is within this distance of the true surface", 50.0, False),
    "coverage": ("share of the seen surface that is in the mesh", 0.9, True),
    "shell_single": ("share of walls, floor and ceiling that are one segment", 1.0, True),
    "precision": ("share of a segment that lies on its surface, mean over surfaces with a segment", 0.9, True),
    "recall": ("share of the seen part of a surface that is in its segment (0 without a segment), mean over surfaces", 0.9, True),
    "glass_recall": ("share of glass and mirrors that is in segments of glass or mirror, with completed panes", 0.5, True),
    "area_precision": ("precision by area", None, True),
    "area_recall": ("recall by area", None, True),
    "worst_recall": ("recall of the worst surface of 1 m2 or more", None, True),
    "missed_flush": ("share of the missed area on surfaces that lie within the depth noise of another surface", None, False),
    "boundary_mm": ("half of the edges of segments are within this distance of a true edge", None, False),
    "boundary_p95_mm": ("95 % of the edges of segments are within this distance of a true edge", None, False),
    "profile_db": ("rms error of range profiles in the room, all surfaces metal (dB)", None, False),
    "false_panes_m2": ("area of completed panes where the room has no glass (m2)", None, False),
}
FEWEST = 3  # smallest number of surfaces for a verdict on a mean over surfaces
SHARE = (0.0, 1.0)  # smallest and largest share
LARGE_M2 = 1.0
SEEDS = {("lab", 1.0): 3}  # (room, strength) -> number of scans in the paper profile; other cases have one scan


def run(config: Config, store: Store, progress: Progress) -> Result:
    """Score the reconstructed scans of every room at every strength of the scanner's errors."""
    cases = [(room, strength) for room in config.profile.scan_rooms for strength in config.profile.scan_strengths]
    rows: list[dict[str, Any]] = []
    scored: dict[tuple[str, float], list[dict[str, Any]]] = {}
    keys = []
    for room, strength in progress.over(cases, "scans"):
        count = SEEDS.get((room, strength), 1) if config.profile.name == "paper" else 1
        products = [fetch(config, store, room, strength, config.seed + k) for k in range(count)]
        scored[room, strength] = [product.read_json(SCORES) for product in products]
        keys += [product.key for product in products]
        rows += case_rows(room, strength, scored[room, strength], config.profile.resamples, config.seed, products[0].key)
    figures: dict[str, Callable[[], Figure]] = {"scan_surfaces": lambda: _figure({case: of_scans[0] for case, of_scans in scored.items()})}
    metrics = {f"{r['metric']}_{r['room']}_{r['strength']:g}": r["value"] for r in rows if r["verdict"]}
    return Result(TABLE.name, rows, figures, dict(list(metrics.items())[:30]), keys)


def fetch(config: Config, store: Store, room: str, strength: float, seed: int) -> Product:
    """Return the scores of a room's scan as a stored result. Scores that are not in the store are computed."""
    scan = virtual_scan.fetch(config, store, room, strength, seed, anew=True)
    spec = {**virtual_scan.specification(config, room, strength, seed, anew=True), "of": scan.key}
    return store.fetch(
        SCORES, spec, ROOTS, lambda folder: save_json(folder, SCORES, scores(scan.path / virtual_scan.FOLDER, room, strength, seed))
    )


def scores(folder: Path, room: str, strength: float, seed: int) -> dict[str, Any]:
    """Return the scores of a reconstructed scene against the true room. The scan is simulated again to find which surfaces it saw."""
    import trimesh

    from experiments.scans.accuracy import accuracy, profile_error_db, sighted
    from experiments.scans.segment_score import score_scene
    from radartwin.testbed.scanner import scan

    truth, scene = rooms.room(room, detail="cluttered"), Scene.load(folder)
    frames, seen = scan(truth, seed, strength, colour_every=0)
    mesh = trimesh.load(folder / "scan.ply", process=False)
    near = accuracy(mesh, truth, seen, frames)  # type: ignore[arg-type]
    score = score_scene(scene, truth, sighted(seen, frames))
    glass = {s.segment for s in score.clear}
    panes = [s for s in scene if s.provenance.get("completed")]
    return {
        "median_mm": 1e3 * near.median_m, "p95_mm": 1e3 * near.p95_m, "coverage": near.coverage,
        "profile_db": profile_error_db(scene, truth, near.move, seen.poses), "missed_flush": score.missed_flush,
        "boundary_mm": 1e3 * score.boundary_median_m, "boundary_p95_mm": 1e3 * score.boundary_p95_m,
        "false_panes_m2": float(sum(s.mesh.area for s in panes if s.name not in glass)),
        "surfaces": [dataclasses.asdict(s) for s in score.surfaces], "clear": [dataclasses.asdict(s) for s in score.clear],
    }  # fmt: skip


def case_rows(room: str, strength: float, scans: Sequence[dict[str, Any]], resamples: int, seed: int, key: str) -> list[dict[str, Any]]:
    """Return the rows of one room and strength; scores of a surface are averaged over its scans, and then over the surfaces."""
    surfaces = [s for scan in scans for s in scan["surfaces"]]
    clear = [s for scan in scans for s in scan["clear"]]
    split = [s for s in surfaces if s["segment"] != "-"]
    shell = [{**s, "single": float(s["iou"] > SHELL_IOU)} for s in surfaces if SHELL.fullmatch(s["name"])]
    large = [s for s in surfaces if s["area_m2"] >= LARGE_M2]
    samples = {
        "shell_single": _of_surfaces(shell, "single"), "precision": _of_surfaces(split, "precision"),
        "recall": _of_surfaces(surfaces, "recall"), "glass_recall": _of_surfaces(clear, "through"),
    }  # fmt: skip
    weighted = {"area_precision": (split, "precision"), "area_recall": (surfaces, "recall")}
    rows = []
    for metric, (claim, _, _) in TARGETS.items():
        said = claim
        if metric in samples:
            if not len(samples[metric]):
                continue  # a room without glass has no glass to find
            estimate = statistics.mean(samples[metric], resamples, seed, SHARE)
        elif metric in weighted:
            group, name = weighted[metric]
            areas = _of_surfaces(group, "area_m2")
            estimate = statistics.ratio(_of_surfaces(group, name) * areas, areas, resamples, seed)
        elif metric == "worst_recall":
            worst = min(large, key=lambda s: s["recall"])
            estimate = statistics.exact(worst["recall"], len(large))
            said = f"{claim}: {worst['name']}, {worst['area_m2']:.1f} m2"
        else:
            estimate = statistics.mean([scan[metric] for scan in scans], resamples, seed)
        judged = metric not in samples or estimate.n >= FEWEST
        rows.append(_row(room, strength, metric, said, estimate, len(scans), key, judged))
    return rows


def _of_surfaces(scores: Sequence[dict[str, Any]], name: str) -> np.ndarray:
    """Return the score `name` of each surface, as a mean over the scans of the surface."""
    surfaces = dict.fromkeys(s["name"] for s in scores)
    return np.array([np.mean([s[name] for s in scores if s["name"] == surface]) for surface in surfaces])


def _row(
    room: str, strength: float, metric: str, claim: str, estimate: statistics.Estimate, scans: int, key: str, judged: bool
) -> dict[str, Any]:
    """Return one table row. If `judged`, a metric with a limit gets a verdict: the claim holds if the whole interval keeps the limit."""
    _, limit, least = TARGETS[metric]
    holds = None
    if judged and limit is not None:
        holds = estimate.low >= limit if least else estimate.high <= limit
    return {
        "room": room, "strength": strength, "claim": claim, "limit": "" if limit is None else f"{'>=' if least else '<='} {limit:g}",
        "scans": scans, **verdicts.score_columns(metric, estimate, "virtual scan", holds, [key]),
    }  # fmt: skip


def _figure(scores: dict[tuple[str, float], dict[str, Any]]) -> Figure:
    """Draw the intersection over union of every true surface and its segment against the surface's area, one panel per room."""
    drawing, axes = figure(1, 1, width_in=PAGE_WIDTH_IN, height_in=3.0)
    for colour, room in zip(PALETTE, dict.fromkeys(room for room, _ in scores), strict=False):
        strength = min((s for r, s in scores if r == room), key=lambda s: abs(s - 1))
        areas, overlaps = np.array([[s["area_m2"], s["iou"]] for s in scores[room, strength]["surfaces"]]).T
        axes.scatter(areas, overlaps, s=14, color=colour, label=f"{room} ({len(areas)} surfaces)")
    labels = {"xlabel": "area of the true surface (m²)", "ylabel": "intersection over union with its segment"}
    axes.set(xscale="log", ylim=(0, 1.02), **labels)
    axes.legend(loc="lower right")
    return drawing
