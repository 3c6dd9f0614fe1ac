"""Divide the cells of a ray-tube grid into whole tubes and pieces of tubes, in blocks that fit in memory.

The tracer assumes that a whole tube meets the surface that its centre ray hits. This assumption is wrong for a tube that straddles an edge
between two surfaces. To find such tubes, the module casts test rays without fields through the middles and the corners of all grid cells. A
cell straddles an edge if its test rays hit different sequences of smooth surface patches. The tracer divides such a cell into pieces of a
finer grid. The tracer also divides a cell whose tube is reflected by a curved surface onto another surface. The division of the tube's
weight function is exact: a box weight is the sum of the box weights of its pieces, and a hat (triangle) weight is the sum of hats n times
finer,

    hat(x) = sum over |k| < n of (1 - |k|/n) hat(n x - k)

so that the hats of divided and whole tubes still sum to one. A piece therefore has two weights. The hat weight of a piece is the sum of its
factors in all divided hats that contain it. The box weight of a piece is 1 if the piece lies in a divided cell and 0 otherwise. Cells whose
test rays hit nothing are not traced. Import this module only after a Mitsuba variant is active.
"""

from collections.abc import Iterator

import drjit as dr
import mitsuba as mi
import numpy as np

from radartwin.errors import BackendError
from radartwin.simulation.curved import tube_grid
from radartwin.simulation.curved.contact import cast, leave, meet
from radartwin.simulation.curved.device import Device
from radartwin.simulation.curved.flight import GridArrays, Tubes, TubeSelection, rays
from radartwin.simulation.curved.hits import TraceOptions
from radartwin.simulation.curved.transit import Walls
from radartwin.simulation.curved.tube_grid import TubeGrid

MAX_TUBES = (1 << 32) - 1  # largest number of tubes in a grid, because tube indices have 32 bits
TUBES_PER_BLOCK = 1 << 20  # number of tubes traced at once; it limits the memory of a kernel to a few hundred megabytes
SPREADING = 1 << 31  # bit in the number of a patch sequence, set if a curved surface reflects the test ray onto another surface


