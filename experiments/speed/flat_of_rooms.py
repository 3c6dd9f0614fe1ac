"""Generate a furnished flat of rooms with a given number of flat surfaces, to measure how the run time grows with the scene.

The rooms stand on a square grid, with a door opening in every wall between two. Cabinets of random sizes, tables and shelves of
axis-parallel boxes are shared out among the rooms, beginning with the radar's. Each room has its own random generator, so that the radar's
room is the same in every flat that is large enough.
"""

import math

import numpy as np
import shapely
import trimesh

from radartwin.scene import objects
from radartwin.scene.rooms import furniture
from radartwin.scene.rooms.parts import GAP
from radartwin.scene.scene import Scene, Surface

ROOM_M, HEIGHT_M = np.array([5.0, 4.0]), 2.7  # sides of a room, from middle to middle of its walls, and height of a room
WALL_M, DOOR_M = 0.1, 0.9  # thickness of a wall and width of a door opening
SURFACES_A_ROOM = 100  # about this many flat surfaces belong to a room
PLAIN = 16  # flats up to this many surfaces are one room with cabinets only
FREE_M = 0.9  # half the side of the square around the middle of a room that stays free for the radar
TRIES = 200  # number of positions tried for a piece of furniture before a smaller piece is tried
BOARD_M, LEG_M = 0.025, 0.04  # thickness of a table's top and of its legs
MATERIALS = ("wood", "metal", "chipboard", "glass")


def flat(surfaces: int) -> tuple[Scene, np.ndarray]:
    """Return a flat of about `surfaces` flat surfaces, and the middle (3,) of the radar's room at the radar's height.

    The origin is the middle of the radar's room on the floor. A box counts as six surfaces.

    >>> scene, place = flat(100)
    >>> sum(round(len(surface.mesh.faces) / 2) for surface in scene.surfaces)
    108
    """
    side = max(1, round(math.sqrt(surfaces / SURFACES_A_ROOM)))
    low = -(np.array([side // 2, side // 2]) + 0.5) * ROOM_M
    high = low + side * ROOM_M
    parts = [Surface(objects.box([*low, 0.0], [*high, HEIGHT_M]), "concrete", "shell", role="room")]
    parts[0].mesh.invert()
    walls = _walls(side, low, high)
    bodies = [trimesh.creation.extrude_polygon(polygon, HEIGHT_M) for polygon in getattr(walls, "geoms", [walls]) if not polygon.is_empty]
    if bodies:
        parts.append(Surface(objects.joined(bodies), "plasterboard", "walls"))
    count = sum(len(part.mesh.facets) for part in parts)
    rooms = [np.array([i, j]) for i in range(side) for j in range(side)]
    rooms = sorted((cell - side // 2 for cell in rooms), key=lambda cell: (float(np.abs(cell).sum()), *cell))
    random = [np.random.default_rng([7, *(cell + 100)]) for cell in rooms]
    taken: list[list[np.ndarray]] = [[] for _ in rooms]
    full = np.zeros(len(rooms), bool)
    while count < surfaces and not full.all():
        for k, cell in enumerate(rooms):
            piece = None if full[k] else _piece(random[k], taken[k], surfaces <= PLAIN)
            full[k] |= piece is None
            if piece is not None and count < surfaces:
                mesh, material = piece
                mesh.apply_translation([*(cell * ROOM_M), 0.0])
                parts.append(Surface(mesh, material, f"piece_{len(parts)}"))
                count += len(mesh.facets)
    return Scene(parts), np.array([0.0, 0.0, 1.0])


def _walls(side: int, low: np.ndarray, high: np.ndarray) -> shapely.Geometry:
    """Return the plan of the walls between rooms, with door openings."""
    pieces = []
    for axis in range(2):
        for line in range(1, side):
            at = low[axis] + line * ROOM_M[axis]
            for cell in range(side):
                begin = low[1 - axis] + cell * ROOM_M[1 - axis]
                door = begin + (0.25 + 0.5 * ((line + cell) % 2)) * ROOM_M[1 - axis]
                for start, end in ((begin, door - DOOR_M / 2), (door + DOOR_M / 2, begin + ROOM_M[1 - axis])):
                    span = [
                        (at - WALL_M / 2, at + WALL_M / 2),
                        (start - WALL_M / 2 * (start == begin), end + WALL_M / 2 * (start != begin)),
                    ]
                    (x0, x1), (y0, y1) = span if axis == 0 else span[::-1]
                    pieces.append(shapely.box(x0, y0, x1, y1))
    return shapely.intersection(shapely.union_all(pieces, grid_size=1e-6), shapely.box(*low, *high))


def _piece(random: np.random.Generator, taken: list[np.ndarray], plain: bool) -> tuple[trimesh.Trimesh, str] | None:
    """Return a piece of furniture and its material, or None if the room is full, and add its rectangle (4,) to those in `taken`."""
    kind = "cabinet" if plain else str(random.choice(["cabinet", "cabinet", "table", "shelf"]))
    for shrink in (1.0, 0.8, 0.6):
        if kind == "table":
            size, height = random.uniform([0.9, 0.6], [1.5, 0.9]), 0.74
        elif kind == "shelf":
            size, height = random.uniform([0.25, 0.7], [0.4, 1.1]), random.uniform(1.2, 2.2)
        else:
            size, height = random.uniform([0.4, 0.3], [1.0, 0.7]), random.uniform(0.6, 2.3)
        size = np.maximum(shrink * size, 0.25)
        room = ROOM_M / 2 - WALL_M - size
        for _ in range(TRIES):
            x, y = random.uniform(-ROOM_M / 2 + WALL_M, room)
            rectangle = np.array([x, y, *(np.array([x, y]) + size)])
            if not any(_overlap(rectangle, other) for other in [*taken, np.array([-FREE_M, -FREE_M, FREE_M, FREE_M])]):
                taken.append(rectangle)
                return _mesh(kind, rectangle, height), str(random.choice(MATERIALS))
    return None


def _overlap(first: np.ndarray, second: np.ndarray) -> bool:
    """Return whether two rectangles (4,) are closer than 5 cm."""
    return bool((first[:2] < second[2:] + 0.05).all() and (second[:2] < first[2:] + 0.05).all())


def _mesh(kind: str, rectangle: np.ndarray, height: float) -> trimesh.Trimesh:
    (x, y), (u, v) = rectangle[:2], rectangle[2:]
    if kind == "shelf":
        return furniture.shelf(x, y, u - x, v - y, height, 4)
    if kind == "cabinet":
        return objects.box([x, y, GAP], [u, v, height])
    legs = [(x, y), (u - LEG_M, y), (x, v - LEG_M), (u - LEG_M, v - LEG_M)]
    boxes = [objects.box([a, b, GAP], [a + LEG_M, b + LEG_M, height - BOARD_M - furniture.JOINT]) for a, b in legs]
    return objects.joined([objects.box([x, y, height - BOARD_M], [u, v, height]), *boxes])
