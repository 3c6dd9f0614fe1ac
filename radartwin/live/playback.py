"""Play a recording back: the spectra of its frames, and the poses of the radar where the recording has them."""

from __future__ import annotations

import numpy as np

from radartwin.live.echoes import Spectra, spectra
from radartwin.radar.recording import Recording


class Playback:
    """Give the frames of a recording with at least one frame. `name` is the name of its file, for messages."""

    def __init__(self, recording: Recording, name: str) -> None:
        self.recording, self.name = recording, name
        self.frames, self.poses = recording.num_frames, recording.sensor_poses
        self.calibrated = not recording.in_counts

    def pose(self, frame: int) -> np.ndarray | None:
        """Return the sensor pose (4, 4) of a frame, or None if the recording has no poses."""
        return None if self.poses is None else self.poses[frame if len(self.poses) > 1 else 0]

    def spectra(self, frame: int) -> Spectra:
        return spectra(self.recording.iq[frame], self.recording.radar)

    def caption(self, frame: int) -> str:
        """Describe a frame in one line of the page."""
        seconds = frame / self.recording.radar.frame_rate_hz
        poses = "radar at the recorded pose" if self.pose(frame) is not None else "the recording has no poses: drag the radar to its place"
        level = "" if self.calibrated else "; levels in ADC counts, shifted to the simulated maximum"
        return f"{self.name}, frame {frame} of {self.frames}, {seconds:.2f} s; {poses}{level}"


def shifted_db(measured_db: np.ndarray, simulated_db: np.ndarray) -> np.ndarray:
    """Shift the level of a measured profile (B,) without calibration, so that its maximum equals that of a simulated profile."""
    return measured_db + float(simulated_db.max() - measured_db.max())
