"""Flat faces of a geometry, and the wedges at their edges.

A face is a connected flat region of one surface, with holes if it has any. Where faces of several surfaces overlap in one plane, only the
smallest face keeps the common area, because only one surface reflects there (a picture replaces the wall behind it). An edge of a face is
split wherever another face begins, ends or touches it. Around each piece, the faces that meet there divide the space into sectors; every
open sector is one wedge. A free edge is a wedge of 360 degrees. A straight side between parts of one face and inner corners of 180/2,
180/3, ... degrees diffract nothing, because images are exact there.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import shapely
import trimesh
from shapely.geometry import LineString, Polygon

from radartwin.simulation.geometry import Geometry

SMALLEST_M = 0.01  # smallest width of a face, because coefficients of edges hold for faces of several wavelengths
FLAT_RAD = 2e-3  # largest angle between triangles that count as coplanar
SAME_M = 1e-5  # largest distance of points that coincide, and of a point from its plane
SHORTEST_M = 1e-3  # shorter pieces of an edge are ignored
SAME_RAD = 1e-3  # largest difference of equal angles
# An inner corner of 180/m degrees diffracts nothing if the relative error of its angle is below this. At other corners, the reflections in
# both orders or in neither order can exist, and only the diffracted wave of the corner makes their sum continuous.
EXACT = 1e-7
# The double echo of two faces passes through the line in which their planes meet, on its way to a radar at R. A gap of this width in metres
# is a fifth of the radius sqrt(lambda R/2) of the Fresnel zone there, for 77 GHz and R = 1 m.
GAP_M = 0.0101
WIDE = 4  # a face that reaches less far from the line than this number of gaps keeps its gap


class Faces(NamedTuple):
    """Hold P faces with T triangles and the wedges of E edges.

    Attributes:
        normal: (P, 3) unit. offset: (P,) metres; points x of a face have normal . x = offset. surface: (P,) surface of each face.
        triangle: (T, 3, 3) corners in metres, counter-clockwise about the normal. first: (P + 1,) range of each face in `triangle`.
        outline: (P, H, 3) convex hull of each face, counter-clockwise about the normal. corners: (P,) its number of corners.
        start: (E, 3) metres. along: (E, 3) unit. length: (E,) metres. Together they give the line piece of an edge.
        into: (E, 3) unit, from the edge into face 0. up: (E, 3) unit, perpendicular to face 0 and to the edge, into the open sector.
        opening: (E,) open angle of the wedge over pi. sides: (E, 2) face 0 and face n.
    """

    normal: np.ndarray
    offset: np.ndarray
    surface: np.ndarray
    triangle: np.ndarray
    first: np.ndarray
    outline: np.ndarray
    corners: np.ndarray
    start: np.ndarray
    along: np.ndarray
    length: np.ndarray
    into: np.ndarray
    up: np.ndarray
    opening: np.ndarray
    sides: np.ndarray

    @staticmethod
    def concatenate(parts: "Sequence[Faces]") -> "Faces":
        """Join faces and number them together."""
        most = max(part.outline.shape[1] for part in parts)
        faces = np.cumsum([0, *(len(part.offset) for part in parts)])
        triangles = np.cumsum([0, *(len(part.triangle) for part in parts)])
        joined = {
            name: np.concatenate([getattr(part, name) for part in parts]) for name in Faces._fields if name not in ("first", "outline")
        }
        joined["first"] = np.concatenate([np.zeros(1, int), *(part.first[1:] + low for part, low in zip(parts, triangles, strict=False))])
        joined["outline"] = np.concatenate([np.pad(p.outline, ((0, 0), (0, most - p.outline.shape[1]), (0, 0))) for p in parts])
        joined["sides"] = np.concatenate([part.sides + low for part, low in zip(parts, faces, strict=False)])
        return Faces(**joined)


@dataclass
class _Region:
    """A flat region: its polygon in coordinates of `axes` (2, 3) about `origin`. `outward`: whether the normal points out of a solid."""

    polygon: Any
    origin: np.ndarray
    axes: np.ndarray
    normal: np.ndarray
    surface: int
    outward: bool

    def to_plane(self, points: np.ndarray) -> np.ndarray:
        return (points - self.origin) @ self.axes.T

    def to_space(self, points: np.ndarray) -> np.ndarray:
        return self.origin + np.asarray(points) @ self.axes

    def corners(self) -> np.ndarray:
        return self.to_space(shapely.get_coordinates(self.polygon))


def find(geometry: Geometry, smallest_m: float = SMALLEST_M) -> tuple[Faces, np.ndarray]:
    """Return the faces of a geometry with their wedges, and a mask (F,) of the triangles that belong to a face.

    smallest_m: smallest width of a face.
    """
    regions, flat = _regions(geometry, smallest_m)
    _close_gaps(regions)
    regions = [part for region in _without_overlaps(regions, smallest_m) for part in _parts(region, smallest_m)]
    return _packed(regions, _wedges(regions)), flat


def _regions(geometry: Geometry, smallest_m: float) -> tuple[list[_Region], np.ndarray]:
    flat = np.zeros(len(geometry.corners), bool)
    even = np.ptp(geometry.normals, axis=1).max(axis=1, initial=0.0) < 1e-4 if len(geometry.corners) else flat
    regions: list[_Region] = []
    for surface in np.unique(geometry.surface[even]):
        faces = np.flatnonzero(even & (geometry.surface == surface))
        outward = bool((geometry.hollow_m[faces] > 0).all())
        for members, normal in _planes(geometry.corners[faces]):
            corners = geometry.corners[faces[members]]
            origin = corners.reshape(-1, 3).mean(axis=0)
            axes = _axes(normal)
            drawn = shapely.polygons((corners - origin) @ axes.T)
            shape: Any = shapely.simplify(shapely.union_all(shapely.set_precision(drawn, 1e-7)), 1e-6)
            hull = shape.convex_hull
            if hull.geom_type == "Polygon" and _width(np.array(hull.exterior.coords[:-1])) >= smallest_m:
                flat[faces[members]] = True
                regions.append(_Region(shape, origin, axes, normal, int(surface), outward))
    return regions, flat


def _close_gaps(regions: list[_Region]) -> None:
    """Extend thin faces to the line in which their planes meet, where both faces end within GAP_M of this line or reach it. The faces then
    share an edge, as faces that touch do. Faces of solids stay as they are.
    """
    thin = [region for region in regions if not region.outward]
    corners = [region.corners() for region in thin]
    boxes = _Boxes.of(corners)
    near = [(i, j) for i, points in enumerate(corners) for j in boxes.touching(points, GAP_M).tolist() if j > i]
    for i, j in near:
        along = np.cross(thin[i].normal, thin[j].normal)
        if along @ along < 0.25:
            continue
        pair = np.array([thin[i].normal, thin[j].normal])
        offsets = [thin[i].normal @ thin[i].origin, thin[j].normal @ thin[j].origin]
        start = np.linalg.lstsq(pair, np.array(offsets), rcond=None)[0]
        along /= np.linalg.norm(along)
        strips = [_strip(thin[k], start, along) for k in (i, j)]
        first, second = (shapely.union_all([LineString([(t, 0), (u, 0)]) for t, u, _, _ in strip]) for strip in strips)
        common = shapely.intersection(first, second)
        if common.length > SHORTEST_M:
            for k, strip in zip((i, j), strips, strict=True):
                _extend(thin[k], start, along, strip, common)


def _strip(region: _Region, start: np.ndarray, along: np.ndarray) -> list[tuple[float, float, float, float]]:
    """Return the places along a line at which a region reaches the line or ends within GAP_M of it, as (first, last, gaps at both)."""
    origin, way = region.to_plane(start), region.axes @ along
    away = np.array([-way[1], way[0]])
    out = []
    for ring in (region.polygon.exterior, *region.polygon.interiors) if isinstance(region.polygon, Polygon) else ():
        points = np.array(ring.coords) - origin
        place, gap = points @ way, points @ away
        reach = np.abs(gap).max()
        for k in range(len(points) - 1):
            widest = max(abs(gap[k]), abs(gap[k + 1]))
            if widest < GAP_M and WIDE * widest < reach and abs(place[k + 1] - place[k]) > SHORTEST_M:
                a, b = sorted((k, k + 1), key=lambda c: place[c])
                out.append((place[a], place[b], gap[a], gap[b]))
    ends = np.array([-1e3, 1e3])[:, None] * way + origin
    for inner in shapely.get_parts(shapely.intersection(LineString(ends), region.polygon)):
        if isinstance(inner, LineString) and inner.length > SHORTEST_M:
            first, last = sorted((np.array(inner.coords)[[0, -1]] - origin) @ way)
            out.append((first, last, 0.0, 0.0))
    return out


def _extend(region: _Region, start: np.ndarray, along: np.ndarray, strip: list[tuple[float, float, float, float]], common: Any) -> None:
    """Fill the area between a line and the sides of a region in the common places (multiple) line string."""
    origin, way = region.to_plane(start), region.axes @ along
    away = np.array([-way[1], way[0]])
    for first, last, gap_first, gap_last in strip:
        for part in shapely.get_parts(shapely.intersection(common, LineString([(first, 0), (last, 0)]))):
            # they meet already, or have at most a point in common
            if max(abs(gap_first), abs(gap_last)) < SAME_M or part.length < SHORTEST_M:
                continue
            t = np.array(part.coords)[[0, -1], 0]
            gap = np.interp(t, (first, last), (gap_first, gap_last))
            ring = [*(origin + t[:, None] * way), *(origin + t[::-1, None] * way + gap[::-1, None] * away)]
            # The ring crosses itself if the side crosses the line, and is a triangle and a line if the side only touches the line.
            gaps = shapely.make_valid(Polygon(ring), method="structure", keep_collapsed=False)
            filled = _areas(shapely.union(region.polygon, gaps, grid_size=1e-7))
            if len(filled) == 1:
                region.polygon = filled[0]


def _areas(shape: Any) -> list[Any]:
    """Return the polygons of a shape, without the lines that set operations leave where two sides coincide."""
    return [part for part in shapely.get_parts(shape) if isinstance(part, Polygon)]


def _planes(corners: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return (triangle indices, unit normal) of each set of connected coplanar triangles."""
    mesh = trimesh.Trimesh(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3), process=False)
    mesh.merge_vertices(digits_vertex=7)
    pairs = np.asarray(mesh.face_adjacency).reshape(-1, 2)
    pairs = pairs[np.asarray(mesh.face_adjacency_angles).reshape(-1) < FLAT_RAD]
    out = []
    for group in trimesh.graph.connected_components(pairs, nodes=np.arange(len(corners)), min_len=1):
        members = np.sort(np.asarray(group, int))
        a, b, c = corners[members].transpose(1, 0, 2)
        area = np.cross(b - a, c - a)
        largest = area[np.argmax(np.linalg.norm(area, axis=1))]
        total = (area * np.sign(area @ largest)[:, None]).sum(axis=0)
        out.append((members, total / np.linalg.norm(total)))
    return out


