"""Estimate the covariance matrix of an array's signals, smooth it over sub-arrays, and load its diagonal.

Symbols and their names in the code: x_k -> snapshots, K -> count, M -> number of antennas, R -> matrix.

A snapshot holds the signals of all antennas at one time. Echoes of one range-Doppler cell have a constant phase relation while the scene
does not move, so that their covariance matrix has rank one (coherent sources). Spatial smoothing averages the covariance matrices of
shifted equal sub-arrays of a uniform line of antennas, which restores the rank. The backward average adds the matrix of the reversed,
conjugated signals.

References: T.-J. Shan, M. Wax, T. Kailath, IEEE Trans. ASSP 33 (1985) 806 (spatial smoothing); S. Pillai, B. Kwon, IEEE Trans. ASSP 37
(1989) 8 (forward-backward smoothing).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import InputError

Complex = NDArray[np.inexact]
Real = NDArray[np.floating]

_STEP_TOLERANCE = 1e-3  # largest deviation of a step from the mean step, in steps; 0.2 degrees of phase at half a wavelength


@dataclass(frozen=True, eq=False)
class Covariance:
    """Hold sample covariance matrices.

    Attributes:
        matrix: matrices (..., M, M), E[x x^H], in squared units of the signals.
        count: number of snapshots that were averaged. Smoothing multiplies this number by the number of sub-arrays, and by 2 for
            forward-backward averaging, although these snapshots are not independent.
    """

    matrix: Complex
    count: int

    def smoothed(self, subarray: int, forward_backward: bool = False) -> Covariance:
        """Average the matrices of all shifted sub-arrays of a uniform line; the result belongs to the first `subarray` antennas.

        Args:
            subarray: number of antennas of a sub-array; if `subarray` is M, the only sub-array is the whole array.
            forward_backward: whether to add the matrices of the reversed, conjugated signals.
        Raises:
            InputError: the sub-array is larger than the array or has fewer than two antennas.
        """
        antennas = self.matrix.shape[-1]
        if not 2 <= subarray <= antennas:
            raise InputError(f"spatial smoothing: a sub-array of {subarray} antennas does not fit {antennas} antennas; use 2 to {antennas}")
        shifts = antennas - subarray + 1
        blocks = (self.matrix[..., first : first + subarray, first : first + subarray] for first in range(shifts))
        matrix = sum(blocks, np.zeros((*self.matrix.shape[:-2], subarray, subarray), dtype=np.complex128)) / shifts
        if not forward_backward:
            return Covariance(matrix, self.count * shifts)
        return Covariance((matrix + matrix[..., ::-1, ::-1].conj()) / 2, 2 * self.count * shifts)

    def loaded(self, loading: float) -> Complex:
        """Return the matrices with `loading` times their mean eigenvalue added to the diagonal, (..., M, M)."""
        size = self.matrix.shape[-1]
        mean = np.trace(self.matrix, axis1=-2, axis2=-1).real / size
        return self.matrix + (loading * mean)[..., None, None] * np.eye(size)


def covariance(snapshots: Complex) -> Covariance:
    """Estimate covariance matrices from snapshots (..., K, M) of K times and M antennas.

    Raises:
        InputError: the snapshots are not finite or do not have two axes.
    """
    if snapshots.ndim < 2 or 0 in snapshots.shape[-2:]:
        raise InputError(f"snapshots must have the shape (..., snapshot, antenna), not {snapshots.shape}")
    if not np.isfinite(snapshots).all():
        raise InputError("snapshots: they hold NaN or infinite values; check the samples of the recording")
    wide = snapshots.astype(np.complex128)
    return Covariance(np.swapaxes(wide, -1, -2) @ wide.conj() / wide.shape[-2], wide.shape[-2])


def uniform_step(positions_m: Real) -> Real:
    """Return the step vector (3,) in metres from each antenna (M, 3) of a uniform line to the next.

    Raises:
        InputError: the antennas are not equally spaced along a line, in the order of the array.

    >>> uniform_step(np.array([[0.0, 0.0, 0.0], [0.0, 0.002, 0.0], [0.0, 0.004, 0.0]])).tolist()
    [0.0, 0.002, 0.0]
    """
    steps = np.diff(positions_m, axis=0)
    mean = steps.mean(axis=0) if len(steps) else np.zeros(3)
    size = float(np.linalg.norm(mean))
    if size == 0 or np.linalg.norm(steps - mean, axis=1).max() > _STEP_TOLERANCE * size:
        remedy = "choose such a row of the array, or leave out subarray and forward_backward"
        raise InputError(f"spatial smoothing: the {len(positions_m)} antennas are not equally spaced along a line; {remedy}")
    return mean
