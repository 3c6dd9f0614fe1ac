"""Spread paths over grids of delays with Dr.Jit, on the device of the active Mitsuba variant.

On a GPU, this module replaces `gridding.spread`. Each Dr.Jit lane adds one path to the cells of one channel. Many lanes add to the same
cell at the same time and in any order. The cells are therefore whole numbers of 64 bits, whose sum does not depend on the order, so that
equal inputs give byte-identical samples. One unit is at most 2^-55 of the number of paths times the strongest coefficient. Path lengths
and positions in the grid have double precision. Kernel weights and phase factors have single precision. Import this module only after a
Mitsuba variant is active.
"""

import math
from typing import Any

import drjit as dr
import mitsuba as mi
import numpy as np

from radartwin.compiled import shared_out
from radartwin.simulation.drjit_arrays import upload
from radartwin.simulation.signal import gridding
from radartwin.simulation.signal.gridding import TAPS, PathArrays, Setup

_element_distance, _image_distance = gridding._element_distance.py_func, gridding._image_distance.py_func  # they also take Dr.Jit arrays
_BITS = 60  # the largest sum that a cell can reach is at most 2 to this power


def spread(starts: np.ndarray, parts: list[PathArrays], setup: Setup, terms: int) -> np.ndarray:
    """Return the delay grids (F, terms, cells x 2 C) of F frames in single precision, as `gridding.spread` fills them, without `pad`.

    Args:
        starts: (P, F + 1) index of the first path of each frame in each of P parts, followed by the end of the last frame.
        parts: the paths of P parts.
        setup: setup of the radar and the grid.
        terms: number of terms of the motion.
    """
    frames, width = starts.shape[1] - 1, 2 * len(setup.tx) * len(setup.rx) * setup.cells
    strongest = max(_largest(part.amplitude) * (_largest(part.gain) if part.gain.size else 1.0) for part in parts)
    paths = int((starts[:, -1] - starts[:, 0]).sum())
    # A path adds at most TAPS copies to one cell, and weights of the motion are at most 2.
    unit = 2.0 ** (math.frexp(2 * 1.01 * TAPS * paths * max(strongest, 1e-300))[1] - _BITS)
    total = dr.zeros(mi.Int64, frames * terms * width)
    for start, part in zip(starts, parts, strict=True):
        if start[-1] > start[0]:
            _add(start, part, setup, terms, unit, total)
    values = mi.Float(mi.Float64(total) * dr.opaque(mi.Float64, unit))
    return values.numpy().reshape(frames, terms, width)


def _largest(values: np.ndarray) -> float:
    return float(np.abs(values).max(initial=0.0))


def _add(start: np.ndarray, part: PathArrays, setup: Setup, terms: int, unit: float, total: Any) -> None:
    """Add the paths `start`[0] to `start`[-1] - 1 of one part to the grids `total`, whose cells count multiples of `unit`."""
    rows, (num_tx, num_rx), copies = slice(start[0], start[-1]), (len(setup.tx), len(setup.rx)), part.amplitude.shape[1]
    channels, count = num_tx * num_rx, int(start[-1] - start[0])
    lane = dr.arange(mi.UInt32, count * channels)
    path = lane // dr.opaque(mi.UInt32, channels)
    channel = lane - path * dr.opaque(mi.UInt32, channels)
    length_in, length_out, rate = (
        dr.gather(mi.Float64, upload(mi.Float64, values[rows]), path) for values in (part.length_in, part.length_out, part.rate)
    )
    antenna_out = channel // dr.opaque(mi.UInt32, num_rx)
    transmitter = _vectors(setup.tx)(antenna_out)
    receiver = _vectors(setup.rx)(channel - antenna_out * dr.opaque(mi.UInt32, num_rx))
    arrival = _vectors(part.arrival[rows])(path)
    drift = rate * dr.opaque(mi.Float64, setup.middle_s)
    if len(part.mirror):
        entries = upload(mi.Float64, part.mirror[rows])
        matrix: Any = mi.Matrix3d
        mirror = matrix(*(dr.gather(mi.Float64, entries, 9 * path + i) for i in range(9)))
        length = drift + _image_distance(length_in + length_out, arrival, mirror, transmitter, receiver, setup.planar)
    else:
        departure = _vectors(part.departure[rows])(path)
        length = drift + _element_distance(length_in, departure, transmitter, setup.planar)
        length += _element_distance(length_out, arrival, receiver, setup.planar)
    cycles = length * dr.opaque(mi.Float64, setup.cycles_per_m)
    sine, cosine = dr.sincos(mi.Float(2 * np.pi * (cycles - dr.round(cycles))))
    if len(part.gain):
        gain = part.gain[rows]
        real, imaginary = (dr.gather(mi.Float, upload(mi.Float, values), lane) for values in (gain.real, gain.imag))
        cosine, sine = cosine * real - sine * imaginary, cosine * imaginary + sine * real
    place = length * dr.opaque(mi.Float64, setup.cells_per_m)
    lowest = dr.floor(place)
    offset = mi.Float(place - lowest)
    weights = []
    for tap in range(TAPS):
        weight = mi.Float(float(setup.kernel[0, tap]))
        for coefficient in setup.kernel[1:, tap]:
            weight = dr.fma(weight, offset, float(coefficient))
        weights.append(weight)
    cells = dr.opaque(mi.UInt32, setup.cells)  # a power of two
    first = mi.UInt32(mi.Int64(lowest) - copies // 2) & (cells - 1)
    columns, widths = dr.opaque(mi.UInt32, terms), dr.opaque(mi.UInt32, copies)
    frame = np.repeat(np.arange(len(start) - 1), np.diff(start))
    base = dr.gather(mi.UInt32, upload(mi.UInt32, frame), path) * columns
    amplitude = upload(mi.Float64, np.ascontiguousarray(part.amplitude[rows]).view(float))
    orders = np.empty((count, terms))
    shared_out(gridding.motions, count, setup.motion_per_mps * part.rate[rows], orders, grain=1000)
    motions = upload(mi.Float64, orders)
    part_of_cell, stride = dr.opaque(mi.UInt32, channels), dr.opaque(mi.UInt32, 2 * channels)
    factor, least = dr.opaque(mi.Float64, 1 / unit), dr.opaque(mi.Float, (setup.least / unit) ** 2)

    def body(step: Any) -> tuple[Any]:
        """Add one copy of the path to the grid of one term of the motion."""
        k = step // widths
        copy = step - k * widths
        at = 2 * (path * widths + copy)
        re, im = (mi.Float(dr.gather(mi.Float64, amplitude, at + i) * factor) for i in range(2))
        motion = mi.Float(dr.gather(mi.Float64, motions, path * columns + k))
        re, im = re * motion, im * motion
        strong = re * re + im * im > least
        values = re * cosine - im * sine, re * sine + im * cosine
        line = (base + k) * cells
        for tap, weight in enumerate(weights):
            cell = (line + ((first + copy + tap) & (cells - 1))) * stride + channel
            for i, value in enumerate(values):
                dr.scatter_reduce(dr.ReduceOp.Add, total, mi.Int64(value * weight), cell + i * part_of_cell, strong)
        return (step + 1,)

    dr.while_loop((dr.zeros(mi.UInt32, count * channels),), lambda step: step < columns * widths, body, labels=("step",))
    dr.eval(total)


def _vectors(values: np.ndarray) -> Any:
    """Return a function that reads rows of `values` (N, 3) by index, as 3-vectors of double precision."""
    flat = upload(mi.Float64, values)
    return lambda index: mi.Vector3d(*(dr.gather(mi.Float64, flat, 3 * index + i) for i in range(3)))
