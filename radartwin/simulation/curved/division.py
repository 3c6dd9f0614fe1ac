"""Divide the cells of a ray-tube grid into whole tubes and pieces of tubes, in blocks that fit in memory.

Cells that a border of a smooth surface patch crosses are cut along this border (`borders`). After a reflection, a tube can also straddle an
edge of the next surface. To find such tubes, the module casts test rays without fields through the middles and the corners of all grid
cells. If the test rays of a cell hit different sequences of smooth surface patches, the module divides the cell into a square of pieces. It
also divides a cell whose tube is reflected by a curved surface onto another surface. Cells whose test rays hit nothing are then not traced.
Import this module only after a Mitsuba variant is active.
"""

import itertools
from collections.abc import Iterator

import drjit as dr
import mitsuba as mi
import numpy as np

from radartwin.errors import BackendError
from radartwin.simulation.curved import borders
from radartwin.simulation.curved.borders import CORNERS, PIECES, Pieces
from radartwin.simulation.curved.contact import cast, leave, meet
from radartwin.simulation.curved.device import Device
from radartwin.simulation.curved.flight import WHOLE, Tubes, TubeSelection, on_device, rays
from radartwin.simulation.curved.transit import Sheets
from radartwin.simulation.curved.tube_grid import TubeGrid
from radartwin.simulation.geometry import Geometry
from radartwin.simulation.hits import TraceOptions

MAX_TUBES = (1 << 32) - 1  # largest number of tubes in a grid, because tube indices have 32 bits
# Tubes at the shadow line of a curved object are divided if the object covers at most this many square wavelengths. Division changes the
# echo of a sphere of 10 mm radius by 0.6 dB, and that of a sphere of 20 mm by less than 0.1 dB.
SMALL = 150
TUBES_PER_BLOCK = 1 << 20  # number of tubes traced at once; it limits the memory of a kernel to a few hundred megabytes
SEVERAL = 1 << 30  # bit in the number of a patch sequence, set if it has several patches
SPREADING = 1 << 31  # bit in the number of a patch sequence, set if a curved surface reflects the test ray onto another surface


