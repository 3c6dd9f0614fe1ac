"""Build procedural rooms with known materials.

The world frame has its origin on the floor, x along the room, y to the left and z up, in metres.

Walls, floor and ceiling are single-sided rectangles that face into the room. Windows and doors fill openings in their walls, so that
surfaces never overlap. Furniture consists of closed boxes with a gap of 1 cm to floor and walls. Without the gap, faces in contact would
shadow each other, because the ray tracer starts each ray at a distance from its face (up to 1 mm at coordinates of 10 m). Every surface has
a material, a roughness and a texture (a name in `textures.LOOKS`). The provenance of a surface contains its true category in the MINC data
set of material photographs.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable
from typing import Any

import numpy as np

from radartwin.errors import SceneError
from radartwin.scene import objects
from radartwin.scene.rooms.atrium import atrium
from radartwin.scene.rooms.lab import CLUTTER, lab
from radartwin.scene.rooms.parts import GAP, Bench, rectangle, surface
from radartwin.scene.rooms.squash_court import squash_court
from radartwin.scene.scene import Scene
from radartwin.scene.trajectories.trajectory import look_at, pose

__all__ = ["CLUTTER", "ROOMS", "atrium", "bench", "empty", "lab", "lab_bench", "rectangle", "room", "squash_court", "support", "void"]

ROVER_HEIGHT_M = 0.4  # height of the rover's radar above the floor
DISC_RADIUS_M, DISC_THICKNESS_M = 0.15, 0.03  # disc of the turntable
# Start position (x, y) of the rover in metres for some rooms; in rooms without an entry, the rover starts at (1, 0).
_STARTS = {"atrium": (2.0, 0.0), "squash_court": (2.0, 0.0)}


def empty() -> Scene:
    """Return a scene without surfaces, which represents free space."""
    return Scene([], {"room": "empty"})


def void(detail: str = "bare") -> Scene:
    """Return a scene without a room, for an object on a stand in otherwise free space. `detail`, an option of every room, has no effect."""
    return Scene([], {"room": "void"})


ROOMS: dict[str, Callable[..., Scene]] = {"lab": lab, "atrium": atrium, "squash_court": squash_court, "empty": empty, "void": void}


def room(name: str, **options: Any) -> Scene:
    """Build a room by name, e.g. `room("squash_court", back="glass", detail="cluttered")`.

    Raises:
        SceneError: the room name or an option of the room is unknown, or the value of an option is invalid.

    >>> room("empty").provenance["room"]
    'empty'
    """
    if name not in ROOMS:
        raise SceneError(f"there is no room {name!r}; choose {', '.join(ROOMS)}")
    known = list(inspect.signature(ROOMS[name]).parameters)
    if unknown := sorted(set(options) - set(known)):
        raise SceneError(f"room {name} has no option {unknown[0]!r}; it takes {', '.join(known) or 'none'}")
    return ROOMS[name](**options)


def bench(name: str, height_m: float = ROVER_HEIGHT_M) -> Bench:
    """Return the sensor pose at the rover's start position in a room.

    The sensor looks along the +x axis of the room. Targets stand on the boresight, 0.5 to 2 m from the sensor.
    """
    if name not in ROOMS:
        raise SceneError(f"there is no room {name!r}; choose {', '.join(ROOMS)}")
    position = np.array([*_STARTS.get(name, (1.0, 0.0)), height_m])
    return Bench(look_at(position, position + np.array([1.0, 0.0, 0.0])))


def lab_bench(height_m: float = 1.0) -> Bench:
    """Return the sensor pose of the turntable experiments in the laboratory: 1 m in front of the back wall, looking along +x.

    In the default laboratory, furniture and walls reflect at ranges of 2 to 6 m, so that the echoes of targets at 0.5 to 2 m are free of
    clutter.
    """
    return bench("lab", height_m)


def support(position: np.ndarray) -> Scene:
    """Build the stand of an object: a turntable disc on a wooden post, with the centre of the disc's upper side at `position` (3,), in m.

    The post is round and thin, and the disc is below the object's base, so that no flat face of the stand points at the radar.
    """
    x, y, top = (float(v) for v in position)
    post = top - DISC_THICKNESS_M - 2 * GAP
    if post <= 0:
        raise SceneError(f"support: its top is at z = {top} m, too low for a {DISC_THICKNESS_M} m disc above the floor; raise it")
    disc = objects.cylinder(DISC_RADIUS_M, DISC_THICKNESS_M).apply_transform(pose([x, y, top - DISC_THICKNESS_M / 2]))
    column = objects.cylinder(0.03, post, 32).apply_transform(pose([x, y, GAP + post / 2]))
    parts = (surface("turntable", disc, "turntable", role="object"), surface("stand", column, "solid wood", role="object"))
    return Scene(part.replaced(roughness_m=0.0) for part in parts)  # the stand is turned and varnished, so it is smooth
