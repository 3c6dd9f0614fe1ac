"""Scores of constructed reconstructions: surfaces are absent, merged, cut, hidden behind a wall or never seen."""

import numpy as np
import pytest
import trimesh

from experiments.scans.accuracy import sighted
from experiments.scans.scan import TARGETS, _row, case_rows
from experiments.scans.segment_score import score_scene
from experiments.statistics import Estimate
from radartwin.errors import SceneError
from radartwin.scene import objects
from radartwin.scene.rooms import rectangle
from radartwin.scene.scene import Scene, Surface
from radartwin.testbed.scanner import scan

X, Y, Z = np.eye(3)
L, W, H = 5.0, 4.0, 2.4
WINDOW = (1.0, 0.9, 2.2, 1.9)  # window in the wall y = W: first x, lower z, last x, upper z in metres


def named(name, mesh, minc="painted"):
    return Surface(mesh, "plasterboard", name, role="room", provenance={"source": "true", "minc": minc})


def room(window=False):
    surfaces = [
        named("floor", rectangle([0, 0, 0], X, Y, (L, W))),
        named("ceiling", rectangle([0, W, H], X, -Y, (L, W))),
        named("back", rectangle([0, 0, 0], Y, Z, (W, H))),
        named("front", rectangle([L, W, 0], -Y, Z, (W, H))),
        named("right", rectangle([L, 0, 0], -X, Z, (L, H))),
        named("left", rectangle([0, W, 0], X, Z, (L, H), [WINDOW] if window else [])),
    ]
    if window:
        surfaces.append(named("window", rectangle([0, W, 0], X, Z, (L, H), inset=WINDOW), "glass"))
    return Scene(surfaces)


def by_name(score):
    return {s.name: s for s in [*score.surfaces, *score.clear]}


def mean(score, quantity):
    return np.mean([getattr(s, quantity) for s in score.surfaces])


def test_true_surfaces_score_one():
    score = score_scene(room(window=True), room(window=True))
    assert min(min(s.precision, s.recall, s.iou) for s in score.surfaces) > 0.96
    assert min(mean(score, "precision"), mean(score, "recall"), mean(score, "iou"), score.clear[0].through) > 0.98
    assert score.boundary_p95_m < 1e-6
    assert score.surfaces[0].name in ("ceiling", "floor"), "largest first"
    (walled_up,) = score_scene(room(window=False), room(window=True)).clear
    assert (walled_up.segment, walled_up.through) == ("-", 0)


def test_missing_surfaces_count_with_recall_zero():
    """The reconstruction contains only the floor, which is one of the six surfaces of the room."""
    score = score_scene(Scene([room().surfaces[0]]), room())
    scores = by_name(score)
    assert scores["floor"].recall > 0.98
    assert {name for name, s in scores.items() if s.segment == "-"} == {"ceiling", "back", "front", "right", "left"}
    assert scores["floor"].precision > 0.98
    assert mean(score_scene(Scene([]), room()), "recall") == 0.0


def test_poster_merged_into_its_wall_is_missed_and_flush():
    poster = named("poster", rectangle([0.005, 1.0, 1.0], Y, Z, (0.8, 1.0)), "paper")
    shelf = named("shelf", rectangle([0.4, 3.0, 1.0], X, Y, (0.8, 0.6)), "wood")
    score = score_scene(room(), Scene([*room(), poster, shelf]))
    scores = by_name(score)
    assert (scores["poster"].segment, scores["poster"].recall) == ("-", 0.0)
    assert scores["poster"].flush > 0.98
    assert (scores["shelf"].recall, scores["shelf"].flush) == (0.0, 0.0)
    assert mean(score, "recall") == pytest.approx(6 / 8, abs=0.02)
    assert score.missed_flush == pytest.approx(0.8 / (0.8 + 0.48), abs=0.05)


