"""Place the objects of a layout in a scene. An impossible placement raises an error whose message gives the reason, such as an overlap."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from radartwin.errors import LayoutError
from radartwin.scene.collision import overlap_m, top_below
from radartwin.scene.layouts.anchor import MAX_TILT_DEG, Anchor, find, floor, supports, words
from radartwin.scene.layouts.layout import Item, Layout, Relation
from radartwin.scene.layouts.spots import spots
from radartwin.scene.layouts.stock import from_mesh, stock
from radartwin.scene.scene import Scene, Surface
from radartwin.scene.trajectories.trajectory import pose

FLOATING_M = 0.02  # largest height above the supporting surface; a higher object floats
COVER_M = 0.03  # objects may stand on flat covers up to this thickness, such as a rug
# gap between object and supporting surface; without a gap, the faces would shadow each other, because each ray starts at a distance from
# its face (up to 1 mm at coordinates of 10 m)
GAP_M = 0.005
BASE_M = 0.005  # vertices up to this height above the lowest vertex belong to the base of an object
STANDS_SHARE = 0.5  # smallest fraction of an object's base that must lie on the supporting surface
TILT_RADIUS_M = 0.15  # radius of the region around an object in which the slope of the supporting surface is measured
FINE_FACES = 5000  # a mesh with more faces counts as fine; overlap tests with a fine mesh are slow
_MAX_TRIES = 200  # largest number of candidate positions that are tested for overlaps

Stock = Callable[[str], Sequence[Surface]]


@dataclass(frozen=True, eq=False)
class Body:
    """Hold the surfaces of an object, rotated by its yaw angle about the vertical axis through the object's origin."""

    surfaces: tuple[Surface, ...]
    mesh: trimesh.Trimesh
    base: np.ndarray  # (N, 3), vertices at most BASE_M above the lowest point
    low: np.ndarray  # (N, 3), sample points of the faces at most COVER_M above the lowest point
    radius_m: float  # largest horizontal distance of a base vertex from the object's origin

    @classmethod
    def of(cls, surfaces: Sequence[Surface], yaw_deg: float) -> Body:
        yaw = np.array(trimesh.transformations.rotation_matrix(np.radians(yaw_deg), [0, 0, 1]))
        rotated = tuple(s.moved(yaw) for s in surfaces)
        mesh: Any = trimesh.util.concatenate([trimesh.Trimesh(s.mesh.vertices, s.mesh.faces, process=False) for s in rotated])
        vertices = np.asarray(mesh.vertices)
        bottom = vertices[:, 2].min()
        base = vertices[vertices[:, 2] < bottom + BASE_M]
        return cls(rotated, mesh, base, _samples_below(mesh, bottom + COVER_M), float(np.linalg.norm(base[:, :2], axis=1).max()))


def furnish(scene: Scene, layout: Layout, sensor_pose: np.ndarray | None = None, make: Stock = stock) -> Scene:
    """Add the objects of a layout to a scene.

    Args:
        sensor_pose: (4, 4) sensor-to-world pose, needed only if an object is placed relative to the sensor.
        make: function that returns the surfaces of an object, given the object's name, in the object's own frame (z up, front towards +x);
            by default the function builds catalogue objects.
    Returns:
        A new scene with the surfaces of the objects added at the end. In each added surface, provenance["layout"] describes the
            position of the object.
    Raises:
        LayoutError: the name of an object or surface is unknown or ambiguous, or an object overlaps a surface, floats, or is outside the
            room.
    """
    for item in layout.items:
        scene = scene + Scene(_placed(item, scene, sensor_pose, make))
    return scene


def _placed(item: Item, scene: Scene, sensor_pose: np.ndarray | None, make: Stock) -> list[Surface]:
    if item.is_mesh:
        assert item.material is not None
        parts = from_mesh(item.object, item.material, item.unit, item.up)
    else:
        parts = make(item.object)
    body = Body.of(parts, item.yaw_deg)
    name = _free_name(item, scene)
    if item.position_m is not None and len(item.position_m) == 3:
        at, below = _at_height(item, body, scene, name)
        _check(body, at, scene, name)
    elif item.position_m is not None:
        possible = [floor(scene)] if item.on is None else supports(item.on, scene, sensor_pose)
        if len(possible) > 1:
            raise LayoutError(f"'{item.on}' may be {' or '.join(s.name for s in possible)}; name one of them")
        support = possible[0]
        at, below = _standing(body, np.array(item.position_m), support, scene, name), support.name
        _check(body, at, scene, name)
    else:
        at, below = _related(item, body, scene, sensor_pose, name)
    what = Path(item.object).name if item.is_mesh else item.object
    where = f"{what} on {below}" if below else f"{what}, held"
    return [s.moved(at).replaced(name=name, provenance={**s.provenance, "layout": where}) for s in body.surfaces]


