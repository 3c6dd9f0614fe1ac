"""Build the parts of procedural rooms: walls with openings, surface finishes with their true materials, and the sensor pose (bench).

A finish is the true description of a surface: material, MINC category, roughness class and texture. `radartwin.materials.roughness` gives
the standard deviation of the height for each roughness class, with its source: painted plaster 0.05 mm, acoustic board 0.3 mm, planed wood
0.03 mm, metal 0.1 mm, concrete 0.3 mm, glass 0. The thicknesses of material layers follow building practice: 12.5 mm plasterboard on 75 mm
studs, 4-16-4 mm double glazing, an 8 mm floor on concrete, 15 mm ceiling board, a 40 mm door leaf, 25 mm chipboard table tops.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
import trimesh

from radartwin.errors import SceneError
from radartwin.materials import Layered, common_sheet, correlation_m, roughness_m
from radartwin.scene import textures
from radartwin.scene.scene import Scene, Surface

Detail = Literal["shell", "furnished", "cluttered"]
DETAILS: tuple[Detail, ...] = ("shell", "furnished", "cluttered")
# u0, v0, u1, v1 in metres, where u is the position along a wall from its corner and v is the height
Opening = tuple[float, float, float, float]

GAP = 0.01  # gap in metres between furniture and the floor or a wall

STUD_WALL = common_sheet("stud wall")
CONCRETE_WALL = Layered([("concrete", 0.20)])
DOOR_LEAF = common_sheet("door")
CLOTH = common_sheet("fabric")  # the foam behind the cloth is nearly air


class Finish(NamedTuple):
    """Hold the true description of a surface: material, roughness and appearance.

    Attributes:
        material: material that the radar simulation uses.
        minc: true category of the surface in the MINC data set of material photographs.
        roughness: roughness class, a name in `radartwin.materials.roughness`.
        look: texture of the surface, a name in `textures.LOOKS`.
        stand_in: whether the material is a substitute, because ITU-R P.2040 has no permittivity fit for the real material at 77 GHz.
    """

    material: str | Layered
    minc: str
    roughness: str
    look: str
    stand_in: bool = False


# Wood panelling is veneered boards on battens, and the floor of the squash court is beech on battens. MINC has no category for ceiling
# boards. Glass replaces porcelain tiles, and thin wood replaces corrugated board, because they are the closest materials in ITU-R P.2040.
# The module materials.minc gives the sources of leather and foliage.
FINISHES: dict[str, Finish] = {
    "plaster wall": Finish(STUD_WALL, "painted", "painted", "plaster"),
    "white wall": Finish(STUD_WALL, "painted", "painted", "white_plaster"),
    "wood panelling": Finish(Layered([("wood", 0.019), ("air", 0.04), ("plasterboard", 0.0125)]), "wood", "wood", "wood_panelling"),
    "court wall": Finish(CONCRETE_WALL, "painted", "concrete", "painted_concrete"),
    "concrete": Finish(CONCRETE_WALL, "stone", "concrete", "concrete"),
    "board floor": Finish(Layered([("floorboard", 0.008)], backing="concrete"), "wood", "floorboard", "floorboards"),
    "court floor": Finish(Layered([("wood", 0.022), ("air", 0.05)], backing="concrete"), "wood", "wood", "court_floor"),
    "tiled floor": Finish(Layered([("glass", 0.010)], backing="concrete"), "tile", "tile", "tiles", stand_in=True),
    "acoustic ceiling": Finish(common_sheet("ceiling_board"), "other", "ceiling_board", "ceiling_board"),
    "window": Finish(common_sheet("double glazing"), "glass", "glass", "glass"),
    "glass leaf": Finish(Layered([("glass", 0.012)]), "glass", "glass", "glass"),
    "wood door": Finish(DOOR_LEAF, "wood", "wood", "wood"),
    "dark wood": Finish(DOOR_LEAF, "wood", "wood", "dark_wood"),
    "table top": Finish(Layered([("chipboard", 0.025)]), "wood", "chipboard", "pale_wood"),
    "shelf": Finish(common_sheet("chipboard"), "wood", "chipboard", "pale_wood"),
    "solid wood": Finish(Layered([], backing="wood"), "wood", "wood", "wood"),
    "metal": Finish("metal", "metal", "metal", "brushed_metal"),
    "dark metal": Finish("metal", "metal", "metal", "dark_metal"),
    "painted metal": Finish("metal", "metal", "metal", "painted_metal"),
    "red metal": Finish("metal", "metal", "metal", "red_metal"),
    "lamp": Finish("metal", "metal", "metal", "lamp"),
    "screen": Finish(Layered([], backing="glass"), "glass", "glass", "monitor"),
    "fabric": Finish(CLOTH, "fabric", "fabric", "fabric", stand_in=True),
    "red fabric": Finish(CLOTH, "fabric", "fabric", "red_fabric", stand_in=True),
    "leather": Finish(Layered([("plasterboard", 0.0012)]), "leather", "leather", "leather", stand_in=True),
    "carpet": Finish(
        Layered([("wood", 0.008)]), "carpet", "carpet", "carpet", stand_in=True
    ),  # the fit of ITU-R P.2040 for carpet tile ends at 40 GHz
    "foliage": Finish(Layered([("detergent", 0.0003)]), "foliage", "foliage", "foliage", stand_in=True),
    # the fit of ITU-R P.2040 for brick ends at 40 GHz, see materials.itu
    "brick": Finish("floorboard", "brick", "brick", "brick", stand_in=True),
    "soil": Finish("concrete", "other", "food", "soil", stand_in=True),
    "paper": Finish(Layered([("wood", 0.001)]), "paper", "paper", "poster", stand_in=True),
    "cardboard": Finish(Layered([("wood", 0.004)]), "paper", "paper", "cardboard", stand_in=True),
    "plastic": Finish(Layered([("hdpe", 0.003)]), "plastic", "plastic", "plastic"),
    "white plastic": Finish(Layered([("hdpe", 0.003)]), "plastic", "plastic", "white_plastic"),
    "turntable": Finish(Layered([("hdpe", 0.03)]), "plastic", "hdpe", "white_plastic"),
}


@dataclass(frozen=True)
class Bench:
    """Hold the sensor pose of an experiment in a room: the sensor looks horizontally along the room, and targets stand on its boresight.

    Attributes:
        sensor_pose: (4, 4) sensor-to-world pose, metres.
    """

    sensor_pose: np.ndarray

    def target_position(self, distance_m: float) -> np.ndarray:
        """Return the world point (3,) on the sensor's boresight at the distance `distance_m` from the sensor."""
        return self.sensor_pose[:3, 3] + distance_m * self.sensor_pose[:3, 0]


