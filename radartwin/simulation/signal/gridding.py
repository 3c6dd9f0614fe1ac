"""The compiled half of the synthesis: spread paths over a grid of delays, transform it, and put the chirps together.

A task is a range of paths of one frame with a grid of its own, so that no two threads write to the same place and sums have a fixed
order; large frames are several tasks. Geometry, phases and grids are double precision, the transform and what follows it single (1e-7 of
the frame's strongest echo). Arrays per channel count transmitters first.
"""

import numpy as np

from radartwin.compiled import compiled, innermost

TAPS = 6  # of the spreading kernel
PAD = TAPS + 2  # cells beyond the grid that a kernel at its end reaches
_BLOCK = 8  # rows turned at once, for the cache
_EARLY = TAPS // 2 - 1  # the first tap lies this many cells before the one left of the point
_SMALL = 1e-4  # below it, three terms of the Bessel functions' series are exact


@compiled
def _turn(cycles):
    """Cosine and sine of 2 pi cycles, to 1e-11: Taylor series of half the angle, which is at most a right one."""
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
    """J_0..J_(len(out)-1) of a real argument into `out`, by Miller's downward recurrence, normalised by J_0 + 2 J_2 + 2 J_4 + ... = 1."""
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
    """Distance from an antenna element to the point `length` along `direction` of the phase centre, to full precision, or as the
    element's place along the direction would have it."""
    along = direction[0] * position[0] + direction[1] * position[1] + direction[2] * position[2]
    if planar:
        return length - along
    squared = position[0] * position[0] + position[1] * position[1] + position[2] * position[2]
    change = squared - 2 * length * along
    return length + change / (length + np.sqrt(max(length * length + change, 0.0)))


@innermost
def _image_distance(length, direction, mirror, transmitter, receiver, planar):
    """Distance to a receiver from the image of a transmitter, whose array is mirrored at `length` along `direction`."""
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
    """Weights of the Chebyshev terms k of the frame and q of the band, (2 - [k=0]) j^k J_k(w) amplitude_q, at k Q + q."""
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
def spread(
    first, last, starts, length_in, length_out, departure, arrival, mirror, drift, motion, amplitude, tx, rx, planar, cycles_per_m,
    cells_per_m, terms, kernel, least, grid_re, grid_im,
):  # fmt: skip
    """Fill the grids of tasks first..last, (tasks, channels x terms x Q, cells + PAD), which are zero.

    Args:
        starts: (tasks + 1,) the first path of each task. mirror: (N, 3, 3), or (0, 3, 3) where hits stay in their places.
        drift: (N,) metres each path is longer in the middle of the frame. motion: (N,) argument of the Bessel functions.
        amplitude: (N, Q) coefficients over the band. tx, rx: element positions. planar: one direction for all.
        cycles_per_m: phase at the middle of the sweep. cells_per_m: grid cells per metre of path.
        kernel: (degree + 1, TAPS) polynomials of the taps in the point's place between two cells, highest power first.
        least: weights below it are left out.
    """
    rows = terms * amplitude.shape[1]
    _spread(
        first, last, starts, length_in, length_out, departure, arrival, mirror, drift, motion, amplitude, tx, rx, planar, cycles_per_m,
        cells_per_m, rows, kernel, least, grid_re, grid_im,
        np.empty(rows), np.empty(rows), np.empty(terms), np.empty(TAPS), np.empty(rows, np.int64), np.empty((3, len(rx))),
    )  # fmt: skip


@innermost
def _spread(
    first, last, starts, length_in, length_out, departure, arrival, mirror, drift, motion, amplitude, tx, rx, planar, cycles_per_m,
    cells_per_m, rows, kernel, least, grid_re, grid_im,
    weight_re, weight_im, orders, taps, kept, received,
):  # fmt: skip
    """`spread` with room to work in."""
    cells = grid_re.shape[2] - PAD
    mirrored = len(mirror) > 0
    rx_m, rx_re, rx_im = received[0], received[1], received[2]
    for task in range(first, last):
        for p in range(starts[task], starts[task + 1]):
            _motion(motion[p], amplitude[p], weight_re, weight_im, orders)
            count = 0
            for b in range(rows):
                if weight_re[b] * weight_re[b] + weight_im[b] * weight_im[b] > least * least:
                    kept[count] = b
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
                    row = (t * len(rx) + r) * rows
                    for j in range(count):
                        b = kept[j]
                        re = weight_re[b] * turn_re - weight_im[b] * turn_im
                        im = weight_re[b] * turn_im + weight_im[b] * turn_re
                        for i in range(TAPS):
                            grid_re[task, row + b, left + np.uint64(i)] += taps[i] * re
                            grid_im[task, row + b, left + np.uint64(i)] += taps[i] * im


@compiled
def _gather(task, stop, grid, out):
    """Sum the grids of tasks task..stop, fold their ends, and lay cells before rows: (cells x rows,) single precision."""
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
                    line[m] += source[m + _EARLY]
                for m in range(_EARLY):
                    line[cells - _EARLY + m] += source[m]
                for m in range(PAD - _EARLY):
                    line[m] += source[cells + _EARLY + m]
        for m in range(cells):
            for b in range(count):
                out[m * rows + low + b] = lines[b, m]


@compiled
def transform(re, im, other_re, other_im, rows, cosine, sine):
    """sum_m x[m] exp(+j 2 pi m n/M) along the first axis of (M, rows) flat arrays, by Stockham's radix-4 passes with one of radix 2 where
    needed; returns the pair of arrays that holds the result. cosine, sine: (M,) of 2 pi m/M, M a power of two."""
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
def finish(first, last, tasks, grid_re, grid_im, cosine, sine, band, slow, iq):
    """Add the grids of frames first..last to their IQ, (F, C, T, R, N).

    Args:
        tasks: (F + 1,) the first task of each frame.
        cosine, sine: (cells,) single precision, of one turn over the grid.
        band: (Q, N) single precision, polynomials over the samples times the correction of the kernel.
        slow: (T, C, terms, N) single precision, the Chebyshev polynomials of f tau.
    """
    rows, cells = grid_re.shape[1], grid_re.shape[2] - PAD
    nodes, samples = band.shape
    num_tx, num_chirps, terms = slow.shape[:3]
    num_rx = iq.shape[3]
    re, im = np.empty(cells * rows, np.float32), np.empty(cells * rows, np.float32)
    other_re, other_im = np.empty_like(re), np.empty_like(im)
    term_re, term_im = np.empty((terms, samples), np.float32), np.empty((terms, samples), np.float32)
    sum_re, sum_im = np.empty(samples, np.float32), np.empty(samples, np.float32)
    wrap = samples // 2  # the sample at the middle of the sweep is the transform's zero
    for frame in range(first, last):
        if tasks[frame] == tasks[frame + 1]:
            continue
        _gather(tasks[frame], tasks[frame + 1], grid_re, re)
        _gather(tasks[frame], tasks[frame + 1], grid_im, im)
        got_re, got_im = transform(re, im, other_re, other_im, rows, cosine, sine)
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
