"""Segments become surfaces: flat ones polygons of few triangles, the rest smooth meshes of few faces.

A plane and what was cut from it by colour (a door in a wall) are outlined together and share their borders; what stands proud of it, as a
poster on a board does, keeps its offset.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import trimesh

from radartwin.reconstruct.distance import covered
from radartwin.reconstruct.outlines import outline
from radartwin.reconstruct.outlines.complete import complete, spanned, within
from radartwin.reconstruct.outlines.flatten import regular
from radartwin.reconstruct.outlines.grid import Grid
from radartwin.reconstruct.outlines.visibility import Cameras, Sight
from radartwin.reconstruct.segmentation import masks
from radartwin.reconstruct.segmentation.bodies import contacts, shell
from radartwin.reconstruct.segmentation.faces import Faces, Segment, thinned

if TYPE_CHECKING:
    from shapely.geometry.base import BaseGeometry

CELL_M = 0.02
CLOSING_M = 0.06  # gaps of noise narrower than twice this are closed
SEAM_M = 0.1  # shorter seams are no neighbours
COPLANAR = np.cos(np.radians(4.0))
COPLANAR_M = 0.03
PROUD_M = 0.01  # what stands off its plane by more keeps its offset: +-1 cm on things over 10 cm (Luetzenburg et al. 2021)
LEAST_SHELL, LEAST_THING = 0.6, 0.85  # of the rectangle it spans that a plane covers before the rest is thought to be there

_Room = tuple[float, np.ndarray, Sight]  # main direction, thinned points, lines of sight


@dataclass(frozen=True, eq=False)
class Flat:
    """What stands for a planar segment.

    Attributes:
        segment: its index; -1 for a pane that was not seen.
        mesh: triangles on its plane.
        grid: of its plane.
        parent: segment the pane lies in, or -1.
        filled_m2: area that was not seen and is taken to go on.
        seen: mask of the grid's cells that the scan has, None where it has none of them.
    """

    segment: int
    mesh: trimesh.Trimesh
    grid: Grid
    parent: int = -1
    filled_m2: float = 0.0
    seen: np.ndarray | None = None


@dataclass(eq=False)
class Flattened:
    """Polygons of all planar segments, and what flattening did."""

    flats: list[Flat] = field(default_factory=list)
    segments: list[Segment] = field(default_factory=list)
    statistics: dict[str, Any] = field(default_factory=dict)


def flattened(
    mesh: trimesh.Trimesh, segments: Sequence[Segment], cameras: Cameras | None = None, step: Callable[[], None] = lambda: None
) -> Flattened:
    """Polygons for the planar segments.

    Args:
        cameras: where the pictures were taken, if that is known.
        step: called after every plane.
    """
    faces = Faces.of(mesh, 0.0)
    bounds = shell(faces, segments)
    segments, main = regular(mesh, segments)
    points = faces.centre[thinned(faces.centre)]
    sight = Sight.of(points, cameras)
    touching = [(i, j) for i, j, length, _ in contacts(faces, segments) if length >= SEAM_M]
    out = Flattened(segments=list(segments))
    distance: list[np.ndarray] = []
    filled = opened = 0.0
    for group in _groups(faces, segments, touching):
        root = segments[group[0]]
        proud = {k: _proud(faces, segments[k], root) for k in group}
        for k in group:
            assert root.normal is not None
            out.segments[k] = replace(segments[k], normal=root.normal, offset_m=root.offset_m + proud[k])
            distance.append(faces.centre[segments[k].faces] @ root.normal - root.offset_m - proud[k])
        flats, more, gaps = _outlined(faces, segments, group, bounds, touching, (main, points, sight))
        for flat in flats:
            if lift := proud.get(flat.segment, 0.0):
                flat.mesh.apply_translation(lift * np.asarray(root.normal))
        out.flats += flats
        filled, opened = filled + more, opened + gaps
        step()
    moved = np.concatenate(distance) if distance else np.zeros(1)
    out.statistics = {
        "flattening_rms_m": float(np.sqrt(np.mean(moved**2))),
        "flattening_max_m": float(np.abs(moved).max()),
        "filled_m2": filled,
        "open_m2": opened,
    }
    return out


def _groups(faces: Faces, segments: Sequence[Segment], touching: Sequence[tuple[int, int]]) -> list[list[int]]:
    """Planar segments, each with the touching smaller ones in its plane, largest first."""
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
        own = segments[k]
        members = [k]
        for j in sorted(near.get(k, ()), key=lambda j: -segments[j].area_m2):
            other = segments[j]
            if (
                j in taken
                or other.normal is None
                or own.normal is None
                or other.area_m2 > own.area_m2
                or other.normal @ own.normal < COPLANAR
            ):
                continue
            at = np.average(faces.centre[other.faces], axis=0, weights=faces.area[other.faces])
            if abs(at @ own.normal - own.offset_m) < COPLANAR_M:
                members.append(j)
        taken.update(members)
        groups.append(members)
    return groups


def _proud(faces: Faces, segment: Segment, root: Segment) -> float:
    """How far a segment stands off the plane of the root it lies in, metres; 0 where that may be noise."""
    if segment is root:
        return 0.0
    away = float(np.average(faces.centre[segment.faces] @ root.normal - root.offset_m, weights=faces.area[segment.faces]))
    return away if abs(away) > PROUD_M else 0.0


def _outlined(
    faces: Faces, segments: Sequence[Segment], group: list[int], bounds: np.ndarray, touching: Sequence[tuple[int, int]], room: _Room
) -> tuple[list[Flat], float, float]:
    """Polygons of one plane and what was cut from it: (flats, area filled, area left open)."""
    main, points, sight = room
    root = segments[group[0]]
    assert root.normal is not None
    together = np.concatenate([segments[k].faces for k in group])
    edge = float(np.sqrt(2 * np.median(faces.area[together])))
    cell = float(np.clip(0.8 * edge, CELL_M, 0.05))
    samples = {k: covered(faces.corners[segments[k].faces], 0.7 * cell)[0] for k in group}
    grid = Grid.around(np.vstack(list(samples.values())), root.normal, root.offset_m, cell)
    turn = _turn(grid, root.normal, main, np.vstack(list(samples.values())), bool(bounds[group[0]]))
    if turn:
        grid = Grid.around(np.vstack(list(samples.values())), root.normal, root.offset_m, cell, turn)
    radius = max(CLOSING_M, 1.5 * cell)
    parts = _shared(grid, samples)
    whole = masks.closed(np.any([masks.closed(grid.cells(p), radius / cell) for p in samples.values()], axis=0), radius / cell)
    limits = bool(bounds[group[0]])
    frame = spanned(whole, LEAST_SHELL if limits else LEAST_THING)
    if limits and frame is not None:
        walls = [(s.normal, s.offset_m) for k, s in enumerate(segments) if bounds[k] and k not in group and s.normal is not None]
        frame = within(grid, frame, whole, walls)
        whole &= frame
    done = complete(grid, whole, points, frame, sight if limits and root.normal[2] < 0.5 else None)

    members = set(group)
    around = {j if i in members else i for i, j in touching if (i in members) != (j in members)}
    cuts = [
        outline.meeting_line(grid, s.normal, s.offset_m)
        for k, s in enumerate(segments)
        if s.normal is not None and k not in members and (k in around or bounds[k])
    ]
    lines = [line for line in cuts if line is not None]
    rest = outline.polygon(grid, done.mask, lines)
    flats: list[Flat] = []
    for pane in done.panes:
        shape = outline.polygon(grid, masks.closed(pane, 1), lines, edge=0.5)
        piece = outline.triangulated(grid, shape)
        if piece is not None:
            flats.append(Flat(-1, piece, grid, group[0], float(shape.area)))
            rest = rest.difference(shape)
    for k in group[1:]:
        # Beyond the plane's own border, which `rest` has, it goes on.
        part = masks.closed(parts[k], radius / cell) & ~np.any([parts[j] for j in group if j != k], axis=0)
        part |= masks.dilated(part, 2, part | ~whole)
        shape = (outline.rectangle(grid, part) or outline.polygon(grid, part, lines, edge=0.0)).intersection(rest)
        piece = outline.triangulated(grid, shape)
        if piece is not None:
            flats.append(Flat(k, piece, grid))
            rest = rest.difference(shape)
    piece = outline.triangulated(grid, _cleaned(rest, cell))
    if piece is not None:
        flats.append(Flat(group[0], piece, grid, filled_m2=done.filled_m2, seen=whole))
    return flats, done.filled_m2, done.open_m2


def _shared(grid: Grid, samples: dict[int, np.ndarray]) -> dict[int, np.ndarray]:
    """Mask of each segment's cells; one that several have part of is the one's with most of it."""
    counts = np.stack([grid.counts(points) for points in samples.values()])
    most = counts.argmax(axis=0)
    return {k: (counts[n] > 0) & (most == n) for n, k in enumerate(samples)}


def _turn(grid: Grid, normal: np.ndarray, main: float, points: np.ndarray, limits: bool) -> float:
    """Angle from the grid's axes to the plane's main direction."""
    if abs(normal[2]) < np.cos(np.radians(10.0)):
        return 0.0  # level and upwards is what upright and slanted things follow
    east = np.array([np.cos(main), np.sin(main), 0.0]) @ grid.axes.T
    room = float(np.arctan2(east[1], east[0]))
    if limits:
        return room
    from shapely import MultiPoint

    rectangle: Any = MultiPoint(points @ grid.axes.T).minimum_rotated_rectangle
    if rectangle.geom_type != "Polygon":
        return room
    box = np.array(rectangle.exterior.coords)
    side = box[1] - box[0]
    own = float(np.arctan2(side[1], side[0]))
    apart = (own - room + np.pi / 4) % (np.pi / 2) - np.pi / 4
    return room if abs(apart) < np.radians(5.0) else own


def _cleaned(shape: BaseGeometry, cell: float) -> BaseGeometry:
    """Without the slivers that cutting leaves: nothing narrower than a cell, corners kept."""
    opened = shape.buffer(-cell / 2, join_style="mitre").buffer(cell / 2, join_style="mitre")
    return opened if not opened.is_empty else shape
