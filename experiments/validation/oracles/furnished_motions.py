"""Furnished metal rooms in which the radar or an object moves, and their full-wave fields, for the chart of speed against accuracy.

The radar is a single point, which drives along x through three seeded rooms, or stands before an alcove in which a box turns. Every frame
is one scene in the sensor frame. `python -m experiments.validation.oracles.furnished_motions` solves the scenes of fullwave_2d/motions
again and writes the files.
"""

import numpy as np

from experiments.validation.oracles import fullwave, moments_2d
from experiments.validation.oracles.furnished import FIELDS, ROOMS, Strips, box, write
from radartwin.radar.chirp import Radar
from radartwin.scene.trajectories import trajectory

FOLDER = FIELDS / "motions"
DRIVEN = ("wall_01", "corridor_03", "alcove_04")
STEP_M = 0.004  # distance that the radar moves from frame to frame
ALCOVE = "alcove_04"  # room whose walls surround the turning box
BOX_M, PLACE_M, START_DEG = (0.06, 0.09), (0.45, 0.05, 0.0), 20.0
FRAMES = 3  # frames with a full-wave field


def drive(frames: int) -> np.ndarray:
    """Return the poses (F, 4, 4) of the driving radar."""
    poses = np.tile(np.eye(4), (frames, 1, 1))
    poses[:, 0, 3] = STEP_M * np.arange(frames)
    return poses


def turning(frames: int) -> np.ndarray:
    """Return the poses (F, 4, 4) of the turning box."""
    return trajectory.turntable(PLACE_M, frames, Radar.iwr1843().frame_rate_hz, 25.0, np.radians(START_DEG))


def walls() -> dict[str, Strips]:
    """Return the walls around the turning box."""
    return {"front": fullwave.strips(ROOMS, ALCOVE)["front"]}


def name(recording: str, frame: int) -> str:
    """Return the name of the scene of one frame of a recording; the recording is a name in DRIVEN or "box"."""
    return f"{recording}_frame_{frame}"


def scenes() -> dict[str, dict[str, Strips]]:
    """Return the surfaces of every frame in the sensor frame."""
    by_name = {}
    for room in DRIVEN:
        for frame, pose in enumerate(drive(FRAMES)):
            by_name[name(room, frame)] = {part: strips - pose[:2, 3] for part, strips in fullwave.strips(ROOMS, room).items()}
    for frame, pose in enumerate(turning(FRAMES)):
        by_name[name("box", frame)] = walls() | {"box": box(*BOX_M) @ pose[:2, :2].T + pose[:2, 3]}
    return by_name


if __name__ == "__main__":
    write(FOLDER, scenes(), list(scenes()), {"nodes_per_wavelength": moments_2d.PER_WAVELENGTH}, np.zeros((2, 2)))
