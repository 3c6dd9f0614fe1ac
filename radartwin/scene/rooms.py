"""Procedural rooms with known truth. World frame: origin on the floor, x along the room, y to the left, z up; metres.

`lab` is the room of the turntable and rail experiments. The paper names its instruments, not its dimensions, so size
and furniture are an ordinary laboratory's: each is a parameter or a named surface that can be left out. Walls, floor
and ceiling are single-sided rectangles facing into the room; window and door fill openings in their walls, so no two
surfaces overlap. Furniture is closed boxes that keep 1 cm from floor and walls, because faces in contact
shadow each other at the tracer's ray offset (up to 1 mm at 10 m, see physics.md).

Layers are building practice: 12.5 mm plasterboard on 75 mm studs, 4-16-4 mm double glazing, an 8 mm floor on concrete,
15 mm ceiling board, a 40 mm door leaf, 25 mm chipboard table tops.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import trimesh

from radartwin.errors import SceneError
from radartwin.materials import Layered
from radartwin.scene import objects
from radartwin.scene.scene import Scene, Surface
from radartwin.scene.trajectory import look_at, pose

Detail = Literal["shell", "furnished", "cluttered"]
DETAILS: tuple[Detail, ...] = ("shell", "furnished", "cluttered")

STUD_WALL = Layered([("plasterboard", 0.0125), ("air", 0.075), ("plasterboard", 0.0125)])
FLOOR = Layered([("floorboard", 0.008)], backing="concrete")
CEILING = Layered([("ceiling_board", 0.015)])
DOUBLE_GLAZING = Layered([("glass", 0.004), ("air", 0.016), ("glass", 0.004)])
DOOR_LEAF = Layered([("wood", 0.04)])
TABLE_TOP = Layered([("chipboard", 0.025)])
SHELF_BOARD = Layered([("chipboard", 0.018)])

GAP = 0.01  # between furniture and what it stands on or leans against, metres
CLUTTER = (
    "monitor",
    "cardboard_box",
    "waste_bin",
    "stool_seat",
    "extinguisher",
)  # what "cluttered" adds and a scan may miss


@dataclass(frozen=True)
class Bench:
    """Where the measurement stands: the sensor looks level along the room, targets stand on its boresight.

    Attributes:
        sensor_pose: (4, 4) sensor-to-world.
    """

    sensor_pose: np.ndarray

    def target_position(self, distance_m: float) -> np.ndarray:
        """Point (3,) on the boresight, at the radar's height."""
        return self.sensor_pose[:3, 3] + distance_m * self.sensor_pose[:3, 0]


def lab_bench(height_m: float = 1.0, wall_distance_m: float = 1.0) -> Bench:
    """The lab's bench: sensor on the long axis, `wall_distance_m` in front of the back wall, looking along +x.

    With the default room, targets at 0.5 to 2 m stand clear, and furniture and walls return between 2 and 6 m.
    """
    position = np.array([wall_distance_m, 0.0, height_m])
    return Bench(look_at(position, position + np.array([1.0, 0.0, 0.0])))


def lab(size_m: Sequence[float] = (6.0, 5.0, 2.8), detail: Detail = "furnished") -> Scene:
    """A laboratory, x in [0, length], y in [-width/2, width/2], z in [0, height].

    Args:
        size_m: length, width, height; furniture keeps its size and its place against the walls.
        detail: "shell" (walls, floor, ceiling, window, door), "furnished" (tables, cabinet, shelf, radiator) or
            "cluttered" (also the small items of `CLUTTER`).
    Raises:
        SceneError: too small for the furniture, or an unknown detail.
    """
    if detail not in DETAILS:
        raise SceneError(f"lab: detail is {detail!r}; choose {', '.join(DETAILS)}")
    length, width, height = (float(v) for v in size_m)
    if not (5.0 <= length <= 20 and 4.5 <= width <= 20 and 2.4 <= height <= 8):
        raise SceneError(f"lab: size {length} x {width} x {height} m; at least 5.0 x 4.5 x 2.4, at most 20 x 20 x 8")
    surfaces = _shell(length, width, height)
    if detail != "shell":
        surfaces += _furniture(length, width)
    if detail == "cluttered":
        surfaces += _clutter(length, width)
    return Scene(surfaces, {"room": "lab", "size_m": [length, width, height], "detail": detail})


