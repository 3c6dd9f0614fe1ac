"""Compute IQ samples from paths by a grid over delay and an FFT, instead of a sum over paths, chirps and samples.

For transmitter t, receiver r, loop c and sample n the signal is

    s[c, t, r, n] = sum_p a_p(f_n) exp(+j 2 pi f_n (L_p,t,r + v_p tau)/c),   f_n = f0 + S n/fs,   tau = t_c,t + n/fs - t_mid

where p counts the paths, a_p is the amplitude of path p, v_p is the rate of change of its length, and L_p,t,r is its length between the
antenna elements t and r (see radartwin.simulation.paths). The Jacobi-Anger expansion exp(j w x) = sum_k (2 - [k=0]) j^k J_k(w) T_k(x), with
w = 2 pi v X/c, x = f_n tau/X and X the largest magnitude of f_n tau, separates the motion of a path from its delay. The number of Fourier
transforms per frame is a few more than the largest |w| of the paths, in radians, and does not depend on the number of chirps. A path whose
amplitude a_p changes over frequency becomes a sum of copies with constant amplitudes, whose delays are one grid cell apart. The function
`_copies` fits the amplitudes of the copies to a_p. The sum over delays is a type-1 non-uniform FFT with the exponential-of-semicircle
kernel of A. Barnett, J. Magland, L. af Klinteberg, SIAM J. Sci. Comput. 41 (2019) C479, on a grid of delays with at least twice as many
cells as a chirp has samples. Equal inputs give byte-identical samples on any number of processor cores.
radartwin.simulation.signal.gridding contains the compiled loops over paths and grid cells. If Mitsuba's GPU variant is active,
radartwin.simulation.signal.spreading spreads the paths on the GPU. On the CPU, that module is slower than the compiled loops for moving
paths. The file is over 300 lines long, because the steps of the transform share their constants.
"""

import functools
import itertools
import math
import weakref
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from radartwin.compiled import shared_out
from radartwin.constants import BOLTZMANN, SPEED_OF_LIGHT
from radartwin.errors import InputError
from radartwin.radar.chirp import Radar
from radartwin.radar.phase_noise import chebyshev_terms
from radartwin.simulation import variant
from radartwin.simulation.argument_checks import check_option
from radartwin.simulation.paths import Paths
from radartwin.simulation.signal import gridding

ELEMENTS = ("exact", "planar")
_SHAPE = 2.30 * gridding.TAPS
_BESSEL_TAIL = 1e-5
MOST_PATHS = 1_000_000  # largest number of paths that are added to the samples at once; limits memory
FRAMES_PER_BLOCK = 256  # number of frames for which noise is computed at once; it limits the memory of the noise arrays
# Relative width of a band of echo delays that get the same phase noise. The resulting error is at most a twentieth of the phase noise.
DELAY_BAND = 0.1
# The synthesis skips terms of a path that are weaker than this factor times the root mean square amplitude of all paths, because such terms
# are smaller than the error of the spreading kernel.
_LEAST = 3e-6
# A path whose amplitude changes over frequency becomes copies in the grid cells before and behind its delay: on each side at most _BESIDE
# cells, and one more for every two frequency nodes. _FIT is the smallest singular value of the fit of the copies, relative to the largest.
# With both values, the error is 7e-6 of the signal of a furnished room, whose walls have 16 nodes.
_BESIDE, _FIT = 12, 1e-5
_PATHS_PER_TASK = 8192
_TASKS_PER_FRAME = 16
# Largest number of paths that `received` synthesises at once; it limits the memory of their coefficients.
_PATHS_AT_ONCE = 500_000
# Number of noise samples that `thermal_noise` draws beyond the end of a chirp. High-pass stages of any corner frequency correlate the first
# and the last sample of a chirp by at most 0.0015 of the noise power.
NOISE_TAIL = 128
_GRID_BYTES = 32_000_000  # largest size of the delay grids in memory, in bytes
_NOT_FINITE = "paths hold amplitudes, lengths or rates that are not finite; correct the simulator that made them"
_signals_of_part: weakref.WeakKeyDictionary[Paths, dict[tuple[Radar, str, bool], list[tuple[np.ndarray, float]]]] = (
    weakref.WeakKeyDictionary()
)