def _free_name(item: Item, scene: Scene) -> str:
    """Return the name of a placed object: the item's own name, or else the catalogue name, with a number if the catalogue name is taken."""
    taken = set(scene.names)
    if item.name:
        if item.name in taken:
            raise LayoutError(f"'{item.name}' is in the scene already; give the {item.object} another name")
        return item.name
    stem = "_".join(words(Path(item.object).stem if item.is_mesh else item.object))
    return next(n for n in itertools.chain([stem], (f"{stem}_{k}" for k in itertools.count(2))) if n not in taken)


def _at_height(item: Item, body: Body, scene: Scene, name: str) -> tuple[np.ndarray, str]:
    """Return the pose of an object of given x, y and height, and the name of the surface below it; empty if held or without a room."""
    assert item.position_m is not None
    x, y, z = item.position_m
    lift = pose([x, y, z - body.base[:, 2].min()])
    _check_inside(body.mesh.copy().apply_transform(lift), scene, name)
    if item.held or not len(scene.only("room")):
        return lift, ""
    tops = [float(top_below(s.mesh, body.base[:, :2] + [x, y], z + GAP_M).max()) for s in scene]
    top, below = max(tops), scene.surfaces[int(np.argmax(tops))]
    if not np.isfinite(top):
        raise LayoutError(f"'{name}' at ({x:g}, {y:g}, {z:g}) m has nothing below it; move it over the floor, or set held: true")
    if z - top > FLOATING_M:
        remedy = f"put it at z = {top:.3f}, or set held: true if its support is not modelled"
        raise LayoutError(f"'{name}' floats {z - top:.3f} m above {below.name}; {remedy}")
    standing = _standing(body, np.array([x, y]), below, scene, name, top + GAP_M)
    return lift if standing[2, 3] < lift[2, 3] else standing, below.name


def _standing(body: Body, at: np.ndarray, support: Surface, scene: Scene, name: str, limit_m: float = np.inf) -> np.ndarray:
    """Return the pose of an object that stands upright on the highest point of its support, and of flat covers on it, such as rugs."""
    heights = top_below(support.mesh, body.base[:, :2] + at, limit_m)
    if not np.isfinite(heights).any():
        raise LayoutError(f"'{name}' at ({at[0]:.3g}, {at[1]:.3g}) m is not over {support.name}, which {_extent(support)}")
    tilt_deg = _tilt_deg(support, at, limit_m)
    if tilt_deg > MAX_TILT_DEG:
        where = f"{support.name} is tilted by {tilt_deg:.1f} degrees at ({at[0]:.3g}, {at[1]:.3g}) m"
        raise LayoutError(f"{where}, but objects slide above {MAX_TILT_DEG:g} degrees; choose another place")
    share = float((heights > heights.max() - FLOATING_M).mean())
    if share < STANDS_SHARE:
        raise LayoutError(f"'{name}' has only {share:.0%} of its base on {support.name}, which {_extent(support)}; move it inwards")
    covers = [top_below(s.mesh, body.low[:, :2] + at, heights.max() + COVER_M) for s in scene if s is not support]
    cover = np.max([np.full(len(body.low), -np.inf), *covers], axis=0)
    return pose([*at, max(float((cover - body.low[:, 2]).max()), float((heights - body.base[:, 2]).max())) + GAP_M])


def _tilt_deg(support: Surface, at: np.ndarray, limit_m: float) -> float:
    """Return the tilt in degrees of a supporting surface around a point (x, y); 0 if the surface is not flat around this point."""
    angle = 2 * np.pi * np.arange(24) / 24
    ring = TILT_RADIUS_M * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    points = np.vstack([share * ring for share in (0.33, 0.66, 1.0)])
    z = top_below(support.mesh, at + points, limit_m + TILT_RADIUS_M)
    known = np.isfinite(z)
    if known.any():
        known &= z > np.median(z[known]) - TILT_RADIUS_M  # leave out lower parts of the same surface
    if known.sum() < 12:
        return 0.0
    columns = np.column_stack([points[known], np.ones(known.sum())])
    plane = np.linalg.lstsq(columns, z[known], rcond=None)[0]
    if np.std(z[known] - columns @ plane) > 0.01:  # on a stepped support the object stands on the highest step
        return 0.0
    return float(np.degrees(np.arctan(np.hypot(*plane[:2]))))


def _samples_below(mesh: trimesh.Trimesh, limit_m: float) -> np.ndarray:
    """Return sample points (N, 3), at most a centimetre apart, of the part of a mesh below the height `limit_m`."""
    low = np.asarray(mesh.triangles)[:, :, 2].min(axis=1) < limit_m
    points = trimesh.remesh.subdivide_to_size(mesh.vertices, mesh.faces[low], 0.01, max_iter=20)[0]
    return points[points[:, 2] < limit_m]