def _axes(normal: np.ndarray) -> np.ndarray:
    """Return two unit vectors (2, 3) that form a right-handed system with the normal."""
    first = np.cross(normal, [0.0, 0.0, 1.0] if abs(normal[2]) < 0.9 else [1.0, 0.0, 0.0])
    first /= np.linalg.norm(first)
    return np.array([first, np.cross(normal, first)])


def _width(ring: np.ndarray) -> float:
    """Return the smallest extent of a convex polygon (N, 2) perpendicular to one of its edges."""
    along = np.roll(ring, -1, axis=0) - ring
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-30)
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    return float(np.ptp(ring @ across.T, axis=0).min())


def _without_overlaps(regions: list[_Region], smallest_m: float) -> list[_Region]:
    """Subtract from every region the smaller regions in its plane. Of equal regions, only the first one remains."""
    order = sorted(range(len(regions)), key=lambda i: (regions[i].polygon.area, i))
    rank = {i: place for place, i in enumerate(order)}
    near = _Boxes.of([region.corners() for region in regions])
    kept: dict[int, _Region] = {}
    for i in order:
        larger = regions[i]
        corners = larger.to_space(shapely.get_coordinates(larger.polygon.convex_hull))
        for j in sorted((j for j in near.touching(corners).tolist() if j in kept), key=rank.__getitem__):
            smaller = kept[j]
            if abs(larger.normal @ smaller.normal) < 1 - 1e-6 or np.abs((corners - smaller.origin) @ smaller.normal).max() > SAME_M:
                continue
            cover = shapely.transform(smaller.polygon, lambda ring, here=larger, there=smaller: here.to_plane(there.to_space(ring)))
            larger.polygon = shapely.multipolygons(_areas(shapely.difference(larger.polygon, cover, grid_size=1e-7)))
        if larger.polygon.area > smallest_m**2:
            kept[i] = larger
    return list(kept.values())


