"""Estimate the directions of echoes by Bartlett, Capon (MVDR) and MUSIC spectra over the virtual array.

Symbols and their names in the code: R -> Covariance.matrix (M, M), a(u) -> response in the direction u, M -> number of antennas,
E_n -> eigenvectors of the M - d smallest eigenvalues, d -> sources, delta -> loading times the mean eigenvalue of R.

    Bartlett  P = a^H R a / M^2                     power of a conventional beam
    Capon     P = 1 / (a^H (R + delta I)^-1 a)      power of the beam that passes u and minimises everything else
    MUSIC     P = M / (a^H E_n E_n^H a)             no power; at least 1, infinite where a(u) is in the signal subspace

A plane wave of amplitude A on every antenna gives the power A^2 in its own direction in the Bartlett spectrum, and in the Capon spectrum if
the noise is weak and delta is zero. The signs are those of radartwin.radar.processing: azimuth is atan2(y, x) and positive to the left.
Signals of a moving target need the TDM phase compensation of `doppler_fft` first.

References: J. Capon, Proc. IEEE 57 (1969) 1408; R. Schmidt, IEEE Trans. Antennas Propag. 34 (1986) 276; P. Stoica, A. Nehorai, IEEE Trans.
ASSP 37 (1989) 720 (accuracy of MUSIC and the Cramer-Rao bound).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from radartwin.errors import InputError
from radartwin.radar.chirp import Radar
from radartwin.radar.covariance import Covariance, covariance, uniform_step
from radartwin.radar.field_checks import is_number, is_whole, require
from radartwin.radar.processing import azimuth_row, response, unit_vectors

Complex = NDArray[np.inexact]
Real = NDArray[np.float64]
Positions = NDArray[np.floating]

METHODS = ("bartlett", "capon", "music")


@dataclass(frozen=True)
class AngleMethod:
    """Describe how a spectrum over directions is computed.

    Attributes:
        name: "bartlett", "capon" or "music".
        loading: diagonal loading of Capon in units of the mean eigenvalue of the covariance matrix.
        subarray: number of antennas of the sub-arrays for spatial smoothing, which needs a uniform linear array; 0 means no sub-arrays.
        forward_backward: whether to average the forward and the backward covariance matrix, which needs a uniform linear array.
        sources: number of sources of MUSIC.
    """

    name: str = "bartlett"
    loading: float = 0.0
    subarray: int = 0
    forward_backward: bool = False
    sources: int = 1

    def __post_init__(self) -> None:
        if self.name not in METHODS:
            raise InputError(f"angle method {self.name!r} is unknown; use one of {', '.join(METHODS)}")
        what = f"angle method {self.name}"
        require(self, what, "loading", lambda value: is_number(value) and value >= 0, "a number of at least 0")
        for name in ("subarray", "sources"):
            require(self, what, name, lambda value: is_whole(value) and value >= 0, "a whole number of at least 0")


BARTLETT = AngleMethod()


@dataclass(frozen=True, eq=False)
class AngleSpectrum:
    """Evaluate one or more spectra in any direction; `spectrum` creates it.

    Attributes:
        form: Hermitian matrices (..., M, M) of the quadratic form in the array response.
        positions_m: positions (M, 3) of the antennas to which the rows and columns of `form` belong, in metres.
        frequency_hz: frequency of the array response.
        scale: factor of the quadratic form.
        reciprocal: whether the spectrum is the reciprocal of the scaled form.
    """

    form: Complex
    positions_m: Positions
    frequency_hz: float
    scale: float
    reciprocal: bool

    def __call__(self, directions: Positions) -> Real:
        """Return the spectra (..., D) in D directions, given as unit vectors (D, 3) in the sensor frame."""
        antennas = len(self.positions_m)
        weights = self.scale * response(self.positions_m, directions, self.frequency_hz).conj()
        beams = self.form.reshape(-1, antennas, antennas) @ weights.conj()
        value = np.einsum("ca,rca->ra", weights, beams).real
        if self.reciprocal:
            # In the direction of a source, the quadratic form of MUSIC is zero, and rounding may make the form negative.
            trace = np.trace(self.form, axis1=-2, axis2=-1).real.reshape(-1, 1)
            value = 1 / np.maximum(value, np.finfo(np.float64).eps * self.scale**2 * trace)
        return value.reshape(*self.form.shape[:-2], len(directions))


def spectrum(signals: Covariance, positions_m: Positions, frequency_hz: float, method: AngleMethod = BARTLETT) -> AngleSpectrum:
    """Return the spectra of covariance matrices.

    Args:
        signals: covariance matrices (..., M, M) of the antenna signals.
        positions_m: positions (M, 3) of the virtual antennas in metres.
        frequency_hz: frequency that sets the phase, for a range bin Radar.center_frequency_hz.
        method: method and its settings.
    Raises:
        InputError: the array does not fit the matrices or the smoothing, there are too few snapshots, or there are too many sources.
    """
    antennas = signals.matrix.shape[-1]
    if positions_m.shape != (antennas, 3):
        raise InputError(f"angles: the covariance matrix has {antennas} antennas; give ({antennas}, 3) positions, not {positions_m.shape}")
    if method.subarray or method.forward_backward:
        uniform_step(positions_m)
        signals = signals.smoothed(method.subarray or antennas, method.forward_backward)
        antennas = signals.matrix.shape[-1]
        positions_m = positions_m[:antennas]
    if method.name == "bartlett":
        return AngleSpectrum(signals.matrix, positions_m, frequency_hz, 1 / antennas, False)
    if method.name == "capon":
        return AngleSpectrum(_inverse(signals, method.loading), positions_m, frequency_hz, 1.0, True)
    if method.sources > min(antennas - 1, signals.count):
        needed = f"{method.sources} sources need at least {method.sources + 1} antennas and {method.sources} snapshots"
        there = f"{antennas} antennas and {signals.count} snapshots (after smoothing)"
        raise InputError(f"music: {needed}, and there are {there}; use fewer sources")
    _, vectors = np.linalg.eigh(signals.matrix)  # eigenvalues ascending
    noise = vectors[..., : antennas - method.sources]
    projector = noise @ np.swapaxes(noise.conj(), -1, -2)
    return AngleSpectrum(projector, positions_m, frequency_hz, antennas**-0.5, True)


def azimuth_spectrum(snapshots: Complex, radar: Radar, azimuth_rad: ArrayLike, method: AngleMethod = BARTLETT) -> Real:
    """Compute spectra over the azimuth of horizontal directions from the antennas of the azimuth row.

    Args:
        snapshots: channel signals (..., K, tx, rx) of K snapshots of a Doppler bin from `doppler_fft`, or of a range bin if the scene is
            at rest.
        radar: radar that recorded the samples.
        azimuth_rad: A azimuth angles atan2(y, x) in radians, positive to the left, shape (A,).
        method: method and its settings.
    Returns:
        Spectra (..., A).
    Raises:
        InputError: the shape does not fit the radar, or the errors of `spectrum`.
    """
    if snapshots.ndim < 3 or snapshots.shape[-2:] != (radar.num_tx, radar.num_rx):
        raise InputError(f"the last axes must be (snapshot, {radar.num_tx} tx, {radar.num_rx} rx); the shape is {snapshots.shape}")
    row = azimuth_row(radar)
    signals = covariance(snapshots.reshape(*snapshots.shape[:-2], -1)[..., row])
    return spectrum(signals, radar.virtual_positions[row], radar.center_frequency_hz, method)(unit_vectors(azimuth_rad))


def _inverse(signals: Covariance, loading: float) -> Complex:
    size = signals.matrix.shape[-1]
    if signals.count < size and loading == 0:
        reason = f"{signals.count} snapshots of {size} antennas leave the covariance matrix without an inverse"
        raise InputError(f"capon: {reason}; use diagonal loading, such as loading=0.01, or more snapshots")
    values, vectors = np.linalg.eigh(signals.loaded(loading))
    if (values[..., 0] <= np.finfo(np.float64).eps * size * values[..., -1]).any():
        raise InputError("capon: the covariance matrix has no inverse, because the signals have no noise; use a larger loading")
    return (vectors / values[..., None, :]) @ np.swapaxes(vectors.conj(), -1, -2)
