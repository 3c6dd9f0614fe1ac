"""Where the target's peak is in each frame: the strongest continuous path through the range bins, then the power-weighted range.

Symbols: P(f, r) -> power; b(f) -> bins, the path that maximises sum_f ln P(f, b(f)) with |b(f+1) - b(f)| <= step within the search window
(dynamic programming; Y. Barniv, Dynamic programming solution for detecting dim moving targets, IEEE Trans. AES 21(1), 1985); track
r(f) = sum P+ r / sum P+ over b(f) +- GATE_BINS, P+ the power above the noise floor (paper, linear transformations: power-weighted
peak-range trajectory; motion-specific feature design, depth: tracked peak-range trajectory). Scale drops out. `brightest` takes the
strongest bin of each frame by itself instead of the path.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from radartwin.errors import InputError
from radartwin.features.processed import Processed
from radartwin.features.profile import FAR_M, GATE_BINS, NEAR_M

SEARCH_M = 0.3  # either side of where the target is nominally: slip, start offset and the object's own depth
MAX_SPEED_MPS = 0.5  # of anything in the study, doubled: 0.24 m/s
Real = NDArray[np.floating]


def track(processed: Processed, low_m: ArrayLike, high_m: ArrayLike, frame_rate_hz: float, max_speed_mps: float = MAX_SPEED_MPS) -> Real:
    """Power-weighted range of the target's peak per frame, (F,).

    Args:
        low_m, high_m: the search window in metres, one or one per frame (F,); cut to NEAR_M..FAR_M.
        max_speed_mps: the peak moves no faster from frame to frame, and at least one bin.
    Raises:
        InputError: a window that holds no bin.
    """
    searched = _searched(processed, low_m, high_m)
    step = max(1, int(np.ceil(max_speed_mps / frame_rate_hz / np.diff(processed.range_m).mean())))
    return _weighted(processed, _strongest_path(processed.power.astype(np.float64), searched, step))


def brightest(processed: Processed, low_m: ArrayLike, high_m: ArrayLike) -> Real:
    """As `track`, about the strongest bin of each frame: it jumps to an echo of the room that outshines the target."""
    searched = _searched(processed, low_m, high_m)
    return _weighted(processed, np.where(searched, processed.power, -1.0).argmax(axis=1))


def _searched(processed: Processed, low_m: ArrayLike, high_m: ArrayLike) -> NDArray[np.bool_]:
    """(F, B): the bins of each frame's window."""
    range_m, frames = processed.range_m, processed.num_frames
    low = np.maximum(np.broadcast_to(low_m, frames), NEAR_M)[:, None]
    high = np.minimum(np.broadcast_to(high_m, frames), FAR_M)[:, None]
    searched = (range_m >= low) & (range_m <= high)
    if not searched.any(axis=1).all():
        frame = int(np.argmin(searched.any(axis=1)))
        raise InputError(
            f"track: frame {frame} is searched from {float(low[frame, 0]):g} to {float(high[frame, 0]):g} m, where there is no range bin; "
            f"the target must be between {NEAR_M} and {FAR_M} m"
        )
    return searched


def _weighted(processed: Processed, path: NDArray[np.intp]) -> Real:
    """Power-weighted range about the path's bins."""
    range_m = processed.range_m
    near = np.abs(np.arange(len(range_m)) - path[:, None]) <= GATE_BINS
    weight = np.maximum(processed.power - processed.noise_floor, 0.0) * near
    total = weight.sum(axis=1)
    return np.where(total > 0, weight @ range_m / np.where(total > 0, total, 1.0), range_m[path])


def around(processed: Processed, distance_m: Real, frame_rate_hz: float, search_m: float = SEARCH_M) -> Real:
    """`track` within `search_m` of the nominal distance of each frame."""
    return track(processed, distance_m - search_m, distance_m + search_m, frame_rate_hz)


def excursion(track_m: Real) -> float:
    """Largest less smallest range, metres."""
    return float(np.ptp(track_m))


def _strongest_path(power: Real, searched: NDArray[np.bool_], step: int) -> NDArray[np.intp]:
    """(F,) bins. Every frame's window is reachable: bins outside are poor, not forbidden, so that windows may jump."""
    tiny = np.finfo(np.float64).tiny
    level = np.log(np.maximum(power, tiny))
    level -= level.max()
    outside = 10 * (level.min() - 1.0)  # worse than the darkest bin of many frames
    level = np.where(searched, level, outside)
    frames, bins = level.shape
    score, came = level[0].copy(), np.zeros((frames, bins), dtype=np.intp)
    shifts = np.array(sorted(range(-step, step + 1), key=abs))  # of equals the smallest move
    source = np.arange(bins)[None] + shifts[:, None]
    allowed = (source >= 0) & (source < bins)
    source = np.clip(source, 0, bins - 1)
    for frame in range(1, frames):
        offered = np.where(allowed, score[source], -np.inf)
        best = offered.argmax(axis=0)
        came[frame] = source[best, np.arange(bins)]
        score = offered[best, np.arange(bins)] + level[frame]
    path = np.zeros(frames, dtype=np.intp)
    path[-1] = int(np.where(searched[-1], score, -np.inf).argmax())
    for frame in range(frames - 1, 0, -1):
        path[frame - 1] = came[frame, path[frame]]
    return path