def surface(
    name: str,
    mesh: trimesh.Trimesh,
    finish: str,
    role: Literal["object", "room"] = "room",
    *,
    look: str | None = None,
    picture: trimesh.Trimesh | None = None,
    seed: int = 0,
) -> Surface:
    """Build a surface from a mesh and a finish, which defines the true material, roughness, texture and MINC category.

    Args:
        look: name of a texture that replaces the texture of the finish.
        picture: the same mesh with a picture as texture, which replaces the texture of the finish.
    """
    kind = FINISHES[finish]
    textured = picture if picture is not None else textures.textured(mesh, look or kind.look, seed)
    provenance = {"source": "true", "confidence": 1.0, "stand_in": kind.stand_in, "minc": kind.minc}
    return Surface(textured, kind.material, name, roughness_m(kind.roughness), role, provenance, correlation_m(kind.roughness))


def room_scene(
    surfaces: Sequence[Surface], room: str, size_m: Sequence[float], detail: Detail, clutter: Sequence[str] = (), **more: object
) -> Scene:
    """Build the scene of a procedural room, with the parameters of the room in the scene's provenance.

    Args:
        clutter: names of the small items that a scan may miss; the provenance lists the items that the room contains.
    """
    names = {s.name for s in surfaces}
    present = [name for name in clutter if name in names]
    described = {"room": room, "size_m": [float(v) for v in size_m], "detail": detail, "clutter": present, **more}
    return Scene([s.replaced(mesh=_stored(s.mesh)) for s in surfaces], described)


