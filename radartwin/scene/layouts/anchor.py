"""Find the anchor of an object. An anchor is the furniture, wall, earlier object or sensor relative to which an object is placed."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh

from radartwin.errors import LayoutError
from radartwin.scene.layouts.layout import SENSOR_NAMES
from radartwin.scene.scene import Scene, Surface
from radartwin.scene.thing_names import things

# Words at the end of a surface name that denote a part of a larger object (table_top, table_legs).
PARTS = {
    "top", "legs", "leg", "feet", "foot", "soil", "shrub", "frame", "seat", "back", "handle", "body", "contents", "lid", "cap",
    "board", "boards", "side", "sides",
}  # fmt: skip
STANDS_ON_M2 = 0.002  # smallest horizontal area in m^2 on which an object can stand
MAX_TILT_DEG = 15.0  # on a steeper supporting surface an object slides (wood on wood at about 15 degrees)
# an anchor counts as flat if the horizontal part of the sum of its area vectors, divided by its area, is longer than this; its front is
# then its normal
FACING = 0.6
_ARTICLES = {"the", "a", "an", "my", "this", "that"}


@dataclass(frozen=True, eq=False)
class Anchor:
    """Describe an anchor: the furniture, wall, earlier object or sensor relative to which an object is placed.

    Attributes:
        name: name of the anchor in error messages.
        surfaces: surfaces that belong to the anchor; empty for the sensor.
        points: (N, 2) x and y coordinates of the anchor's vertices, metres.
        front: (2,) horizontal unit vector that points out of the front side of the anchor.
        left: (2,) horizontal unit vector to the left of a person who looks at the front of the anchor; if the anchor is the sensor, to the
            sensor's own left.
    """

    name: str
    surfaces: tuple[Surface, ...]
    points: np.ndarray
    front: np.ndarray
    left: np.ndarray

    @property
    def is_sensor(self) -> bool:
        return not self.surfaces


def words(text: str) -> list[str]:
    """Split a name into lower-case words and numbers, and omit articles.

    >>> words("the Table_left-top 2")
    ['table', 'left', 'top', '2']
    """
    return [w for w in re.findall(r"[a-z]+|\d+", text.lower()) if w not in _ARTICLES]


def find(text: str, scene: Scene, sensor_pose: np.ndarray | None) -> list[Anchor]:
    """Find all anchors that `text` may mean: the surface with exactly this name, or else surfaces whose names contain all words of `text`,
    or else the things of a scan (`radartwin.scene.thing_names`) with this name, such as "sofa".

    Parts of the same object (table_left_top, table_left_legs) form a single anchor.

    Raises:
        LayoutError: no surface name matches (the message lists all names), or `text` means the sensor and `sensor_pose` is None.
    """
    wanted = words(text)
    if len(wanted) == 1 and wanted[0] in SENSOR_NAMES:
        if sensor_pose is None:
            raise LayoutError(f"'{text}' means the sensor, but no sensor pose is given; give a sensor pose, or name another thing")
        return [_sensor(np.asarray(sensor_pose, dtype=np.float64).reshape(-1, 4, 4)[0])]
    same = [s for s in scene if s.name == text.strip()] or [s for s in scene if words(s.name) == wanted]
    matching = same or [s for s in scene if wanted and set(wanted) <= set(words(s.name))]
    known = set(scene.names)
    if not matching and wanted:
        named = [(s, thing.category) for s, thing in zip(scene, things(scene), strict=True)]
        known |= {name for _, name in named}
        same = matching = [s for s, name in named if words(name) == wanted] or [s for s, name in named if set(wanted) <= set(words(name))]
    if not matching:
        raise LayoutError(f"the scene has nothing called '{text}'; it has {', '.join(sorted(filter(None, known))) or 'no named surfaces'}")
    groups: dict[str, list[Surface]] = {}
    for surface in matching:
        groups.setdefault(surface.name if same else _without_parts(surface.name), []).append(surface)
    middle = scene.bounds.mean(axis=0)[:2]
    return [_anchor(group, middle) for group in groups.values()]


def supports(text: str, scene: Scene, sensor_pose: np.ndarray | None) -> list[Surface]:
    """Return the surfaces named by `text` on which an object can stand: the part with the largest horizontal area of each matching anchor.

    Raises:
        LayoutError: no surface name matches `text`, or no matching surface has a horizontal area on which an object can stand.
    """
    parts = [max(anchor.surfaces, key=level_area) for anchor in find(text, scene, sensor_pose) if anchor.surfaces]
    level = [part for part in parts if level_area(part) > STANDS_ON_M2]
    if not level:
        raise LayoutError(f"nothing can stand on '{text}': it has no level side; choose another support")
    return level


def level_area(surface: Surface) -> float:
    """Return the area in m^2 of the faces of a surface that are at most MAX_TILT_DEG from horizontal.

    For a closed mesh, only the upper side counts.
    """
    least = np.cos(np.radians(MAX_TILT_DEG))
    upward = np.asarray(surface.mesh.face_normals[:, 2])
    areas = np.asarray(surface.mesh.area_faces)
    up, down = float(areas[upward > least].sum()), float(areas[upward < -least].sum())
    return max(up, down)  # the normals of a scanned surface may point up or down


def floor(scene: Scene) -> Surface:
    """Return the surface named "floor", or else the lowest large horizontal surface of the scene.

    Raises:
        LayoutError: the scene has neither a surface named "floor" nor a large horizontal surface.
    """
    named = [s for s in scene if "floor" in words(s.name)]
    level = named or [s for s in scene if s.kind == "room" and level_area(s) > 1.0]
    if not level:
        raise LayoutError("the scene has no floor for the object; give the key on, or position_m with held: true")
    lowest = min(float(s.mesh.bounds[0, 2]) for s in level)
    return max((s for s in level if s.mesh.bounds[0, 2] < lowest + 0.1), key=level_area)


def _without_parts(name: str) -> str:
    parts = words(name)
    while len(parts) > 1 and parts[-1] in PARTS:
        parts.pop()
    return " ".join(parts)


def _sensor(pose: np.ndarray) -> Anchor:
    forward = pose[:2, 0]
    if np.linalg.norm(forward) < 1e-6:
        raise LayoutError("the sensor looks straight up or down and has no front; name another thing")
    forward = forward / np.linalg.norm(forward)
    return Anchor("the sensor", (), pose[None, :2, 3], forward, np.array([-forward[1], forward[0]]))


def _anchor(surfaces: Sequence[Surface], middle: np.ndarray) -> Anchor:
    points = np.vstack([np.asarray(s.mesh.vertices)[:, :2] for s in surfaces])
    front = _front(surfaces, points, middle)
    name = " and ".join(sorted({s.name for s in surfaces}))
    return Anchor(name, tuple(surfaces), points, front, np.array([front[1], -front[0]]))


def _front(surfaces: Sequence[Surface], points: np.ndarray, middle: np.ndarray) -> np.ndarray:
    """Return the horizontal unit vector (2,) out of an anchor's front side, which is the side towards the middle of the room."""
    from scipy.spatial import QhullError

    centre = (points.min(axis=0) + points.max(axis=0)) / 2
    areas = np.concatenate([s.mesh.area_faces for s in surfaces])
    normals = np.vstack([s.mesh.face_normals for s in surfaces])
    mean = (normals * areas[:, None]).sum(axis=0)[:2] / areas.sum()
    inward = middle - centre
    if np.linalg.norm(mean) > FACING:  # flat and upright
        mean = mean / np.linalg.norm(mean)
        return mean if mean @ inward >= 0 else -mean
    try:
        axes = trimesh.bounds.oriented_bounds_2D(points)[0][:2, :2]
    except (QhullError, ValueError):  # all points lie on a line, as for a wall seen from above
        axes = np.eye(2)
    # the side of the smallest enclosing rectangle that faces the middle of the room best
    return max(np.vstack([axes, -axes]), key=lambda side: (round(float(side @ inward), 6), *side.round(6)))
