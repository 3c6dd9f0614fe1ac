"""Range profiles of a recording, their target gate and their comparison.

Symbols: P(f, r) -> range_time, power per frame and range bin, chirps added coherently and virtual channels averaged in power. Paper:
environment ablation (void against reconstructed scene) and the multipath share.
"""

import numpy as np

from radartwin.errors import InputError
from radartwin.radar.processing import range_fft
from radartwin.radar.recording import Recording

NEAR_M, FAR_M = 0.3, 5.5  # range of all comparisons: beyond the antenna coupling, before the weakest walls
GATE_BINS = 3  # range bins of the target gate to either side


def range_time(recording: Recording) -> tuple[np.ndarray, np.ndarray]:
    """Power per frame and range bin.

    Returns:
        power (F, bins), in squared amplitude units, and range (bins,) in metres.
    """
    power = []
    axis = np.zeros(0)
    for block in recording.frame_blocks():
        spectrum, axis = range_fft(recording.iq[block].mean(axis=1), recording.radar)
        power.append((np.abs(spectrum) ** 2).mean(axis=(1, 2)))
    return np.concatenate(power), axis


def gate(range_m: np.ndarray, target_m: float, bins: int = GATE_BINS) -> np.ndarray:
    """Mask of the target gate, (bins,): `bins` to either side of the bin nearest to the target.

    >>> gate(np.arange(5.0), 2.1, 1)
    array([False,  True,  True,  True, False])
    """
    centre = int(np.abs(range_m - target_m).argmin())
    return np.abs(np.arange(len(range_m)) - centre) <= bins


def beyond_target_share(profile: np.ndarray, range_m: np.ndarray, target_m: float) -> float:
    """Energy behind the target gate over all energy between NEAR_M and FAR_M: sum_{r > gate} P / sum P, between 0 and 1."""
    inside = (range_m >= NEAR_M) & (range_m <= FAR_M)
    beyond = inside & (range_m > target_m) & ~gate(range_m, target_m)
    return float(profile[beyond].sum() / profile[inside].sum())


def profile_correlation(first: np.ndarray, second: np.ndarray, range_m: np.ndarray, scale: str = "amplitude") -> float:
    """Pearson correlation of two mean range profiles between NEAR_M and FAR_M.

    Args:
        first, second: power (bins,).
        scale: "amplitude" correlates the square roots of the powers, where the strongest peak dominates; "db" correlates the
            logarithms, where all bins above the noise have similar weight.
    """
    inside = (range_m >= NEAR_M) & (range_m <= FAR_M)
    if scale not in ("amplitude", "db"):
        raise InputError(f"profile correlation: scale {scale!r} is unknown; choose amplitude or db")
    transform = np.sqrt if scale == "amplitude" else lambda power: 10 * np.log10(power)
    return float(np.corrcoef(transform(first[inside]), transform(second[inside]))[0, 1])