def _stored(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """Return a mesh whose coordinates are float32 numbers, so that a room has the same vertices after it was saved and read."""
    points = np.asarray(mesh.vertices, np.float32)
    return trimesh.Trimesh(points, mesh.faces, vertex_normals=mesh.vertex_normals, visual=mesh.visual, process=False)


def check_options(
    room: str, size_m: Sequence[float], detail: str, least: tuple[float, float, float], most: tuple[float, float, float]
) -> list[float]:
    """Check the options of a procedural room, and return the length, width and height of the room in metres.

    Raises:
        SceneError: `detail` is unknown, `size_m` does not have three numbers, or a number is below `least` or above `most`.
    """
    if detail not in DETAILS:
        raise SceneError(f"{room}: detail is {detail!r}; choose {', '.join(DETAILS)}")
    size = [float(v) for v in size_m]
    bounds = f"at least {least[0]} x {least[1]} x {least[2]}, at most {most[0]:g} x {most[1]:g} x {most[2]:g}"
    if len(size) != 3:
        raise SceneError(f"{room}: size_m has {len(size)} numbers; give length, width and height in metres, {bounds}")
    if not all(low <= value <= high for low, value, high in zip(least, size, most, strict=True)):
        raise SceneError(f"{room}: size_m {size[0]} x {size[1]} x {size[2]} m is out of range; give {bounds}")
    return size


def rectangle(
    corner: np.ndarray | Sequence[float],
    along: np.ndarray,
    up: np.ndarray,
    size: tuple[float, float],
    openings: Sequence[Opening] = (),
    inset: Opening | None = None,
) -> trimesh.Trimesh:
    """Build a single-sided rectangle with rectangular openings, without T-junctions between triangles.

    The normal of the rectangle is the cross product of `along` and `up`.

    Args:
        corner: (3,) position of the rectangle's corner, metres.
        along, up: (3,) unit vectors along the two sides that start at the corner.
        size: lengths of the rectangle along `along` and `up`, metres.
        openings: parts that stay open, each (u0, v0, u1, v1) in metres from the corner.
        inset: the only part of the rectangle that is built, (u0, v0, u1, v1), for example to fill an opening; None builds the whole
            rectangle.
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


@dataclass(frozen=True)
class Shell:
    """Hold the six inner sides of a box-shaped room: x in [0, length], y in [-width/2, width/2], z in [0, height].

    `side(name)` returns the arguments corner, along, up and size of `rectangle` for the side with this name. The names are floor and
    ceiling (whose corner is at the back wall), wall_front (x = length), wall_back (x = 0), wall_left (y > 0) and wall_right (y < 0).
    """

    length: float
    width: float
    height: float

    def side(self, name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray, tuple[float, float]]:
        y, (x_axis, y_axis, z_axis) = self.width / 2, np.eye(3)
        corners = {
            "floor": ([0, -y, 0], x_axis, y_axis, (self.length, self.width)),
            "ceiling": ([0, y, self.height], x_axis, -y_axis, (self.length, self.width)),
            "wall_front": ([self.length, y, 0], -y_axis, z_axis, (self.width, self.height)),
            "wall_back": ([0, -y, 0], y_axis, z_axis, (self.width, self.height)),
            "wall_left": ([0, y, 0], x_axis, z_axis, (self.length, self.height)),
            "wall_right": ([self.length, -y, 0], -x_axis, z_axis, (self.length, self.height)),
        }
        corner, along, up, size = corners[name]
        return np.array(corner, float), along, up, size

    def wall(self, name: str, openings: Sequence[Opening] = ()) -> trimesh.Trimesh:
        """Build a side of the room with rectangular openings."""
        return rectangle(*self.side(name), openings=openings)

    def filling(self, name: str, inset: Opening, openings: Sequence[Opening] = ()) -> trimesh.Trimesh:
        """Build a rectangle that fills the opening `inset` of a side of the room. The rectangle may have openings, too."""
        return rectangle(*self.side(name), openings=openings, inset=inset)
