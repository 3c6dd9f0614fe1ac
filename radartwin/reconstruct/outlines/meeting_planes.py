"""Trace the covered cells of a plane as polygons whose edges end exactly where the plane meets its neighbours.

The traced border of the cells is ragged and up to some cells wrong. Each stretch of the border therefore gets a line on which it ends:
- where a neighbouring plane touches this plane and the cells end within REACH_CELLS of the intersection line, the border ends on this line;
- a stretch along a straight border of the scanned faces, as models have, ends on this border;
- a stretch that is nearly parallel to a main direction of the plane ends on a line in this direction.
Two lines that meet within reach of their ends form a corner. A corner of three planes is thus the point that is common to the planes, and
the polygons of all three have the same vertex.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import trimesh
from scipy.ndimage import binary_dilation, median_filter
from shapely import Polygon, box, coverage_simplify, make_valid, unary_union
from shapely.affinity import affine_transform
from shapely.geometry.base import BaseGeometry
from shapely.geometry.polygon import orient
from skimage.measure import find_contours

from radartwin.reconstruct.segmentation.grid import Grid

REACH_CELLS = 4  # a border moves onto an intersection line if it is at most this number of cells away from the line
CORNER_CELLS = 6.0  # and its ends move to a corner with another line at most this number of cells away
SHALLOW = np.sin(np.radians(17.0))  # two planes, or two lines in a plane, form no corner at a smaller angle
SHORTEST_CELLS = 3  # shorter stretches keep their traced shape
SQUARE = np.cos(np.radians(12.0))  # an edge turns into a main direction if its angle to this direction is at most 12 degrees
STRAIGHT_CELLS = 0.2  # largest standard deviation from a line, in cells, of a border of faces that counts as straight, as in a model
STRAIGHT_M = 0.1  # shorter edges away from other planes keep their traced shape
SMALLEST_M2 = 0.004
WELD_M = 1e-4  # polygon vertices nearer than this are equal except for rounding errors of the polygon operations
RAGGED = 0.1  # largest area in which the cells and the fitted rectangle differ, relative to the area of the rectangle


class Cut(NamedTuple):
    """The intersection line of a plane with a neighbouring plane, in in-plane coordinates: a point (2,) and a unit direction (2,).

    `places` (N, 2) are the places in metres at which the two surfaces touch; None if the neighbour bounds the whole plane.
    """

    point: np.ndarray
    along: np.ndarray
    places: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class _Stretch:
    """A stretch of the border on a line: points point + t along with start < t < stop, and the polygon on the left.

    `short` and `over` are the largest lengths in metres by which the traced border ends before the line and beyond it.
    """

    point: np.ndarray
    along: np.ndarray
    start: float
    stop: float
    short: float
    over: float

    @property
    def left(self) -> np.ndarray:
        return np.array([-self.along[1], self.along[0]])

    def at(self, t: float) -> np.ndarray:
        return self.point + t * self.along


def polygon(grid: Grid, mask: np.ndarray, cuts: Sequence[Cut], border: np.ndarray, edge: float = -0.5) -> BaseGeometry:
    """Trace the cells of a boolean mask as polygons with holes, in in-plane coordinates in metres.

    Args:
        mask: boolean mask of the covered cells.
        cuts: intersection lines with neighbouring planes.
        border: (N, 2) points on the border of the scanned faces.
        edge: number of cells by which the polygon extends beyond the mask. A partly covered cell counts as covered. The border of
            a scanned part therefore lies half a cell inside the mask (-0.5), and the border of an unscanned part half a cell outside (0.5).
    """
    shape = _traced(grid, mask).buffer(edge * grid.cell_m, join_style="mitre").simplify(1.2 * grid.cell_m)
    pieces = [orient(p) for p in getattr(shape, "geoms", [shape]) if p.area >= SMALLEST_M2]
    pieces = [Polygon(p.exterior, [r for r in p.interiors if Polygon(r).area >= SMALLEST_M2]) for p in pieces]
    stretches = [stretch for cut in cuts for stretch in _on_cut(grid, mask, cut)]
    stretches = _nearest_only(stretches, grid)
    for piece in pieces:
        for ring in (piece.exterior, *piece.interiors):
            free = (_free(a, b, stretches, border, grid) for a, b in itertools.pairwise(np.array(ring.coords)))
            stretches += [stretch for stretch in free if stretch is not None]
    out = unary_union(pieces)
    cornered = [_cornered(stretch, stretches, grid) for stretch in stretches]
    out = out.difference(unary_union([beyond for beyond, _ in cornered])).union(unary_union([inside for _, inside in cornered]))
    c = grid.cell_m
    out = out.buffer(0.1 * c, join_style="mitre").buffer(-0.1 * c, join_style="mitre")  # without the slits between the parts
    return coverage_simplify(out, 0.02 * c).simplify(0.3 * c)  # first without the points on straight edges


def rectangle(grid: Grid, mask: np.ndarray) -> BaseGeometry | None:
    """Return a rectangle along the grid axes if the marked cells form nearly a rectangle, as on a door or poster; otherwise None.

    Each side of the rectangle lies at the median end of the rows or columns of marked cells. The number of cells in which the marked cells
    and the rectangle differ must not exceed the circumference of the rectangle in cells, nor the fraction RAGGED of its area in cells.
    """
    sides = []
    for cells in (mask.T, mask):
        cells = cells[cells.any(axis=1)]
        if not len(cells):
            return None
        last = cells.shape[1] - cells[:, ::-1].argmax(axis=1)
        sides.append((float(np.median(cells.argmax(axis=1))), float(np.median(last))))
    (x0, x1), (y0, y1) = sides
    frame = np.zeros_like(mask)
    frame[round(x0) : round(x1), round(y0) : round(y1)] = True
    if (mask ^ frame).sum() > min(2 * (x1 - x0 + y1 - y0), RAGGED * frame.sum()):
        return None
    low, high = grid.low + grid.cell_m * np.array([x0, y0]), grid.low + grid.cell_m * np.array([x1, y1])
    return box(*low, *high)


def triangulated(grid: Grid, shape: BaseGeometry) -> trimesh.Trimesh | None:
    """Triangulate a polygon on the plane of `grid`, with faces along the plane's normal; None if the polygon is empty."""
    polygons = [p for p in getattr(shape, "geoms", [shape]) if p.geom_type == "Polygon" and p.area >= SMALLEST_M2]
    if not polygons:
        return None
    pieces = [trimesh.creation.triangulate_polygon(piece, engine="earcut") for piece in polygons]
    points, index = trimesh.util.append_faces([grid.to_space(corners) for corners, _ in pieces], [faces for _, faces in pieces])
    points, same = np.unique(points, axis=0, return_inverse=True)  # earcut repeats the first corner of a ring
    return trimesh.Trimesh(points, same.reshape(-1)[index], vertex_normals=np.tile(grid.normal, (len(points), 1)), process=False)