def blocks(
    device: Device,
    grid: TubeGrid,
    geometry: Geometry,
    options: TraceOptions,
    walls: Sheets | None,
    panes: bool,
    wavelength_m: float,
    receivers: int = 1,
) -> Iterator[TubeSelection]:
    """Yield the tubes of a grid in blocks. A block holds all tubes of one or more sensor poses. If a pose has more than
    TUBES_PER_BLOCK tubes, a block holds that many consecutive tubes, also of two poses. With several receivers, it holds fewer tubes.

    The function cuts no tube of a room, whose tubes overlap, and none if the tubes of a pose do not fit into one block.

    Args:
        device: geometry on the device, for the test rays.
        grid: grid of tubes.
        geometry: the same geometry.
        options: trace options, of which the function reads the number of bounces, the first cluster, and whether tubes fill a room.
        walls: walls of hollow objects through which the tubes pass; None for tubes that are reflected on the outside of the surfaces.
        panes: whether tubes also pass through sheets. wavelength_m: wavelength in metres.
        receivers: largest number of receivers of a tube.
    Raises:
        BackendError: the grid has more tubes than MAX_TUBES.
    """
    end = grid.poses * grid.per_pose
    if end > MAX_TUBES:
        raise BackendError(f"{end:.3g} tubes in one grid exceed the limit of {MAX_TUBES:.3g}; trace fewer poses at once")
    if options.hats or grid.per_pose > TUBES_PER_BLOCK // 2:
        stride = TUBES_PER_BLOCK // grid.per_pose * grid.per_pose or TUBES_PER_BLOCK
        yield from (TubeSelection(np.arange(low, min(low + stride, end), dtype=np.uint32)) for low in range(0, end, stride))
        return
    among = None if options.cluster is None else options.cluster == options.first_cluster
    # the size of the body decides, not the poses of the call
    small = np.sort(np.ptp(geometry.hull_points(), axis=0))[1:].prod() <= SMALL * wavelength_m**2
    # Test rays do not pass panes, and the far wall of a curved shell has its shadow line where the near wall has it.
    tested = not panes and (small or (options.max_bounces > 1 if walls is None else not device.curved))
    most = max(1, TUBES_PER_BLOCK // receivers)
    step = max(1, most // (2 * grid.per_pose))
    for low in range(0, grid.poses, step):
        poses = low, min(low + step, grid.poses)
        sequences = patch_sequences(device, grid, poses, options, walls) if tested else None
        cut = borders.cut(geometry, grid, poses, None if sequences is None else _around(sequences, grid, SEVERAL), among)
        index, share, cut = divided(cut, sequences, grid, poses, device.curved, small)
        for start in range(0, len(index), most):
            part = slice(start, start + most)
            tubes = index[part].astype(np.uint32)
            yield TubeSelection(tubes, share[part], cut) if len(cut.square) else TubeSelection(tubes)


def patch_sequences(device: Device, grid: TubeGrid, poses: tuple[int, int], options: TraceOptions, walls: Sheets | None) -> np.ndarray:
    """Cast the test rays and return, for each ray, a number that identifies the sequence of smooth surface patches that the ray meets.

    Returns:
        Numbers (poses, count_u count_v + (count_u + 1)(count_v + 1)), uint32. Each row lists first the test rays through the cell middles,
        then those through the cell corners. In both lists, the index along u changes fastest. The number is 0 if a ray meets no patch. Its
        bit SEVERAL is set if it meets several patches, and its bit SPREADING if a curved surface reflects it onto another surface.
        With `walls`, the sequence of a ray consists of the
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
    origin, direction, *_ = rays(on_device(grid), pose, mi.Float(cell - cell_v * count) - offset, mi.Float(cell_v) - offset)
    zero, length = mi.Vector3f(0.0), mi.Float64(0.0)
    tubes = Tubes(
        index, pose, origin, direction, zero, zero, zero, zero, length, None, zero, zero, [], mi.UInt32(0), length, length,
    )  # fmt: skip
    alive, sequence, curved, spreading, several = mi.Bool(True), mi.UInt32(0), mi.Bool(False), mi.Bool(False), mi.Bool(False)
    for bounce in range(2 if walls else options.max_bounces):
        alive = cast(device, tubes, bounce == 0, alive)
        contact, alive = meet(device, tubes, bounce == 0, alive)
        if bounce == 0:
            alive = device.in_cluster(contact.face, alive)
        if walls and bounce == 0:
            alive = walls.enter(tubes, contact, alive)
        several = several | (alive & (bounce > 0))
        # The multiplication by an odd constant makes the number depend on the order in which the ray meets the patches.
        sequence = dr.select(alive, (sequence * 0x9E3779B1) ^ dr.gather(mi.UInt32, device.patch, contact.face, alive), sequence)
        if walls and bounce == 0:
            continue
        if device.curved and not walls:
            spreading = spreading | (alive & curved)
            curved = curved | (alive & contact.is_curved())
        alive &= leave(device, tubes, contact)
    # The lowest bit is set for every sequence of patches, so that no sequence has the number 0.
    sequence = dr.select(sequence > 0, ((sequence << 1) & (SEVERAL - 1)) | 1, 0)
    sequence |= dr.select(several, mi.UInt32(SEVERAL), 0) | dr.select(spreading, mi.UInt32(SPREADING), 0)
    return sequence.numpy().reshape(poses[1] - poses[0], -1)


def divided(
    cut: Pieces, sequences: np.ndarray | None, grid: TubeGrid, poses: tuple[int, int], curved: bool, small: bool
) -> tuple[np.ndarray, np.ndarray, Pieces]:
    """Divide the squares in which tubes straddle an edge after a reflection, and return the arrays of a `TubeSelection`, ordered by pose.

    Args:
        cut: pieces of the squares that a border crosses.
        sequences: result of `patch_sequences` for these sensor poses; None divides no further square and keeps all tubes.
        grid: grid of tubes.
        poses: first sensor pose, and the pose after the last one.
        curved: whether the geometry has curved facets. small: whether tubes at shadow lines are also divided.
    """
    count, rows, columns = poses[1] - poses[0], grid.count_v, grid.count_u
    broken = np.zeros((count, rows + 1, columns + 1), bool)
    share = np.full((count, rows, columns), WHOLE)
    squares = broken.size // count
    if sequences is not None:
        middle, corner = _rays(sequences, grid)
        for i in (0, 1):
            for j in (0, 1):
                broken |= corner != middle[:, i : i + rows + 1, j : j + columns + 1]
        broken |= _around(sequences, grid, SPREADING)
        if curved and not small:
            broken &= _around(sequences, grid, SEVERAL)
        share[middle[:, 1:-1, 1:-1] == 0] = 0
        if curved and small:  # near its shadow line, a curved surface bends too much for a whole tube
            wide = np.pad(broken, ((0, 0), (1, 1), (1, 1)))
            for i in range(3):
                for j in range(3):
                    broken |= wide[:, i : i + rows + 1, j : j + columns + 1]
    broken.ravel()[cut.square - poses[0] * squares] = False
    straddles = broken.copy()
    broken.ravel()[cut.square - poses[0] * squares] = True
    # A tube contributes where no square around its centre ray is divided, one bit for each of the four squares.
    for bit, (i, j) in enumerate(((0, 0), (0, 1), (1, 0), (1, 1))):
        share[broken[:, i : i + rows, j : j + columns]] &= ~(1 << bit)
    index = np.flatnonzero(share)
    share = share.ravel()[index]
    fine, bits = _narrow_tubes(np.argwhere(straddles), broken.shape, curved)
    at = fine[:, :0:-1] / PIECES - 1
    side = np.array([[-1, -1], [1, -1], *[[1, 1]] * (CORNERS - 3), [-1, 1]]) / (2 * PIECES)
    cut = Pieces(
        np.concatenate([cut.square // squares, fine[:, 0].astype(int) + poses[0]]),
        np.concatenate([cut.centre, at]),
        np.concatenate([cut.corner, np.broadcast_to(side, (len(at), *side.shape))]),
    )
    bits = np.concatenate([np.zeros(len(cut.square) - len(bits), int), bits])
    index = np.concatenate([index + poses[0] * grid.per_pose, cut.square * grid.per_pose])
    share = np.concatenate([share, bits + (WHOLE + 1) * (1 + np.arange(len(bits)))])
    order = np.argsort(index // grid.per_pose, kind="stable")
    return index[order], share[order], cut


def _rays(sequences: np.ndarray, grid: TubeGrid) -> tuple[np.ndarray, np.ndarray]:
    """Return the numbers of `patch_sequences` through the cell middles, with zeros around the grid, and through the cell corners."""
    rows, columns = grid.count_v, grid.count_u
    middle = sequences[:, : rows * columns].reshape(-1, rows, columns)
    return np.pad(middle, ((0, 0), (1, 1), (1, 1))), sequences[:, rows * columns :].reshape(-1, rows + 1, columns + 1)


def _around(sequences: np.ndarray, grid: TubeGrid, bit: int) -> np.ndarray:
    """Return the mask (poses, rows + 1, columns + 1) of the squares in which a test ray has a bit of its number set."""
    middle, corner = (numbers & bit > 0 for numbers in _rays(sequences, grid))
    return corner | middle[:, :-1, :-1] | middle[:, :-1, 1:] | middle[:, 1:, :-1] | middle[:, 1:, 1:]


def _narrow_tubes(square: np.ndarray, shape: tuple[int, ...], curved: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return the tubes of a grid PIECES times finer that fill squares, given by pose, row and column (S, 3) in an array of this shape.

    On curved surfaces, the tubes overlap as whole tubes do. On flat surfaces, they are square pieces that lie side by side.

    Returns:
        Pose, row and column (N, 3) of the tubes in the fine grid, and the squares of this grid in which they contribute, as four bits (N,);
        zero for pieces.
    """
    place = np.arange(PIECES + 1) if curved else np.arange(PIECES) + 0.5
    inside = [(place > 0) * 1, (place < PIECES) * 1]  # towards smaller and larger coordinates
    bits = sum((inside[i][:, None] * inside[j]) << bit for bit, (i, j) in enumerate(itertools.product(range(2), repeat=2)))
    row, column = (PIECES * square[:, 1 + i, None, None] + axis for i, axis in enumerate((place[:, None], place)))
    at = np.stack(np.broadcast_arrays(square[:, 0, None, None], row, column), axis=3).reshape(-1, 3)
    if not curved:
        return at, np.zeros(len(at), int)
    rows, columns = PIECES * shape[1] + 1, PIECES * shape[2] + 1
    _, first, of = np.unique((at[:, 0] * rows + at[:, 1]) * columns + at[:, 2], return_index=True, return_inverse=True)
    return at[first], np.bincount(of.ravel(), np.tile(np.ravel(bits), len(square)), len(first)).astype(int)
