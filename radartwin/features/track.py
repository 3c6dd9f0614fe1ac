"""Range of the target's peak in each frame: the power-weighted range around the strongest continuous path through the range bins.

Symbols: P(f, r) -> power; b(f) -> bins, the path that maximises sum_f ln P(f, b(f)) with |b(f+1) - b(f)| <= step within the search window
(dynamic programming; Y. Barniv, Dynamic programming solution for detecting dim moving targets, IEEE Trans. AES 21(1), 1985); track
r(f) = sum P+ r / sum P+ over b(f) +- GATE_BINS, P+ the power above the noise floor (paper, linear transformations: power-weighted
peak-range trajectory; motion-specific feature design, depth: tracked peak-range trajectory). The track does not depend on scale.
`brightest` uses the strongest bin of each frame instead of the path.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from radartwin.errors import InputError
from radartwin.features.processed import Processed
from radartwin.features.profile import FAR_M, GATE_BINS, NEAR_M

SEARCH_M = 0.3  # to either side of the nominal range, for slip, start offset and the depth of the object
MAX_SPEED_MPS = 0.5  # twice the highest speed of the study, 0.24 m/s
Real = NDArray[np.floating]


def track(processed: Processed, low_m: ArrayLike, high_m: ArrayLike, frame_rate_hz: float, max_speed_mps: float = MAX_SPEED_MPS) -> Real:
    """Power-weighted range of the target's peak per frame, (F,).

    Args:
        low_m, high_m: limits of the search window in metres, one value or one per frame (F,); clipped to NEAR_M..FAR_M.
        max_speed_mps: highest speed of the peak; a step of one bin per frame is always allowed.
    Raises:
        InputError: the window contains no bin.
    """
    searched = _searched(processed, low_m, high_m)
    step = max(1, int(np.ceil(max_speed_mps / frame_rate_hz / np.diff(processed.range_m).mean())))
    return _weighted(processed, _strongest_path(processed.power.astype(np.float64), searched, step))


def brightest(processed: Processed, low_m: ArrayLike, high_m: ArrayLike) -> Real:
    """As `track`, around the strongest bin of each frame; it jumps to an echo of the room that is stronger than the target."""
    searched = _searched(processed, low_m, high_m)
    return _weighted(processed, np.where(searched, processed.power, -1.0).argmax(axis=1))


def _searched(processed: Processed, low_m: ArrayLike, high_m: ArrayLike) -> NDArray[np.bool_]:
    """Mask of the bins in the window of each frame, (F, B)."""
    range_m, frames = processed.range_m, processed.num_frames
    low = np.maximum(np.broadcast_to(low_m, frames), NEAR_M)[:, None]
    high = np.minimum(np.broadcast_to(high_m, frames), FAR_M)[:, None]
    searched = (range_m >= low) & (range_m <= high)
    if not searched.any(axis=1).all():
        frame = int(np.argmin(searched.any(axis=1)))
        raise InputError(
            f"track: frame {frame} is searched from {float(low[frame, 0]):g} to {float(high[frame, 0]):g} m, where there is no range bin; "
            f"place the target between {NEAR_M} and {FAR_M} m"
        )
    return searched


def _weighted(processed: Processed, path: NDArray[np.intp]) -> Real:
    """Power-weighted range around the bins of the path."""
    range_m = processed.range_m
    near = np.abs(np.arange(len(range_m)) - path[:, None]) <= GATE_BINS
    weight = np.maximum(processed.power - processed.noise_floor, 0.0) * near
    total = weight.sum(axis=1)
    return np.where(total > 0, weight @ range_m / np.where(total > 0, total, 1.0), range_m[path])


def around(processed: Processed, distance_m: Real, frame_rate_hz: float, search_m: float = SEARCH_M) -> Real:
    """`track` within `search_m` of the nominal distance of each frame."""
    return track(processed, distance_m - search_m, distance_m + search_m, frame_rate_hz)


def excursion(track_m: Real) -> float:
    """Largest minus smallest range, metres."""
    return float(np.ptp(track_m))


def _strongest_path(power: Real, searched: NDArray[np.bool_], step: int) -> NDArray[np.intp]:
    """Bins of the strongest path, (F,). Bins outside the window have a low score and are allowed, so that windows may jump."""
    tiny = np.finfo(np.float64).tiny
    level = np.log(np.maximum(power, tiny))
    level -= level.max()
    outside = 10 * (level.min() - 1.0)  # lower than the sum of the weakest bins of many frames
    level = np.where(searched, level, outside)
    frames, bins = level.shape
    score, previous = level[0].copy(), np.zeros((frames, bins), dtype=np.intp)
    shifts = np.array(sorted(range(-step, step + 1), key=abs))  # the smallest of equal steps
    source = np.arange(bins)[None] + shifts[:, None]
    allowed = (source >= 0) & (source < bins)
    source = np.clip(source, 0, bins - 1)
    for frame in range(1, frames):
        candidates = np.where(allowed, score[source], -np.inf)
        best = candidates.argmax(axis=0)
        previous[frame] = source[best, np.arange(bins)]
        score = candidates[best, np.arange(bins)] + level[frame]
    path = np.zeros(frames, dtype=np.intp)
    path[-1] = int(np.where(searched[-1], score, -np.inf).argmax())
    for frame in range(frames - 1, 0, -1):
        path[frame - 1] = previous[frame, path[frame]]
    return path