def meeting_line(grid: Grid, normal: np.ndarray, offset: float, places: np.ndarray | None = None) -> Cut | None:
    """Return the intersection line of the grid's plane with a second plane; None if the planes are nearly parallel.

    `places` (N, 3) are the places at which the two surfaces touch; None if the second plane bounds the whole plane.
    """
    inside = grid.axes @ normal
    length = float(np.linalg.norm(inside))
    if length < SHALLOW:
        return None
    # A point of the grid's plane is x = u axes + offset_m normal, so inside . u = offset - offset_m normal . other.
    point = inside * (offset - grid.offset_m * float(grid.normal @ normal)) / length**2
    return Cut(point, np.array([-inside[1], inside[0]]) / length, None if places is None else places @ grid.axes.T)


def _traced(grid: Grid, mask: np.ndarray) -> BaseGeometry:
    """Return the border of the marked cells as valid polygons."""
    shape = Polygon()
    rings = [Polygon(ring) for ring in find_contours(np.pad(mask, 1).astype(float), 0.5) if len(ring) >= 4]
    for ring in sorted(rings, key=lambda r: -r.area):  # a ring inside another ring is a hole
        shape = shape.symmetric_difference(ring if ring.is_valid else make_valid(ring))
    c = grid.cell_m
    return affine_transform(shape, [c, 0, 0, c, grid.low[0] - c / 2, grid.low[1] - c / 2])


