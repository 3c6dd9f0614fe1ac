"""Compare the segments of a reconstructed scan with the true surfaces of the room, piece by piece if a surface has separate pieces.

The segment of a true surface covers most of it, among all segments that lie mostly on it. Recall is the share of the seen true surface in
its segment (0 without one), precision the share of the segment on the surface, and IoU the area on it over the area of the segment plus the
seen area that it misses. Area that the sensor did not see lowers the precision only if it lies off the surface. The boundary error is the
distance from edges of segments to the nearest true edge. Glass and mirrors are scored separately over their whole area.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import KDTree

from experiments.scans.true_surfaces import SPACING_M, Sighted, Truth, nearest, outline_points, samples
from radartwin.errors import SceneError
from radartwin.scene.scene import Scene

MIN_AREA_M2 = 0.25


@dataclass(frozen=True)
class SurfaceScore:
    """Scores of one true surface."""

    name: str
    area_m2: float  # area seen by the sensor; for glass and mirrors the whole area
    segment: str  # name of the segment, or "-" without one; the precision is then NaN
    recall: float
    precision: float
    iou: float
    flush: float  # share of the seen area at most FLUSH_M above another surface, so that the depth noise hides the step
    through: float  # share of area in segments that are at least half glass or mirror; NaN for other surfaces


@dataclass(frozen=True)
class Score:
    """Scores of all true surfaces whose area is at least MIN_AREA_M2."""

    surfaces: list[SurfaceScore]  # all surfaces except glass and mirrors; the largest comes first
    clear: list[SurfaceScore]  # all surfaces of glass and mirrors
    boundary_median_m: float  # boundary error over the segments of `surfaces`
    boundary_p95_m: float  # 95 % quantile of the same error
    missed_flush: float  # of the seen area of `surfaces` that their segments miss, the share on surfaces flush with another surface


def score_scene(scene: Scene, truth: Scene, sighted: Sighted | None = None) -> Score:
    """Score a reconstructed scene, whose surfaces are the segments, with holes filled and unseen areas completed. `sighted` decides which
    true points the sensor saw; None counts all. Raises SceneError if the true scene has no surface to compare with.
    """
    if not len(truth):
        raise SceneError("there is no truth to score against; give the procedural room that was scanned")
    true, names = Truth.of(truth, sighted), scene.names
    points, normals, label = samples(scene)
    shape = (len(true.scene), len(names))
    # Area of each segment on each true piece, and seen area of each piece in each segment, m2.
    lies = _table(true.owners()(points, normals), label, shape)
    at, facing = true.points[true.seen], true.normals[true.seen]
    held = nearest(KDTree(points), label, normals, at, facing, strict=True) if len(points) else np.full(len(at), -1)
    holds = _table(true.piece[true.seen], held, shape)
    segment_area = np.bincount(label, minlength=len(names)) * SPACING_M**2
    seen = np.bincount(true.piece[true.seen], minlength=len(true.scene)) * SPACING_M**2
    mostly = np.where(lies.max(axis=0, initial=0) > 0, lies.argmax(axis=0), -1)
    area = np.where(true.clear, [s.mesh.area for s in true.scene], seen)
    flush = true.flush()
    see_through = lies[true.clear].sum(axis=0) >= np.maximum(0.5 * segment_area, SPACING_M**2)

    solid, clear, segments = [], [], []
    for k in np.argsort(-area, kind="stable"):
        if area[k] < MIN_AREA_M2:
            continue
        within = np.where(mostly == k, (lies if true.clear[k] else holds)[k], 0.0)
        best = int(within.argmax()) if within.max(initial=0) > 0 else -1
        segment, recall, precision, iou = "-", 0.0, float("nan"), 0.0
        if best >= 0:
            segment, recall = names[best], min(float(within[best] / area[k]), 1.0)
            precision = min(float(lies[k, best] / segment_area[best]), 1.0)
            iou = min(float(lies[k, best] / (segment_area[best] + (1 - recall) * area[k])), 1.0)
        through = min(float(lies[k, see_through].sum() / area[k]), 1.0) if true.clear[k] else float("nan")
        row = SurfaceScore(true.scene.names[k], float(area[k]), segment, recall, precision, iou, float(flush[k]), through)
        if true.clear[k]:
            clear.append(row)
        else:
            solid.append(row)
            segments.append(best)
    missed = np.array([r.area_m2 * (1 - r.recall) for r in solid])
    flush_share = float(np.average([r.flush for r in solid], weights=missed)) if missed.sum() > 0 else 0.0
    edges = np.concatenate([np.zeros((0, 3)), *(outline_points(scene.surfaces[k].mesh) for k in set(segments) if k >= 0)])
    away = KDTree(true.outlines).query(edges, workers=-1)[0] if len(edges) else np.array([np.nan])
    return Score(solid, clear, float(np.median(away)), float(np.quantile(away, 0.95)), flush_share)


def _table(row: np.ndarray, column: np.ndarray, shape: tuple[int, int]) -> np.ndarray:
    """Return the area (m2) of the samples for each pair of indices (row, column). Samples with an index of -1 are left out."""
    both = (row >= 0) & (column >= 0)
    return np.bincount(row[both] * shape[1] + column[both], minlength=shape[0] * shape[1]).reshape(shape) * SPACING_M**2
