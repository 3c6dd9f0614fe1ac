"""Which tubes of a launch are traced whole, and which in parts.

A tube counts as its centre ray does, so one that straddles an edge counts too much or not at all. Rays at the middles and the corners of
all cells, followed through every bounce without any field, tell which cells straddle: their sequences of smooth patches differ. Those are
traced as pieces of a finer grid, and so are those that a curved surface spreads onto another. The division is exact: a box is the sum of
its pieces, and a hat that of hats n times finer,

    hat(x) = sum over |k| < n of (1 - |k|/n) hat(n x - k)

so that divided and whole hats still sum to one. A piece therefore carries two weights: its share of the divided hats around it, and
whether the box it lies in is divided. Cells that nothing meets are left out. Import only once a Mitsuba variant is active.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np

from radartwin.errors import BackendError
from radartwin.simulation.curved import coverage, scouting
from radartwin.simulation.curved.device import Device
from radartwin.simulation.curved.flight import Chosen
from radartwin.simulation.curved.tube_grid import Launch

MOST_TUBES = (1 << 32) - 1  # indices are of 32 bits
TUBES_PER_LAUNCH = 1 << 20  # bounds a kernel's memory to a few hundred megabytes


def blocks(
    device: Device,
    launch: Launch,
    corners: np.ndarray,
    max_bounces: int,
    first_hit: int,
    pieces: int,
    found: np.ndarray | None,
    walls: Any = None,
) -> Iterator[Chosen]:
    """Tubes of a launch in blocks that fit in memory, of whole poses unless one pose is larger than a block.

    Args:
        corners: (N, 3, 3) of the facets that are hit: of a large pose, tubes that could meet none are left out.
        pieces: odd, parts of a straddling tube each way; 1, or a pose too large for one block, for whole tubes only.
        found: (N,) sorted indices to trace and no others; None: all.
        walls: `transit.Walls` that tubes go through; None: they are mirrored.
    """
    end = launch.poses * launch.per_pose
    if end > MOST_TUBES:
        raise BackendError(
            f"{end:.3g} tubes in one launch are more than the {MOST_TUBES:.3g} that can be counted; trace fewer poses at once"
        )
    if pieces == 1 or launch.per_pose > TUBES_PER_LAUNCH // 2:
        stride = max(1, TUBES_PER_LAUNCH // launch.per_pose) * launch.per_pose
        several = (np.arange(low, min(low + stride, end)) for low in range(0, end, stride))
        if found is not None:
            several = _parts(found)
        elif launch.per_pose > TUBES_PER_LAUNCH:
            several = (part for pose in range(launch.poses) for part in _parts(_met(launch, pose, corners)))
        yield from (Chosen(index.astype(np.uint32)) for index in several if len(index))
        return
    step = max(1, TUBES_PER_LAUNCH // (2 * launch.per_pose))
    for low in range(0, launch.poses, step):
        high = min(low + step, launch.poses)
        met = scouting.faces_met(device, launch, (low, high), max_bounces, first_hit, walls)
        index, share, whole = divided(met, launch, low, pieces, device.curved)
        if found is not None:
            keep = np.isin(index, found)
            index, share, whole = index[keep], share[keep], whole[keep]
        for start in range(0, len(index), TUBES_PER_LAUNCH):
            part = slice(start, start + TUBES_PER_LAUNCH)
            yield Chosen(index[part].astype(np.uint32), share[part], whole[part], pieces)


def _parts(index: np.ndarray) -> Iterator[np.ndarray]:
    return (index[low : low + TUBES_PER_LAUNCH] for low in range(0, len(index), TUBES_PER_LAUNCH))


def _met(launch: Launch, pose: int, corners: np.ndarray) -> np.ndarray:
    """Indices of one pose's tubes that could meet anything."""
    cells = coverage.covered(launch, pose, corners)
    return pose * launch.per_pose + (np.arange(launch.per_pose) if cells is None else cells)


def divided(met: np.ndarray, launch: Launch, first_pose: int, pieces: int, curved: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(index, share, whole) as `flight.Chosen` holds them, from the sequences met in the middles and corners of some poses' cells."""
    poses, (rows, columns) = len(met), (launch.count_v, launch.count_u)
    middle = met[:, : rows * columns].reshape(poses, rows, columns)
    corner = met[:, rows * columns :].reshape(poses, rows + 1, columns + 1)
    straddles = np.zeros(middle.shape, bool)
    for i in (0, 1):
        for j in (0, 1):
            straddles |= corner[:, i : i + rows, j : j + columns] != middle
    straddles |= middle >= scouting.SPREADING
    if curved:  # a hat reaches to the middles of its neighbours
        padded = np.pad(middle, ((0, 0), (1, 1), (1, 1)), mode="edge")
        for i in range(3):
            for j in range(3):
                straddles |= padded[:, i : i + rows, j : j + columns] != middle
    cells = np.flatnonzero(~straddles & (middle > 0))
    margin = (pieces - 1) // 2
    pose, v, u = np.nonzero(straddles)
    fine_rows, fine_columns = pieces * rows + 2 * margin, pieces * columns + 2 * margin
    reach = np.arange(-2 * margin, 2 * margin + 1) if curved else np.arange(-margin, margin + 1)
    tent = 1 - np.abs(reach) / pieces
    # per straddling cell its pieces, twice as many each way where hats overlap, gathered where they coincide
    fine_v = (v[:, None] * pieces + 2 * margin + reach)[:, :, None]
    fine_u = (u[:, None] * pieces + 2 * margin + reach)[:, None, :]
    piece = ((pose[:, None, None] * fine_rows + fine_v) * fine_columns + fine_u).reshape(-1)
    weight = np.broadcast_to(tent[:, None] * tent, (len(pose), len(tent), len(tent))).reshape(-1)
    inside = (np.abs(reach) <= margin)[:, None] & (np.abs(reach) <= margin)
    total = np.bincount(piece, weight, poses * fine_rows * fine_columns)
    box = np.zeros(len(total), bool)
    box[piece.reshape(-1, len(tent) ** 2)[:, inside.reshape(-1)]] = True
    part = np.flatnonzero(total)
    index = np.concatenate(
        [first_pose * launch.per_pose + cells, launch.poses * launch.per_pose + first_pose * fine_rows * fine_columns + part]
    )
    share = np.concatenate([np.ones(len(cells)), total[part]])
    whole = np.concatenate([np.ones(len(cells), bool), box[part]])
    return index, share, whole
