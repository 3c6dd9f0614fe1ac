"""Track the range of the target's peak over the frames of a recording.

The tracker selects one range bin b(f) per frame: the sequence that maximises sum_f ln P(f, b(f)) inside the search window, with
|b(f+1) - b(f)| <= step (dynamic programming; Y. Barniv, Dynamic programming solution for detecting dim moving targets, IEEE Trans. AES
21(1), 1985). The tracked range is r(f) = sum P+ r / sum P+ over b(f) +- GATE_BINS, with P+ the power above the noise floor (paper, linear
transformations: power-weighted peak-range trajectory; motion-specific feature design, depth: tracked peak-range trajectory). The track
does not depend on the signal level. `brightest` uses the strongest bin of each frame instead of the sequence.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from radartwin.errors import InputError
from radartwin.features.processed import Processed
from radartwin.features.profile import FAR_M, GATE_BINS, NEAR_M

SEARCH_M = 0.3  # half width of the search window around the nominal range; covers wheel slip, start offset and the object's depth
MAX_SPEED_MPS = 0.5  # highest speed of the peak: twice the highest speed of the study, 0.24 m/s
Real = NDArray[np.floating]


def track(processed: Processed, low_m: ArrayLike, high_m: ArrayLike, frame_rate_hz: float) -> Real:
    """Track the power-weighted range of the target's peak in each frame, metres, (F,). A step of one bin per frame is always allowed.

    Args:
        low_m, high_m: limits of the search window in metres, one value or one per frame (F,); clipped to NEAR_M..FAR_M.
    Raises:
        InputError: the search window of a frame contains no range bin.
    """
    searched = _searched(processed, low_m, high_m)
    step = max(1, int(np.ceil(MAX_SPEED_MPS / frame_rate_hz / np.diff(processed.range_m).mean())))
    return _weighted(processed, _strongest_path(processed.power.astype(np.float64), searched, step))


def brightest(processed: Processed, low_m: ArrayLike, high_m: ArrayLike) -> Real:
    """Return the range around the strongest bin of each frame, (F,); arguments as for `track`.

    Unlike `track`, the result jumps to an echo of the room wherever that echo is stronger than the target.
    """
    searched = _searched(processed, low_m, high_m)
    return _weighted(processed, np.where(searched, processed.power, -1.0).argmax(axis=1))


def _searched(processed: Processed, low_m: ArrayLike, high_m: ArrayLike) -> NDArray[np.bool_]:
    """Return the mask (F, B) of the range bins inside the search window of each frame."""
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
    """Compute the power-weighted range around the selected bin of each frame, (F,)."""
    range_m = processed.range_m
    near = np.abs(np.arange(len(range_m)) - path[:, None]) <= GATE_BINS
    weight = np.maximum(processed.power - processed.noise_floor, 0.0) * near
    total = weight.sum(axis=1)
    return np.where(total > 0, weight @ range_m / np.where(total > 0, total, 1.0), range_m[path])


def around(processed: Processed, distance_m: Real, frame_rate_hz: float) -> Real:
    """Track the target within SEARCH_M of its nominal distance in each frame, (F,)."""
    return track(processed, distance_m - SEARCH_M, distance_m + SEARCH_M, frame_rate_hz)


def excursion(track_m: Real) -> float:
    """Compute the largest minus the smallest tracked range, metres."""
    return float(np.ptp(track_m))


def _strongest_path(power: Real, searched: NDArray[np.bool_], step: int) -> NDArray[np.intp]:
    """Select the strongest sequence of bins, (F,). Bins outside the window stay allowed at low power, so that the window may jump."""
    tiny = np.finfo(np.float64).tiny
    level = np.log(np.maximum(power, tiny))
    level -= level.max()
    outside = 10 * (level.min() - 1.0)  # lower than the sum of the smallest levels of ten frames
    level = np.where(searched, level, outside)
    frames, bins = level.shape
    score, previous = level[0].copy(), np.zeros((frames, bins), dtype=np.intp)
    shifts = np.array(sorted(range(-step, step + 1), key=abs))  # of equally good steps, take the smallest
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
