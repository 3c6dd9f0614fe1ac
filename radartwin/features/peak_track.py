"""Track the range of the target's power peak over the frames of a recording.

The tracker selects one range bin b(f) per frame f. Inside the search window, it finds the sequence of range bins that maximises the sum
over frames of ln P(f, b(f)), where P is the power, under the condition |b(f+1) - b(f)| <= step. The method is dynamic programming (Y.
Barniv, Dynamic programming solution for detecting dim moving targets, IEEE Trans. AES 21(1), 1985). The tracked range is the power-weighted
mean range r(f) = sum P+ r / sum P+ over the range bins b(f) +- GATE_BINS, where P+ is the power above the noise. The RadarTwin paper calls
this result the tracked peak-range trajectory. The tracked range does not depend on the signal level. The function `brightest` uses the
strongest range bin of each frame instead of the best sequence.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from radartwin.errors import InputError
from radartwin.features.processed import Processed
from radartwin.features.profile import FAR_M, GATE_BINS, NEAR_M

# Half width in metres of the search window around the nominal range. The window includes the effects of wheel slip, start offset and the
# depth of the object.
SEARCH_M = 0.3
LEAST_SPEED_MPS = 0.5  # speed in m/s that the tracked peak may always have; twice the highest speed of the recorded motions (0.24 m/s)
Real = NDArray[np.floating]


def track(processed: Processed, low_m: ArrayLike, high_m: ArrayLike, frame_rate_hz: float) -> Real:
    """Track the power-weighted range of the target's power peak in each frame, in metres, (F,).

    The peak may move at LEAST_SPEED_MPS or at twice the speed of the search window, whichever is higher, and in any case by one range bin
    per frame.

    Args:
        processed: processed recording of F frames.
        low_m: lower limit of the search window in metres, one value or one per frame (F,); values below NEAR_M are raised to NEAR_M.
        high_m: upper limit of the search window in metres, one value or one per frame (F,); values above FAR_M are lowered to FAR_M.
    Raises:
        InputError: the search window of a frame contains no range bin.
    """
    searched = _searched(processed, low_m, high_m)
    per_frame_m = max(float(np.abs(np.diff(np.atleast_1d(limit))).max(initial=0.0)) for limit in (low_m, high_m))
    speed_mps = max(LEAST_SPEED_MPS, 2 * per_frame_m * frame_rate_hz)
    step = max(1, int(np.ceil(speed_mps / frame_rate_hz / np.diff(processed.range_m).mean())))
    return _weighted(processed, _strongest_path(processed.power.astype(np.float64), searched, step))


def brightest(processed: Processed, low_m: ArrayLike, high_m: ArrayLike) -> Real:
    """Return the power-weighted range around the strongest range bin of each frame, in metres, (F,). The arguments are those of `track`.

    Unlike the result of `track`, this range jumps to an echo of the room in frames in which this echo is stronger than the target.
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
    """Compute the power-weighted mean range around the selected range bin `path` (F,) of each frame, in metres, (F,)."""
    range_m = processed.range_m
    near = np.abs(np.arange(len(range_m)) - path[:, None]) <= GATE_BINS
    weight = np.maximum(processed.power - processed.noise_floor, 0.0) * near
    total = weight.sum(axis=1)
    return np.where(total > 0, weight @ range_m / np.where(total > 0, total, 1.0), range_m[path])


def around(processed: Processed, distance_m: Real, frame_rate_hz: float) -> Real:
    """Track the target within SEARCH_M of its nominal distance, and return its range in each frame in metres, (F,)."""
    return track(processed, distance_m - SEARCH_M, distance_m + SEARCH_M, frame_rate_hz)


def excursion(track_m: Real) -> float:
    """Compute the difference between the largest and the smallest tracked range, in metres."""
    return float(np.ptp(track_m))


def _strongest_path(power: Real, searched: NDArray[np.bool_], step: int) -> NDArray[np.intp]:
    """Select the sequence of range bins (F,) with the highest sum of log powers."""
    tiny = np.finfo(np.float64).tiny
    level = np.log(np.maximum(power, tiny))
    level -= level.max()
    # Log power of a range bin outside the search window: lower than the sum of the lowest log powers of ten frames.
    outside = 10 * (level.min() - 1.0)
    level = np.where(searched, level, outside)
    frames, bins = level.shape
    score, previous = level[0].copy(), np.zeros((frames, bins), dtype=np.intp)
    shifts = np.array(sorted(range(-step, step + 1), key=abs))  # among equally good steps, the smallest is used
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
