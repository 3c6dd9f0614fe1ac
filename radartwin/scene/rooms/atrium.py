"""Build a furnished atrium (entrance hall) with wood-panelled walls, glass doors, metal fixtures and plasterboard.

The paper that RadarTwin reproduces names these features ("a furnished atrium (glass doors, metal fixtures, plasterboard walls)", and in the
caption of its rover setup) but gives no dimensions. The size and the furniture here are therefore those of an ordinary entrance hall. A
strip 2 m wide along the long axis of the atrium is free for the rover.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from radartwin.scene import objects
from radartwin.scene.rooms import furniture
from radartwin.scene.rooms.parts import GAP, Detail, Shell, check_options, room_scene, surface
from radartwin.scene.scene import Scene, Surface
from radartwin.scene.trajectories.trajectory import pose

CLUTTER = ("parcel", "laptop", "desk_vase", "magazines", "bag", "umbrella_stand", "litter_bin", "coffee_cup")
FRAME_M = 0.06  # width of the bars of door frames
THIN_M = 0.012  # thickness of boards, plates and rugs; the module `furniture` gives the reason


def atrium(size_m: Sequence[float] = (12.0, 9.0, 5.0), detail: Detail = "furnished") -> Scene:
    """Build an atrium with x in [0, length], y in [-width/2, width/2] and z in [0, height] and with glass doors in the front wall.

    Args:
        size_m: length, width and height in metres; for any size, furniture keeps its own size and stands at the same walls.
        detail: "shell" (walls, doors, windows, lifts), "furnished" (columns, desk, seats, planters, railing, metal fixtures, lamps) or
            "cluttered" (also the small items of CLUTTER).
    """
    length, width, height = check_options("atrium", size_m, detail, (10.0, 8.0, 3.5), (30, 30, 12))
    surfaces = _shell(Shell(length, width, height))
    if detail != "shell":
        surfaces += _fixtures(length, width, height) + _seats(length, width)
    if detail == "cluttered":
        surfaces += _clutter(length, width)
    return room_scene(surfaces, "atrium", (length, width, height), detail, CLUTTER)


def _shell(shell: Shell) -> list[Surface]:
    length, width = shell.length, shell.width
    middle = width / 2
    entrance = (middle - 1.5, 0.0, middle + 1.5, 2.6)
    panes = [
        (middle - 1.5 + FRAME_M, 0.0, middle - FRAME_M / 2, 2.2),
        (middle + FRAME_M / 2, 0.0, middle + 1.5 - FRAME_M, 2.2),
        (middle - 1.5 + FRAME_M, 2.2 + FRAME_M, middle + 1.5 - FRAME_M, 2.6 - FRAME_M),
    ]
    lifts = [(middle + u, 0.0, middle + u + 1.1, 2.1) for u in (1.4, 2.9)]
    windows = [(u, 0.9, u + 1.8, 2.9) for u in np.linspace(1.0, length - 2.8, 3)]
    roof = (length / 2 - 2.0, middle - 1.5, length / 2 + 2.0, middle + 1.5)

    def fill(side: str, opening: tuple[float, float, float, float], name: str, finish: str) -> Surface:
        return surface(name, shell.filling(side, opening), finish)

    return [
        surface("floor", shell.wall("floor"), "tiled floor"),
        surface("ceiling", shell.wall("ceiling", [roof]), "acoustic ceiling"),
        fill("ceiling", roof, "skylight", "window"),
        surface("wall_front", shell.wall("wall_front", [entrance]), "white wall"),
        surface("door_frame", shell.filling("wall_front", entrance, panes), "metal"),
        *(fill("wall_front", pane, name, "glass leaf") for pane, name in zip(panes, ("door_left", "door_right", "transom"), strict=True)),
        surface("wall_back", shell.wall("wall_back", lifts), "wood panelling"),
        *(fill("wall_back", lift, f"lift_{k}", "metal") for k, lift in enumerate(lifts, 1)),
        surface("wall_left", shell.wall("wall_left"), "wood panelling"),
        surface("wall_right", shell.wall("wall_right", windows), "white wall"),
        *(fill("wall_right", window, f"window_{k}", "window") for k, window in enumerate(windows, 1)),
    ]


def _fixtures(length: float, width: float, height: float) -> list[Surface]:
    y = width / 2
    columns = [(x, side * (y - 1.3)) for x in (4.0, length - 1.6) for side in (1, -1)]
    boxes = [objects.box([u - 0.2, v - 0.2, GAP], [u + 0.2, v + 0.2, height - GAP]) for u, v in columns]
    mail = [
        objects.box([GAP, -y + 0.8 + 0.42 * i, 0.7 + 0.32 * j], [0.28, -y + 1.215 + 0.42 * i, 1.015 + 0.32 * j])
        for i in range(4)
        for j in range(3)
    ]
    desk = objects.box([length - 5.0, y - 2.0, GAP], [length - 2.6, y - 1.4, 1.0])
    counter = objects.box([length - 5.1, y - 2.1, 1.01], [length - 2.5, y - 1.3, 1.05])
    kick = objects.box([length - 5.0, y - 2.0 - GAP - THIN_M, 0.03], [length - 2.6, y - 2.0 - GAP, 0.15])
    rows = (-y + 1.5, y - 1.5)
    lamps = [objects.box([u - 0.6, v - 0.15, height - 0.1], [u + 0.6, v + 0.15, height - GAP]) for u in (2.5, length - 2.5) for v in rows]
    handles = [objects.box([length - 0.08, v - 0.015, 0.8], [length - 0.05, v + 0.015, 1.4]) for v in (0.12, -0.12)]
    screen = objects.box([length - 2.3, y - 0.07, 1.4], [length - 1.1, y - GAP, 2.1])
    bills = [objects.box([GAP, -0.4 + 0.75 * k, 1.2], [GAP + THIN_M, 0.2 + 0.75 * k, 2.05]) for k in range(2)]
    return [
        *(surface(f"column_{k}", box, "concrete") for k, box in enumerate(boxes, 1)),
        surface("reception_desk", desk, "dark wood"),
        surface("reception_counter", counter, "table top"),
        surface("reception_kick_plate", kick, "metal"),
        surface("mailboxes", objects.joined(mail), "painted metal"),
        surface("railing", furniture.railing([1.0, -y + 2.4], [3.4, -y + 2.4]), "metal"),
        surface("display", screen, "screen"),
        *(surface(f"poster_{k}", bill, "paper", seed=k) for k, bill in enumerate(bills, 1)),
        surface("extinguisher_cabinet", objects.box([1.2, y - 0.24, 0.8], [1.6, y - GAP, 1.5]), "red metal"),
        surface("ceiling_lamps", objects.joined(lamps), "lamp"),
        surface("door_handles", objects.joined(handles), "metal"),
    ]


def _seats(length: float, width: float) -> list[Surface]:
    y = width / 2
    x = length / 2 + 0.2  # x at which the seating group along the right wall begins
    rug = objects.box([x + 0.3, -y + 1.35, GAP], [x + 2.7, -y + 2.85, GAP + THIN_M])
    return [
        *furniture.sofa("sofa", [x + 0.4, -y + 0.35], [x + 2.5, -y + 1.25], "-y", "fabric"),
        *furniture.sofa("armchair_1", [x + 3.0, -y + 1.5], [x + 3.9, -y + 2.4], "+x", "leather"),
        *furniture.sofa("armchair_2", [x - 0.8, -y + 1.5], [x + 0.1, -y + 2.4], "-x", "red fabric"),
        surface("rug", rug, "carpet"),
        *furniture.table("coffee_table", (x + 0.9, -y + 1.7), (1.1, 0.6), 0.42, GAP + THIN_M, "table top", "metal"),
        *furniture.table("side_table", (1.6, y - 1.5), (1.4, 0.7)),
        *furniture.planter("planter_1", length - 0.55, 2.3),
        *furniture.planter("planter_2", length - 0.55, -2.3),
        *furniture.planter("planter_3", 0.7, y - 0.7, 0.6, 0.55, 1.4),
    ]


def _clutter(length: float, width: float) -> list[Surface]:
    y, x = width / 2, length / 2 + 0.2
    stand = objects.cylinder(0.12, 0.55, 48).apply_transform(pose([length - 0.4, 1.85, 0.275 + GAP]))
    bin_ = objects.cylinder(0.16, 0.7, 48).apply_transform(pose([3.9, -y + 0.5, 0.35 + GAP]))
    vase = objects.revolution([(0, 0), (0.05, 0), (0.075, 0.06), (0.08, 0.12), (0.06, 0.2), (0.035, 0.25), (0, 0.25)], 48)
    cup = objects.cylinder(0.04, 0.1, 48).apply_transform(pose([x + 1.7, -y + 2.05, 0.42 + 0.05 + GAP]))
    lid = objects.box([length - 3.75, y - 1.95, 1.07], [length - 3.4, y - 1.93, 1.3])
    deck = objects.box([length - 3.75, y - 1.925, 1.06], [length - 3.4, y - 1.68, 1.075])
    return [
        surface("parcel", objects.box([1.9, y - 1.35, 0.75], [2.4, y - 1.0, 1.05]), "cardboard"),
        surface("laptop", objects.joined([lid, deck]), "plastic"),
        surface("desk_vase", vase.apply_transform(pose([length - 4.6, y - 1.7, 1.06])), "glass leaf", role="object"),
        surface("magazines", objects.box([x + 1.1, -y + 1.85, 0.43], [x + 1.4, -y + 2.07, 0.45]), "paper"),
        surface("bag", objects.box([x + 3.1, -y + 1.0, GAP], [x + 3.5, -y + 1.2, 0.36]), "leather", look="leather"),
        surface("umbrella_stand", stand, "dark metal", role="object"),
        surface("litter_bin", bin_, "metal", role="object"),
        surface("coffee_cup", cup, "paper", look="white_plastic", role="object"),
    ]
