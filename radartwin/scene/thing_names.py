"""Name the things of a scanned room: what each surface is, and where, such as "wall behind the sofa".

A reconstruction names its surfaces by their geometry alone (wall_2, plane_7). This module guesses the thing from the size, the attitude and
the height of a surface and from its MINC category. Its place is the nearest landmark, a large piece of furniture. The names are for readers
and for sentences that place objects. No simulation depends on them. A surface that no scan made keeps its own name.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import trimesh
from scipy.spatial import KDTree

from radartwin.scene.scene import Scene
from radartwin.scene.surface import Surface

LEVEL, UPRIGHT = 0.9, 0.35  # limits of |z| of the normal of a level and of an upright face
FLOOR_M, HIGH_M = 0.15, 1.8  # the floor ends at this height above the scan's lowest level surface; lamps and beams begin at the other
SHELL_M = 0.4  # a wall is at most this far from a side of the room's bounding box, because walls have alcoves
NEAR_M, NEAR_SHARE = 0.4, 0.1  # a thing is near a landmark if this share of its points is within this horizontal distance
POINTS = 400  # points on a surface that measure horizontal distances
TALL_M, SMALL_M = 1.0, 0.6
TABLE_M2, SEAT_M2, WALL_M2 = 0.3, 0.3, 1.0

MASONRY = {None, "brick", "other", "painted", "polishedstone", "stone", "tile", "wallpaper"}  # MINC categories of walls
CLOTH = {"fabric", "leather"}
RIGID = {"ceramic", "glass", "metal", "plastic", "polishedstone", "stone", "wood"}
ADJECTIVES = {"foliage": "leafy", "polishedstone": "stone", "wood": "wooden", "other": "", None: ""}
LANDMARKS = ("sofa", "bed", "low table", "table", "counter", "bookshelf", "cabinet")


@dataclass(frozen=True)
class Thing:
    """What a surface is, such as "wall", and where it is, such as "behind the sofa"; the place may be empty."""

    category: str
    place: str = ""

    def __str__(self) -> str:
        return f"{self.category} {self.place}".strip()


@dataclass(frozen=True, eq=False)
class _Shape:
    """The box of a surface (heights above the floor), its areas by attitude in m2, the mean height of its upward faces in metres, and
    points on it as seen from above (POINTS, 2).
    """

    low: np.ndarray
    high: np.ndarray
    middle: np.ndarray
    area: float
    up: float
    down: float
    upright: float
    flat: bool
    top_m: float
    plan: np.ndarray

    @classmethod
    def of(cls, surface: Surface, floor_m: float) -> _Shape:
        mesh, lift = surface.mesh, np.array([0.0, 0.0, floor_m])
        area, vertical = np.asarray(mesh.area_faces), np.asarray(mesh.face_normals)[:, 2]
        middle = np.average(mesh.triangles_center, axis=0, weights=np.maximum(area, 1e-12)) - lift
        upward = np.where(vertical > LEVEL, area, 0.0)
        top_m = float(np.average(mesh.triangles_center[:, 2], weights=upward)) - floor_m if upward.any() else 0.0
        up, down, upright = (float(area[chosen].sum()) for chosen in (vertical > LEVEL, vertical < -LEVEL, abs(vertical) < UPRIGHT))
        flat = bool(np.linalg.norm(area @ mesh.face_normals) > 0.85 * area.sum())
        plan = trimesh.sample.sample_surface(mesh, POINTS, seed=0)[0][:, :2]
        low, high = mesh.bounds - lift
        return cls(low, high, middle, float(area.sum()), up, down, upright, flat, top_m, plan)

    @property
    def size(self) -> np.ndarray:
        return self.high - self.low

    def near(self, other: _Shape) -> float:
        """Return the share of this surface that is near another one as seen from above."""
        return float(np.isfinite(KDTree(other.plan).query(self.plan, distance_upper_bound=NEAR_M)[0]).mean())

    def over(self, other: _Shape) -> bool:
        """Return whether the middle of this surface is within the box of another one as seen from above."""
        return bool(((self.middle > other.low) & (self.middle < other.high))[:2].all())


def things(scene: Scene) -> list[Thing]:
    """Return the thing that each surface of a scene is."""
    scanned = [surface for surface in scene if "segment" in surface.provenance]
    floor = next((surface for surface in scanned if surface.name == "floor"), None)
    floor_m = float(floor.mesh.bounds[0, 2]) if floor is not None else float(scene.bounds[0, 2])
    shapes = {id(surface): _Shape.of(surface, floor_m) for surface in scanned}
    room = Scene(scanned).only("room").bounds if scanned else scene.bounds
    categories = {id(surface): _category(surface, shapes[id(surface)], room, floor_m, floor) for surface in scanned}
    landmarks = [(categories[key], shapes[key]) for key in shapes if categories[key] in LANDMARKS]
    of_name = {surface.name: categories[id(surface)] for surface in scanned}

    def thing(surface: Surface) -> Thing:
        if (category := categories.get(id(surface))) is not None:
            return Thing(category, _place(category, shapes[id(surface)], landmarks))
        support = str(surface.provenance.get("layout", "")).partition(" on ")[2]
        if support in of_name:
            return Thing(surface.name.replace("_", " "), f"on the {of_name[support]}")
        return Thing(surface.name)

    return [thing(surface) for surface in scene]


def _category(surface: Surface, shape: _Shape, room: np.ndarray, floor_m: float, floor: Surface | None) -> str:
    """Return what a scanned surface is. `room` is the bounding box (2, 3) of the surfaces of the room in the scene's coordinates."""
    minc = surface.provenance.get("minc")
    adjective = ADJECTIVES.get(minc, str(minc))
    if surface.name in ("floor", "ceiling"):
        return surface.name
    if shape.up > 0.5 * shape.area and shape.middle[2] < FLOOR_M:
        keys = ("minc", "named")
        same = floor is not None and all(surface.provenance.get(key) == floor.provenance.get(key) for key in keys)
        return "rug" if minc in ("carpet", "fabric") and not same else "floor"
    if shape.down > 0.8 * shape.area and shape.low[2] > HIGH_M:
        return "ceiling"
    shell = float(np.minimum(shape.middle - room[0], room[1] - shape.middle)[:2].min()) < SHELL_M
    if shape.middle[2] > HIGH_M and shape.high[2] > room[1, 2] - floor_m - 0.2 and not shell:
        return "beam" if minc in MASONRY or shape.size.max() > TALL_M else "lamp"
    if shape.flat and shape.upright > 0.8 * shape.area:
        return _upright(minc, adjective, shape, shell)
    return _solid(minc, adjective, shape)