def empty() -> Scene:
    """Free space: no surfaces; add a target to it."""
    return Scene([], {"room": "empty"})


def support(position: np.ndarray, radius_m: float = 0.15, thickness_m: float = 0.03) -> Scene:
    """A turntable disc on a wooden post, its top centred at `position` (3,): what an object stands on.

    The post is round and thin and the disc ends below the object's base, so that neither faces the radar squarely.
    """
    x, y, top = (float(v) for v in position)
    post = top - thickness_m - 2 * GAP
    if post <= 0:
        raise SceneError(f"support: its top is at z = {top} m, too low for a {thickness_m} m disc above the floor")
    disc = objects.cylinder(radius_m, thickness_m).apply_transform(pose([x, y, top - thickness_m / 2]))
    column = objects.cylinder(0.03, post, 32).apply_transform(pose([x, y, GAP + post / 2]))
    return Scene(
        [
            _truth("turntable", disc, Layered([("hdpe", thickness_m)]), role="object"),
            _truth("stand", column, "wood", role="object"),
        ]
    )


def _shell(length: float, width: float, height: float) -> list[Surface]:
    y = width / 2
    door = (y - 1.7, 0.0, y - 0.8, 2.05)  # along the wall from its right-hand corner, up
    window = (length / 2 - 1.1, 0.9, length / 2 + 0.9, 2.1)
    x_axis, y_axis, z_axis = np.eye(3)
    front, back = np.array([length, y, 0]), np.array([0, -y, 0])
    left, right = np.array([0, y, 0]), np.array([length, -y, 0])
    mirrored = (width - door[2], door[1], width - door[0], door[3])
    return [
        _truth("floor", rectangle([0, -y, 0], x_axis, y_axis, (length, width)), FLOOR),
        _truth("ceiling", rectangle([0, y, height], x_axis, -y_axis, (length, width)), CEILING),
        _truth("wall_front", rectangle(front, -y_axis, z_axis, (width, height), [mirrored]), STUD_WALL),
        _truth("door", rectangle(front, -y_axis, z_axis, (width, height), inset=mirrored), DOOR_LEAF),
        _truth("wall_back", rectangle(back, y_axis, z_axis, (width, height)), STUD_WALL),
        _truth("wall_left", rectangle(left, x_axis, z_axis, (length, height), [window]), STUD_WALL),
        _truth("window", rectangle(left, x_axis, z_axis, (length, height), inset=window), DOUBLE_GLAZING),
        _truth("wall_right", rectangle(right, -x_axis, z_axis, (length, height)), STUD_WALL),
    ]


def rectangle(
    corner: np.ndarray | Sequence[float],
    along: np.ndarray,
    up: np.ndarray,
    size: tuple[float, float],
    openings: Sequence[tuple[float, float, float, float]] = (),
    inset: tuple[float, float, float, float] | None = None,
) -> trimesh.Trimesh:
    """Single-sided rectangle with rectangular openings, facing along x up; no T-junctions.

    Args:
        corner: (3,); along, up: unit vectors; size: metres along both.
        openings: (u0, v0, u1, v1) in metres from the corner, left out.
        inset: only this part instead of the whole: what fills an opening.
    """
    u0, v0, u1, v1 = inset if inset is not None else (0.0, 0.0, *size)
    us = np.unique(np.clip([u0, u1, *(o[k] for o in openings for k in (0, 2))], u0, u1))
    vs = np.unique(np.clip([v0, v1, *(o[k] for o in openings for k in (1, 3))], v0, v1))
    along, up, corner = np.asarray(along, float), np.asarray(up, float), np.asarray(corner, float)
    vertices = corner + us[:, None, None] * along + vs[None, :, None] * up
    index = np.arange(len(us) * len(vs)).reshape(len(us), len(vs))
    faces = []
    for i, j in np.ndindex(len(us) - 1, len(vs) - 1):
        u, v = (us[i] + us[i + 1]) / 2, (vs[j] + vs[j + 1]) / 2
        if not any(o[0] < u < o[2] and o[1] < v < o[3] for o in openings):
            a, b, c, d = index[i, j], index[i + 1, j], index[i + 1, j + 1], index[i, j + 1]
            faces += [[a, b, c], [a, c, d]]
    flat = vertices.reshape(-1, 3)
    normals = np.tile(np.cross(along, up), (len(flat), 1))
    return trimesh.Trimesh(flat, np.array(faces), vertex_normals=normals, process=False)


