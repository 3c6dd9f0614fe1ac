"""Quality of a segmentation of a scan, compared with the true surfaces of the room.

A true surface in separate pieces, such as the legs of a table, is scored piece by piece. Among the segments that lie mostly on a surface,
the segment that holds most of the surface is the surface's segment. A surface without such a segment has recall 0. Recall is the share of
the seen surface that lies in its segment: evenly spread true points are looked up in the scan, within REACH_M and with an agreeing normal.
Precision is the share of the segment that lies on the surface. IoU is the intersection of segment and seen surface, over their union.
A reconstruction may complete areas that the sensor did not see. Completed area on the true surface does not change precision or recall;
completed area off the true surface lowers precision. Boundary error is the distance from the edges of segments to the nearest edge of a
true surface. Depth sensors miss glass and mirrors, so these surfaces are scored separately and over their whole true area.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import trimesh
from scipy.spatial import KDTree

from experiments.scans.true_surfaces import SPACING_M, Sighted, Truth, nearest, outline_points
from radartwin.errors import SceneError
from radartwin.reconstruct.distance import spread
from radartwin.reconstruct.segmentation.faces import Segment
from radartwin.scene.scene import Scene

MIN_AREA_M2 = 0.25


@dataclass(frozen=True)
class SurfaceScore:
    """Score of one true surface.

    Attributes:
        area_m2: seen area; for glass and mirrors the whole area.
        segment: name of its segment, or "-" if it has none; precision is then NaN.
        boundary_m: median of the boundary error along the segment's edge.
        clear: whether the surface is glass or a mirror.
        flush: share of the seen area that is at most FLUSH_M above another surface, where depth cannot separate the two.
        through: for glass and mirrors, the share in segments that are at least half glass or mirror.
    """

    name: str
    area_m2: float
    segment: str
    recall: float
    precision: float
    iou: float
    boundary_m: float
    clear: bool
    flush: float = 0.0
    through: float = float("nan")


@dataclass(frozen=True)
class Score:
    """Means over the true surfaces of at least MIN_AREA_M2, without glass and mirrors. Precision is over the surfaces with a segment.

    Attributes:
        area_recall, area_precision: recall and precision weighted by area.
        found: share of these surfaces with an IoU of at least 0.5.
        right: share of the segments of at least MIN_AREA_M2 that are the best segment of a surface and lie on it with at least half of
            their area.
        boundary_median_m, boundary_p95_m: boundary error over all segments of these surfaces.
        clear_recall: for glass and mirrors, the share of their area in segments that are at least half glass or mirror.
        missed_flush: share of the missed area that belongs to surfaces flush with another surface.
        surfaces: score of each of these surfaces, largest first.
        clear: scores of glass and mirrors.
    """

    precision: float
    recall: float
    area_precision: float
    area_recall: float
    mean_iou: float
    found: float
    right: float
    boundary_median_m: float
    boundary_p95_m: float
    clear_recall: float
    missed_flush: float
    surfaces: list[SurfaceScore] = field(repr=False)
    clear: list[SurfaceScore] = field(repr=False)

    def lines(self) -> list[str]:
        """Return the scores as lines of text: one surface per line, then the means."""
        head = f"{'surface':24} {'m2':>7} {'segment':>14} {'recall':>7} {'precision':>9} {'IoU':>6} {'edge mm':>8} {'flush':>6}"
        rows = [
            f"{s.name[:24]:24} {s.area_m2:7.2f} {s.segment[:14]:>14} {s.recall:7.3f} {s.precision:9.3f} {s.iou:6.3f} "
            f"{1000 * s.boundary_m:8.1f} {s.flush:6.2f}" + ("  glass or mirror" if s.clear else "")
            for s in [*self.surfaces, *self.clear]
        ]
        return [
            head,
            *rows,
            f"precision {self.precision:.3f}, recall {self.recall:.3f}, IoU {self.mean_iou:.3f}, found {self.found:.3f}, "
            f"right {self.right:.3f}; by area precision {self.area_precision:.3f}, recall {self.area_recall:.3f}",
            f"of the area missed {self.missed_flush:.2f} is of surfaces flush with another",
            f"glass and mirrors in segments of their own {self.clear_recall:.3f}",
            f"edges within {1000 * self.boundary_median_m:.0f} mm (median) and {1000 * self.boundary_p95_m:.0f} mm (95 %)",
        ]


@dataclass(frozen=True, eq=False)
class _Found:
    """A segmentation, as points on the scan and on the edges of segments.

    Attributes:
        points, normals: (N, 3) samples of the scan, one per SPACING_M^2, and their normals.
        label: (N,) segment of each sample, -1 for none.
        edges, edge_of: (E, 3) points on the edges of segments, and (E,) their segments.
        names: names of the segments.
    """

    points: np.ndarray
    normals: np.ndarray
    label: np.ndarray
    edges: np.ndarray
    edge_of: np.ndarray
    names: list[str]


def score_segments(mesh: trimesh.Trimesh, segments: Sequence[Segment], truth: Scene, sighted: Sighted | None = None) -> Score:
    """Score a segmented scan; the sides of one body count as one segment.

    Args:
        sighted: function that tells which true points the sensor saw (`experiments.scans.accuracy.sighted`); by default all points.
    Raises:
        SceneError: there is no truth to compare with.
    """
    numbers = [(1, s.body) if s.body >= 0 else (0, k) for k, s in enumerate(segments)]
    order = sorted(set(numbers), key=numbers.index)
    label = np.full(len(mesh.faces), -1)
    for segment, number in zip(segments, numbers, strict=True):
        label[segment.faces] = order.index(number)
    points, face = spread(mesh, SPACING_M)
    border = np.asarray(mesh.face_adjacency)
    ends = label[border[:, 0]] != label[border[:, 1]]
    edge = np.asarray(mesh.vertices)[np.asarray(mesh.face_adjacency_edges)[ends]].mean(axis=1)
    # An edge between two segments belongs to both.
    edges, of = np.vstack([edge, edge]), np.concatenate([label[border[ends, 0]], label[border[ends, 1]]])
    found = _Found(points, np.asarray(mesh.face_normals)[face], label[face], edges, of, [f"{k}" for k in range(len(order))])
    return _score(found, truth, sighted)


def score_scene(scene: Scene, truth: Scene, sighted: Sighted | None = None) -> Score:
    """Score a reconstructed scene. Its surfaces are the segments, with filled holes and completed areas.

    Args:
        sighted: function that tells which true points the sensor saw (`experiments.scans.accuracy.sighted`); by default all points.
    Raises:
        SceneError: there is no truth to compare with.
    """
    nowhere, nobody = np.zeros((0, 3)), np.zeros(0, int)
    points, normals, labels, ends, owner = [nowhere], [nowhere], [nobody], [nowhere], [nobody]
    for k, surface in enumerate(scene):
        at, face = spread(surface.mesh, SPACING_M)
        points.append(at)
        normals.append(np.asarray(surface.mesh.face_normals)[face])
        labels.append(np.full(len(at), k))
        ends.append(outline_points(surface.mesh))
        owner.append(np.full(len(ends[-1]), k))
    places, facing, label, edges, edge_of = (np.concatenate(x) for x in (points, normals, labels, ends, owner))
    return _score(_Found(places, facing, label, edges, edge_of, list(scene.names)), truth, sighted)


def _score(found: _Found, scene: Scene, sighted: Sighted | None) -> Score:
    if not len(scene):
        raise SceneError("there is no truth to score against; give the procedural room that was scanned")
    truth = Truth.of(scene, sighted)
    count, names = len(truth.scene), found.names
    # Area of each segment on each true piece, and seen area of each piece in each segment, m2.
    lies = _table(truth.owners()(found.points, found.normals), found.label, (count, len(names)))
    own = found.label >= 0
    tree = KDTree(found.points[own]) if own.any() else None
    at, facing = truth.points[truth.seen], truth.normals[truth.seen]
    held = np.full(len(at), -1) if tree is None else nearest(tree, found.label[own], found.normals[own], at, facing, strict=True)
    holds = _table(truth.piece[truth.seen], held, (count, len(names)))
    segment_area = np.bincount(found.label[own], minlength=len(names)) * SPACING_M**2
    seen = np.bincount(truth.piece[truth.seen], minlength=count) * SPACING_M**2
    mostly = np.where(lies.max(axis=0, initial=0) > 0, lies.argmax(axis=0), -1)
    area = np.where(truth.clear, [s.mesh.area for s in truth.scene], seen)
    flush = truth.flush()
    away = KDTree(truth.outlines).query(found.edges, workers=-1)[0] if len(found.edges) else np.zeros(0)

    see_through = lies[truth.clear].sum(axis=0) >= np.maximum(0.5 * segment_area, SPACING_M**2)
    rows = []
    for k in np.argsort(-area, kind="stable"):
        if area[k] < MIN_AREA_M2:
            continue
        within = np.where(mostly == k, (lies if truth.clear[k] else holds)[k], 0.0)
        best = int(within.argmax()) if within.max(initial=0) > 0 else -1
        name, clear, none = truth.scene.surfaces[k].name, bool(truth.clear[k]), float("nan")
        through = min(float(lies[k, see_through].sum() / area[k]), 1.0) if clear else none
        if best < 0:
            rows.append(SurfaceScore(name, float(area[k]), "-", 0.0, none, 0.0, none, clear, float(flush[k]), through))
            continue
        recall = min(float(within[best] / area[k]), 1.0)
        precision = min(float(lies[k, best] / segment_area[best]), 1.0)
        iou = min(float(lies[k, best] / (segment_area[best] + (1 - recall) * area[k])), 1.0)
        edge = away[found.edge_of == best]
        boundary = float(np.median(edge)) if edge.size else none
        rows.append(SurfaceScore(name, float(area[k]), names[best], recall, precision, iou, boundary, clear, float(flush[k]), through))
    solid, clear_rows = [r for r in rows if not r.clear], [r for r in rows if r.clear]
    large = np.flatnonzero(segment_area >= MIN_AREA_M2)
    pure = [lies[:, s].max() >= 0.5 * segment_area[s] and lies[mostly[s]].argmax() == s for s in large]
    scored = np.isin(found.edge_of, [names.index(r.segment) for r in solid if r.segment != "-"])
    areas, recalls = np.array([r.area_m2 for r in solid]), np.array([r.recall for r in solid])
    split = [r for r in solid if r.segment != "-"]
    missed = areas * (1 - recalls)
    return Score(
        precision=_mean([r.precision for r in split]),
        recall=_mean(recalls),
        area_precision=_mean([r.precision for r in split], [r.area_m2 for r in split]),
        area_recall=_mean(recalls, areas),
        mean_iou=_mean([r.iou for r in solid]),
        found=_mean([float(r.iou >= 0.5) for r in solid]),
        right=_mean([float(p) for p in pure]),
        boundary_median_m=float(np.median(away[scored])) if scored.any() else float("nan"),
        boundary_p95_m=float(np.quantile(away[scored], 0.95)) if scored.any() else float("nan"),
        clear_recall=_mean([r.through for r in clear_rows]),
        missed_flush=_mean([r.flush for r in solid], missed) if missed.sum() > 0 else 0.0,
        surfaces=solid,
        clear=clear_rows,
    )


def _table(row: np.ndarray, column: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Return the area (m2) of the samples for each pair of row and column; samples with index -1 are left out."""
    both = (row >= 0) & (column >= 0)
    return np.bincount(row[both] * shape[1] + column[both], minlength=shape[0] * shape[1]).reshape(shape) * SPACING_M**2


def _mean(values: Sequence[float] | np.ndarray, weights: Sequence[float] | np.ndarray | None = None) -> float:
    return float(np.average(values, weights=weights)) if len(values) else float("nan")
