"""Paths to IQ: gridding in delay and one FFT instead of a sum over paths, chirps and samples.

For transmitter t, receiver r, loop c and sample n the signal is

    s[c, t, r, n] = sum_p a_p(f_n) exp(+j 2 pi f_n (L_p,t,r + v_p tau)/c),   f_n = f0 + S n/fs,   tau = t_c,t + n/fs - t_mid

with L_p,t,r the exact distance over the elements and v_p the rate of the path. Motion is separated by the Jacobi-Anger expansion
exp(j w x) = sum_k (2 - [k=0]) j^k J_k(w) T_k(x), w = 2 pi v X/c, x = f_n tau/X: a frame needs as many transforms as |w| is radians
large, plus a few, however many chirps it has. The sum over delays is a type-1 non-uniform FFT with the exponential-of-semicircle
kernel of A. Barnett, J. Magland, L. af Klinteberg, SIAM J. Sci. Comput. 41 (2019) C479, on a grid of twice the samples.
Spreading is a sparse matrix product: ordered, so equal inputs give equal bytes.
"""

from dataclasses import replace

import numpy as np
from scipy.sparse import csc_matrix
from scipy.special import jv

from radartwin.constants import BOLTZMANN, SPEED_OF_LIGHT
from radartwin.radar.antenna import element_gain
from radartwin.radar.chirp import Radar
from radartwin.simulation.paths import Paths
from radartwin.simulation.reflection_table import lagrange_basis

KERNEL_WIDTH = 6  # taps; relative error 1e-5 with the shape below on a doubled grid
_SHAPE = 2.30 * KERNEL_WIDTH
_BESSEL_TAIL = 1e-5
PATHS_PER_BLOCK = 400_000


def _kernel(x: np.ndarray) -> np.ndarray:
    """exp(beta (sqrt(1 - z^2) - 1)) for taps at distance x from the point, in grid cells."""
    z2 = np.clip((2 * x / KERNEL_WIDTH) ** 2, 0, 1)
    return np.exp(_SHAPE * (np.sqrt(1 - z2) - 1))


def _kernel_transform(samples: int, grid: int) -> np.ndarray:
    """(samples,) Fourier transform of the kernel at the centred sample indices."""
    nodes, weights = np.polynomial.legendre.leggauss(64)
    x = nodes * KERNEL_WIDTH / 2
    index = np.arange(samples) - samples // 2
    return (KERNEL_WIDTH / 2) * (weights * _kernel(x)) @ np.cos(2 * np.pi * np.outer(x, index) / grid)


def _doppler_terms(paths: Paths, reach: float) -> np.ndarray:
    """(N, K) complex weights of the Chebyshev terms for phase reach X (cycles of f tau at most)."""
    w = 2 * np.pi * paths.rate_mps * reach / SPEED_OF_LIGHT
    largest = float(np.abs(w).max(initial=0.0))
    if largest < _BESSEL_TAIL:
        return np.ones((len(w), 1), complex)
    count = int(largest) + 1
    while abs(jv(count, largest)) > _BESSEL_TAIL:
        count += 1
    order = np.arange(count)
    return np.where(order == 0, 1, 2) * 1j**order * jv(order[None, :], w[:, None])


def synthesize(paths: Paths, radar: Radar) -> np.ndarray:
    """IQ of all poses, one frame each.

    Args:
        paths: of F poses, ascending in pose.
        radar: T transmitters, R receivers, C loops, N samples.
    Returns:
        complex128 (F, C, T, R, N), amplitude units: |.|^2 is received over transmitted power.
    """
    gain = element_gain(radar.element, paths.departure) * element_gain(radar.element, paths.arrival)
    weighted = paths.amplitude * gain[:, None]
    paths = replace(paths, amplitude=weighted).where(gain > 0)
    iq = np.zeros((paths.poses, radar.num_chirps, radar.num_tx, radar.num_rx, radar.num_samples), complex)
    edges = np.searchsorted(paths.pose, np.arange(paths.poses + 1))
    start = 0
    while start < paths.poses:
        stop = start + 1
        while stop < paths.poses and edges[stop + 1] - edges[start] <= PATHS_PER_BLOCK:
            stop += 1
        block = paths.where(slice(edges[start], edges[stop]))
        if len(block):
            _add_block(iq[start:stop], block, start, radar)
        start = stop
    return iq