def _furniture(length: float, width: float) -> list[Surface]:
    y = width / 2
    cabinet = objects.box([length - 0.45 - GAP, y - 1.1, GAP], [length - GAP, y - 0.2, 1.9])
    radiator = objects.box([length / 2 - 0.8, y - 0.12, 0.15], [length / 2 + 0.6, y - 0.03, 0.75])
    return [
        *_table("table_left", length - 2.1, y - 1.9, 0.8, 1.6),
        *_table("table_right", length - 2.4, -y + 0.1, 1.6, 0.8),
        _truth("cabinet", cabinet, "metal"),
        _truth("shelf", _shelf(length - 0.3 - GAP, y - 2.1, 0.3, 0.8), SHELF_BOARD),
        _truth("radiator", radiator, "metal"),
    ]


def _table(name: str, x: float, y: float, depth: float, width: float, height: float = 0.74) -> list[Surface]:
    """A top and four square metal legs; the legs stop 5 mm under the top, see the module's note on contact."""
    top = objects.box([x, y, height - 0.025], [x + depth, y + width, height])
    side, inset = 0.04, 0.03
    legs = [
        objects.box([u, v, GAP], [u + side, v + side, height - 0.03])
        for u in (x + inset, x + depth - inset - side)
        for v in (y + inset, y + width - inset - side)
    ]
    return [_truth(f"{name}_top", top, TABLE_TOP), _truth(f"{name}_legs", objects.joined(legs), "metal")]


def _shelf(x: float, y: float, depth: float, width: float, height: float = 1.8, boards: int = 5) -> trimesh.Trimesh:
    """An open shelf along y: two sides and evenly spaced boards between them."""
    t, gap = 0.018, 0.005
    parts = [objects.box([x, v, GAP], [x + depth, v + t, height]) for v in (y, y + width - t)]
    for z in np.linspace(0.08, height - t, boards):
        parts.append(objects.box([x, y + t + gap, z], [x + depth, y + width - t - gap, z + t]))
    return objects.joined(parts)


def _clutter(length: float, width: float) -> list[Surface]:
    y = width / 2
    table_left, table_right = (length - 2.1, y - 1.9), (length - 2.4, -y + 0.1)
    x, v = table_left
    monitor = objects.box([x + 0.5, v + 0.5, 0.85], [x + 0.54, v + 1.05, 1.2])
    x, v = table_right
    carton = objects.box([x + 0.3, v + 0.2, 0.74 + GAP], [x + 0.7, v + 0.5, 1.0])
    waste = objects.cylinder(0.14, 0.35, 32).apply_transform(pose([x + 1.9, v + 0.3, 0.175 + GAP]))
    seat = objects.cylinder(0.17, 0.03, 32).apply_transform(pose([length - 2.6, 1.0, 0.48]))
    bottle = objects.cylinder(0.08, 0.5, 48).apply_transform(pose([length - 0.15, -y + 0.3, 1.1]))
    items = (monitor, carton, waste, seat, bottle)
    stuff = ("glass", Layered([("wood", 0.004)]), "metal", "wood", "metal")  # corrugated board: closest to thin wood
    return [_truth(name, mesh, material) for name, mesh, material in zip(CLUTTER, items, stuff, strict=True)]


def _truth(name: str, mesh: trimesh.Trimesh, material: str | Layered, role: Literal["object", "room"] = "room") -> Surface:
    return Surface(mesh, material, name, role=role, provenance={"source": "true"})
