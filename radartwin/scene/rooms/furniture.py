"""Build furniture from closed boxes with outward normals and gaps of a few millimetres between the boxes.

Boxes never touch, because faces in contact would shadow each other: the ray tracer starts each ray at a distance from its face (up to 1 mm
at coordinates of 10 m). Table legs end 5 mm below the table top, and all furniture stands at a distance of 1 cm (`GAP`) from floor and
walls. Every box is at least 12 mm thick, because the ray tracer traces faces narrower than 10 mm by ray tubes instead of flat faces with
edges.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
import trimesh

from radartwin.scene import objects
from radartwin.scene.rooms.parts import GAP, surface
from radartwin.scene.scene import Surface

JOINT = 0.005  # gap in metres between the parts of a piece of furniture


def table(
    name: str,
    corner: tuple[float, float],
    size: tuple[float, float],
    height: float = 0.74,
    floor: float = 0.0,
    top: str = "table top",
    legs: str = "dark metal",
) -> list[Surface]:
    """Build a table: a top of `size` (x, y) with its corner of smallest x and y at `corner`, on metal legs.

    The legs end at the distance GAP above the height `floor`. All lengths are in metres.
    """
    (x, y), (depth, width) = corner, size
    board = objects.box([x, y, height - 0.025], [x + depth, y + width, height])
    side, inset = 0.04, 0.03
    posts = [
        objects.box([u, v, floor + GAP], [u + side, v + side, height - 0.03])
        for u in (x + inset, x + depth - inset - side)
        for v in (y + inset, y + width - inset - side)
    ]
    return [surface(f"{name}_top", board, top), surface(f"{name}_legs", objects.joined(posts), legs)]


def shelf(x: float, y: float, depth: float, width: float, height: float = 1.8, boards: int = 5) -> trimesh.Trimesh:
    """Build an open shelf whose width is along y: two sides with evenly spaced boards between them."""
    t, gap = 0.018, JOINT
    parts = [objects.box([x, v, GAP], [x + depth, v + t, height]) for v in (y, y + width - t)]
    for z in np.linspace(0.08, height - t, boards):
        parts.append(objects.box([x, y + t + gap, z], [x + depth, y + width - t - gap, z + t]))
    return objects.joined(parts)


def sofa(name: str, low: Sequence[float], high: Sequence[float], back: str, finish: str = "fabric") -> list[Surface]:
    """Build a sofa or armchair on metal feet, within the rectangle from `low` (x, y) to `high` (x, y).

    Args:
        back: side on which the backrest stands: "-x", "+x", "-y" or "+y".
    """
    axis, sign = "xy".index(back[1]), 1 if back[0] == "+" else -1
    corner, size = np.asarray(low, float), np.asarray(high, float) - np.asarray(low, float)
    across = 1 - axis
    arm, depth, seat, top, rest = 0.16, 0.2, 0.42, 0.62, 0.82

    def part(span: tuple[float, float], run: tuple[float, float], z: tuple[float, float]) -> trimesh.Trimesh:
        """Build a box from its extents: `span` along the backrest, `run` perpendicular to the backrest, and `z`.

        `span` and `run` are measured in metres from the side of smaller x or y.
        """
        a, b = np.zeros(2), np.zeros(2)
        a[across], b[across] = span
        a[axis], b[axis] = run if sign > 0 else (size[axis] - run[1], size[axis] - run[0])
        return objects.box([*(corner + a), z[0]], [*(corner + b), z[1]])

    wide, deep = size[across], size[axis]
    inner = (arm + JOINT, wide - arm - JOINT)
    cushions = max(1, round((inner[1] - inner[0]) / 0.75))
    edges = np.linspace(*inner, cushions + 1)
    front = (0.02, deep - depth - JOINT)
    body = [
        part((0, arm), (0, deep), (0.13, top)),
        part((wide - arm, wide), (0, deep), (0.13, top)),
        part(inner, (0.04, deep - depth - JOINT), (0.13, 0.28)),
        part(inner, (deep - depth, deep), (0.13, rest)),
    ]
    for a, b in itertools.pairwise(edges):
        body.append(part((a + JOINT, b - JOINT), front, (0.285, seat)))
        body.append(part((a + JOINT, b - JOINT), (deep - depth - 0.16, deep - depth - JOINT), (seat + JOINT, rest - 0.03)))
    feet = [part((u, u + 0.05), (v, v + 0.05), (GAP, 0.125)) for u in (0.04, wide - 0.09) for v in (0.04, deep - 0.09)]
    return [surface(name, objects.joined(body), finish), surface(f"{name}_feet", objects.joined(feet), "dark metal")]


def planter(name: str, x: float, y: float, side: float = 0.5, height: float = 0.5, tall: float = 1.1) -> list[Surface]:
    """Build a planter centred at (x, y): a brick box with soil and a shrub."""
    h, t = side / 2, 0.06
    walls = [
        objects.box([x - h, y - h, GAP], [x - h + t, y + h, height]),
        objects.box([x + h - t, y - h, GAP], [x + h, y + h, height]),
        objects.box([x - h + t + JOINT, y - h, GAP], [x + h - t - JOINT, y - h + t, height]),
        objects.box([x - h + t + JOINT, y + h - t, GAP], [x + h - t - JOINT, y + h, height]),
    ]
    soil = objects.box([x - h + t + JOINT, y - h + t + JOINT, GAP], [x + h - t - JOINT, y + h - t - JOINT, height - 0.05])
    return [
        surface(name, objects.joined(walls), "brick"),
        surface(f"{name}_soil", soil, "soil"),
        surface(f"{name}_shrub", shrub(np.array([x, y, height]), tall, 0.55 * side), "foliage"),
    ]


def shrub(base: np.ndarray, height: float, spread: float) -> trimesh.Trimesh:
    """Build a shrub on the point `base` (3,) as an eight-sided body that is widest at a third of its height.

    All edges of the shrub have angles of 30 degrees or more, so that the ray tracer treats its faces as flat, like those of all furniture.
    """
    azimuth = np.pi / 4 * np.arange(8) + np.pi / 8
    around = np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros(8)], axis=1)
    tiers = ((0.03, 0.55 * spread), (0.36 * height, spread), (height - 0.15, 0.3 * spread))
    rings = [base + [0, 0, z] + radius * around for z, radius in tiers]
    sides = [[low[k], low[(k + 1) % 8], high[(k + 1) % 8], high[k]] for low, high in itertools.pairwise(rings) for k in range(8)]
    return objects.flat([*sides, rings[0][::-1], rings[-1]])


def railing(low: Sequence[float], high: Sequence[float]) -> trimesh.Trimesh:
    """Build a metal railing of 1 m height along x or y from `low` to `high` (x, y), in metres.

    The railing has five posts of 40 mm width, five bars between two posts, and a handrail.
    """
    height = 1.0
    axis = int(np.argmax(np.subtract(high, low)))
    across = 1 - axis
    places = np.linspace(low[axis] + 0.02, high[axis] - 0.02, 5)

    def bar(start: float, stop: float, half: float, bottom: float, top: float) -> trimesh.Trimesh:
        a, b = np.zeros(3), np.zeros(3)
        a[axis], b[axis] = start, stop
        a[across], b[across] = low[across] - half, low[across] + half
        a[2], b[2] = bottom, top
        return objects.box(a.tolist(), b.tolist())

    parts = [bar(place - 0.02, place + 0.02, 0.02, GAP, height - 0.05) for place in places]
    for start, stop in zip(places[:-1] + 0.02 + JOINT, places[1:] - 0.02 - JOINT, strict=True):
        parts += [bar(start, stop, 0.01, z, z + 0.02) for z in np.linspace(0.15, height - 0.2, 5)]
    parts.append(bar(low[axis], high[axis], 0.025, height - 0.045, height))
    return objects.joined(parts)