class _Boxes(NamedTuple):
    """Hold axis-parallel boxes, with a search tree in x and y. low, high: (N, 3) corners."""

    low: np.ndarray
    high: np.ndarray
    tree: shapely.STRtree

    @staticmethod
    def of(points: Sequence[np.ndarray] | np.ndarray) -> "_Boxes":
        """Return the boxes of sets of points (V, 3)."""
        low, high = (np.array([bound(corners, axis=0) for corners in points]).reshape(-1, 3) for bound in (np.min, np.max))
        return _Boxes(low, high, shapely.STRtree(shapely.box(*low[:, :2].T, *high[:, :2].T)))

    def touching(self, points: np.ndarray, distance_m: float = SAME_M) -> np.ndarray:
        """Return the indices, in ascending order, of the boxes closer than a distance to the box of points (V, 3), along each axis."""
        low, high = points.min(axis=0) - distance_m, points.max(axis=0) + distance_m
        indices = np.sort(self.tree.query(shapely.box(*low[:2], *high[:2])))
        return indices[(self.high[indices, 2] >= low[2]) & (self.low[indices, 2] <= high[2])]


def _parts(region: _Region, smallest_m: float) -> list[_Region]:
    return [replace(region, polygon=shape) for shape in _areas(region.polygon) if shape.area > smallest_m**2]


