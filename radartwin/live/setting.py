"""Describe what the live page simulates: the pose of the radar, the poses of the objects, the materials and the number of bounces."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache

import numpy as np

from radartwin.label.material_sources import SceneLabels, Uniform, Void
from radartwin.label.surface_labels import belongs_to_room
from radartwin.scene.scene import Scene, Surface
from radartwin.scene.trajectories.trajectory import pose

# the labels of the scene, one material for the room, or no room
MATERIALS = {"labelled": SceneLabels(), "uniform": Uniform(), "void": Void()}
RADAR = "radar"  # name of the radar in the page, which no object may have
MAX_BOUNCES = 4  # the default of `radartwin.simulate`


@dataclass(frozen=True, eq=False)
class LiveSetting:
    """Hold what the live page simulates."""

    radar_pose: np.ndarray  # sensor-to-world (4, 4)
    object_poses: Mapping[str, np.ndarray] = field(default_factory=dict)  # object-to-world (4, 4) by name
    materials: str = "labelled"  # a key of MATERIALS
    max_bounces: int = MAX_BOUNCES  # largest number of reflections of a path


@dataclass(frozen=True, eq=False)
class Movable:
    """Hold an object of the scene that the user can move."""

    name: str  # of the object and of all of its surfaces
    surfaces: tuple[Surface, ...]  # in the object's own frame
    pose: np.ndarray  # object-to-world (4, 4) at the start


def split(scene: Scene) -> tuple[Scene, list[Movable]]:
    """Split a scene into the room and the objects that the user can move, which are the surfaces of one name outside the room.

    The frame of an object has the axes of the world and the centre of its bounding box. An object "radar" gets another name.
    """
    room, groups = [], dict[str, list[Surface]]()
    taken = {RADAR, *scene.names}
    radar = free_name(RADAR, list(taken))
    for surface in scene:
        if belongs_to_room(surface):
            room.append(surface)
        elif surface.name:
            groups.setdefault(radar if surface.name == RADAR else surface.name, []).append(surface)
        else:
            groups[free_name("object", [*taken, *groups])] = [surface]
    return Scene(room, scene.provenance), [_movable(name, surfaces) for name, surfaces in groups.items()]


def free_name(name: str, taken: Sequence[str]) -> str:
    """Return the name, with a number after it if the name is taken.

    >>> free_name("mug", ["mug", "mug 2"])
    'mug 3'
    """
    number = 1
    while (candidate := name if number == 1 else f"{name} {number}") in taken:
        number += 1
    return candidate


def _movable(name: str, surfaces: Sequence[Surface]) -> Movable:
    low, high = Scene(surfaces).bounds
    place = pose((low + high) / 2)
    return Movable(name, tuple(s.moved(pose(-place[:3, 3])).replaced(name=name) for s in surfaces), place)


def with_materials(room: Scene) -> Callable[[str], Scene]:
    """Return a function that gives the room with a choice of materials. Equal choices give the same Scene object."""
    return cache(lambda materials: MATERIALS[materials](room))
