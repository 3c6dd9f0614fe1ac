"""Replace the planar segments of a scan by polygons with few triangles.

A segment and the smaller segments in its plane, such as a wall and its door, are outlined together, so that their polygons share borders. A
segment in front of the plane, such as a thick board on a wall, keeps its distance from the plane.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import trimesh
from shapely import MultiPoint
from shapely.geometry.base import BaseGeometry

from radartwin.reconstruct.distance import covered
from radartwin.reconstruct.outlines import outline
from radartwin.reconstruct.outlines.complete import complete, spanned, within
from radartwin.reconstruct.outlines.flatten import regular
from radartwin.reconstruct.outlines.grid import Grid
from radartwin.reconstruct.outlines.visibility import Cameras, Sight
from radartwin.reconstruct.segmentation import masks
from radartwin.reconstruct.segmentation.bodies import contacts, room_bounds
from radartwin.reconstruct.segmentation.faces import Faces, Segment, thinned

CELL_M = 0.02
CLOSING_M = 0.06  # gaps in a segment narrower than twice this length count as noise and are closed
SEAM_M = 0.1  # segments with a shorter common edge do not count as touching
COPLANAR = np.cos(np.radians(4.0))
COPLANAR_M = 0.03
# a larger offset from the plane is real, because phone LiDAR has an error of +-1 cm on objects over 10 cm (Luetzenburg et al. 2021)
PROUD_M = 0.01
# smallest covered fraction of a rectangle that is completed, for room surfaces and for objects
MIN_ROOM_SHARE, MIN_OBJECT_SHARE = 0.6, 0.85


@dataclass(frozen=True, eq=False)
class Flat:
    """The polygon of a planar segment.

    Attributes:
        segment: index of the segment; -1 for a pane that the scan missed.
        parent: index of the segment in which a pane lies; otherwise -1.
        filled_m2: area in m2 of the part of the polygon that the scan missed.
        seen: boolean mask of the scanned grid cells; None if all cells or no cells were scanned.
    """

    segment: int
    mesh: trimesh.Trimesh
    grid: Grid
    parent: int = -1
    filled_m2: float = 0.0
    seen: np.ndarray | None = None


class Flattened(NamedTuple):
    """The result of `flattened`: the polygons of all planar segments, the segments with their final planes, and statistics."""

    flats: list[Flat]
    segments: list[Segment]
    statistics: dict[str, Any]


class _Room(NamedTuple):
    """Data of the whole scan that are needed to outline its planes; `main_rad` is the main direction of the walls in radians.

    `points` are scan points, thinned to a regular spacing.
    """

    faces: Faces
    segments: Sequence[Segment]
    bounds: np.ndarray
    touching: Sequence[tuple[int, int]]
    main_rad: float
    points: np.ndarray
    sight: Sight


def flattened(
    mesh: trimesh.Trimesh, segments: Sequence[Segment], cameras: Cameras | None = None, step: Callable[[], None] = lambda: None
) -> Flattened:
    """Replace the planar segments of a scan by polygons.

    `cameras` are the cameras that recorded the scan, or None if unknown. The function calls `step` after each finished plane, to report
    progress.
    """
    faces = Faces.of(mesh, 0.0)
    bounds = room_bounds(faces, segments)
    segments, main_rad = regular(mesh, segments)
    points = faces.centre[thinned(faces.centre)]
    touching = [(i, j) for i, j, length, _ in contacts(faces, segments) if length >= SEAM_M]
    room = _Room(faces, segments, bounds, touching, main_rad, points, Sight.of(points, cameras))
    out = Flattened([], list(segments), {})
    distance: list[np.ndarray] = []
    filled = opened = 0.0
    for group in _groups(faces, segments, touching):
        root = segments[group[0]]
        offsets = {k: _offset_from(faces, segments[k], root) for k in group}
        for k in group:
            assert root.normal is not None
            out.segments[k] = replace(segments[k], normal=root.normal, offset_m=root.offset_m + offsets[k])
            distance.append(faces.centre[segments[k].faces] @ root.normal - root.offset_m - offsets[k])
        flats, filled_m2, open_m2 = _outlined(room, group)
        for flat in flats:
            if lift := offsets.get(flat.segment, 0.0):
                flat.mesh.apply_translation(lift * np.asarray(root.normal))
        out.flats.extend(flats)
        filled, opened = filled + filled_m2, opened + open_m2
        step()
    moved = np.concatenate(distance) if distance else np.zeros(1)
    rms_m, max_m = float(np.sqrt(np.mean(moved**2))), float(np.abs(moved).max())
    out.statistics.update({"flattening_rms_m": rms_m, "flattening_max_m": max_m, "filled_m2": filled, "open_m2": opened})
    return out


def _groups(faces: Faces, segments: Sequence[Segment], touching: Sequence[tuple[int, int]]) -> list[list[int]]:
    """Group each planar segment with the smaller segments that touch it and lie in its plane.

    The largest segment of a group comes first.
    """
    order = sorted((k for k, s in enumerate(segments) if s.normal is not None), key=lambda k: -segments[k].area_m2)
    near: dict[int, set[int]] = {}
    for i, j in touching:
        near.setdefault(i, set()).add(j)
        near.setdefault(j, set()).add(i)
    taken: set[int] = set()
    groups = []
    for k in order:
        if k in taken:
            continue
        members = [k]
        for j in sorted(near.get(k, ()), key=lambda j: -segments[j].area_m2):
            if j not in taken and _in_plane_of(faces, segments[j], segments[k]):
                members.append(j)
        taken.update(members)
        groups.append(members)
    return groups


def _in_plane_of(faces: Faces, segment: Segment, larger: Segment) -> bool:
    if segment.normal is None or larger.normal is None or segment.area_m2 > larger.area_m2 or segment.normal @ larger.normal < COPLANAR:
        return False
    centre = np.average(faces.centre[segment.faces], axis=0, weights=faces.area[segment.faces])
    return bool(abs(centre @ larger.normal - larger.offset_m) < COPLANAR_M)


def _offset_from(faces: Faces, segment: Segment, root: Segment) -> float:
    """Return the offset in metres of a segment from the plane of the largest segment in its group; 0 if the offset may be noise."""
    if segment is root:
        return 0.0
    away = float(np.average(faces.centre[segment.faces] @ root.normal - root.offset_m, weights=faces.area[segment.faces]))
    return away if abs(away) > PROUD_M else 0.0


def _outlined(room: _Room, group: list[int]) -> tuple[list[Flat], float, float]:
    """Outline a group of coplanar segments.

    Return the polygons of the group, and the area of filled gaps and of gaps left open, both in m2.
    """
    root = room.segments[group[0]]
    assert root.normal is not None
    limits = bool(room.bounds[group[0]])
    grid, samples = _grid(room, group, limits)
    radius = max(CLOSING_M, 1.5 * grid.cell_m) / grid.cell_m
    parts = _cells_of_each(grid, samples)
    whole = masks.closed(np.any([masks.closed(grid.counts(p) > 0, radius) for p in samples.values()], axis=0), radius)
    frame = spanned(whole, MIN_ROOM_SHARE if limits else MIN_OBJECT_SHARE)
    if limits and frame is not None:
        walls = [(s.normal, s.offset_m) for k, s in enumerate(room.segments) if room.bounds[k] and k not in group and s.normal is not None]
        frame = within(grid, frame, whole, walls)
        whole &= frame
    done = complete(grid, whole, room.points, frame, room.sight if limits and root.normal[2] < 0.5 else None)

    lines = _cut_lines(room, grid, group)
    rest = outline.polygon(grid, done.mask, lines)
    flats: list[Flat] = []
    for pane in done.panes:
        shape = outline.polygon(grid, masks.closed(pane, 1), lines, edge=0.5)
        piece = outline.triangulated(grid, shape)
        if piece is not None:
            flats.append(Flat(-1, piece, grid, group[0], float(shape.area)))
            rest = rest.difference(shape)
    for k in group[1:]:
        # The part is first extended beyond the border of the whole plane. The intersection with `rest` then cuts it at this border.
        part = masks.closed(parts[k], radius) & ~np.any([parts[j] for j in group if j != k], axis=0)
        part |= masks.dilated(part, 2, part | ~whole)
        shape = (outline.rectangle(grid, part) or outline.polygon(grid, part, lines, edge=0.0)).intersection(rest)
        piece = outline.triangulated(grid, shape)
        if piece is not None:
            flats.append(Flat(k, piece, grid))
            rest = rest.difference(shape)
    piece = outline.triangulated(grid, _without_slivers(rest, grid.cell_m))
    if piece is not None:
        flats.append(Flat(group[0], piece, grid, filled_m2=done.filled_m2, seen=whole))
    return flats, done.filled_m2, done.open_m2


def _grid(room: _Room, group: list[int], limits: bool) -> tuple[Grid, dict[int, np.ndarray]]:
    """Return the grid on the plane of a group, along the plane's main direction, and the sample points (N, 3) of each segment."""
    faces, root = room.faces, room.segments[group[0]]
    assert root.normal is not None
    together = np.concatenate([room.segments[k].faces for k in group])
    edge = float(np.sqrt(2 * np.median(faces.area[together])))
    cell = float(np.clip(0.8 * edge, CELL_M, 0.05))
    samples = {k: covered(faces.corners[room.segments[k].faces], 0.7 * cell)[0] for k in group}
    points = np.vstack(list(samples.values()))
    grid = Grid.around(points, root.normal, root.offset_m, cell)
    turn = _turn(grid, room.main_rad, points, limits)
    return (Grid.around(points, root.normal, root.offset_m, cell, turn) if turn else grid), samples


