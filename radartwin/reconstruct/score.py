"""How good a segmentation is, against a room whose truth is known.

Points spread evenly over the scan belong to the true surface nearest to them whose normal agrees, and to the segment they lie on;
what the scan did not see is nobody's. A true surface in pieces that lie apart, like the legs of a table, is scored piece by piece.
A true surface's segment is the one that holds most of it. Recall is the share of the surface in its segment, precision the share
of the segment on the surface, IoU their intersection over union. Boundary error is the distance from where segments end to the
nearest edge of a true surface. Glass and mirrors, which depth sensors miss, are scored apart and over their true area, seen or not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import scipy.sparse as sp
import trimesh
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from radartwin.errors import SceneError
from radartwin.reconstruct.distance import covered, spread
from radartwin.reconstruct.segment import Segment
from radartwin.scene.scene import Scene, Surface

SPACING_M = 0.04  # of the points on scan and truth
REACH_M = 0.12  # a point farther from every true surface belongs to none
AGREEING = 0.7  # cosine of normals that agree: the floor is not the underside of what stands on it
APART_M = 0.05  # parts of a true surface with a wider gap are surfaces of their own
MIN_AREA_M2 = 0.25
CLEAR = ("glass", "mirror")  # MINC categories that depth sensors see through
SHARP = np.radians(30.0)


@dataclass(frozen=True)
class SurfaceScore:
    """One true surface: area that was seen (all of it for glass), and its segment. `boundary_m` is the median along the segment's edge."""

    name: str
    area_m2: float
    segment: str
    recall: float
    precision: float
    iou: float
    boundary_m: float
    clear: bool


@dataclass(frozen=True)
class Score:
    """Means over the true surfaces of at least MIN_AREA_M2, glass and mirrors apart.

    Attributes:
        found: share of those surfaces with IoU of at least one half.
        right: share of the segments of that size that are the best of some surface of any size with at least half of their area on it.
        boundary_median_m, boundary_p95_m: of all segments that hold a scored surface.
        clear_recall: of glass and mirrors, in segments of which at least half is glass or mirror: a window walled up is not found.
        surfaces: every surface of that size, largest first; clear: glass and mirrors.
    """

    precision: float
    recall: float
    mean_iou: float
    found: float
    right: float
    boundary_median_m: float
    boundary_p95_m: float
    clear_recall: float
    surfaces: list[SurfaceScore] = field(repr=False)
    clear: list[SurfaceScore] = field(repr=False)

    def lines(self) -> list[str]:
        """The table for people, one surface a line, and the means."""
        head = f"{'surface':24} {'m2':>7} {'segment':>14} {'recall':>7} {'precision':>9} {'IoU':>6} {'edge mm':>8}"
        rows = [
            f"{s.name[:24]:24} {s.area_m2:7.2f} {s.segment[:14]:>14} {s.recall:7.3f} {s.precision:9.3f} {s.iou:6.3f} "
            f"{1000 * s.boundary_m:8.1f}" + ("  glass or mirror" if s.clear else "")
            for s in [*self.surfaces, *self.clear]
        ]
        return [
            head,
            *rows,
            f"precision {self.precision:.3f}, recall {self.recall:.3f}, IoU {self.mean_iou:.3f}, found {self.found:.3f}, "
            f"right {self.right:.3f}",
            f"glass and mirrors in segments of their own {self.clear_recall:.3f}",
            f"edges within {1000 * self.boundary_median_m:.0f} mm (median) and {1000 * self.boundary_p95_m:.0f} mm (95 %)",
        ]