def _related(item: Item, body: Body, scene: Scene, sensor_pose: np.ndarray | None, name: str) -> tuple[np.ndarray, str]:
    """Return the best free pose of an object that is placed by `on` or by relations, and the name of its supporting surface."""
    choices = [[(relation, a) for a in find(relation.anchor, scene, sensor_pose)] for relation in item.relations]
    on = None if item.on is None else supports(item.on, scene, sensor_pose)
    possible: list[tuple[Surface, tuple[tuple[Relation, Anchor], ...], np.ndarray]] = []
    for related in itertools.product(*choices):
        for surface in on if on is not None else [_carrier(related, scene)]:
            positions = spots(surface, body.radius_m, related)
            if len(positions):
                possible.append((surface, related, positions))
    sentence = _sentence(item)
    if not possible:
        raise LayoutError(f"there is no place for the {sentence}; choose another place ({_described(choices, on)})")
    if len(possible) > 1:
        choice = " or ".join(" ".join([f"on {s.name}", *(f"{r.relation} {a.name}" for r, a in related)]) for s, related, _ in possible)
        raise LayoutError(f"the {sentence} may be {choice}; name one of them")
    surface, _, positions = possible[0]
    reason: LayoutError | None = None
    tested = _spread(len(positions))
    for position in _fine_last(positions[tested], body, scene):
        try:
            at = _standing(body, position, surface, scene, name)
            _check(body, at, scene, name)
            return at, surface.name
        except LayoutError as error:
            reason = reason or error
    share = f" among the {len(tested)} tested of {len(positions)} places" if len(tested) < len(positions) else ""
    raise LayoutError(f"there is no free place for the {sentence}{share}: at the best place, {reason}")


def _carrier(related: Sequence[tuple[Relation, Anchor]], scene: Scene) -> Surface:
    """Return the surface on which an object without `on` stands: the support of the object that is its first anchor, or the floor."""
    ground = floor(scene)
    if not related or related[0][1].is_sensor or related[0][0].relation == "under":
        return ground
    anchor = related[0][1]
    if any(s.kind != "object" for s in anchor.surfaces):
        return ground
    low = min(float(s.mesh.bounds[0, 2]) for s in anchor.surfaces)
    middle = anchor.points.mean(axis=0)[None]
    others = [s for s in scene if all(s is not part for part in anchor.surfaces)]
    tops = [float(top_below(s.mesh, middle, low + GAP_M)[0]) for s in others]
    best = int(np.argmax(tops))
    return others[best] if low - tops[best] < FLOATING_M else ground


def _check(body: Body, at: np.ndarray, scene: Scene, name: str) -> None:
    """Raise an error for an object that is outside the room or overlaps a surface."""
    mesh = body.mesh.copy().apply_transform(at)
    _check_inside(mesh, scene, name)
    depths = [(overlap_m(mesh, s.mesh), s.name) for s in scene]
    depth, other = max(depths, default=(0.0, ""))
    if depth > 0:
        raise LayoutError(f"'{name}' overlaps {other} by {depth:.3f} m; move one of them by at least as much")


def _check_inside(mesh: trimesh.Trimesh, scene: Scene, name: str) -> None:
    room = scene.only("room")
    if len(room):
        low, high = room.bounds
        beyond = np.concatenate([low - mesh.bounds[0], mesh.bounds[1] - high])
        if beyond.max() > 0.002:
            side = ("-x", "-y", "-z", "+x", "+y", "+z")[int(np.argmax(beyond))]
            raise LayoutError(f"'{name}' is outside the room: it reaches {beyond.max():.3f} m beyond its {side} end; move it inwards")


def _spread(count: int) -> np.ndarray:
    """Return the indices of the positions to test for overlaps: the best first, then at growing steps down the sorted list."""
    return np.unique(np.round(np.geomspace(1, count, min(count, _MAX_TRIES))).astype(int)) - 1


def _fine_last(places: np.ndarray, body: Body, scene: Scene) -> np.ndarray:
    """Move positions (N, 2) inside the box of a finely meshed object to the end, because their overlap tests are slow."""
    low, high = body.mesh.bounds[:, :2]
    near = np.zeros(len(places), dtype=bool)
    for s in scene:
        if s.kind == "object" and len(s.mesh.faces) > FINE_FACES:
            near |= ((places + high > s.mesh.bounds[0, :2]) & (places + low < s.mesh.bounds[1, :2])).all(axis=1)
    return np.concatenate([places[~near], places[near]])


def _sentence(item: Item) -> str:
    parts = [item.object, *([f"on {item.on}"] if item.on else [])]
    parts += [f"{r.relation} {r.anchor}" if r.distance_m is None else f"{r.distance_m:g} m {r.relation} {r.anchor}" for r in item.relations]
    return " ".join(parts)


def _extent(support: Surface) -> str:
    (x0, y0), (x1, y1) = support.mesh.bounds[:, :2]
    return f"lies at x {x0:.2f} to {x1:.2f}, y {y0:.2f} to {y1:.2f} m"


def _described(choices: Sequence[Sequence[tuple[Relation, Anchor]]], on: Sequence[Surface] | None) -> str:
    """Return a text for an error message with the positions of the anchors and supporting surfaces that an object could refer to."""
    places = [f"{s.name} {_extent(s)}" for s in on or ()]
    for _, anchor in itertools.chain(*choices):
        x, y = (anchor.points.min(axis=0) + anchor.points.max(axis=0)) / 2
        places.append(f"{anchor.name} is at ({x:.2f}, {y:.2f}) and faces ({anchor.front[0]:.2f}, {anchor.front[1]:.2f})")
    return "; ".join(places)