def _kernel(x: np.ndarray) -> np.ndarray:
    """Return the spreading kernel exp(beta (sqrt(1 - z^2) - 1)), z = 2 x/TAPS, at distances x (in grid cells) from a path's position."""
    z2 = np.clip((2 * x / gridding.TAPS) ** 2, 0, 1)
    return np.exp(_SHAPE * (np.sqrt(1 - z2) - 1))


@functools.cache
def _of_grid(samples: int, cells: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return cosine and sine (cells,) of the phases of the Fourier transform of the grid, and the reciprocal of the Fourier transform of
    the spreading kernel (samples,) at the sample indices relative to the middle sample.
    """
    nodes, weights = np.polynomial.legendre.leggauss(64)
    x, index = nodes * gridding.TAPS / 2, np.arange(samples) - samples // 2
    transform = (gridding.TAPS / 2) * (weights * _kernel(x)) @ np.cos(2 * np.pi * np.outer(x, index) / cells)
    angle = 2 * np.pi * np.arange(cells) / cells
    return np.cos(angle).astype(np.float32), np.sin(angle).astype(np.float32), (1 / transform).astype(np.float32)


@functools.cache
def _kernel_polynomials() -> np.ndarray:
    """Return polynomial coefficients (DEGREE + 1, TAPS), highest power first, for the weights of the spreading kernel's taps.

    The polynomial of a tap gives its weight as a function of the position (0 to 1) of a path between two grid cells.
    """
    place = (1 + np.polynomial.chebyshev.chebpts1(4 * gridding.DEGREE)) / 2
    taps = _kernel(place[:, None] - np.arange(gridding.TAPS) + gridding.TAPS // 2 - 1)
    return np.ascontiguousarray(np.polyfit(place, taps, gridding.DEGREE))


def _chebyshev(x: np.ndarray, terms: int) -> np.ndarray:
    """Return the Chebyshev polynomials T_k(x) (T, C, terms, N) of x (C, T, N), in single precision."""
    out = np.ones((x.shape[1], x.shape[0], terms, x.shape[2]), np.float32)
    x = x.swapaxes(0, 1)
    before, here = np.ones_like(x), x
    for k in range(1, terms):
        out[:, :, k] = here
        before, here = here, 2 * x * here - before
    return out


def synthesize(paths: Paths | Sequence[Paths], radar: Radar, *, elements: str = "exact", out: np.ndarray | None = None) -> np.ndarray:
    """Compute the IQ samples of all sensor poses of `paths`, one frame per pose, without noise.

    Args:
        paths: propagation paths of F poses, sorted by pose, or several `Paths` objects of F poses each, whose signals add up.
        radar: radar with T transmitters, R receivers, C chirp loops per frame and N samples per chirp.
        elements: "exact" computes the path length to every antenna element. "planar" assumes plane waves across the array; it exists for
            comparison and shortens the run time by at most a seventh.
        out: (F, C, T, R, N) complex array to which the function adds the samples. If `out` is None, the function creates an array of zeros.
    Returns:
        Samples (F, C, T, R, N) in `out`, or in a new complex64 array. The squared magnitude of a sample is received over transmitted power.
    Raises:
        InputError: `elements` is unknown, `out` has a wrong shape, or a path has a value that is not finite.
    """
    check_option("elements", elements, ELEMENTS)
    parts = [paths] if isinstance(paths, Paths) else list(paths)
    if (gains := radar.channel_gains()) is not None:
        # The gains do not depend on the path, so that they act on the sum over paths.
        even = synthesize(parts, replace(radar, tx_gains_db=None, rx_gains_db=None), elements=elements)
        even *= gains.astype(np.float32)[:, :, None]
        if out is not None:
            out += even
        return even if out is None else out
    frames = parts[0].poses
    shape = (frames, radar.num_chirps, radar.num_tx, radar.num_rx, radar.num_samples)
    iq = np.zeros(shape, np.complex64) if out is None else out
    if iq.shape != shape:
        raise InputError(f"out must have shape {shape}, not {iq.shape}")
    parts = [part for part in parts if len(part)]
    if not parts:
        return iq
    if sum(map(len, parts)) > MOST_PATHS:  # the work arrays of all paths together would take too much memory
        for part in parts:
            for first in range(0, len(part), MOST_PATHS):
                synthesize(part.where(slice(first, first + MOST_PATHS)), radar, elements=elements, out=iq)
        return iq
    samples, channels = radar.num_samples, radar.num_tx * radar.num_rx
    cells = max(16, 1 << (2 * samples - 1).bit_length())
    fast_time = np.arange(samples) / radar.sample_rate_hz
    frequency = radar.start_frequency_hz + radar.slope_hz_per_s * fast_time
    if not all(np.isfinite(part.length_m).all() and np.isfinite(part.rate_mps).all() for part in parts):
        raise InputError(_NOT_FINITE)
    fastest = max(float(np.abs(part.rate_mps).max()) for part in parts)
    middle_s, motion_per_mps, slow = _motion_terms(fastest, radar, frequency, fast_time)
    terms = slow.shape[2]
    arrays, least = _expanded(parts, radar, frequency, cells)
    cells_per_m = radar.slope_hz_per_s / radar.sample_rate_hz / SPEED_OF_LIGHT * cells
    setup = gridding.Setup(
        radar.tx_positions, radar.rx_positions, elements == "planar",
        (radar.start_frequency_hz + radar.slope_hz_per_s * fast_time[samples // 2]) / SPEED_OF_LIGHT, cells_per_m, cells, middle_s,
        motion_per_mps, _kernel_polynomials(), least,
    )  # fmt: skip
    array_m = sum(float(np.linalg.norm(np.ptp(positions, axis=0))) for positions in (radar.tx_positions, radar.rx_positions))
    edges = np.stack([np.searchsorted(part.pose, np.arange(frames + 1)) for part in parts])
    gpu, copies = variant.on_gpu(), max(array.amplitude.shape[1] for array in arrays)
    pad = 0 if gpu else gridding.TAPS + int(np.ceil(abs(cells_per_m) * array_m)) + copies
    tasks, starts = (np.arange(frames + 1), edges) if gpu else _tasks(edges)
    line = 2 * channels * (cells + pad)
    at_once = max(_TASKS_PER_FRAME, _GRID_BYTES // (4 * terms * line))
    room = _aligned((0 if gpu else min(at_once, int(tasks[-1])), terms, line))
    first = 0
    while first < frames:
        last = int(np.searchsorted(tasks, tasks[first] + at_once, side="right")) - 1
        low, high = tasks[first], tasks[last]
        if gpu:
            from radartwin.simulation.signal import spreading

            grid = spreading.spread(starts[:, low : high + 1], arrays, setup, terms)
        else:
            grid = room[: high - low]
            grid[:] = 0.0
            for start, array in zip(starts, arrays, strict=True):
                shared_out(gridding.spread, int(high - low), start[low : high + 1], array, setup, grid)
        shared_out(gridding.finish, last - first, tasks[first : last + 1] - low, grid, *_of_grid(samples, cells), slow, iq[first:last])
        first = last
    return iq


def _aligned(shape: tuple[int, ...]) -> np.ndarray:
    """Return a single-precision array without initial values that begins at a cache line of the processor."""
    memory = np.empty(math.prod(shape) + 16, np.float32)
    return memory[-memory.ctypes.data // 4 % 16 :][: math.prod(shape)].reshape(shape)


@functools.cache
def _fit(samples: int, cells: int, reach: int) -> np.ndarray:
    """Return the matrix (2 reach + 1, samples) that maps a function of the sample index to its best fit by copies with delays of -reach to
    reach grid cells.

    The phase factors of neighbouring cells are nearly linearly dependent over one chirp, so combinations with a singular value below _FIT
    are left out.
    """
    delays = np.arange(-reach, reach + 1)
    phase = 2 * np.pi / cells * np.outer(np.arange(samples) - samples // 2, delays)
    return np.linalg.pinv(np.exp(1j * phase), rcond=_FIT)


def _copies(nodes_hz: np.ndarray, frequency: np.ndarray, cells: int) -> NDArray[np.complex128]:
    """Return the weights (Q, D) of D copies of a path, whose sum has the amplitude 1 at one of Q frequency nodes and 0 at the others.

    Args:
        nodes_hz: (Q,) frequency nodes. frequency: (N,) of the samples of a chirp. cells: number of grid cells.
    """
    nodes, samples = len(nodes_hz), len(frequency)
    if nodes == 1:
        return np.ones((1, 1), complex)
    both = np.concatenate([nodes_hz, frequency])
    x = (both - (both.max() + both.min()) / 2) / (np.ptp(both) / 2)
    values = np.polynomial.chebyshev.chebvander(x, nodes - 1)
    between = values[nodes:] @ np.linalg.inv(values[:nodes])
    return (_fit(samples, cells, min(_BESIDE + nodes // 2, samples // 2)) @ between).T


def _expanded(parts: Sequence[Paths], radar: Radar, frequency: np.ndarray, cells: int) -> tuple[list[gridding.PathArrays], float]:
    """Represent the amplitudes of all paths over frequency, times the gains of the antennas and of the IF filter, by copies of the paths.

    Returns:
        The arrays of each `Paths` object, and the smallest weight of a copy or term of a path that the synthesis uses.
    """
    arrays, power = [], 0.0
    for part in parts:
        gain = radar.gain(part.departure)
        back = gain if np.array_equal(part.departure, part.arrival) else radar.gain(part.arrival)
        gain = gain * back
        if radar.if_filter is not None:
            gain = gain * radar.if_filter.gain(radar.slope_hz_per_s / SPEED_OF_LIGHT * part.length_m, radar.band_hz)
        copies = _copies(part.frequencies_hz, frequency, cells)
        weights, powers = np.empty((len(part), copies.shape[1]), complex), np.empty(len(part))
        amplitude = np.ascontiguousarray(part.amplitude, complex)
        both = (np.ascontiguousarray(values) for values in (copies.real, copies.imag))
        shared_out(gridding.expand, len(part), amplitude, gain.astype(complex), *both, weights, powers, grain=1000)
        power += float(powers.sum())
        mirror = np.zeros((0, 3, 3)) if part.mirror is None else part.mirror
        plain = (part.length_in_m, part.length_out_m, part.departure, part.arrival, part.rate_mps, mirror)
        plain = [np.ascontiguousarray(values, float) for values in plain]
        arrays.append(gridding.PathArrays(*plain, _channel_gain(part, radar), weights))
    if not np.isfinite(power):
        raise InputError(_NOT_FINITE)
    return arrays, _LEAST * float(np.sqrt(power / sum(len(part) for part in parts)))


def _channel_gain(part: Paths, radar: Radar) -> np.ndarray:
    """Return the factor (N, C) on the amplitude of each path in each channel, or an array (0, 0) if the factor is 1 everywhere."""
    if radar.antenna_errors is None:
        return np.zeros((0, 0), complex) if part.gain is None else np.ascontiguousarray(part.gain, complex)
    wavelength = SPEED_OF_LIGHT / radar.center_frequency_hz
    points, weights = radar.antenna_errors.ripples(radar.element, radar.num_tx + radar.num_rx, wavelength)
    out = np.empty((len(part), radar.num_tx * radar.num_rx), complex)
    ways = (np.ascontiguousarray(way, float) for way in (part.departure, part.arrival))
    shared_out(gridding.ripple, len(part), *ways, radar.num_tx, points / wavelength, weights, out, grain=1000)
    return out if part.gain is None else out * part.gain


def _motion_terms(largest_mps: float, radar: Radar, frequency: np.ndarray, fast_time: np.ndarray) -> tuple[float, float, np.ndarray]:
    """Return the quantities that represent the motion of paths within a frame, for rates of change up to `largest_mps` in m/s.

    Returns:
        The time from the start to the middle of the frame, the argument of the Bessel functions for a rate of 1 m/s in radians, and the
        Chebyshev polynomials (T, C, terms, samples) of the product of frequency and time.
    """
    chirp_start = radar.chirp_times()
    middle = (chirp_start.max() + fast_time[-1]) / 2
    # Product of frequency and time relative to the middle of the frame, (C, T, samples). This product times v_p/c is the phase, in cycles,
    # that the motion of path p causes.
    moving = frequency * (chirp_start[:, :, None] + fast_time - middle)
    reach = float(np.abs(moving).max()) or 1.0
    motion_per_mps = 2 * np.pi * reach / SPEED_OF_LIGHT
    largest = motion_per_mps * largest_mps
    terms = 1 if largest < _BESSEL_TAIL else chebyshev_terms(largest, _BESSEL_TAIL)
    return float(middle), motion_per_mps, _chebyshev(moving / reach, terms)


def _tasks(edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Split the paths of each frame into groups of consecutive paths, each of which is a task for one thread. The groups are the same for
    any number of processor cores, so that the result of the sum over paths is the same too.

    Args:
        edges: (P, F + 1) path indices; frame f has the paths edges[p, f] to edges[p, f + 1] - 1 of the `Paths` object p.
    Returns:
        The index of the first task of each frame (F + 1,), and the index of the first path of each task in each `Paths` object,
        (P, tasks + 1).
    """
    counts = np.diff(edges)
    every = counts.sum(axis=0)
    pieces = np.clip(-(-every // _PATHS_PER_TASK), np.minimum(every, 1), _TASKS_PER_FRAME)
    tasks = np.concatenate([[0], np.cumsum(pieces)])
    frame = np.repeat(np.arange(len(pieces)), pieces)
    share = counts[:, frame] * (np.arange(tasks[-1]) - tasks[frame]) // pieces[frame]
    return tasks, np.ascontiguousarray(np.concatenate([edges[:, frame] + share, edges[:, -1:]], axis=1))


def thermal_noise(shape: tuple[int, ...], radar: Radar, rng: np.random.Generator) -> np.ndarray:
    """Return complex64 thermal noise of the receiver, in the amplitude units of the samples.

    The noise power is k T0 fs F divided by the transmitted power, where k is Boltzmann's constant, T0 = 290 K, fs the sample rate and F the
    noise figure. This noise arises in front of the IF filter. If the radar has an IF filter, the spectral density of the noise at the beat
    frequency f is therefore proportional to |H(f)|^2, where H is the gain of the filter, and the signal-to-noise ratio of an echo does not
    depend on the filter. The function draws NOISE_TAIL more samples per chirp than it returns, so that the first and the last samples of a
    chirp are independent of each other.

    Args:
        shape: shape (..., N) of the result, with N samples per chirp.
        radar: radar whose noise figure, transmit power, sample rate and IF filter apply. Of a radar with real samples, use the real part.
        rng: random generator.

    >>> bool(thermal_noise((4, 2), Radar.iwr1843(), np.random.default_rng(0)).std() > 0)
    True
    """
    from scipy import fft

    received = BOLTZMANN * 290.0 * radar.sample_rate_hz * 10 ** (radar.noise_figure_db / 10)
    transmitted = 1e-3 * 10 ** (radar.transmit_power_dbm / 10)
    drawn = shape[-1] if radar.if_filter is None else shape[-1] + NOISE_TAIL
    parts = rng.standard_normal((*shape[:-1], 2 * drawn), dtype=np.float32)
    parts *= np.float32(np.sqrt(received / transmitted / 2))
    noise = parts.view(np.complex64)
    if radar.if_filter is None:
        return noise
    cycles = fft.fftfreq(drawn) if radar.real_sampling else np.arange(drawn) / drawn
    gain = radar.if_filter.gain(radar.sample_rate_hz * cycles, radar.band_hz).astype(np.complex64)
    return np.ascontiguousarray(np.asarray(fft.ifft(gain * np.asarray(fft.fft(noise))))[..., : shape[-1]])


def received(
    parts: Sequence[Paths], radar: Radar, frames: int, *, elements: str = "exact", oscillator: np.random.Generator | None = None
) -> np.ndarray:
    """Compute the sum of the IQ samples of all `Paths` objects in `parts`, without thermal noise.

    The sum includes phase noise if `oscillator` is given and the radar has phase noise. To first order in the phase error phi, which is a
    few milliradians, phase noise multiplies an echo of delay tau by 1 + j phi(t; tau). All echoes in one band of delays, whose relative
    width is DELAY_BAND, get the phase noise of one delay, the middle of this band, so that the function synthesises each path only once.

    Args:
        parts: propagation paths. Each `Paths` object has F poses, or one pose that is valid for all frames.
        radar: radar with T transmitters, R receivers, C chirp loops per frame and N samples per chirp.
        frames: number of frames, F.
        elements: "exact" or "planar", as in `synthesize`.
        oscillator: random generator of the phase noise; None leaves out phase noise.
    Returns:
        Samples (F, C, T, R, N), complex64.
    """
    out = np.zeros((frames, radar.num_chirps, radar.num_tx, radar.num_rx, radar.num_samples), np.complex64)
    parts = [part for part in parts if len(part)]
    resting, moving = ([part for part in parts if (part.poses == frames) == moves] for moves in (False, True))
    if oscillator is None or radar.phase_noise is None or not parts:
        for part in resting:
            out += _resting_signals(part, radar, elements, by_delay=False)[0][0]
        size = max(1, frames * _PATHS_AT_ONCE // max(sum(len(part) for part in moving), 1))
        for start in range(0, frames if moving else 0, size):
            batch = [part.frames(start, min(start + size, frames)) for part in moving]
            synthesize(batch, radar, elements=elements, out=out[start : start + size])
        return out
    longest = max(float(part.length_m.max()) for part in parts)
    resting_signals = [signal for part in resting for signal in _resting_signals(part, radar, elements, by_delay=True)]
    for start in range(0, frames, FRAMES_PER_BLOCK):
        block = out[start : start + FRAMES_PER_BLOCK]
        shape = (len(block), radar.num_chirps, radar.num_tx, 1, radar.num_samples)
        processes = radar.phase_noise.processes(
            shape[0] * shape[1] * shape[2], radar.num_samples, radar.sample_rate_hz, longest / SPEED_OF_LIGHT, oscillator
        ).astype(np.float32)
        moving_signals = (
            (synthesize(band, radar, elements=elements), length)
            for part in moving
            for band, length in _delay_bands(part.frames(start, start + len(block)))
        )
        for signal, length in itertools.chain(resting_signals, moving_signals):
            basis = np.polynomial.chebyshev.chebvander(2 * length / longest - 1, len(processes) - 1).astype(np.float32)
            phase = basis @ processes.reshape(len(processes), -1)
            block += signal * (1 + np.complex64(1j) * phase.reshape(shape))
    return out


def _resting_signals(part: Paths, radar: Radar, elements: str, by_delay: bool) -> list[tuple[np.ndarray, float]]:
    """Return the signals of paths that do not change over the frames, each with the middle of its path lengths in metres.

    If `by_delay` is True, each band of delays has its own signal; otherwise all paths together have one signal, whose length is given as 0.
    The function keeps the signals in memory as long as the `Paths` object exists.
    """
    cached = _signals_of_part.setdefault(part, {})
    key = (radar, elements, by_delay)
    if key not in cached:
        bands = _delay_bands(part) if by_delay else [(part, 0.0)]
        cached[key] = [(synthesize(band, radar, elements=elements), length) for band, length in bands]
    return cached[key]


def _delay_bands(part: Paths) -> Iterator[tuple[Paths, float]]:
    """Yield the paths of each band of delays, with the middle of the band's shortest and longest path length in metres."""
    band = np.floor(np.log(np.maximum(part.length_m, 1e-6)) / DELAY_BAND).astype(np.int64)
    for index in np.unique(band).tolist():
        paths = part.where(band == index)
        yield paths, float(paths.length_m.min() + paths.length_m.max()) / 2