def _upright(minc: str | None, adjective: str, shape: _Shape, shell: bool) -> str:
    """Return what a flat upright surface is; `shell` states whether it is at a side of the room."""
    if minc in ("glass", "sky", "mirror"):
        return "mirror" if minc == "mirror" else "window"
    if shell and minc in MASONRY:
        return "wall"
    if shell and minc in CLOTH:
        return "curtain" if shape.size[2] > 1.5 else "wall hanging"
    return f"{adjective} {'wall' if shell and shape.area > WALL_M2 and minc != 'plastic' else 'panel'}".strip()


def _solid(minc: str | None, adjective: str, shape: _Shape) -> str:
    """Return what a surface is that is neither level nor upright as a whole."""
    if minc == "foliage":
        return "plant"
    if minc == "paper" and shape.size[2] > TALL_M:
        return "bookshelf"
    if minc in CLOTH and shape.up > SEAT_M2 and 0.2 < shape.top_m < 0.8:
        wide = shape.size[:2].max() > 1.1
        return ("sofa" if shape.high[2] > shape.top_m + 0.2 else "bed") if wide else "upholstered chair"
    if minc in RIGID and shape.up > TABLE_M2 and shape.high[2] < min(shape.top_m + 0.2, 1.3):
        return "low table" if shape.top_m < 0.6 else "table" if shape.top_m < 0.9 else "counter"
    if minc in RIGID and shape.size[2] > TALL_M and shape.low[2] < 0.3:
        return "cabinet"
    if minc in MASONRY and shape.upright > 0.5 * shape.area:
        return "wall"
    return f"{'small ' if shape.size.max() < SMALL_M else ''}{adjective} object".replace("  ", " ").strip()


def _place(category: str, shape: _Shape, landmarks: Sequence[tuple[str, _Shape]]) -> str:
    """Return where a thing is: on, under, above, behind or beside the nearest landmark of another category; "" without one nearby."""
    others = [(name, other) for name, other in landmarks if name != category]
    if category in ("floor", "ceiling", "beam", "lamp") or not others:
        return ""
    wall = category.split()[-1] in ("wall", "curtain", "hanging", "window", "mirror", "panel")
    shares = [other.near(shape) if wall else shape.near(other) for _, other in others]
    name, nearest = others[int(np.argmax(shares))]
    if max(shares) < NEAR_SHARE:
        return ""
    if wall:
        return f"{'above' if shape.low[2] > nearest.high[2] - 0.1 else 'behind'} the {name}"
    if category in LANDMARKS or not shape.over(nearest):
        return f"beside the {name}"
    if category == "rug" or shape.high[2] < nearest.top_m:
        return f"under the {name}"
    return f"{'on' if shape.low[2] > nearest.top_m - 0.1 else 'beside'} the {name}"