def _cut_lines(room: _Room, grid: Grid, group: list[int]) -> list[outline.Line]:
    """Return the lines in which other planes cut the plane of the grid. The other planes are those of adjacent scan segments, of the
    floor, of the ceiling and of the walls.
    """
    members = set(group)
    around = {j if i in members else i for i, j in room.touching if (i in members) != (j in members)}
    cuts = [
        outline.meeting_line(grid, s.normal, s.offset_m)
        for k, s in enumerate(room.segments)
        if s.normal is not None and k not in members and (k in around or room.bounds[k])
    ]
    return [line for line in cuts if line is not None]


def _cells_of_each(grid: Grid, samples: dict[int, np.ndarray]) -> dict[int, np.ndarray]:
    """Return a boolean mask of the grid cells of each segment. A shared cell belongs to the segment with most sample points in the cell."""
    counts = np.stack([grid.counts(points) for points in samples.values()])
    most = counts.argmax(axis=0)
    return {k: (counts[n] > 0) & (most == n) for n, k in enumerate(samples)}


def _turn(grid: Grid, main_rad: float, points: np.ndarray, limits: bool) -> float:
    """Return the angle in radians from the grid axes to the main direction of a level plane; 0 for upright and slanted planes."""
    if abs(grid.normal[2]) < np.cos(np.radians(10.0)):
        return 0.0  # the grid axes are already horizontal and upward
    east = np.array([np.cos(main_rad), np.sin(main_rad), 0.0]) @ grid.axes.T
    room = float(np.arctan2(east[1], east[0]))
    if limits:
        return room
    rectangle: Any = MultiPoint(points @ grid.axes.T).minimum_rotated_rectangle
    if rectangle.geom_type != "Polygon":
        return room
    box = np.array(rectangle.exterior.coords)
    side = box[1] - box[0]
    own = float(np.arctan2(side[1], side[0]))
    difference = (own - room + np.pi / 4) % (np.pi / 2) - np.pi / 4
    return room if abs(difference) < np.radians(5.0) else own


def _without_slivers(shape: BaseGeometry, cell: float) -> BaseGeometry:
    """Remove the parts of a polygon that are narrower than a grid cell, without rounding the corners of the polygon."""
    opened = shape.buffer(-cell / 2, join_style="mitre").buffer(cell / 2, join_style="mitre")
    return opened if not opened.is_empty else shape
