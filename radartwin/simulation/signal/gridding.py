"""Contain the compiled functions of the signal synthesis: they spread paths over a grid of delays, transform the grid, and form the chirps.

A task is a group of consecutive paths of one frame. Each task has its own grid of delays, so that no two threads write to the same grid
cell, and the sum over paths always has the same order. Frames with many paths are split into several tasks. Path lengths, phases and grids
have double precision. The Fourier transform and the chirps have single precision, which causes an error of 1e-7 of the frame's strongest
echo. The channels (pairs of a transmitter and a receiver) are ordered by transmitter first, then by receiver. All these functions are in
one file of over 300 lines, because Numba does not recompile a cached function when a function in another file changes.
"""

from typing import Any, NamedTuple

import numpy as np

from radartwin.compiled import compiled, innermost

TAPS = 6  # number of delay-grid cells (taps) over which the spreading kernel distributes each path
PAD = TAPS + 2  # number of cells appended to the delay grid, for kernels that extend beyond the end of the grid
_BLOCK = 8  # number of grid rows that `_gather` transposes at once, so that the rows fit into the processor's cache
_TAPS_BEFORE = TAPS // 2 - 1  # number of kernel taps to the left of the grid cell in which the delay of a path lies
_SMALL = 1e-4  # for arguments below this limit, three terms of the Bessel functions' power series are exact in double precision


class PathArrays(NamedTuple):
    """Hold the N paths of all tasks; a task is a group of consecutive paths of one frame.

    The first six arrays are those of `radartwin.simulation.paths.Paths`. `mirror` has the shape (0, 3, 3) if no path is a mirror path, and
    `gain` the shape (0, 0) if all channels have the same amplitude.
    """

    length_in: Any
    length_out: Any
    departure: Any
    arrival: Any
    mirror: Any
    gain: Any
    drift: Any  # (N,) change of each path's length from the start to the middle of the frame, in metres
    motion: Any  # (N,) argument of the Bessel functions that represent the phase caused by each path's motion, in radians
    amplitude: Any  # (N, Q) coefficients of Q Chebyshev polynomials that represent each path's amplitude over frequency


class Elements(NamedTuple):
    """Hold the positions of the antenna elements in the sensor frame, in metres."""

    tx: Any  # (T, 3) positions of the transmit antennas, in metres
    rx: Any  # (R, 3) positions of the receive antennas, in metres
    planar: Any  # True assumes plane waves, so that all antenna elements see a path in the same direction


class GridScale(NamedTuple):
    """Define how a path length in metres is converted to a phase and to a position in the delay grid."""

    cycles_per_m: Any  # phase per metre of path length at the middle of the frequency sweep, in cycles
    cells_per_m: Any  # number of delay-grid cells per metre of path length
    terms: Any  # number of Chebyshev terms that represent the motion of the paths within a frame
    # (degree + 1, TAPS) polynomial coefficients, highest power first. The polynomial of a tap gives its kernel weight as a function of the
    # position (0 to 1) of a path between two grid cells.
    kernel: Any
    least: Any  # the synthesis skips terms of a path whose weight has a smaller magnitude than this


class Grid(NamedTuple):
    """Hold the real and the imaginary part of the delay grids of all tasks, each of shape (tasks, channels x terms x Q, cells + PAD)."""

    re: Any
    im: Any


class Workspace(NamedTuple):
    """Hold the arrays that `spread` allocates once, before its loop over paths."""

    weight_re: Any
    weight_im: Any
    orders: Any
    taps: Any
    used: Any
    received: Any


class Turn(NamedTuple):
    """Hold the cosine and the sine of the angles 2 pi m/cells for m = 0 to cells - 1, each (cells,) in single precision."""

    cosine: Any
    sine: Any


@compiled
def _turn(cycles):
    """Return cosine and sine of the angle 2 pi cycles, with an error of 1e-11.

    The function uses Taylor series of half the angle, whose magnitude is at most pi/2.
    """
    half = np.pi * (cycles - np.floor(cycles + 0.5))
    z = half * half
    sine = 1 - z * (1 / 156) * (1 - z * (1 / 210))
    sine = 1 - z * (1 / 42) * (1 - z * (1 / 72) * (1 - z * (1 / 110) * sine))
    sine = half * (1 - z * (1 / 6) * (1 - z * (1 / 20) * sine))
    cosine = 1 - z * (1 / 132) * (1 - z * (1 / 182) * (1 - z * (1 / 240)))
    cosine = 1 - z * (1 / 30) * (1 - z * (1 / 56) * (1 - z * (1 / 90) * cosine))
    cosine = 1 - z * (1 / 2) * (1 - z * (1 / 12) * cosine)
    return 1 - 2 * sine * sine, 2 * sine * cosine