class _Side(NamedTuple):
    """One half-plane at an edge piece: its direction, its face, and the unit normal out of its solid (zero for a thin face)."""

    direction: np.ndarray
    face: int
    outward: np.ndarray


class _Wedge(NamedTuple):
    start: np.ndarray
    along: np.ndarray
    length: float
    into: np.ndarray
    up: np.ndarray
    opening: float
    sides: tuple[int, int]


def _borders(regions: list[_Region]) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the ends (S, 3), (S, 3) of all straight border pieces, the unit direction (S, 3) into their face, and the face (S,)."""
    begin, end, inward, owner = [np.zeros((0, 3))], [np.zeros((0, 3))], [np.zeros((0, 3))], []
    for i, region in enumerate(regions):
        shape = shapely.orient_polygons(region.polygon)
        for ring in (shape.exterior, *shape.interiors):
            points = np.array(ring.coords)
            space = region.to_space(points)
            way = np.diff(space, axis=0)
            size = np.linalg.norm(way, axis=1)
            keep = size > SAME_M
            begin.append(space[:-1][keep])
            end.append(space[1:][keep])
            inward.append(np.cross(region.normal, way[keep] / size[keep, None]))  # exterior counter-clockwise, holes clockwise
            owner += [i] * int(keep.sum())
    return np.concatenate(begin), np.concatenate(end), np.concatenate(inward), np.array(owner, int)


def _wedges(regions: list[_Region]) -> list[_Wedge]:
    begin, end, inward, owner = _borders(regions)
    normals = np.array([r.normal for r in regions]).reshape(-1, 3)
    offsets = np.array([r.normal @ r.origin for r in regions])
    pieces = _Boxes.of(np.stack([begin, end], axis=1))
    areas = _Boxes.of([region.corners() for region in regions])
    wedges: list[_Wedge] = []

    @cache
    def inside(face: int) -> Any:
        return regions[face].polygon.buffer(-2 * SAME_M)

    for i in range(len(owner)):
        way = end[i] - begin[i]
        size = float(np.linalg.norm(way))
        along = way / size
        both = np.stack([begin[i], end[i]])
        # border pieces on the same line
        near = pieces.touching(both)
        places = [(points[near] - begin[i]) @ along for points in (begin, end)]
        away = [
            np.linalg.norm(points[near] - begin[i] - t[:, None] * along, axis=1) for points, t in zip((begin, end), places, strict=True)
        ]
        low, high = np.minimum(*places), np.maximum(*places)
        same = np.flatnonzero((np.maximum(*away) < SAME_M) & (low < size - SAME_M) & (high > SAME_M))
        spans = [(float(low[k]), float(high[k]), [_side(regions, inward[near[k]], owner[near[k]])], int(near[k])) for k in same]
        # faces that the piece crosses inside their borders
        near = areas.touching(both)
        level = np.abs(both @ normals[near].T - offsets[near]).max(axis=0)
        for f in near[(level < SAME_M) & (near != owner[i])]:
            line = LineString(regions[f].to_plane(np.array([begin[i], end[i]])))
            inner = shapely.intersection(line, inside(int(f)))
            across = np.cross(normals[f], along)
            for piece in getattr(inner, "geoms", [inner]):
                if isinstance(piece, LineString) and piece.length > SHORTEST_M:
                    ends = sorted(((regions[f].to_space(np.array(piece.coords)) - begin[i]) @ along)[[0, -1]].tolist())
                    spans.append((ends[0], ends[1], [_side(regions, across, f), _side(regions, -across, f)], -1))
        wedges += _pieces(i, begin[i], along, size, spans)
    return wedges


def _side(regions: list[_Region], direction: np.ndarray, face: Any) -> _Side:
    return _Side(direction, int(face), regions[face].normal if regions[face].outward else np.zeros(3))


def _pieces(index: int, begin: np.ndarray, along: np.ndarray, size: float, spans: list[tuple]) -> list[_Wedge]:
    """Return the wedges of a border piece. If border pieces overlap, only the first one gives the wedges of their common part."""
    cuts = np.array(sorted({0.0, size, *(t for span in spans for t in span[:2] if SAME_M < t < size - SAME_M)}))
    wedges = []
    for low, high in pairwise(cuts):
        if high - low < SHORTEST_M:
            continue
        middle = (low + high) / 2
        here = [span for span in spans if span[0] < middle < span[1]]
        if any(0 <= span[3] < index for span in here):
            continue
        sides = [side for span in here for side in span[2]]
        for into, up, opening, faces in _sectors(along, sides):
            wedges.append(_Wedge(begin + low * along, along, high - low, into, up, opening, faces))
    return wedges


def _sectors(along: np.ndarray, sides: list[_Side]) -> list[tuple[np.ndarray, np.ndarray, float, tuple[int, int]]]:
    """Return (into, up, opening, faces) of the open sectors between half-planes around an edge."""
    first = sides[0].direction
    second = np.cross(along, first)
    angles = np.array([np.arctan2(side.direction @ second, side.direction @ first) % (2 * np.pi) for side in sides])
    angles[angles > 2 * np.pi - SAME_RAD] = 0.0
    order = np.argsort(angles, kind="stable")
    distinct = [int(order[0])] + [int(b) for a, b in pairwise(order) if angles[b] - angles[a] > SAME_RAD]
    sectors = []
    for k, i in enumerate(distinct):
        j = distinct[(k + 1) % len(distinct)]
        angle = float((angles[j] - angles[i]) % (2 * np.pi)) if len(distinct) > 1 else 2 * np.pi
        opening = angle / np.pi
        up = np.cross(along, sides[i].direction)
        if sides[i].outward @ up < -0.5 or sides[j].outward @ np.cross(along, sides[j].direction) > 0.5:
            continue  # the sector is inside a solid
        order_of_images = round(1 / opening)
        if order_of_images >= 1 and abs(opening * order_of_images - 1) < EXACT and (order_of_images > 1 or sides[i].face == sides[j].face):
            continue
        sectors.append((sides[i].direction, up, opening, (sides[i].face, sides[j].face)))
    return sectors


def _packed(regions: list[_Region], wedges: list[_Wedge]) -> Faces:
    triangles: list[np.ndarray] = []
    first, hulls = [0], []
    for region in regions:
        vertices, faces = trimesh.creation.triangulate_polygon(region.polygon, engine="earcut")
        corners = np.asarray(vertices)[faces]
        u, v = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        area = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
        corners[area < 0] = corners[area < 0][:, ::-1]
        triangles.append(region.to_space(corners))
        first.append(first[-1] + len(faces))
        hulls.append(region.to_space(np.array(shapely.orient_polygons(region.polygon.convex_hull).exterior.coords[:-1])))
    most = max((len(hull) for hull in hulls), default=3)
    outline = np.zeros((len(regions), most, 3))
    for i, hull in enumerate(hulls):
        outline[i, : len(hull)] = hull
    normal = np.array([r.normal for r in regions]).reshape(-1, 3)
    shapes = {"start": (3,), "along": (3,), "length": (), "into": (3,), "up": (3,), "opening": (), "sides": (2,)}
    kinds = {name: int if name == "sides" else float for name in shapes}
    edges = {name: np.array([getattr(w, name) for w in wedges], kinds[name]).reshape(-1, *shape) for name, shape in shapes.items()}
    return Faces(
        normal=normal,
        offset=np.array([r.normal @ r.origin for r in regions]),
        surface=np.array([r.surface for r in regions], int),
        triangle=np.concatenate(triangles) if triangles else np.zeros((0, 3, 3)),
        first=np.array(first),
        outline=outline,
        corners=np.array([len(hull) for hull in hulls], int),
        **edges,
    )
