"""Compute the poses of the radar at the frames of a recording from its trajectory file."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from radartwin.errors import RecordingError
from radartwin.scene.trajectories.file import read_track


def frame_poses(path: Path, start_s: float, frames: int, rate_hz: float) -> np.ndarray:
    """Interpolate the sensor poses (F, 4, 4) at the frames. A frame up to half a frame period outside the file takes the nearest pose.

    Args:
        path: a trajectory file that `read_track` accepts.
        start_s: time of the first frame on the clock of the trajectory file, seconds.
        frames: number of frames.
        rate_hz: frame rate.
    Raises:
        MissingError, PoseError: the file is missing or unreadable.
        RecordingError: the file does not cover the frames.
    """
    track = read_track(path)
    (begin, end), times, slack = track.times_s[[0, -1]], start_s + np.arange(frames) / rate_hz, 0.5 / rate_hz
    if times[0] < begin - slack or times[-1] > end + slack:
        covered = f"it covers {begin:.3f} to {end:.3f} s, the frames are at {times[0]:.3f} to {times[-1]:.3f} s"
        raise RecordingError(f"{path}: {covered}; give a longer trajectory, or a start_s column")
    return track.at(times.clip(begin, end))