@innermost
def bessel(argument, out):
    """Write J_0..J_(len(out)-1) of a real argument to `out`, by Miller's downward recurrence with J_0 + 2 J_2 + 2 J_4 + ... = 1."""
    x, count = abs(argument), len(out)
    out[:] = 0.0
    if x < _SMALL:
        out[0] = 1 - x * x / 4
        if count > 1:
            out[1] = argument / 2
        if count > 2:
            out[2] = x * x / 8
        return
    order = 2 * ((int(x) + 18 + int(3 * x ** (1 / 3))) // 2)
    above, here, total = 0.0, 1e-30, 2e-30
    if order < count:
        out[order] = here
    while order > 0:
        above, here = here, 2 * order / x * here - above
        order -= 1
        if order % 2 == 0:
            total += 2 * here if order else here
        if order < count:
            out[order] = here
    for k in range(count):
        out[k] = out[k] / total if k % 2 == 0 or argument > 0 else -out[k] / total


@innermost
def _element_distance(length, direction, position, planar):
    """Return the distance in metres from an antenna element to the point that is `length` metres from the phase centre along `direction`.

    If `planar` is True, the function assumes a plane wave.
    """
    along = direction[0] * position[0] + direction[1] * position[1] + direction[2] * position[2]
    if planar:
        return length - along
    squared = position[0] * position[0] + position[1] * position[1] + position[2] * position[2]
    change = squared - 2 * length * along
    return length + change / (length + np.sqrt(max(length * length + change, 0.0)))


@innermost
def _image_distance(length, direction, mirror, transmitter, receiver, planar):
    """Return the distance in metres of a receive element from the mirror image of a transmit element.

    The mirror image of the sensor's phase centre is `length` metres from the phase centre along `direction`. If `planar` is True, the
    function assumes a plane wave.
    """
    x, y, z = -receiver[0], -receiver[1], -receiver[2]
    for i in range(3):
        x += mirror[0, i] * transmitter[i]
        y += mirror[1, i] * transmitter[i]
        z += mirror[2, i] * transmitter[i]
    along = x * direction[0] + y * direction[1] + z * direction[2]
    if planar:
        return length + along
    return np.sqrt(max(length * length + 2 * length * along + x * x + y * y + z * z, 0.0))


@innermost
def _motion(w, amplitude, weight_re, weight_im, orders):
    """Write the weight (2 - [k=0]) j^k J_k(w) amplitude_q of Chebyshev term k of the motion and frequency term q to index k Q + q."""
    bessel(w, orders)
    nodes = len(amplitude)
    for k in range(len(orders)):
        size = orders[k] if k == 0 else 2 * orders[k]
        if k % 4 >= 2:
            size = -size
        for q in range(nodes):
            a = amplitude[q]
            if k % 2 == 0:
                weight_re[k * nodes + q], weight_im[k * nodes + q] = size * a.real, size * a.imag
            else:
                weight_re[k * nodes + q], weight_im[k * nodes + q] = -size * a.imag, size * a.real


@compiled
def spread(first, last, starts, paths, elements, scale, grid):
    """Add the paths of the tasks `first` to `last` - 1 to delay grids. A task is a group of consecutive paths of one frame and has its own
    delay grid.

    The caller must set the delay grids to zero before the call.

    Args:
        starts: index of the first path of each task, followed by the number of paths N.
        paths: the PathArrays of all tasks.
        elements: the Elements of the radar's antenna array.
        scale: the GridScale that converts path lengths to phases and grid positions.
        grid: the Grid to which the paths are added.
    """
    terms, rows = scale.terms, scale.terms * paths.amplitude.shape[1]
    room = Workspace(
        np.empty(rows), np.empty(rows), np.empty(terms), np.empty(TAPS), np.empty(rows, np.int64), np.empty((3, len(elements.rx)))
    )
    _spread(first, last, starts, paths, elements, scale, grid, room)


@innermost
def _spread(first, last, starts, paths, elements, scale, grid, room):
    """Do the work of `spread` with the arrays of a Workspace, which `room` holds."""
    length_in, length_out, departure, arrival, mirror = paths.length_in, paths.length_out, paths.departure, paths.arrival, paths.mirror
    drift, motion, amplitude = paths.drift, paths.motion, paths.amplitude
    tx, rx, planar = elements.tx, elements.rx, elements.planar
    cycles_per_m, cells_per_m, kernel, least = scale.cycles_per_m, scale.cells_per_m, scale.kernel, scale.least
    grid_re, grid_im = grid.re, grid.im
    weight_re, weight_im, orders, taps, used = room.weight_re, room.weight_im, room.orders, room.taps, room.used
    rows = len(weight_re)
    cells = grid_re.shape[2] - PAD
    mirrored, gains = len(mirror) > 0, len(paths.gain) > 0
    rx_m, rx_re, rx_im = room.received[0], room.received[1], room.received[2]
    for task in range(first, last):
        for p in range(starts[task], starts[task + 1]):
            _motion(motion[p], amplitude[p], weight_re, weight_im, orders)
            count = 0
            for b in range(rows):
                if weight_re[b] * weight_re[b] + weight_im[b] * weight_im[b] > least * least:
                    used[count] = b
                    count += 1
            for r in range(len(rx) if not mirrored else 0):
                rx_m[r] = _element_distance(length_out[p], arrival[p], rx[r], planar)
                rx_re[r], rx_im[r] = _turn(cycles_per_m * rx_m[r])
            for t in range(len(tx)):
                tx_m, tx_re, tx_im = drift[p], 1.0, 0.0
                if not mirrored:
                    tx_m += _element_distance(length_in[p], departure[p], tx[t], planar)
                    tx_re, tx_im = _turn(cycles_per_m * tx_m)
                for r in range(len(rx)):
                    if mirrored:
                        rx_m[r] = _image_distance(length_in[p] + length_out[p], arrival[p], mirror[p], tx[t], rx[r], planar)
                        rx_re[r], rx_im[r] = _turn(cycles_per_m * (tx_m + rx_m[r]))
                    place = cells_per_m * (tx_m + rx_m[r])
                    place -= cells * np.floor(place / cells)
                    left = np.uint64(place)
                    offset = place - left
                    for i in range(TAPS):
                        taps[i] = kernel[0, i]
                    for d in range(1, kernel.shape[0]):
                        for i in range(TAPS):
                            taps[i] = taps[i] * offset + kernel[d, i]
                    turn_re, turn_im = tx_re * rx_re[r] - tx_im * rx_im[r], tx_re * rx_im[r] + tx_im * rx_re[r]
                    if gains:
                        g = paths.gain[p, t * len(rx) + r]
                        turn_re, turn_im = turn_re * g.real - turn_im * g.imag, turn_re * g.imag + turn_im * g.real
                    row = (t * len(rx) + r) * rows
                    for j in range(count):
                        b = used[j]
                        re = weight_re[b] * turn_re - weight_im[b] * turn_im
                        im = weight_re[b] * turn_im + weight_im[b] * turn_re
                        for i in range(TAPS):
                            grid_re[task, row + b, left + np.uint64(i)] += taps[i] * re
                            grid_im[task, row + b, left + np.uint64(i)] += taps[i] * im


@compiled
def _gather(task, stop, grid, out):
    """Sum the delay grids of the tasks `task` to `stop` - 1 of one frame and write the sum to `out`, (cells x rows,) in single precision.

    The PAD cells beyond the ends of the grid are added to the cells at its opposite end, because the delay grid is periodic.
    """
    rows, cells = grid.shape[1], grid.shape[2] - PAD
    lines = np.empty((_BLOCK, cells))
    for low in range(0, rows, _BLOCK):
        count = min(_BLOCK, rows - low)
        for b in range(count):
            line = lines[b]
            line[:] = 0.0
            for one in range(task, stop):
                source = grid[one, low + b]
                for m in range(cells):
                    line[m] += source[m + _TAPS_BEFORE]
                for m in range(_TAPS_BEFORE):
                    line[cells - _TAPS_BEFORE + m] += source[m]
                for m in range(PAD - _TAPS_BEFORE):
                    line[m] += source[cells + _TAPS_BEFORE + m]
        for m in range(cells):
            for b in range(count):
                out[m * rows + low + b] = lines[b, m]


@compiled
def transform(re, im, other_re, other_im, rows, cosine, sine):
    """Compute the Fourier sum sum_m x[m] exp(+j 2 pi m n/M) along the first axis of flattened (M, rows) arrays.

    The function uses the Stockham FFT with radix 4 and 2. The length M must be a power of two.

    Args:
        re, im: real and imaginary part of the input x; the function overwrites both arrays.
        other_re, other_im: work arrays of the same size as `re` and `im`.
        cosine, sine: (M,) cosine and sine of the angles 2 pi m/M.
    Returns:
        The pair of arrays (real part, imaginary part) that holds the result.
    """
    size = len(cosine)
    n, stride, turns = size, rows, 1
    while n >= 4:
        quarter = n // 4
        for p in range(quarter):
            c1, s1 = cosine[p * turns], sine[p * turns]
            c2, s2 = cosine[2 * p * turns], sine[2 * p * turns]
            c3, s3 = cosine[3 * p * turns], sine[3 * p * turns]
            source, target, step = stride * p, stride * 4 * p, stride * quarter
            for i in range(stride):
                a_re, a_im = re[source + i], im[source + i]
                b_re, b_im = re[source + step + i], im[source + step + i]
                c_re, c_im = re[source + 2 * step + i], im[source + 2 * step + i]
                d_re, d_im = re[source + 3 * step + i], im[source + 3 * step + i]
                even_re, even_im, odd_re, odd_im = a_re + c_re, a_im + c_im, a_re - c_re, a_im - c_im
                sum_re, sum_im = b_re + d_re, b_im + d_im
                turned_re, turned_im = d_im - b_im, b_re - d_re  # j (b - d)
                other_re[target + i], other_im[target + i] = even_re + sum_re, even_im + sum_im
                x_re, x_im = odd_re + turned_re, odd_im + turned_im
                other_re[target + stride + i], other_im[target + stride + i] = c1 * x_re - s1 * x_im, c1 * x_im + s1 * x_re
                x_re, x_im = even_re - sum_re, even_im - sum_im
                other_re[target + 2 * stride + i], other_im[target + 2 * stride + i] = c2 * x_re - s2 * x_im, c2 * x_im + s2 * x_re
                x_re, x_im = odd_re - turned_re, odd_im - turned_im
                other_re[target + 3 * stride + i], other_im[target + 3 * stride + i] = c3 * x_re - s3 * x_im, c3 * x_im + s3 * x_re
        re, im, other_re, other_im = other_re, other_im, re, im
        n, stride, turns = quarter, 4 * stride, 4 * turns
    if n == 2:
        for i in range(stride):
            a_re, a_im, b_re, b_im = re[i], im[i], re[stride + i], im[stride + i]
            other_re[i], other_im[i], other_re[stride + i], other_im[stride + i] = a_re + b_re, a_im + b_im, a_re - b_re, a_im - b_im
        re, im, other_re, other_im = other_re, other_im, re, im
    return re, im


@compiled
def finish(first, last, tasks, grid, turn, band, slow, iq):
    """Compute the IQ samples of the frames `first` to `last` - 1 from their delay grids, and add the samples to `iq` (F, C, T, R, N).

    Args:
        tasks: (F + 1,) index of the first task of each frame.
        grid: the Grid that `spread` has filled.
        turn: the Turn for the Fourier transform over the grid cells.
        band: (Q, N) single precision. Row q is Chebyshev polynomial q over the N samples of a chirp, divided by the Fourier transform of
            the spreading kernel.
        slow: (T, C, terms, N) single precision. Entry k of the third axis is Chebyshev polynomial k of the product of frequency and time.
    """
    rows, cells = grid.re.shape[1], grid.re.shape[2] - PAD
    nodes, samples = band.shape
    num_tx, num_chirps, terms = slow.shape[:3]
    num_rx = iq.shape[3]
    re, im = np.empty(cells * rows, np.float32), np.empty(cells * rows, np.float32)
    other_re, other_im = np.empty_like(re), np.empty_like(im)
    term_re, term_im = np.empty((terms, samples), np.float32), np.empty((terms, samples), np.float32)
    sum_re, sum_im = np.empty(samples, np.float32), np.empty(samples, np.float32)
    wrap = samples // 2  # the middle sample of the frequency sweep has index zero in the Fourier transform
    for frame in range(first, last):
        if tasks[frame] == tasks[frame + 1]:
            continue
        _gather(tasks[frame], tasks[frame + 1], grid.re, re)
        _gather(tasks[frame], tasks[frame + 1], grid.im, im)
        got_re, got_im = transform(re, im, other_re, other_im, rows, turn.cosine, turn.sine)
        for t in range(num_tx):
            for r in range(num_rx):
                row = (t * num_rx + r) * terms * nodes
                term_re[:], term_im[:] = 0.0, 0.0
                for n in range(samples):
                    at = (n - wrap if n >= wrap else n - wrap + cells) * rows + row
                    for k in range(terms):
                        for q in range(nodes):
                            term_re[k, n] += band[q, n] * got_re[at + k * nodes + q]
                            term_im[k, n] += band[q, n] * got_im[at + k * nodes + q]
                for c in range(num_chirps):
                    sum_re[:], sum_im[:] = term_re[0], term_im[0]
                    for k in range(1, terms):
                        for n in range(samples):
                            sum_re[n] += slow[t, c, k, n] * term_re[k, n]
                            sum_im[n] += slow[t, c, k, n] * term_im[k, n]
                    for n in range(samples):
                        iq[frame, c, t, r, n] += complex(sum_re[n], sum_im[n])
