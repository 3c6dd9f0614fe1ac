"""Compute the propagation paths that involve the target or its stand. Measured and simulated recordings use this code for any motion."""

from collections.abc import Sequence

import numpy as np

from radartwin.scene.scene import Surface
from radartwin.simulation.backends.track_paths import Track
from radartwin.simulation.paths import Paths

FEW = 10  # with fewer frames, paths between object and room are traced at each frame, not at the track's thirty shared positions


def seen(
    drives: Track,
    sensor: np.ndarray,
    rate_hz: float,
    target: Sequence[Surface],
    poses: np.ndarray,
    disc: Sequence[Surface],
    apart: Sequence[Surface],
    aside: np.ndarray | None = None,
    shadow: bool = True,
    coupled: bool = True,
) -> list[Paths]:
    """Return the propagation paths of target, stand and other objects for all frames, or for one frame if nothing moves.

    Args:
        sensor: (F, 4, 4) or (1, 4, 4) poses of the radar, radar frame to world frame.
        rate_hz: frame rate in frames per second.
        target: surfaces of the target in the target's own frame.
        poses: (F, 4, 4) or (1, 4, 4) poses of the target, target frame to world frame. Either the radar or the target moves.
        disc: surfaces of the disc on which the target stands, at rest in the world. For a moving radar, the disc and the target shadow
            each other.
        apart: other objects at rest (posts, motors, cables); paths of these objects that also reflect at faces of the room are ignored.
        aside: (3,) offset in metres of the target's true position from its logged position, for a moving radar.
        shadow: whether to include the shadow of the target on the paths of the room. For a moving radar, this shadow is always included.
        coupled: for a radar at rest, whether to include the paths between the target and the room.
    """  # fmt: skip
    parts: list[Paths] = []
    if len(sensor) > 1:
        together = [*disc, *(s.moved(poses[0]) for s in target)]
        for surfaces, over_room in ((together, True), *(([surface], False) for surface in apart)):
            share = over_room and len(sensor) >= FEW
            parts += drives.moving(surfaces, sensor, np.eye(4)[None], over_room and not share, aside)
            if share:
                parts += drives.over_room(surfaces, sensor, aside).seen(sensor, rate_hz)
        return parts
    parts += drives.moving(target, sensor, poses, coupled, shadow=shadow)
    for surfaces, over_room in ((disc, True), *(([surface], False) for surface in apart)):
        parts += drives.at_rest(surfaces, sensor, over_room)
    return parts


def on_carriage(
    drives: Track,
    sensor: np.ndarray,
    target: Sequence[Surface],
    poses: np.ndarray,
    start: np.ndarray,
    disc: Sequence[Surface],
    apart: Sequence[Surface],
) -> list[Paths]:
    """Return the propagation paths of all frames for a radar at rest and a target whose stand moves with the target.

    Args:
        sensor: (1, 4, 4) pose of the radar, radar frame to world frame.
        target: surfaces of the target in the target's own frame.
        poses: (F, 4, 4) poses of the target, target frame to world frame.
        start: (4, 4) pose of the target in which the positions of `disc` and `apart` are given.
    """
    back = np.linalg.inv(start)
    parts = drives.moving([*target, *(s.moved(back) for s in disc)], sensor, poses)
    for surface in apart:
        parts += drives.moving([surface.moved(back)], sensor, poses, False)
    return parts