def score_segments(mesh: trimesh.Trimesh, segments: Sequence[Segment], truth: Scene) -> Score:
    """Score of a segmented scan; sides of one body count as one segment.

    Raises:
        SceneError: no truth to compare with.
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
    # An edge between two segments is the end of both.
    edges = (np.vstack([edge, edge]), np.concatenate([label[border[ends, 0]], label[border[ends, 1]]]))
    return _score((points, np.asarray(mesh.face_normals)[face], label[face]), edges, [f"{k}" for k in range(len(order))], truth)


def score_scene(scene: Scene, truth: Scene) -> Score:
    """Score of a reconstructed scene: its surfaces are the segments, filled and completed areas included.

    Raises:
        SceneError: no truth to compare with.
    """
    points, normals, labels, ends, owner = [], [], [], [], []
    for k, surface in enumerate(scene):
        at, face = spread(surface.mesh, SPACING_M)
        points.append(at)
        normals.append(np.asarray(surface.mesh.face_normals)[face])
        labels.append(np.full(len(at), k))
        ends.append(outline_points(surface.mesh))
        owner.append(np.full(len(ends[-1]), k))
    samples = tuple(np.concatenate(x) for x in (points, normals, labels))
    return _score(samples, (np.concatenate(ends), np.concatenate(owner)), list(scene.names), truth)


def _score(samples, edges: tuple[np.ndarray, np.ndarray], names: list[str], truth: Scene) -> Score:
    """From points, one for each SPACING_M^2: (N, 3) places, (N, 3) normals, (N,) segments; edges: (E, 3) places, (E,) segments."""
    if not len(truth):
        raise SceneError("there is no truth to score against; give the procedural room that was scanned")
    points, normals, label = samples
    truth = Scene(piece for surface in truth for piece in pieces(surface))
    clear = np.array([s.provenance.get("minc") in CLEAR for s in truth])
    tree, of_sample, true_normals = _truth_points(truth)
    unit = _nearest(tree, of_sample, true_normals, points, normals)
    both = (label >= 0) & (unit >= 0)
    count = np.bincount(unit[both] * len(names) + label[both], minlength=len(truth) * len(names))
    table = count.reshape(len(truth), len(names)) * SPACING_M**2
    segment_area = np.bincount(label[label >= 0], minlength=len(names)) * SPACING_M**2
    seen = np.bincount(unit[unit >= 0], minlength=len(truth)) * SPACING_M**2
    area = np.where(clear, [s.mesh.area for s in truth], seen)

    away = KDTree(np.concatenate([outline_points(s.mesh) for s in truth])).query(edges[0], workers=-1)[0] if len(edges[0]) else np.zeros(0)
    rows = []
    for k in np.argsort(-area, kind="stable"):
        if area[k] < MIN_AREA_M2:
            continue
        best = int(table[k].argmax())
        shared = float(table[k, best])
        mine = away[edges[1] == best]
        rows.append(
            SurfaceScore(
                truth.surfaces[k].name,
                float(area[k]),
                names[best] if shared > 0 else "-",
                min(shared / float(area[k]), 1.0),
                shared / segment_area[best] if shared > 0 else 0.0,
                shared / max(area[k] + segment_area[best] - shared, 1e-12) if shared > 0 else 0.0,
                float(np.median(mine)) if mine.size and shared > 0 else float("nan"),
                bool(clear[k]),
            )
        )
    solid = [r for r in rows if not r.clear]
    large = np.flatnonzero(segment_area >= MIN_AREA_M2)
    pure = [table[:, s].max() >= 0.5 * segment_area[s] and table[table[:, s].argmax()].argmax() == s for s in large]
    scored = np.isin(edges[1], [names.index(r.segment) for r in solid if r.segment in names])

    see_through = table[clear].sum(axis=0) >= np.maximum(0.5 * segment_area, SPACING_M**2)
    through = [min(float(table[k, see_through].sum() / area[k]), 1.0) for k in np.flatnonzero(clear & (area >= MIN_AREA_M2))]

    def mean(values: list[float]) -> float:
        return float(np.mean(values)) if values else float("nan")

    return Score(
        mean([r.precision for r in solid]),
        mean([r.recall for r in solid]),
        mean([r.iou for r in solid]),
        mean([float(r.iou >= 0.5) for r in solid]),
        mean([float(p) for p in pure]),
        float(np.median(away[scored])) if scored.any() else float("nan"),
        float(np.quantile(away[scored], 0.95)) if scored.any() else float("nan"),
        mean(through),
        solid,
        [r for r in rows if r.clear],
    )


def pieces(surface: Surface) -> list[Surface]:
    """The parts of a surface that lie more than APART_M from one another, largest first."""
    mesh = surface.mesh.copy()
    mesh.merge_vertices(merge_tex=True, merge_norm=True, digits_vertex=6)
    points, face = covered(np.asarray(mesh.triangles, dtype=float), APART_M / 2)
    pairs = KDTree(points).query_pairs(APART_M, output_type="ndarray")
    links = np.vstack([face[pairs], np.asarray(mesh.face_adjacency).reshape(-1, 2)])
    count, part = connected_components(sp.coo_matrix((np.ones(len(links)), links.T), shape=(len(mesh.faces),) * 2), directed=False)
    if count == 1:
        return [surface]
    area = np.bincount(part, mesh.area_faces, count)
    out = []
    for number, k in enumerate(np.argsort(-area, kind="stable"), 1):
        piece = trimesh.Trimesh(mesh.vertices, np.asarray(mesh.faces)[part == k], process=False)
        out.append(surface.replaced(mesh=piece, name=f"{surface.name}.{number}"))
    return out


def _truth_points(truth: Scene):
    samples = [covered(np.asarray(s.mesh.triangles, dtype=float), SPACING_M) for s in truth]
    unit = np.repeat(np.arange(len(truth)), [len(p) for p, _ in samples])
    normals = np.concatenate([np.asarray(s.mesh.face_normals)[face] for s, (_, face) in zip(truth, samples, strict=True)])
    return KDTree(np.concatenate([p for p, _ in samples]), balanced_tree=False), unit, normals


def _nearest(tree: KDTree, unit: np.ndarray, true_normals: np.ndarray, points: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """True surface (N,) of each point, -1 for none: the nearest whose normal agrees, or else the nearest."""
    distance, near = tree.query(points, k=10, distance_upper_bound=REACH_M, workers=-1)
    known = np.isfinite(distance)
    index = np.where(known, near, 0)
    agrees = np.einsum("nki,ni->nk", true_normals[index], normals) > AGREEING
    rank = np.where(known, distance + np.where(agrees, 0.0, 0.05), np.inf)
    best = rank.argmin(axis=1)
    rows = np.arange(len(points))
    return np.where(known[rows, best], unit[index[rows, best]], -1)


def outline_points(mesh: trimesh.Trimesh, spacing_m: float = SPACING_M / 2) -> np.ndarray:
    """Points (N, 3) along the edges of a mesh that end it or are sharp."""
    vertices, index = np.unique(np.round(np.asarray(mesh.vertices), 6), axis=0, return_inverse=True)
    welded = trimesh.Trimesh(vertices, index.reshape(-1)[np.asarray(mesh.faces)], process=False)
    pairs, count = np.unique(welded.edges_sorted, axis=0, return_counts=True)
    angles = np.asarray(welded.face_adjacency_angles)
    sharp = np.asarray(welded.face_adjacency_edges).reshape(-1, 2)[angles > SHARP]
    ends = vertices[np.vstack([pairs[count == 1], sharp])]
    steps = np.maximum(np.ceil(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / spacing_m).astype(int), 1)
    share = np.concatenate([(np.arange(n) + 0.5) / n for n in steps]) if len(steps) else np.zeros(0)
    start, stop = np.repeat(ends[:, 0], steps, axis=0), np.repeat(ends[:, 1], steps, axis=0)
    return start + share[:, None] * (stop - start)
