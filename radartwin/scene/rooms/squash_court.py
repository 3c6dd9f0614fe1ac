"""Build an enclosed squash court with painted concrete walls, a wood floor, and a metal sheet at the foot of the front wall (the tin).

Ref: World Squash Federation, court specifications (singles): 9.75 x 6.40 m, clear height 5.64 m, lines 50 mm wide; lower edges of the front
wall line at 4.57 m and of the service line at 1.78 m, top of the tin at 0.48 m with its upper 50 mm as a line; the side wall lines fall
from 4.57 m to the 2.13 m of the back wall line; short line 4.26 m from the back wall, service boxes of 1.60 m; door in
the middle of the back wall, 0.90 x 2.13 m at most.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np

from radartwin.errors import SceneError
from radartwin.scene import objects, textures
from radartwin.scene.rooms.parts import FINISHES, GAP, Detail, Opening, Shell, check_options, room_scene, surface
from radartwin.scene.scene import Scene, Surface
from radartwin.scene.trajectories.trajectory import pose

SIZE_M = (9.75, 6.40, 5.64)
TIN_M, SERVICE_M, OUT_FRONT_M, OUT_BACK_M = 0.48, 1.78, 4.57, 2.13
SHORT_M, BOX_M, LINE_M = 4.26, 1.60, 0.05
DOOR_M = (0.90, 2.13)
TIN_DEPTH_M = 0.045  # distance between the front of the tin and the wall, the maximum that the regulations allow
LINE_RGB = np.array([0.72, 0.10, 0.12])
PIXEL_M = 0.006
CLUTTER = ("ball", "racket_bag", "water_bottle", "bench")

Back = Literal["solid", "glass"]
Mark = tuple[tuple[float, float], tuple[float, float]]  # two opposite corners of a rectangle, or the two ends of a line


def squash_court(size_m: Sequence[float] = SIZE_M, detail: Detail = "furnished", back: Back = "solid") -> Scene:
    """Build a squash court with x in [0, length] towards the front wall, y in [-width/2, width/2] and z in [0, height].

    Args:
        size_m: length, width and height in metres; the default values are those of the World Squash Federation.
        detail: "shell" (walls, floor, ceiling, door, tin), "furnished" (lamps, a ventilation grille, the door's plate and handle) or
            "cluttered" (also the small items of CLUTTER).
        back: material of the back wall below 2.13 m: "solid" with a wooden door, or 12 mm "glass" with a glass door in a metal frame.
    """
    if back not in ("solid", "glass"):
        raise SceneError(f"squash_court: back is {back!r}; choose solid or glass")
    length, width, height = check_options("squash_court", size_m, detail, (7.0, 4.5, 5.0), (15, 12, 10))
    shell = Shell(length, width, height)
    surfaces = [*_walls(shell), *_back(shell, back), _tin(length, width)]
    if detail != "shell":
        surfaces += _fixtures(shell, back)
    if detail == "cluttered":
        surfaces += _clutter(length, width)
    return room_scene(surfaces, "squash_court", (length, width, height), detail, CLUTTER, back=back)


def _walls(shell: Shell) -> list[Surface]:
    length, width = shell.length, shell.width
    marks: dict[str, list[Mark]] = {
        "floor": [  # line positions are as seen from the back wall, x = 0
            ((SHORT_M, 0), (SHORT_M + LINE_M, width)),
            ((0, width / 2 - LINE_M / 2), (SHORT_M, width / 2 + LINE_M / 2)),
            *(((SHORT_M - BOX_M, v), (SHORT_M - BOX_M + LINE_M, v + BOX_M)) for v in (0, width - BOX_M)),
            *(((SHORT_M - BOX_M, v), (SHORT_M, v + LINE_M)) for v in (BOX_M, width - BOX_M - LINE_M)),
        ],
        "wall_front": [((0, h), (width, h + LINE_M)) for h in (SERVICE_M, OUT_FRONT_M)],
        "wall_left": [((0, OUT_BACK_M), (length, OUT_FRONT_M))],
        "wall_right": [((0, OUT_FRONT_M), (length, OUT_BACK_M))],
    }
    sides = [_marked(shell, name, [], marks[name], "court floor" if name == "floor" else "court wall") for name in marks]
    return [sides[0], surface("ceiling", shell.wall("ceiling"), "white wall"), *sides[1:]]


def _back(shell: Shell, back: Back) -> list[Surface]:
    width = shell.width
    middle = width / 2
    door = (middle - DOOR_M[0] / 2, 0.0, middle + DOOR_M[0] / 2, DOOR_M[1])
    if back == "solid":
        wall = _marked(shell, "wall_back", [door], [((0, OUT_BACK_M), (width, OUT_BACK_M + LINE_M))])
        return [wall, surface("door", shell.filling("wall_back", door), "wood door")]
    glazing = (0.0, 0.0, width, OUT_BACK_M)
    bar = 0.05
    panes = [
        (bar, bar, door[0] - bar, glazing[3] - bar),
        (door[0], bar, door[2], door[3] - bar),
        (door[2] + bar, bar, width - bar, glazing[3] - bar),
    ]
    return [
        surface("wall_back", shell.wall("wall_back", [glazing]), "court wall"),
        surface("glass_frame", shell.filling("wall_back", glazing, panes), "metal"),
        *(
            surface(name, shell.filling("wall_back", pane), "glass leaf")
            for name, pane in zip(("glass_right", "door", "glass_left"), panes, strict=True)
        ),
    ]


def _tin(length: float, width: float) -> Surface:
    """Build the tin, the metal sheet at the foot of the front wall, whose upper 50 mm are painted as a line."""
    y = width / 2 - GAP
    mesh = objects.box([length - TIN_DEPTH_M, -y, GAP], [length - GAP, y, TIN_M])
    canvas = textures.tiled("painted_metal", (2 * y, TIN_M - GAP), PIXEL_M)
    canvas[: round(LINE_M / PIXEL_M)] = LINE_RGB
    corner, along, up = np.array([length, y, GAP]), np.array([0, -2 * y, 0.0]), np.array([0, 0, TIN_M - GAP])
    return surface("tin", mesh, "painted metal", picture=textures.with_image(mesh, canvas, corner, along, up))


def _fixtures(shell: Shell, back: Back) -> list[Surface]:
    length, width, height = shell.length, shell.width, shell.height
    lamps = [
        objects.box([x - 0.75, y - 0.2, height - 0.09], [x + 0.75, y + 0.2, height - GAP])
        for x in np.linspace(1.4, length - 1.6, 3)
        for y in (-width / 4, width / 4)
    ]
    grille = objects.box([GAP, -width / 2 + 0.6, 4.4], [0.05, -width / 2 + 1.6, 4.8])
    handle = objects.box([0.03, 0.335, 0.95], [0.055, 0.36, 1.15])
    out = [
        surface("ceiling_lamps", objects.joined(lamps), "lamp"),
        surface("ventilation_grille", grille, "metal"),
        surface("door_handle", handle, "metal"),
    ]
    if back == "solid":
        plate = objects.box([GAP, -0.42, 0.03], [GAP + 0.012, 0.42, 0.28])
        out.append(surface("door_kick_plate", plate, "metal"))
    return out


def _clutter(length: float, width: float) -> list[Surface]:
    y = width / 2
    ball = objects.sphere(0.02, 3).apply_transform(pose([length - 1.3, -1.9, 0.02 + GAP]))
    bottle = objects.cylinder(0.035, 0.22, 48).apply_transform(pose([0.4, -y + 1.7, 0.11 + GAP]))
    bag = objects.box([0.15, y - 1.2, GAP], [0.45, y - 0.45, 0.3])
    seat = objects.box([0.1, -y + 0.3, 0.4], [0.45, -y + 1.5, 0.44])
    legs = [objects.box([0.2, v, GAP], [0.35, v + 0.04, 0.395]) for v in (-y + 0.4, -y + 1.36)]
    return [
        surface("ball", ball, "plastic", role="object"),
        surface("racket_bag", bag, "red fabric"),
        surface("water_bottle", bottle, "white plastic", role="object"),
        surface("bench", objects.joined([seat, *legs]), "solid wood", look="pale_wood"),
    ]


def _marked(shell: Shell, side: str, openings: Sequence[Opening], marks: Sequence[Mark], finish: str = "court wall") -> Surface:
    """Build a side of the squash court with its painted markings: rectangles, or on the side walls lines between two points."""
    mesh = shell.wall(side, openings)
    corner, along, up, size = shell.side(side)
    canvas = textures.tiled(FINISHES[finish].look, size, PIXEL_M)
    rows, columns = canvas.shape[:2]
    right = (np.arange(columns) + 0.5)[None] / columns * size[0]
    high = size[1] - (np.arange(rows) + 0.5)[:, None] / rows * size[1]
    for (u0, v0), (u1, v1) in marks:
        if side in ("wall_left", "wall_right"):
            level = v0 + (v1 - v0) * (right - u0) / (u1 - u0)
            inside = (high >= level) & (high < level + LINE_M)
        else:
            inside = (right >= u0) & (right < u1) & (high >= v0) & (high < v1)
        canvas[inside] = LINE_RGB
    return surface(side, mesh, finish, picture=textures.with_image(mesh, canvas, corner, along * size[0], up * size[1]))