def test_cut_surface_is_half_found_and_merged_segment_has_one_owner():
    floor, ceiling, back, front, right, left = room()
    halves = [named(f"floor_{k}", rectangle([x, 0, 0], X, Y, (length, W))) for k, x, length in ((1, 0, 2 * L / 3), (2, 2 * L / 3, L / 3))]
    cut = by_name(score_scene(Scene([*halves, ceiling, back, front, right, left]), room()))
    assert cut["floor"].recall == pytest.approx(2 / 3, abs=0.03)
    assert cut["floor"].precision > 0.97
    both = named("both", trimesh.util.concatenate([ceiling.mesh, front.mesh]))
    merged = by_name(score_scene(Scene([floor, both, back, right, left]), room()))
    assert merged["ceiling"].recall > 0.97
    assert merged["ceiling"].precision == pytest.approx(L * W / (L * W + W * H), abs=0.03)
    assert (merged["front"].segment, merged["front"].recall) == ("-", 0.0)


def test_unseen_area_does_not_count_except_for_glass():
    whole = room(window=True)
    ceiling = whole.names.index("ceiling")
    built = Scene(s for s in whole if s.name not in ("ceiling", "window"))
    score = score_scene(built, whole, lambda points, normals, surface: surface != ceiling)
    assert "ceiling" not in by_name(score)
    assert mean(score, "recall") > 0.98
    assert [(s.name, s.recall, s.through) for s in score.clear] == [("window", 0.0, 0.0)]
    half = score_scene(whole, whole, lambda points, normals, surface: (surface != 0) | (points[:, 0] < L / 2))
    assert by_name(half)["floor"].area_m2 == pytest.approx(L * W / 2, rel=0.03)
    assert by_name(half)["floor"].iou > 0.98, "what is completed on the surface is not held against it"


def test_pixels_see_the_front_of_a_thin_plate_only():
    """A tolerance as large as the depth noise would count the surface behind the plate of 20 mm as seen."""
    plate = objects.box([2.2, 1.8, 0.9], [2.8, 2.2, 0.92])
    hidden = rectangle([2.3, 1.9, 0.895], X, Y, (0.4, 0.2))
    scene = Scene([*room(), named("plate", plate), named("hidden", hidden)])
    pose = np.eye(4)
    pose[:3, :3] = np.stack([X, -Y, -Z], axis=1)  # the camera looks down
    pose[:3, 3] = 2.5, 2.0, 2.2
    frames, truth = scan(scene, strength=0.0, poses=pose[None], colour_every=0)
    see = sighted(truth, frames)
    at = np.array([[2.5, 2.0, 0.92], [2.5, 2.0, 0.9], [2.5, 2.0, 0.895], [3.3, 2.0, 0.0], [2.5, 2.0, 0.0]])
    facing = np.array([Z, -Z, Z, Z, Z])
    assert see(at, facing, np.array([6, 6, 7, 0, 0])).tolist() == [True, False, False, True, False]
    assert not see(at[:1], facing[:1], np.array([0])).any(), "another surface's point"


def test_a_scan_claim_is_judged_by_its_whole_interval_and_needs_a_truth() -> None:
    for low, judged, verdict in ((0.91, True, "holds"), (0.88, True, "misses"), (0.91, False, "")):
        assert _row("lab", 1.0, "recall", "", Estimate(0.95, low, 0.99, 17), 1, "", judged)["verdict"] == verdict
    with pytest.raises(SceneError, match="no truth to score against"):
        score_scene(room(), Scene([]))


def test_a_surface_of_several_scans_counts_once() -> None:
    """Two panes in three scans are two surfaces, too few for a verdict; three walls are enough."""
    wall = {"segment": "s", "iou": 0.9, "precision": 0.95, "recall": 0.95, "area_m2": 10.0}
    scan_wide = {metric: 1.0 for metric in TARGETS}
    scans = [
        {"surfaces": [{"name": f"wall_{n}", **wall} for n in "abc"], "clear": [{"name": n, "through": 0.9} for n in "xy"], **scan_wide}
        for _ in range(3)
    ]
    rows = {row["metric"]: row for row in case_rows("lab", 1.0, scans, 100, 0, "")}
    assert (rows["glass_recall"]["n"], rows["glass_recall"]["verdict"]) == (2, "")
    assert (rows["recall"]["n"], rows["recall"]["verdict"]) == (3, "holds")
