"""Paths by way of what is measured and what it stands on, from a radar that drives or rests; both domains set it up alike."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from radartwin.scene.scene import Surface
from radartwin.simulation.drives import Drives
from radartwin.simulation.paths import Paths

FEW = 10  # frames, whose ways over the room are traced by themselves: there are some thirty places along a track, which all drives share


def seen(
    drives: Drives,
    sensor: np.ndarray,
    rate_hz: float,
    target: Sequence[Surface],
    poses: np.ndarray,
    disc: Sequence[Surface],
    apart: Sequence[Surface],
    aside: np.ndarray | None = None,
) -> list[Paths]:
    """Parts of all frames or of one that holds for all.

    Args:
        sensor: (F, 4, 4) or (1, 4, 4) to world. rate_hz: of the frames.
        target: in its own frame, at `poses` (F, 4, 4) or (1, 4, 4); one of the two moves.
        disc: what it stands on, at rest in the world; before a radar on its way the two are one thing, and shadow each other.
        apart: other things at rest, seen directly only: posts, motors, cables.
        aside: (3,) metres from where the log has the target, before a radar on its way.
    """  # fmt: skip
    parts: list[Paths] = []
    if len(sensor) > 1:
        together = [*disc, *(s.moved(poses[0]) for s in target)]
        for things, coupled in ((together, True), *(([one], False) for one in apart)):
            share = coupled and len(sensor) >= FEW
            parts += drives.moving(things, sensor, np.eye(4)[None], coupled and not share, aside)
            if share:
                parts += drives.over_room(things, aside).seen(sensor, rate_hz)
        return parts
    parts += drives.moving(target, sensor, poses)
    at_rest = np.eye(4)[None]
    for things, coupled in ((disc, True), *(([one], False) for one in apart)):
        parts += drives.moving(things, sensor, at_rest, coupled)
    return parts


def on_carriage(
    drives: Drives,
    sensor: np.ndarray,
    target: Sequence[Surface],
    poses: np.ndarray,
    start: np.ndarray,
    disc: Sequence[Surface],
    apart: Sequence[Surface],
) -> list[Paths]:
    """Parts of all frames before a radar at rest: what the target stands on goes with it.

    Args:
        sensor: (1, 4, 4). target: in its own frame, at `poses` (F, 4, 4).
        start: (4, 4) of the target where `disc` and `apart` stand as given.
    """
    back = np.linalg.inv(start)
    parts = drives.moving([*target, *(s.moved(back) for s in disc)], sensor, poses)
    for one in apart:
        parts += drives.moving([one.moved(back)], sensor, poses, False)
    return parts
