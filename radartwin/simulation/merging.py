"""Merge paths with nearly equal lengths, directions and rates of change into one path, so that the synthesis has fewer paths.

An object that is traced by ray tubes has a path for each tube, but the radar cannot resolve the tubes. The paths of one pose are sorted
into cells of directions of departure and arrival, length and rate of change. The paths of a cell become one path at their mean, weighted by
power. The phase of each path in the middle of the frame, relative to the mean, is part of the merged amplitude at the frequency nodes. The
merged path is therefore exact at the phase centre of the array in the middle of the frame. The widths of the cells limit the error at other
elements and times. The number of bounces of a merged path is that of its last path.
"""

import math

import numpy as np

from radartwin.compiled import compiled, shared_out
from radartwin.constants import SPEED_OF_LIGHT
from radartwin.radar.chirp import Radar
from radartwin.simulation.paths import Paths
from radartwin.simulation.pruning import both_gains

# Largest change over the width of a cell, in rad, of the phase difference between the phase centre and the outermost element, and of the
# phase difference between the middle and the end of the frame. With these limits, the largest error of a frame is 0.005 of the merged
# signal in the laboratory with clutter.
PHASE = 0.015
WIDEST = 0.03  # largest width of a cell of directions, because a merged path has only one antenna gain
# Largest phase in rad that half the width of a length cell causes over half the sweep; more would need more frequency terms.
BAND_PHASE = 1.0
BAND_ERROR = 1e-3  # error of the phase between the frequency nodes, which limits the length cells of paths with few nodes
_KEYS = 8  # number of coordinates of a cell


def merged(paths: Paths, radar: Radar, gain: np.ndarray | None = None) -> Paths:
    """Return fewer paths with nearly the same signal.

    Args:
        paths: paths without mirror paths and without the fields `gain` and `points`.
        radar: radar that receives the paths.
        gain: (N,) antenna gain of each path relative to the other paths, at both ends together; None computes it for this radar.
    """
    assert paths.mirror is None
    if not len(paths):
        return paths
    gain = both_gains(radar, paths.departure, paths.arrival) if gain is None else gain
    start = np.searchsorted(paths.pose, np.arange(paths.poses + 1))
    number, count = np.empty(len(paths), np.int64), np.zeros(paths.poses, np.int64)
    read = [np.ascontiguousarray(v, float) for v in (paths.departure, paths.arrival, paths.length_m, paths.rate_mps)]
    shared_out(_number, paths.poses, start, *read, 1 / _widths(paths, radar), number, count)
    first = np.concatenate([[0], np.cumsum(count)])
    total, nodes = int(first[-1]), len(paths.frequencies_hz)
    amplitude, bounces = np.zeros((total, nodes), complex), np.zeros(total, paths.bounces.dtype)
    mean = np.zeros((total, 10))  # departure, arrival, lengths, rate and gain
    ends = [np.ascontiguousarray(v, float) for v in (paths.length_in_m, paths.length_out_m)]
    shared_out(
        _add, paths.poses, start, first, number, np.ascontiguousarray(paths.amplitude, complex), paths.bounces, read[0], read[1], *ends,
        read[3], np.ascontiguousarray(gain, float), 2 * np.pi / SPEED_OF_LIGHT * paths.frequencies_hz, radar.frame_duration_s / 2,
        amplitude, bounces, mean,
    )  # fmt: skip
    pose = np.repeat(np.arange(paths.poses), count)
    return Paths(paths.poses, pose, bounces, amplitude, paths.frequencies_hz, mean[:, 6], mean[:, 7], mean[:, :3], mean[:, 3:6], mean[:, 8])


def _widths(paths: Paths, radar: Radar) -> np.ndarray:
    """Return the widths (_KEYS,) of the cells of departure, arrival, length in metres and rate in m/s."""
    wavenumber = 2 * np.pi / radar.wavelength_m
    out = np.empty(_KEYS)
    reach = np.maximum(np.abs(radar.tx_positions).max(axis=0), np.abs(radar.rx_positions).max(axis=0))
    out[:6] = np.tile(np.minimum(PHASE / np.maximum(wavenumber * reach, 1e-9), WIDEST), 2)
    nodes = len(paths.frequencies_hz)
    # The error of a polynomial through Chebyshev nodes is 2 (x/2)^nodes/nodes! for the phase x.
    phase = min(BAND_PHASE, 2 * (BAND_ERROR / 2 * math.factorial(nodes)) ** (1 / nodes))
    out[6] = 2 * phase * SPEED_OF_LIGHT / (np.pi * radar.sampled_bandwidth_hz)
    out[7] = PHASE / (wavenumber * radar.frame_duration_s / 2)
    return out