def _on_cut(grid: Grid, mask: np.ndarray, cut: Cut) -> list[_Stretch]:
    """Return the stretches of a line on which the cells of a mask end: they cover one side of it, and the other side at most in part."""
    c, n = grid.cell_m, REACH_CELLS
    across = np.array([-cut.along[1], cut.along[0]])
    frame = grid.low + c * np.array([[0, 0], [0, 1], [1, 0], [1, 1]]) * grid.shape
    reach = (frame - cut.point) @ cut.along
    t = np.arange(reach.min(), reach.max(), c)
    s = (np.arange(-n, n) + 0.5) * c
    cell = np.floor((cut.point + t[:, None, None] * cut.along + s[:, None] * across - grid.low) / c).astype(int)
    inside = np.all((cell >= 0) & (cell < np.array(grid.shape)), axis=2)
    cell = np.where(inside[..., None], cell, 0)
    covered = mask[cell[..., 0], cell[..., 1]] & inside
    sides = covered[:, n:], covered[:, n - 1 :: -1]  # to the left and to the right of the line, from the line outwards
    depth = [side.cumprod(axis=1).sum(axis=1) for side in sides]
    gap = [np.where(side.any(axis=1), side.argmax(axis=1), n) for side in sides]
    here, there = depth
    sign = np.zeros(len(t), dtype=int)
    sign[(here > 0) & (there < n) & ((here == n) | (here >= 2 * there))] = 1
    sign[(there > 0) & (here < n) & ((there == n) | (there >= 2 * here))] = -1
    apart = (here == 0) & (there == 0)
    sign[apart] = np.sign(gap[1] - gap[0])[apart]
    if cut.places is not None:
        near = cut.places[np.abs((cut.places - cut.point) @ across) < n * c]
        touched = np.bincount(np.clip(((near - cut.point) @ cut.along - t[0]) / c, 0, len(t) - 1).astype(int), minlength=len(t)) > 0
        sign[np.logical_not(binary_dilation(touched, iterations=n))] = 0
    sign = median_filter(sign, 5, mode="constant")
    out = []
    for a, b in itertools.pairwise([*np.flatnonzero(np.diff(sign, prepend=0)), len(t)]):
        if sign[a] == 0 or b - a < SHORTEST_CELLS:
            continue
        inner = 0 if sign[a] > 0 else 1
        short, over = float(gap[inner][a:b].max()), float(np.where(depth[1 - inner] < n, depth[1 - inner], 0)[a:b].max())
        start, stop = (t[a], t[b - 1] + c) if inner == 0 else (-t[b - 1] - c, -t[a])
        out.append(_Stretch(cut.point, sign[a] * cut.along, start, stop, short * c, over * c))
    return out


def _nearest_only(stretches: list[_Stretch], grid: Grid) -> list[_Stretch]:
    """Shorten each stretch where another stretch of nearly the same direction and within reach fits the border better."""
    out: list[_Stretch] = []
    for stretch in sorted(stretches, key=lambda s: max(s.short, s.over)):
        start, stop = stretch.start, stretch.stop
        for other in out:
            away = abs((other.at(other.start) - stretch.point) @ stretch.left)
            if stretch.along @ other.along < SQUARE or away > REACH_CELLS * grid.cell_m:
                continue
            a, b = sorted((other.at(t) - stretch.point) @ stretch.along for t in (other.start, other.stop))
            if a <= start:
                start = max(start, b)
            else:
                stop = min(stop, a) if b >= stop or a - start >= stop - b else stop
        if stop - start >= SHORTEST_CELLS * grid.cell_m:
            out.append(replace(stretch, start=start, stop=stop))
    return out


