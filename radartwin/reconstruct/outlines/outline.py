"""Trace the covered cells of a plane as simplified polygons with straight edges and right angles.

A polygon edge near the intersection line with a neighbouring plane moves onto that line, so that rooms close at their corners. Each
remaining edge turns into a main direction of the plane if the edge is nearly parallel to this direction. If these steps would change a
polygon by more than the resolution of the scan, the polygon is only simplified.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import trimesh
from shapely import Polygon, box, make_valid, unary_union
from shapely.affinity import affine_transform
from shapely.geometry.base import BaseGeometry
from skimage.measure import find_contours

from radartwin.reconstruct.outlines.grid import Grid

SNAP_CELLS = 4.0  # an edge moves onto an intersection line if it is at most this number of cells away from the line
ALONG = np.cos(np.radians(15.0))  # and if the angle between the edge and the intersection line is at most 15 degrees
SQUARE = np.cos(np.radians(12.0))  # an edge turns into a main direction if its angle to this direction is at most 12 degrees
SQUARE_M = 0.1  # shorter edges keep their direction
SMALLEST_M2 = 0.004
RAGGED = 0.1  # largest area in which the cells and the fitted rectangle differ, relative to the area of the rectangle

Line = tuple[np.ndarray, np.ndarray]  # a point (2,) and a unit direction (2,)
_Edge = tuple[np.ndarray, np.ndarray, Line | None]  # the ends of an edge, and the line that it moves onto


def polygon(grid: Grid, mask: np.ndarray, lines: Sequence[Line] = (), edge: float = -0.5) -> BaseGeometry:
    """Trace the cells of a boolean mask as polygons with holes, in in-plane coordinates in metres.

    Args:
        mask: boolean mask of the covered cells.
        lines: intersection lines with neighbouring planes, in in-plane coordinates.
        edge: number of cells by which the polygon extends beyond the mask. A partly covered cell counts as covered. The border of
            a scanned part therefore lies half a cell inside the mask (-0.5), and the border of an unscanned part half a cell outside (0.5).
    """
    raw = _traced(grid, mask).buffer(edge * grid.cell_m, join_style="mitre").simplify(1.2 * grid.cell_m)
    pieces = []
    for piece in getattr(raw, "geoms", [raw]):
        if piece.is_empty or piece.area < SMALLEST_M2:
            continue
        shell = _regular(np.array(piece.exterior.coords)[:-1], grid, lines)
        holes = [_regular(np.array(r.coords)[:-1], grid, lines) for r in piece.interiors if Polygon(r).area >= SMALLEST_M2]
        tidy = Polygon(shell, [h for h in holes if len(h) >= 3]) if len(shell) >= 3 else piece
        tidy = tidy if tidy.is_valid else tidy.buffer(0)
        moved = tidy.symmetric_difference(piece).area
        pieces.append(tidy if moved < 0.1 * piece.area + SNAP_CELLS * grid.cell_m * piece.length / 2 else piece.simplify(grid.cell_m))
    return unary_union(pieces) if pieces else Polygon()


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
    a, b, c = points[index].transpose(1, 0, 2)
    turned = np.cross(b - a, c - a) @ grid.normal < 0
    index[turned] = index[turned][:, ::-1]
    return trimesh.Trimesh(points, index, vertex_normals=np.tile(grid.normal, (len(points), 1)), process=False)


def meeting_line(grid: Grid, normal: np.ndarray, offset: float) -> Line | None:
    """Return the intersection line of the grid's plane with a second plane, in in-plane coordinates; None if the planes are nearly
    parallel.
    """
    inside = grid.axes @ normal
    length = float(np.linalg.norm(inside))
    if length < 0.5:
        return None
    # A point of the grid's plane is x = u axes + offset_m normal, so inside . u = offset - offset_m normal . other.
    point = inside * (offset - grid.offset_m * float(grid.normal @ normal)) / length**2
    return point, np.array([-inside[1], inside[0]]) / length


def _traced(grid: Grid, mask: np.ndarray) -> BaseGeometry:
    """Return the border of the marked cells as valid polygons."""
    shape = Polygon()
    rings = [Polygon(ring) for ring in find_contours(np.pad(mask, 1).astype(float), 0.5) if len(ring) >= 4]
    for ring in sorted(rings, key=lambda r: -r.area):  # a ring inside another ring is a hole
        shape = shape.symmetric_difference(ring if ring.is_valid else make_valid(ring))
    c = grid.cell_m
    return affine_transform(shape, [c, 0, 0, c, grid.low[0] - c / 2, grid.low[1] - c / 2])


def _regular(ring: np.ndarray, grid: Grid, lines: Sequence[Line]) -> np.ndarray:
    """Move the edges of a closed polygon ring (n, 2) onto intersection lines, or turn the edges into main directions of the plane."""
    fixed = [_fixed(a, b, grid, lines) for a, b in zip(ring, np.roll(ring, -1, axis=0), strict=True)]
    edges: list[_Edge] = []
    for a, b, line in zip(ring, np.roll(ring, -1, axis=0), fixed, strict=True):
        if edges and line is not None and edges[-1][2] is not None and _same(edges[-1][2], line, grid.cell_m):
            first = edges[-1]
            longer = first[2] if np.linalg.norm(first[1] - first[0]) >= np.linalg.norm(b - a) else line
            edges[-1] = (first[0], b, longer)
        else:
            edges.append((a, b, line))
    if len(edges) > 1 and edges[0][2] is not None and edges[-1][2] is not None and _same(edges[0][2], edges[-1][2], grid.cell_m):
        edges[0] = (edges[-1][0], edges[0][1], edges[0][2])
        edges.pop()
    edges = _pointed(edges, 6 * grid.cell_m)
    corners: list[np.ndarray] = []
    for (_, at, before), (_, _, after) in zip(edges, edges[1:] + edges[:1], strict=True):
        corners += _corner(at, before, after, 6 * grid.cell_m)
    return np.array(corners).reshape(-1, 2)


def _pointed(edges: list[_Edge], reach: float) -> list[_Edge]:
    """Remove short edges that cut off a corner between two straight edges; the tracing of square cells causes such edges."""
    out = []
    for k, (a, b, line) in enumerate(edges):
        before, after = edges[k - 1][2], edges[(k + 1) % len(edges)][2]
        if line is None and before is not None and after is not None and abs(_cross(before, after)) > 0.3:
            meet = _meeting(before, after)
            if max(np.linalg.norm(meet - a), np.linalg.norm(meet - b)) < reach:
                continue
        out.append((a, b, line))
    return out


def _cross(first: Line, second: Line) -> float:
    return float(first[1][0] * second[1][1] - first[1][1] * second[1][0])


def _meeting(first: Line, second: Line) -> np.ndarray:
    """Return the intersection point (2,) of two lines that are not parallel."""
    step = second[0] - first[0]
    return first[0] + (step[0] * second[1][1] - step[1] * second[1][0]) / _cross(first, second) * first[1]


def _fixed(a: np.ndarray, b: np.ndarray, grid: Grid, lines: Sequence[Line]) -> Line | None:
    """Return the line onto which the polygon edge from `a` to `b` moves, or None if the edge stays."""
    step = b - a
    length = float(np.linalg.norm(step))
    if length < 1e-9:
        return None
    best, nearest = None, SNAP_CELLS * grid.cell_m
    for point, along in lines:
        across = np.array([-along[1], along[0]])
        off = max(abs((a - point) @ across), abs((b - point) @ across))
        if off < nearest and (abs(step @ along) > ALONG * length or length < 3 * grid.cell_m):
            best, nearest = (point, along), off
    if best is not None or length < max(SQUARE_M, 3 * grid.cell_m):
        return best
    for turn in (0.0, np.pi / 2):
        along = np.array([np.cos(turn), np.sin(turn)])
        if abs(step @ along) > SQUARE * length:
            return (a + b) / 2, along
    return None


def _same(first: Line, second: Line, tolerance: float) -> bool:
    across = np.array([-first[1][1], first[1][0]])
    return bool(abs(second[1] @ across) < 1e-6 and abs((second[0] - first[0]) @ across) < 1.5 * tolerance)


def _corner(at: np.ndarray, before: Line | None, after: Line | None, reach: float) -> list[np.ndarray]:
    """Return the polygon corners that replace the corner `at` after the edges before and after it moved onto lines."""

    def onto(line: Line) -> np.ndarray:
        return line[0] + ((at - line[0]) @ line[1]) * line[1]

    if before is None and after is None:
        return [at]
    if before is None or after is None:
        return [onto(before if after is None else after)]  # type: ignore[arg-type]
    if abs(_cross(before, after)) > 0.3:
        meet = _meeting(before, after)
        if np.linalg.norm(meet - at) < reach:
            return [meet]
    return [onto(before), onto(after)]