@compiled
def _number(low, high, start, departure, arrival, length, rate, per_width, number, count):  # fmt: skip
    """Write the number of its cell to each path of the poses `low` to `high` - 1, and the number of cells of each pose to `count`."""
    key = np.empty(_KEYS, np.int64)
    for f in range(low, high):
        size = 16
        while size < 2 * (start[f + 1] - start[f]):
            size *= 2
        table, keys = np.full(size, -1, np.int64), np.empty((start[f + 1] - start[f], _KEYS), np.int64)
        for n in range(start[f], start[f + 1]):
            for k in range(3):
                key[k] = math.floor(departure[n, k] * per_width[k])
                key[3 + k] = math.floor(arrival[n, k] * per_width[3 + k])
            key[6], key[7] = math.floor(length[n] * per_width[6]), math.floor(rate[n] * per_width[7])
            place = 0
            for k in range(_KEYS):
                place = (place ^ key[k]) * 0x9E3779B97F4A7C1
                place ^= place >> 29
            while True:
                place &= size - 1
                cell = table[place]
                if cell < 0:
                    cell = count[f]
                    table[place] = cell
                    keys[cell] = key
                    count[f] += 1
                    break
                same = True
                for k in range(_KEYS):
                    same &= keys[cell, k] == key[k]
                if same:
                    break
                place += 1
            number[n] = cell


@compiled
def _add(
    low, high, start, first, number, amplitude, bounces, departure, arrival, length_in, length_out, rate, gain, wavenumber, middle_s,
    amplitude_to, bounces_to, mean,
):  # fmt: skip
    """For each pose from `low` to `high` - 1, add its paths to the merged paths, whose numbers begin at `first`."""
    nodes, values = len(wavenumber), np.empty(10)
    for f in range(low, high):
        weights = np.zeros(first[f + 1] - first[f])
        for n in range(start[f], start[f + 1]):
            row = first[f] + number[n]
            weight = 1e-60
            for q in range(nodes):
                weight += amplitude[n, q].real ** 2 + amplitude[n, q].imag ** 2
            weights[number[n]] += weight
            bounces_to[row] = bounces[n]
            for k in range(3):
                values[k], values[3 + k] = departure[n, k], arrival[n, k]
            values[6], values[7], values[8], values[9] = length_in[n], length_out[n], rate[n], gain[n]
            for k in range(10):
                mean[row, k] += weight * values[k]
        for row in range(first[f], first[f + 1]):
            for k in range(10):
                mean[row, k] /= weights[row - first[f]]
            for end in range(0, 6, 3):
                size = math.sqrt(mean[row, end] ** 2 + mean[row, end + 1] ** 2 + mean[row, end + 2] ** 2)
                for k in range(end, end + 3):
                    mean[row, k] /= size
        for n in range(start[f], start[f + 1]):
            row = first[f] + number[n]
            extra = length_in[n] - mean[row, 6] + length_out[n] - mean[row, 7] + middle_s * (rate[n] - mean[row, 8])
            share = gain[n] / mean[row, 9] if mean[row, 9] > 0 else 1.0
            middle = extra * wavenumber[nodes // 2]
            phasor = share * complex(math.cos(middle), math.sin(middle))
            for q in range(nodes):
                x = extra * (wavenumber[q] - wavenumber[nodes // 2])
                z = x * x
                cosine = 1 - z * (1 / 2) * (1 - z * (1 / 12) * (1 - z * (1 / 30) * (1 - z * (1 / 56) * (1 - z * (1 / 90)))))
                sine = x * (1 - z * (1 / 6) * (1 - z * (1 / 20) * (1 - z * (1 / 42) * (1 - z * (1 / 72)))))
                amplitude_to[row, q] += amplitude[n, q] * (phasor * complex(cosine, sine))
