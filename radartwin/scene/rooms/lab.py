"""Build the procedural laboratory in which the turntable and rail experiments are simulated.

The paper that RadarTwin reproduces gives no dimensions of its laboratory, so size and furniture are those of an ordinary laboratory. The
size is a parameter, and every piece of furniture is a named surface that can be omitted.
"""

from __future__ import annotations

from collections.abc import Sequence

from radartwin.scene import objects
from radartwin.scene.rooms import furniture
from radartwin.scene.rooms.parts import GAP, Detail, Shell, check_options, room_scene, surface
from radartwin.scene.scene import Scene, Surface
from radartwin.scene.trajectories.trajectory import pose

# The small items of the detail level "cluttered", which a scan may miss.
CLUTTER = ("monitor", "cardboard_box", "waste_bin", "stool_seat", "extinguisher")


def lab(size_m: Sequence[float] = (6.0, 5.0, 2.8), detail: Detail = "furnished") -> Scene:
    """Build a laboratory with x in [0, length], y in [-width/2, width/2] and z in [0, height].

    Args:
        size_m: length, width and height in metres; for any size, furniture keeps its own size and stands at the same walls.
        detail: "shell" (walls, floor, ceiling, window, door), "furnished" (tables, cabinet, shelf, radiator) or
            "cluttered" (also the small items of `CLUTTER`).
    """
    length, width, height = check_options("lab", size_m, detail, (5.0, 4.5, 2.4), (20, 20, 8))
    surfaces = _shell(Shell(length, width, height))
    if detail != "shell":
        surfaces += _furniture(length, width)
    if detail == "cluttered":
        surfaces += _clutter(length, width)
    return room_scene(surfaces, "lab", (length, width, height), detail, CLUTTER)


def _shell(shell: Shell) -> list[Surface]:
    width, length = shell.width, shell.length
    window = (length / 2 - 1.1, 0.9, length / 2 + 0.9, 2.1)
    door = (width / 2 + 0.8, 0.0, width / 2 + 1.7, 2.05)  # position along the wall from its left-hand corner, and height
    return [
        surface("floor", shell.wall("floor"), "board floor"),
        surface("ceiling", shell.wall("ceiling"), "acoustic ceiling"),
        surface("wall_front", shell.wall("wall_front", [door]), "plaster wall"),
        surface("door", shell.filling("wall_front", door), "wood door"),
        surface("wall_back", shell.wall("wall_back"), "plaster wall"),
        surface("wall_left", shell.wall("wall_left", [window]), "plaster wall"),
        surface("window", shell.filling("wall_left", window), "window"),
        surface("wall_right", shell.wall("wall_right"), "plaster wall"),
    ]


def _furniture(length: float, width: float) -> list[Surface]:
    y = width / 2
    cabinet = objects.box([length - 0.45 - GAP, y - 1.1, GAP], [length - GAP, y - 0.2, 1.9])
    radiator = objects.box([length / 2 - 0.8, y - 0.12, 0.15], [length / 2 + 0.6, y - 0.03, 0.75])
    return [
        *furniture.table("table_left", (length - 2.1, y - 1.9), (0.8, 1.6)),
        *furniture.table("table_right", (length - 2.4, -y + 0.1), (1.6, 0.8)),
        surface("cabinet", cabinet, "painted metal"),
        surface("shelf", furniture.shelf(length - 0.3 - GAP, y - 2.1, 0.3, 0.8), "shelf"),
        surface("radiator", radiator, "painted metal"),
    ]


def _clutter(length: float, width: float) -> list[Surface]:
    y = width / 2
    x, v = length - 2.1, y - 1.9  # corner of the left table
    monitor = objects.box([x + 0.5, v + 0.5, 0.85], [x + 0.54, v + 1.05, 1.2])
    x, v = length - 2.4, -y + 0.1  # corner of the right table
    carton = objects.box([x + 0.3, v + 0.2, 0.74 + GAP], [x + 0.7, v + 0.5, 1.0])
    waste = objects.cylinder(0.14, 0.35, 32).apply_transform(pose([x + 1.9, v + 0.3, 0.175 + GAP]))
    seat = objects.cylinder(0.17, 0.03, 32).apply_transform(pose([length - 2.6, 1.0, 0.48]))
    bottle = objects.cylinder(0.08, 0.5, 48).apply_transform(pose([length - 0.15, -y + 0.3, 1.1]))
    items = (monitor, carton, waste, seat, bottle)
    finishes = ("screen", "cardboard", "metal", "solid wood", "red metal")
    return [surface(name, mesh, finish) for name, mesh, finish in zip(CLUTTER, items, finishes, strict=True)]