def blocks(device: Device, grid: TubeGrid, corners: np.ndarray, options: TraceOptions, walls: Walls | None) -> Iterator[TubeSelection]:
    """Yield the tubes of a grid in blocks. A block holds all tubes of one or more sensor poses, or, if a pose has too many tubes, a part of
    them.

    The function divides no tube if `options.pieces` is 1 or if the tubes of a pose do not fit into one block.

    Args:
        device: geometry on the device, for the test rays.
        grid: grid of tubes.
        corners: (N, 3, 3) corners of N facets. If the tubes of a pose do not fit into one block, the function leaves out the tubes whose
            centre ray cannot meet a facet.
        options: trace options, of which the function reads the number of bounces, the first cluster and the number of pieces.
        walls: walls of hollow objects through which the tubes pass; None for tubes that are reflected on the outside of the surfaces.
    Raises:
        BackendError: the grid has more tubes than MAX_TUBES.
    """
    end = grid.poses * grid.per_pose
    if end > MAX_TUBES:
        raise BackendError(f"{end:.3g} tubes in one grid exceed the limit of {MAX_TUBES:.3g}; trace fewer poses at once")
    if options.pieces == 1 or grid.per_pose > TUBES_PER_BLOCK // 2:
        stride = max(1, TUBES_PER_BLOCK // grid.per_pose) * grid.per_pose
        parts = (np.arange(low, min(low + stride, end)) for low in range(0, end, stride))
        if grid.per_pose > TUBES_PER_BLOCK:
            parts = (part for pose in range(grid.poses) for part in _parts(_covered(grid, pose, corners)))
        yield from (TubeSelection(index.astype(np.uint32)) for index in parts if len(index))
        return
    step = max(1, TUBES_PER_BLOCK // (2 * grid.per_pose))
    for low in range(0, grid.poses, step):
        sequences = patch_sequences(device, grid, (low, min(low + step, grid.poses)), options, walls)
        index, hat_share, in_box = divided(sequences, grid, low, options.pieces, device.curved)
        for start in range(0, len(index), TUBES_PER_BLOCK):
            part = slice(start, start + TUBES_PER_BLOCK)
            yield TubeSelection(index[part].astype(np.uint32), hat_share[part], in_box[part], options.pieces)


def _parts(index: np.ndarray) -> Iterator[np.ndarray]:
    return (index[low : low + TUBES_PER_BLOCK] for low in range(0, len(index), TUBES_PER_BLOCK))


def _covered(grid: TubeGrid, pose: int, corners: np.ndarray) -> np.ndarray:
    """Return the indices of those tubes of one sensor pose whose centre ray can meet a facet."""
    cells = tube_grid.covered(grid, pose, corners)
    return pose * grid.per_pose + (np.arange(grid.per_pose) if cells is None else cells)


def patch_sequences(device: Device, grid: TubeGrid, poses: tuple[int, int], options: TraceOptions, walls: Walls | None) -> np.ndarray:
    """Cast the test rays and return, for each ray, a number that identifies the sequence of smooth surface patches that the ray meets.

    Returns:
        Numbers (poses, count_u count_v + (count_u + 1)(count_v + 1)), uint32. Each row lists first the test rays through the cell middles,
        then those through the cell corners. In both lists, the index along u changes fastest. The number is 0 if a ray meets no patch. Its
        bit SPREADING is set if a curved surface reflects the ray onto another surface. With `walls`, the sequence of a ray consists of the
        patch of the first wall and the next patch behind this wall.
    """
    middles, corners = grid.per_pose, (grid.count_u + 1) * (grid.count_v + 1)
    index = dr.arange(mi.UInt32, (poses[1] - poses[0]) * (middles + corners))
    pose = index // dr.opaque(mi.UInt32, middles + corners)
    cell = index - pose * dr.opaque(mi.UInt32, middles + corners)
    pose += dr.opaque(mi.UInt32, poses[0])
    corner = cell >= dr.opaque(mi.UInt32, middles)
    cell = dr.select(corner, cell - dr.opaque(mi.UInt32, middles), cell)
    count = dr.select(corner, dr.opaque(mi.UInt32, grid.count_u + 1), dr.opaque(mi.UInt32, grid.count_u))
    cell_v = cell // count
    offset = dr.select(corner, mi.Float(0.5), 0.0)
    origin, direction, *_ = rays(GridArrays.of(grid), pose, mi.Float(cell - cell_v * count) - offset, mi.Float(cell_v) - offset)
    zero, length = mi.Vector3f(0.0), mi.Float64(0.0)
    tubes = Tubes(
        index, pose, origin, direction, zero, zero, zero, zero, length, None, None, zero, zero, [], mi.UInt32(0), length, length,
    )  # fmt: skip
    alive, sequence, curved, spreading = mi.Bool(True), mi.UInt32(0), mi.Bool(False), mi.Bool(False)
    for bounce in range(2 if walls else options.max_bounces):
        alive = cast(device, tubes, bounce == 0, alive)
        contact, alive = meet(device, tubes, bounce == 0, alive)
        if bounce == 0:
            alive = device.in_cluster(contact.face, alive)
        if walls and bounce == 0:
            alive = walls.enter(tubes, contact, alive)
        # The multiplication by an odd constant makes the number depend on the order in which the ray meets the patches.
        sequence = dr.select(alive, (sequence * 0x9E3779B1) ^ dr.gather(mi.UInt32, device.patch, contact.face, alive), sequence)
        if walls and bounce == 0:
            continue
        if device.curved and not walls:
            spreading = spreading | (alive & curved)
            curved = curved | (alive & contact.is_curved())
        alive &= leave(device, tubes, contact)
    # The lowest bit is set for every sequence of patches, so that no sequence has the number 0.
    sequence = dr.select(sequence > 0, ((sequence << 1) & (SPREADING - 1)) | 1, 0) | dr.select(spreading, mi.UInt32(SPREADING), 0)
    return sequence.numpy().reshape(poses[1] - poses[0], -1)


def divided(sequences: np.ndarray, grid: TubeGrid, first_pose: int, pieces: int, curved: bool) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Divide the cells that straddle an edge and return the arrays index, hat_share and in_box of a `TubeSelection`.

    Args:
        sequences: result of `patch_sequences` for consecutive sensor poses.
        grid: grid of tubes.
        first_pose: index of the first of these poses.
        pieces: number of pieces of a divided cell along each grid axis.
        curved: whether the geometry has curved facets, on which tubes have hat weights.
    """
    poses, (rows, columns) = len(sequences), (grid.count_v, grid.count_u)
    middle = sequences[:, : rows * columns].reshape(poses, rows, columns)
    corner = sequences[:, rows * columns :].reshape(poses, rows + 1, columns + 1)
    straddles = np.zeros(middle.shape, bool)
    for i in (0, 1):
        for j in (0, 1):
            straddles |= corner[:, i : i + rows, j : j + columns] != middle
    straddles |= middle >= SPREADING
    if curved:  # the hat weight of a tube extends to the middles of the neighbouring cells
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
    # List the pieces of each cell that straddles an edge. Hat weights reach twice as far as box weights, so a piece may lie in several
    # hats, whose factors are summed.
    fine_v = (v[:, None] * pieces + 2 * margin + reach)[:, :, None]
    fine_u = (u[:, None] * pieces + 2 * margin + reach)[:, None, :]
    piece = ((pose[:, None, None] * fine_rows + fine_v) * fine_columns + fine_u).reshape(-1)
    weight = np.broadcast_to(tent[:, None] * tent, (len(pose), len(tent), len(tent))).reshape(-1)
    inside = (np.abs(reach) <= margin)[:, None] & (np.abs(reach) <= margin)
    total = np.bincount(piece, weight, poses * fine_rows * fine_columns)
    box = np.zeros(len(total), bool)
    box[piece.reshape(-1, len(tent) ** 2)[:, inside.reshape(-1)]] = True
    part = np.flatnonzero(total)
    first_piece = grid.poses * grid.per_pose + first_pose * fine_rows * fine_columns
    index = np.concatenate([first_pose * grid.per_pose + cells, first_piece + part])
    return index, np.concatenate([np.ones(len(cells)), total[part]]), np.concatenate([np.ones(len(cells), bool), box[part]])
