"""Contain the compiled functions of the signal synthesis: they spread paths over a grid of delays, transform the grid, and form the chirps.

A task is a group of paths of one frame. Each task has its own grid of delays, so that no two threads write to the same grid cell, and the
sum over paths always has the same order. Frames with many paths are split into several tasks. Path lengths and phases have double
precision. The grids, the Fourier transform and the chirps have single precision, which causes an error of 3e-7 of the frame's strongest
echo. The channels (pairs of a transmitter and a receiver) are ordered by transmitter first, then by receiver. The channels of a grid cell
are next to each other in memory, because a path has almost the same delay in all channels.
"""

from typing import Any, NamedTuple

import numpy as np

from radartwin.compiled import compiled, inner, innermost

TAPS = 6  # number of delay-grid cells (taps) over which the spreading kernel distributes each path
DEGREE = TAPS + 1  # degree of the polynomials that approximate the spreading kernel with an error of 1e-6 of its peak
_TAPS_BEFORE = TAPS // 2 - 1  # number of kernel taps to the left of the grid cell in which the delay of a path lies
_SMALL = 1e-13  # smallest argument of the Bessel functions' recurrence, which smaller arguments would make overflow


class PathArrays(NamedTuple):
    """Hold the N paths of all tasks.

    The first seven arrays are those of `radartwin.simulation.paths.Paths`. `mirror` has the shape (0, 3, 3) if no path is a mirror path,
    and `gain` the shape (0, 0) if all channels have the same amplitude.
    """

    length_in: Any
    length_out: Any
    departure: Any
    arrival: Any
    rate: Any
    mirror: Any
    gain: Any
    # (N, D) weights of D copies of each path, whose delays are one grid cell apart and whose mean delay is that of the path. The sum of the
    # copies has the amplitude of the path over frequency.
    amplitude: Any


class Setup(NamedTuple):
    """Hold the antenna elements, and define how a path length in metres is converted to a phase and to a position in the delay grid."""

    tx: Any  # (T, 3) positions of the transmit antennas in the sensor frame, in metres
    rx: Any  # (R, 3) positions of the receive antennas
    planar: Any  # True assumes plane waves, so that all antenna elements see a path in the same direction
    cycles_per_m: Any  # phase per metre of path length at the middle of the frequency sweep, in cycles
    cells_per_m: Any  # number of delay-grid cells per metre of path length
    cells: Any  # number of delay-grid cells
    middle_s: Any  # time from the start to the middle of the frame
    motion_per_mps: Any  # argument of the Bessel functions that represent the motion of a path of 1 m/s within a frame, in radians
    # (DEGREE + 1, TAPS) polynomial coefficients, highest power first. The polynomial of a tap gives its kernel weight as a function of the
    # position (0 to 1) of a path between two grid cells.
    kernel: Any
    least: Any  # the synthesis skips copies and terms of a path whose weight has a smaller magnitude than this


@inner
def _phasor(cycles):
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
def _element_distance(length, direction, position, planar):
    """Return the distance in metres from an antenna element to the point that is `length` metres from the phase centre along `direction`.

    If `planar` is True, the function assumes a plane wave. `spreading` evaluates this function for Dr.Jit arrays.
    """
    along = direction[0] * position[0] + direction[1] * position[1] + direction[2] * position[2]
    if planar:
        return length - along
    squared = position[0] * position[0] + position[1] * position[1] + position[2] * position[2]
    change = squared - 2 * length * along
    return length + change / (length + abs(length * length + change) ** 0.5)


@innermost
def _image_distance(length, direction, mirror, transmitter, receiver, planar):
    """Return the distance in metres of a receive element from the mirror image of a transmit element.

    The mirror image of the sensor's phase centre is `length` metres from the phase centre along `direction`. If `planar` is True, the
    function assumes a plane wave. `spreading` evaluates this function for Dr.Jit arrays.
    """
    x, y, z = -receiver[0], -receiver[1], -receiver[2]
    for i in range(3):
        x += mirror[0, i] * transmitter[i]
        y += mirror[1, i] * transmitter[i]
        z += mirror[2, i] * transmitter[i]
    along = x * direction[0] + y * direction[1] + z * direction[2]
    if planar:
        return length + along
    return abs(length * length + 2 * length * along + x * x + y * y + z * z) ** 0.5


