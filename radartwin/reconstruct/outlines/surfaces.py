"""Replace the planar segments of a scan by polygons with few triangles.

A segment and the smaller segments in its plane, such as a wall and its door, are outlined together, so that their polygons share borders. A
segment in front of the plane, such as a thick board on a wall, keeps its distance from the plane.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import trimesh
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree
from shapely import MultiPoint
from shapely.geometry.base import BaseGeometry

from radartwin.reconstruct.mesh_distance import covered
from radartwin.reconstruct.outlines import meeting_planes
from radartwin.reconstruct.outlines.complete import Completed, complete, spanned, within
from radartwin.reconstruct.outlines.flatten import regular
from radartwin.reconstruct.outlines.seen_points import Cameras, Sight
from radartwin.reconstruct.segmentation import masks
from radartwin.reconstruct.segmentation.bodies import contacts, owners, room_bounds
from radartwin.reconstruct.segmentation.face_arrays import Faces, Segment, members, thinned
from radartwin.reconstruct.segmentation.grid import Grid

CELL_M = 0.02
NARROW_CELLS = 5  # a narrow plane has at least this number of cells across, so that its two borders are not mistaken for each other
CLOSING_M = 0.06  # gaps in a segment narrower than twice this length count as noise and are closed
SEAM_M = 0.1  # segments with a shorter common edge do not count as touching
COPLANAR = np.cos(np.radians(4.0))
COPLANAR_M = 0.03
BESIDE_M = 0.2  # two parallel bounds of a room at a smaller distance are a wall and a board on it, or a floor and a mat
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

    `touching` holds for each segment the segments that touch it, with the places (N, 3) in metres at which they touch. `points` are scan
    points, thinned to a regular spacing. `border` holds the border points (N, 3) of each segment.
    """

    faces: Faces
    segments: Sequence[Segment]
    bounds: np.ndarray
    touching: Sequence[dict[int, np.ndarray]]
    main_rad: float
    points: np.ndarray
    sight: Sight
    border: Sequence[np.ndarray]


def flattened(
    mesh: trimesh.Trimesh,
    segments: Sequence[Segment],
    cameras: Cameras | None = None,
    over: Callable[[Sequence[int]], Iterable[int]] = iter,
) -> Flattened:
    """Replace the planar segments of a scan by polygons.

    `cameras` are the cameras that recorded the scan, or None if unknown. `over` iterates over the numbers of the planes and may report
    progress.
    """
    faces = Faces.of(mesh, 0.0)
    bounds = room_bounds(faces, segments)
    segments, main_rad = regular(mesh, segments)
    points = faces.samples[0][thinned(faces.samples[0])]
    touching: list[dict[int, np.ndarray]] = [{} for _ in segments]
    for contact in contacts(faces, segments):
        if contact.length_m >= SEAM_M:
            touching[contact.first][contact.second] = touching[contact.second][contact.first] = contact.places
    groups = _groups(faces, segments, touching)
    moved, lifts = list(segments), {}
    for root, k in ((segments[group[0]], k) for group in groups for k in group):
        which = segments[k].faces
        away = float(np.average(faces.centre[which] @ root.normal - root.offset_m, weights=faces.area[which]))
        lifts[k] = away if segments[k] is not root and abs(away) > PROUD_M else 0.0
        moved[k] = replace(segments[k], normal=root.normal, offset_m=root.offset_m + lifts[k])
    borders = border_points(mesh, owners(faces, segments))
    room = _Room(faces, moved, bounds, touching, main_rad, points, Sight.of(points, cameras), borders)
    outlined: dict[int, tuple[list[Flat], Completed]] = {}
    # Large planes take longest. In random order, the time of the first planes is a fair estimate for the others.
    for number in over(np.random.default_rng(0).permutation(len(groups)).tolist()):
        outlined[number] = _outlined(room, groups[number])
    flats = [flat for number in sorted(outlined) for flat in outlined[number][0]]
    for flat in flats:
        if lift := lifts.get(flat.segment, 0.0):
            flat.mesh.apply_translation(lift * np.asarray(flat.grid.normal))
    areas = {name: sum(getattr(done, name) for _, done in outlined.values()) for name in ("filled_m2", "open_m2", "closed_m2")}
    _weld(flats)
    away = np.concatenate([np.zeros(1), *(faces.centre[s.faces] @ s.normal - s.offset_m for s in moved if s.normal is not None)])
    rms_m, max_m = float(np.sqrt(np.mean(away**2))), float(np.abs(away).max())
    return Flattened(flats, moved, {"flattening_rms_m": rms_m, "flattening_max_m": max_m, **areas})