def _free(a: np.ndarray, b: np.ndarray, ended: Sequence[_Stretch], border: np.ndarray, grid: Grid) -> _Stretch | None:
    """Return the stretch for the polygon edge from `a` to `b`; None if the edge is short, ends on another plane or keeps its shape."""
    c, length = grid.cell_m, float(np.linalg.norm(b - a))
    if length < max(STRAIGHT_M, SHORTEST_CELLS * c):
        return None
    along, middle = (b - a) / length, (a + b) / 2
    across = np.array([-along[1], along[0]])
    for other in ended:
        at = (middle - other.point) @ other.along
        beside = abs((middle - other.point) @ other.left) < REACH_CELLS * c
        if abs(along @ other.along) > SQUARE and beside and other.start < at < other.stop:
            return None
    t, off = (border - middle) @ along, (border - middle) @ across
    near = (np.abs(t) < length / 2) & (np.abs(off) < 2 * c)
    if near.sum() > 2 and np.ptp(t[near]) > length / 2:
        slope, shift = np.polyfit(t[near], off[near], 1)
        if np.std(off[near] - slope * t[near] - shift) < STRAIGHT_CELLS * c:
            fitted = (along + slope * across) / np.hypot(1, slope)
            return _Stretch(middle + shift * across, fitted, -length / 2, length / 2, 1.2 * c, 1.2 * c)
    for axis in (*np.eye(2), *-np.eye(2)):
        if along @ axis > SQUARE:
            return _Stretch(middle, axis, -length / 2, length / 2, 1.2 * c, 1.2 * c)
    return None


def _cornered(stretch: _Stretch, others: Sequence[_Stretch], grid: Grid) -> tuple[BaseGeometry, BaseGeometry]:
    """Let a stretch end at its corners with other stretches. Return the parts beyond the line, to be cut off, and inside, to be filled."""
    reach = CORNER_CELLS * grid.cell_m
    off = (1.2 + 0.5) * grid.cell_m  # largest distance of the traced polygon from the border of the cells
    over, short = stretch.over + off, stretch.short + off
    beyond, inside = [], []
    for t, outwards in ((stretch.start, -1), (stretch.stop, 1)):
        corner, into, extended, deepest = t, stretch.left, 0.0, np.inf
        nearest = reach
        for other in others:
            sine = _cross(stretch.along, other.along)
            if abs(sine) < SHALLOW:
                continue
            at = _cross(other.point - stretch.point, other.along) / sine
            along_other = (stretch.at(at) - other.point) @ other.along
            away, near = abs((at - t) * sine), reach / abs(sine)  # lines of a shallow corner are near each other over a longer distance
            if away < nearest and other.start - near < along_other < other.stop + near:
                nearest, corner = away, at
                into = other.along / (other.along @ stretch.left)  # along the other line to a depth of one metre inside
                convex = (stretch.at((stretch.start + stretch.stop) / 2) - other.point) @ other.left > 0
                extended = reach if convex else 0.0
                deepest = (other.stop - other.start) * abs(sine)
        short = max(short, min(abs(corner - t), reach) + off) if corner != t else short
        beyond.append(corner + outwards * extended)
        inside.append((corner, into, deepest))
    if inside[0][0] >= inside[1][0]:
        return Polygon(), Polygon()
    cut = [stretch.at(t) for t in beyond] + [stretch.at(t) - over * stretch.left for t in beyond[::-1]]
    fill = [stretch.at(t) for t, *_ in inside] + [stretch.at(t) + min(short, deepest) * into for t, into, deepest in inside[::-1]]
    return Polygon(cut).buffer(0), Polygon(fill).buffer(0)


def _cross(first: np.ndarray, second: np.ndarray) -> float:
    return float(first[0] * second[1] - first[1] * second[0])