@innermost
def bessel(argument, out):
    """Write J_0..J_(len(out)-1) of a real argument to `out`, by Miller's downward recurrence with J_0 + 2 J_2 + 2 J_4 + ... = 1."""
    x, count = max(abs(argument), _SMALL), len(out)
    out[:] = 0.0
    order = 14 if x < 1 else 2 * ((int(x) + 18 + int(3 * x ** (1 / 3))) // 2)
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
def _motion(argument, out):
    """Write the weight (2 - [k=0]) J_k(argument) of each Chebyshev term k of the motion to `out`; `finish` applies the factor j^k."""
    bessel(argument, out)
    for k in range(1, len(out)):
        out[k] *= 2


@compiled
def motions(first, last, argument, out):
    """Write the weights of the terms of the motion to `out` (N, terms), for the arguments (N,) `first` to `last` - 1."""
    for p in range(first, last):
        _motion(argument[p], out[p])


@compiled
def expand(first, last, amplitude, gain, copies_re, copies_im, weights, power):
    """Compute the weights of the copies of the paths `first` to `last` - 1.

    Args:
        amplitude: (N, Q) amplitudes at the frequency nodes.
        gain: (N,) complex gain of the antennas and of the IF filter.
        copies_re, copies_im: (Q, D) weights of the copies of a path whose amplitude is 1 at one node and 0 at the others.
        weights: (N, D) receives the weights of the copies.
        power: (N,) receives the squared magnitude of the amplitudes, averaged over the nodes.
    """
    nodes, copies = copies_re.shape
    re, im = np.empty(copies), np.empty(copies)
    for p in range(first, last):
        re[:], im[:], power[p] = 0.0, 0.0, 0.0
        for j in range(nodes):
            a = gain[p] * amplitude[p, j]
            power[p] += (a.real * a.real + a.imag * a.imag) / nodes
            _combine(a.real, copies_re[j], -a.imag, copies_im[j], re)
            _combine(a.real, copies_im[j], a.imag, copies_re[j], im)
        for m in range(copies):
            weights[p, m] = complex(re[m], im[m])


@compiled
def ripple(first, last, departure, arrival, num_tx, points, weights, out):
    """Write to `out` (N, C) the factor by which each channel multiplies the amplitude of a path, for the paths `first` to `last` - 1.

    Args:
        departure, arrival: (N, 3) directions of the paths.
        num_tx: number of transmit antennas, T.
        points: (T + R, J, 3) displacements of J copies of each antenna in wavelengths, transmitters first.
        weights: (T + R, 1 + J) complex weights of each antenna and of its copies.
    """
    antennas, copies = points.shape[:2]
    num_rx = antennas - num_tx
    factor = np.empty(antennas, np.complex128)
    for p in range(first, last):
        for k in range(antennas):
            way = departure[p] if k < num_tx else arrival[p]
            re, im = weights[k, 0].real, weights[k, 0].imag
            for j in range(copies):
                d, w = points[k, j], weights[k, 1 + j]
                c, s = _phasor(-(d[0] * way[0] + d[1] * way[1] + d[2] * way[2]))
                re += w.real * c - w.imag * s
                im += w.real * s + w.imag * c
            factor[k] = complex(re, im)
        for c in range(num_tx * num_rx):
            out[p, c] = factor[c // num_rx] * factor[num_tx + c % num_rx]


@compiled
def spread(first, last, starts, paths, setup, grid):
    """Add the paths of the tasks `first` to `last` - 1 to delay grids. Each task has its own delay grid.

    Args:
        starts: index of the first path of each task, followed by the number of paths N.
        paths: the PathArrays of all tasks.
        setup: the Setup of the radar and the grid.
        grid: (tasks, terms, (cells + pad) x 2 C) delay grids in single precision, to which the paths are added, one for each term of the
            motion. A cell has the real parts of all C channels, followed by the imaginary parts. The grid has `pad` more cells than the
            period of the delays, for kernels and copies that extend beyond its end.
    """
    channels = len(setup.tx) * len(setup.rx)
    width = (grid.shape[2] // (2 * channels) - setup.cells) * 2 * channels
    received, length, phasor, offset = np.empty(len(setup.rx)), np.empty(channels), np.empty((2, channels)), np.empty(channels)
    orders = np.empty(grid.shape[1])
    shift, lines = np.empty(channels, np.int64), np.empty((3, width), np.float32)
    shape, turned = lines[0].reshape(-1, 2, channels), lines[1].reshape(-1, 2, channels)
    order, ends = np.empty(starts[last] - starts[first], np.int64), np.empty(setup.cells + 1, np.int64)
    for task in range(first, last):
        _by_delay(starts[task], starts[task + 1], paths, setup, order, ends)
        for i in range(starts[task + 1] - starts[task]):
            _spread(order[i], paths, setup, grid[task], orders, received, length, phasor, offset, shift, shape, turned, lines)


@innermost
def _by_delay(start, stop, paths, setup, order, ends):
    """Write the paths `start` to `stop` - 1 to `order`, sorted by their grid cell, so that the cells stay in the processor's cache.

    The work array `ends` has one entry more than the grid has cells.
    """
    ends[:] = 0
    for p in range(start, stop):
        ends[int(np.floor(setup.cells_per_m * (paths.length_in[p] + paths.length_out[p]))) % setup.cells + 1] += 1
    for m in range(1, len(ends)):
        ends[m] += ends[m - 1]
    for p in range(start, stop):
        cell = int(np.floor(setup.cells_per_m * (paths.length_in[p] + paths.length_out[p]))) % setup.cells
        order[ends[cell]] = p
        ends[cell] += 1


@innermost
def _lengths(p, paths, setup, drift, received, length):
    """Write the length of path `p` between the elements of each channel, at the middle of the frame, to `length` (C,)."""
    tx, rx, planar = setup.tx, setup.rx, setup.planar
    count = len(rx)
    if len(paths.mirror) > 0:
        whole = paths.length_in[p] + paths.length_out[p]
        for t in range(len(tx)):
            for r in range(count):
                length[t * count + r] = drift + _image_distance(whole, paths.arrival[p], paths.mirror[p], tx[t], rx[r], planar)
        return
    for r in range(count):
        received[r] = _element_distance(paths.length_out[p], paths.arrival[p], rx[r], planar)
    for t in range(len(tx)):
        sent = drift + _element_distance(paths.length_in[p], paths.departure[p], tx[t], planar)
        for r in range(count):
            length[t * count + r] = sent + received[r]


@innermost
def _spread(p, paths, setup, grid, orders, received, length, phasor, offset, shift, shape, turned, lines):
    """Add path `p` to the delay grid (terms, (cells + pad) x 2 C) of its task.

    The other arguments are work arrays: `orders` (terms,), `received` (R,), `phasor` (2, C), and `length`, `offset` and `shift` (C,).
    `shape` (cells, 2, C) receives the weights of a copy of the path in all channels of the cells that its kernel reaches, and `turned` the
    same times j. They are the first two rows of `lines` (3, cells x 2 C), whose third row receives the sum of all copies.
    """
    channels, kernel, copies = len(length), setup.kernel, paths.amplitude.shape[1]
    # The length of each channel gives the phase factor and the position in the grid.
    _lengths(p, paths, setup, setup.middle_s * paths.rate[p], received, length)
    lowest = np.inf
    for c in range(channels):
        phasor[0, c], phasor[1, c] = _phasor(setup.cycles_per_m * length[c])
        offset[c] = setup.cells_per_m * length[c]
        lowest = min(lowest, offset[c])
    if len(paths.gain) > 0:
        for c in range(channels):
            g = paths.gain[p, c]
            phasor[0, c], phasor[1, c] = phasor[0, c] * g.real - phasor[1, c] * g.imag, phasor[0, c] * g.imag + phasor[1, c] * g.real
    # The channels share the leftmost cell; `offset` is the position of a channel between two cells, `shift` its distance in cells.
    lowest = np.floor(lowest)
    farthest = 0
    for c in range(channels):
        offset[c] -= lowest
        shift[c] = int(offset[c])
        offset[c] -= shift[c]
        farthest = max(farthest, shift[c])
    # Weights of the taps, from the polynomials of the kernel, moved right by `shift` cells.
    for i in range(TAPS):
        for c in range(channels):
            weight = kernel[0, i]
            for d in range(1, DEGREE + 1):
                weight = weight * offset[c] + kernel[d, i]
            shape[i, 0, c], shape[i, 1, c] = weight * phasor[0, c], weight * phasor[1, c]
    reach = TAPS + farthest
    if farthest > 0:
        shape[TAPS:reach] = 0.0
        for c in range(channels):
            for _ in range(shift[c]):
                for i in range(reach - 1, 0, -1):
                    shape[i, 0, c], shape[i, 1, c] = shape[i - 1, 0, c], shape[i - 1, 1, c]
                shape[0, 0, c], shape[0, 1, c] = 0.0, 0.0
    for i in range(reach):
        for c in range(channels):
            turned[i, 0, c], turned[i, 1, c] = -shape[i, 1, c], shape[i, 0, c]
    width = 2 * channels
    left, size, every = (int(lowest) - copies // 2) % setup.cells * width, reach * width, (reach + copies - 1) * width
    # Sum of all copies whose weight is not negligible.
    total, power = lines[2, :every], 0.0
    total[:] = 0.0
    for m in range(copies):
        a = paths.amplitude[p, m]
        squared = a.real * a.real + a.imag * a.imag
        power += squared
        if squared > setup.least * setup.least:
            place = m * width
            _combine(np.float32(a.real), lines[0, :size], np.float32(a.imag), lines[1, :size], total[place : place + size])
    # The sum times the weight of each term of the motion goes to the grid of this term.
    _motion(setup.motion_per_mps * paths.rate[p], orders)
    for k in range(len(orders)):
        if power * orders[k] * orders[k] > setup.least * setup.least:
            _add(np.float32(orders[k]), total, grid[k, left : left + every])


@innermost
def _combine(first, values, second, others, line):
    """Add values and other values, each times a factor, to the entries of `line`."""
    for i in range(len(line)):
        line[i] += first * values[i] + second * others[i]


@innermost
def _add(factor, values, line):
    """Add values, times a factor, to the entries of `line`."""
    for i in range(len(values)):
        line[i] += factor * values[i]


@inner
def _gather(task, stop, row, grid, channels, re, im):
    """Sum one row of the delay grids of the tasks `task` to `stop` - 1, and write the sum to `re` and `im`, (cells x channels,) in single
    precision.

    The cells beyond the ends of the grid are added to the cells at its opposite end, because the delay grid is periodic.
    """
    cells, total = len(re) // channels, grid.shape[2] // (2 * channels)
    for step in range(total):
        source = (step + _TAPS_BEFORE) % total
        target = (source - _TAPS_BEFORE) % cells * channels
        for c in range(channels):
            sum_re, sum_im = 0.0, 0.0
            for k in range(task, stop):
                sum_re += grid[k, row, 2 * source * channels + c]
                sum_im += grid[k, row, (2 * source + 1) * channels + c]
            if step < cells:
                re[target + c], im[target + c] = sum_re, sum_im
            else:
                re[target + c] += sum_re
                im[target + c] += sum_im


@inner
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
def finish(first, last, tasks, grid, cosine, sine, band, slow, iq):
    """Compute the IQ samples of the frames `first` to `last` - 1 from their delay grids, and add the samples to `iq` (F, C, T, R, N).

    Args:
        tasks: (F + 1,) index of the first task of each frame.
        grid: the delay grids that `spread` has filled.
        cosine, sine: (cells,) cosine and sine of the angles 2 pi m/cells, in single precision.
        band: (N,) one over the Fourier transform of the spreading kernel at the N samples of a chirp, in single precision.
        slow: (T, C, terms, N) single precision. Entry k of the third axis is Chebyshev polynomial k of the product of frequency and time.
    """
    num_tx, num_chirps, terms, samples = slow.shape
    num_rx, cells = iq.shape[3], len(cosine)
    channels = num_tx * num_rx
    re, im = np.empty(cells * channels, np.float32), np.empty(cells * channels, np.float32)
    other_re, other_im = np.empty_like(re), np.empty_like(im)
    line_re, line_im = np.empty((channels, terms, samples), np.float32), np.empty((channels, terms, samples), np.float32)
    sum_re, sum_im = np.empty(samples, np.float32), np.empty(samples, np.float32)
    wrap = samples // 2  # the middle sample of the frequency sweep has index zero in the Fourier transform
    for frame in range(first, last):
        if tasks[frame] == tasks[frame + 1]:
            continue
        # Spectrum of each term of the motion, times its factor j^k and the correction of the spreading kernel.
        for k in range(terms):
            _gather(tasks[frame], tasks[frame + 1], k, grid, channels, re, im)
            got_re, got_im = transform(re, im, other_re, other_im, channels, cosine, sine)
            turned_re, turned_im = (got_im, got_re) if k % 2 == 1 else (got_re, got_im)
            sign_re, sign_im = np.float32(-1.0 if 0 < k % 4 < 3 else 1.0), np.float32(-1.0 if k % 4 >= 2 else 1.0)
            for n in range(samples):
                at, value = (n - wrap if n >= wrap else n - wrap + cells) * channels, band[n]
                for c in range(channels):
                    line_re[c, k, n], line_im[c, k, n] = sign_re * value * turned_re[at + c], sign_im * value * turned_im[at + c]
        # Samples of each chirp: sum over the terms, times the Chebyshev polynomials of frequency and time.
        for t in range(num_tx):
            for r in range(num_rx):
                term_re, term_im = line_re[t * num_rx + r], line_im[t * num_rx + r]
                for c in range(num_chirps):
                    sum_re[:], sum_im[:] = term_re[0], term_im[0]
                    for k in range(1, terms):
                        for n in range(samples):
                            sum_re[n] += slow[t, c, k, n] * term_re[k, n]
                            sum_im[n] += slow[t, c, k, n] * term_im[k, n]
                    for n in range(samples):
                        iq[frame, c, t, r, n] += complex(sum_re[n], sum_im[n])