def border_points(mesh: trimesh.Trimesh, label: np.ndarray) -> list[np.ndarray]:
    """Return points (N, 3) on the borders of each part of a mesh. `label` (F,) is the number of the part of each face, or -1."""
    vertices, edges = np.asarray(mesh.vertices), np.asarray(mesh.edges_sorted, dtype=np.int64)
    pair, shared = np.asarray(mesh.face_adjacency).reshape(-1, 2), np.asarray(mesh.face_adjacency_edges, dtype=np.int64).reshape(-1, 2)
    inner = shared[label[pair[:, 0]] == label[pair[:, 1]]] @ [len(vertices), 1]
    at_border = (np.repeat(label, 3) >= 0) & ~np.isin(edges @ [len(vertices), 1], inner)
    start, end = vertices[edges[at_border]].transpose(1, 0, 2)
    count = np.ceil(np.linalg.norm(end - start, axis=1) / CELL_M).astype(int)
    edge = np.repeat(np.arange(len(count)), count)
    share = (np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count) + 0.5) / count[edge]
    points = start[edge] + share[:, None] * (end - start)[edge]
    parts = members(np.repeat(label, 3)[at_border][edge])
    return [points[part] for part in parts] + [np.zeros((0, 3))] * (int(label.max(initial=-1)) + 1 - len(parts))


def _weld(flats: Sequence[Flat]) -> None:
    """Give vertices of different polygons that differ by rounding errors only the same coordinates."""
    if not flats:
        return
    vertices = np.vstack([flat.mesh.vertices for flat in flats])
    _, part = connected_components(KDTree(vertices).sparse_distance_matrix(KDTree(vertices), meeting_planes.WELD_M), directed=False)
    first = np.unique(part, return_index=True)[1]
    welded = np.split(vertices[first[part]], np.cumsum([len(flat.mesh.vertices) for flat in flats])[:-1])
    for flat, corners in zip(flats, welded, strict=True):
        flat.mesh.vertices = corners


def _groups(faces: Faces, segments: Sequence[Segment], touching: Sequence[dict[int, np.ndarray]]) -> list[list[int]]:
    """Group each planar segment with the smaller segments that touch it and lie in its plane, the largest first."""
    order = sorted((k for k, s in enumerate(segments) if s.normal is not None), key=lambda k: -segments[k].area_m2)
    taken: set[int] = set()
    groups = []
    for k in order:
        if k in taken:
            continue
        near = sorted(touching[k], key=lambda j: -segments[j].area_m2)
        groups.append([k, *(j for j in near if j not in taken and _in_plane_of(faces, segments[j], segments[k]))])
        taken.update(groups[-1])
    return groups


def _in_plane_of(faces: Faces, segment: Segment, larger: Segment) -> bool:
    if segment.normal is None or larger.normal is None or segment.area_m2 > larger.area_m2 or segment.normal @ larger.normal < COPLANAR:
        return False
    centre = np.average(faces.centre[segment.faces], axis=0, weights=faces.area[segment.faces])
    return bool(abs(centre @ larger.normal - larger.offset_m) < COPLANAR_M)


def _outlined(room: _Room, group: list[int]) -> tuple[list[Flat], Completed]:
    """Outline a group of coplanar segments. Return the polygons of the group, and how its gaps were completed."""
    root = room.segments[group[0]]
    assert root.normal is not None
    limits = bool(room.bounds[group[0]])
    grid, samples = _grid(room, group, limits)
    radius = max(CLOSING_M, 1.5 * grid.cell_m) / grid.cell_m
    counts = np.stack([grid.counts(points) for points in samples.values()])
    most = counts.argmax(axis=0)  # a shared cell belongs to the segment with most sample points in the cell
    parts = {k: (counts[n] > 0) & (most == n) for n, k in enumerate(samples)}
    whole = masks.closed(np.any([masks.closed(count > 0, radius) for count in counts], axis=0), radius)
    walls = [(s.normal, s.offset_m) for k, s in enumerate(room.segments) if room.bounds[k] and k not in group and s.normal is not None]
    possible = within(grid, whole, walls) if limits else np.ones_like(whole)
    frame = spanned(whole, possible, MIN_ROOM_SHARE if limits else MIN_OBJECT_SHARE)
    if limits and frame is not None:
        whole &= frame
    done = complete(grid, whole, room.points, frame, room.sight if limits and root.normal[2] < 0.5 else None)

    cuts, borders = _cuts(room, grid, group), {k: room.border[k] @ grid.axes.T for k in group}
    whole_border = np.vstack(list(borders.values()))
    rest = meeting_planes.polygon(grid, done.mask, cuts, whole_border)
    flats: list[Flat] = []
    for pane in done.panes:
        shape = meeting_planes.polygon(grid, masks.closed(pane, 1), cuts, whole_border, edge=0.5)
        piece = meeting_planes.triangulated(grid, shape)
        if piece is not None:
            flats.append(Flat(-1, piece, grid, group[0], float(shape.area)))
            rest = rest.difference(shape)
    for k in group[1:]:
        # The part is first extended beyond the border of the whole plane. The intersection with `rest` then cuts it at this border.
        part = masks.closed(parts[k], radius) & ~np.any([parts[j] for j in group if j != k], axis=0)
        part |= masks.dilated(part, 2, part | ~whole)
        shape = (meeting_planes.rectangle(grid, part) or meeting_planes.polygon(grid, part, cuts, borders[k], edge=0.0)).intersection(rest)
        piece = meeting_planes.triangulated(grid, shape)
        if piece is not None:
            flats.append(Flat(k, piece, grid))
            rest = rest.difference(shape)
    piece = meeting_planes.triangulated(grid, _without_slivers(rest, grid.cell_m))
    if piece is not None:
        flats.append(Flat(group[0], piece, grid, filled_m2=done.filled_m2, seen=whole))
    return flats, done


