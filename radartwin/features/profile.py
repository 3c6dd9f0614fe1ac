"""Compute range profiles of a recording, select the target gate, and compare profiles.

Symbols: P(f, r) -> range_time, power per frame and range bin; coherent over chirps, averaged in power over virtual channels. The paper uses
range profiles for the environment ablation (simulation in free space against simulation in the scene) and for the multipath share.
"""

import numpy as np

from radartwin.errors import InputError
from radartwin.radar.processing import range_fft
from radartwin.radar.recording import Recording

NEAR_M, FAR_M = 0.3, 5.5  # limits of all range sums: beyond the leakage between the antennas, before the walls with the weakest echoes
GATE_BINS = 3  # range bins of the target gate on either side of the target's bin


def range_time(recording: Recording) -> tuple[np.ndarray, np.ndarray]:
    """Compute the power in each frame and range bin of a recording.

    Returns:
        power: (F, bins), in squared amplitude units.
        range: (bins,) in metres.
    """
    power = []
    axis = np.zeros(0)
    for block in recording.frame_blocks():
        spectrum, axis = range_fft(recording.iq[block].mean(axis=1), recording.radar)
        power.append((np.abs(spectrum) ** 2).mean(axis=(1, 2)))
    return np.concatenate(power), axis


def gate(range_m: np.ndarray, target_m: float, bins: int = GATE_BINS) -> np.ndarray:
    """Return the mask (bins,) of the target gate: the bin nearest to the target and `bins` bins on either side.

    >>> gate(np.arange(5.0), 2.1, 1)
    array([False,  True,  True,  True, False])
    """
    centre = int(np.abs(range_m - target_m).argmin())
    return np.abs(np.arange(len(range_m)) - centre) <= bins


def beyond_target_share(profile: np.ndarray, range_m: np.ndarray, target_m: float) -> float:
    """Compute the fraction of the energy from NEAR_M to FAR_M that lies behind the target gate: sum_{r > gate} P / sum P."""
    inside = (range_m >= NEAR_M) & (range_m <= FAR_M)
    beyond = inside & (range_m > target_m) & ~gate(range_m, target_m)
    return float(profile[beyond].sum() / profile[inside].sum())


def profile_correlation(first: np.ndarray, second: np.ndarray, range_m: np.ndarray, scale: str = "amplitude") -> float:
    """Compute the Pearson correlation of two mean range profiles between NEAR_M and FAR_M.

    Args:
        first, second: power (bins,).
        scale: "amplitude" correlates the square roots of the powers, so the strongest peak dominates. "db" correlates the logarithms, so
            all bins above the noise have similar weight.
    """
    inside = (range_m >= NEAR_M) & (range_m <= FAR_M)
    if scale not in ("amplitude", "db"):
        raise InputError(f"profile correlation: scale {scale!r} is unknown; choose amplitude or db")
    transform = np.sqrt if scale == "amplitude" else lambda power: 10 * np.log10(power)
    return float(np.corrcoef(transform(first[inside]), transform(second[inside]))[0, 1])