def _add_block(iq: np.ndarray, paths: Paths, first_pose: int, radar: Radar) -> None:
    """Synthesise consecutive poses into their frames."""
    frames, samples = len(iq), radar.num_samples
    grid = 2 * samples
    fast_time = np.arange(samples) / radar.sample_rate_hz
    frequency = radar.start_frequency_hz + radar.slope_hz_per_s * fast_time
    chirp_start = radar.chirp_times()
    middle = (chirp_start.max() + fast_time[-1]) / 2
    # frequency times time from the middle of the frame, (C, T, N) cycles per (m/s) of path rate and light second
    slow = frequency * (chirp_start[:, :, None] + fast_time - middle)
    reach = float(np.abs(slow).max())
    doppler = _doppler_terms(paths, reach)
    band = lagrange_basis(paths.frequencies_hz, frequency)
    terms, nodes = doppler.shape[1], len(band)
    weights = (doppler[:, :, None] * paths.amplitude[:, None, :]).reshape(len(paths), terms * nodes)
    slow_terms = np.cos(np.arange(terms)[:, None, None, None] * np.arccos(np.clip(slow / reach, -1, 1)))
    centred = samples // 2
    correction = 1 / _kernel_transform(samples, grid)
    at_middle = paths.rate_mps * middle
    to_tx = [_element_distance(paths.length_in_m, paths.departure, p) for p in radar.tx_positions]
    to_rx = [_element_distance(paths.length_out_m, paths.arrival, p) for p in radar.rx_positions]
    row_of_pose = (paths.pose - first_pose) * grid
    offsets = np.arange(KERNEL_WIDTH) - (KERNEL_WIDTH // 2 - 1)
    columns = np.arange(len(paths) + 1) * KERNEL_WIDTH
    for t in range(radar.num_tx):
        for r in range(radar.num_rx):
            delay = (to_tx[t] + to_rx[r] + at_middle) / SPEED_OF_LIGHT
            beat = radar.slope_hz_per_s / radar.sample_rate_hz * delay  # cycles per sample
            # cycles are taken modulo one before the exponential: 1e4 of them would cost four digits
            start_phase = np.exp(2j * np.pi * np.mod(radar.start_frequency_hz * delay + beat * centred, 1.0))
            position = np.mod(beat, 1.0) * grid
            left = np.floor(position)
            taps = _kernel(position[:, None] - left[:, None] - offsets)
            rows = np.mod(left[:, None] + offsets, grid).astype(np.int64) + row_of_pose[:, None]
            spread = csc_matrix((taps.ravel(), rows.ravel(), columns), shape=(frames * grid, len(paths)))
            gridded = (spread @ (weights * start_phase[:, None])).reshape(frames, grid, terms, nodes)
            # sum over cells of exp(+j 2 pi m n/M) for the centred n: an inverse FFT, rolled
            signal = np.fft.ifft(gridded, axis=1, norm="forward")
            signal = np.roll(signal, centred, axis=1)[:, :samples]
            in_band = np.einsum("fnkq,qn,n->fkn", signal, band, correction)
            iq[:, :, t, r] += np.einsum("fkn,kcn->fcn", in_band, slow_terms[:, :, t])


def _element_distance(length: np.ndarray, direction: np.ndarray, position: np.ndarray) -> np.ndarray:
    """Distance from an antenna element to the point `length` along `direction` of the phase centre, to full precision."""
    along = direction @ position
    squared = position @ position
    change = (squared - 2 * length * along) / (length + np.sqrt(np.maximum(length**2 - 2 * length * along + squared, 0)))
    return length + change


def thermal_noise(shape: tuple[int, ...], radar: Radar, rng: np.random.Generator) -> np.ndarray:
    """Complex receiver noise in amplitude units: k T0 fs F over the transmitted power, T0 = 290 K.

    >>> bool(thermal_noise((4, 2), Radar.iwr1843(), np.random.default_rng(0)).std() > 0)
    True
    """
    received = BOLTZMANN * 290.0 * radar.sample_rate_hz * 10 ** (radar.noise_figure_db / 10)
    transmitted = 1e-3 * 10 ** (radar.transmit_power_dbm / 10)
    scale = np.sqrt(received / transmitted / 2)
    return scale * (rng.standard_normal(shape) + 1j * rng.standard_normal(shape))