def _grid(room: _Room, group: list[int], limits: bool) -> tuple[Grid, dict[int, np.ndarray]]:
    """Return the grid on the plane of a group, along the plane's main direction, and the sample points (N, 3) of each segment."""
    faces, root = room.faces, room.segments[group[0]]
    assert root.normal is not None
    together = np.concatenate([room.segments[k].faces for k in group])
    edge = float(np.sqrt(2 * np.median(faces.area[together])))
    width = faces.area[together].sum() / np.linalg.norm(np.ptp(faces.corners[together].reshape(-1, 3), axis=0))
    cell = float(np.clip(min(0.8 * edge, width / NARROW_CELLS), CELL_M, 0.05))
    samples = {k: covered(faces.corners[room.segments[k].faces], 0.7 * cell)[0] for k in group}
    points = np.vstack(list(samples.values()))
    grid = Grid.around(points, root.normal, root.offset_m, cell)
    angle_rad = _main_angle(grid, room.main_rad, points, limits)
    return (Grid.around(points, root.normal, root.offset_m, cell, angle_rad) if angle_rad else grid), samples


def _cuts(room: _Room, grid: Grid, group: list[int]) -> list[meeting_planes.Cut]:
    """Return the lines in which other planes cut the plane of the grid: the planes that touch the group, and the bounds of the room."""
    touching: dict[int, list[np.ndarray]] = {int(k): [] for k in np.flatnonzero(room.bounds)}
    for member in group:
        for k, places in room.touching[member].items():
            touching.setdefault(k, []).append(places)
    cuts = []
    for k, places in sorted(touching.items()):
        normal, offset = room.segments[k].normal, room.segments[k].offset_m
        if normal is not None and k not in group:
            # A mat on the floor or a board along a wall counts as a bound, too, but ends a plane only where it touches the plane.
            larger = (s for b, s in enumerate(room.segments[:k]) if room.bounds[b] and s.normal is not None)
            whole = room.bounds[k] and not any(s.normal @ normal > COPLANAR and abs(s.offset_m - offset) < BESIDE_M for s in larger)
            if whole or places:
                cuts.append(meeting_planes.meeting_line(grid, normal, offset, None if whole else np.vstack(places)))
    return [cut for cut in cuts if cut is not None]


def _main_angle(grid: Grid, main_rad: float, points: np.ndarray, limits: bool) -> float:
    """Return the angle in radians from the grid axes to the main direction of a level plane; 0 for upright and slanted planes."""
    if abs(grid.normal[2]) < np.cos(np.radians(10.0)):
        return 0.0  # the grid axes are already horizontal and upward
    east = np.array([np.cos(main_rad), np.sin(main_rad), 0.0]) @ grid.axes.T
    room_rad = float(np.arctan2(east[1], east[0]))
    if limits:
        return room_rad
    rectangle: Any = MultiPoint(points @ grid.axes.T).minimum_rotated_rectangle
    if rectangle.geom_type != "Polygon":
        return room_rad
    box = np.array(rectangle.exterior.coords)
    side = box[1] - box[0]
    side_rad = float(np.arctan2(side[1], side[0]))
    difference = (side_rad - room_rad + np.pi / 4) % (np.pi / 2) - np.pi / 4
    return room_rad if abs(difference) < np.radians(5.0) else side_rad


def _without_slivers(shape: BaseGeometry, cell: float) -> BaseGeometry:
    """Remove the parts of a polygon that are narrower than a grid cell, without rounding the corners of the polygon."""
    shape = shape.simplify(meeting_planes.WELD_M, preserve_topology=False)  # without the holes of rounding errors that differences leave
    opened = shape.buffer(-cell / 2, join_style="mitre").buffer(cell / 2, join_style="mitre")
    return opened if not opened.is_empty else shape
