"""Axes that scans come in: which way is up, and how a camera's pose is written.

Ours: world z up; poses camera-to-world with the camera's x right, y down, z forward, as OpenCV has it. OpenGL, ARKit and Blender have the
camera's y up and z back. Structure-from-motion tools such as COLMAP write world-to-camera, the inverse.
"""

from __future__ import annotations

import numpy as np

# Rotations that take an up axis to z: cyclic, so that handedness is kept.
TO_Z_UP = {
    "x": np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0]]),
    "y": np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]]),
    "z": np.eye(3),
    "-x": np.array([[0, -1, 0], [0, 0, 1], [-1, 0, 0]]),
    "-y": np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]]),
    "-z": np.diag([1, -1, -1]),
}
CAMERA_FLIP = np.diag([1.0, -1.0, -1.0, 1.0])  # y up, z back -> y down, z forward, and back
# What a pose may be, by the word for `--poses`.
READINGS = {
    "opencv": "camera-to-world, x right, y down, z forward",
    "opengl": "camera-to-world, x right, y up, z back",
    "opencv-inverse": "world-to-camera, x right, y down, z forward",
    "opengl-inverse": "world-to-camera, x right, y up, z back",
}


def camera_to_world(poses: np.ndarray, reading: str) -> np.ndarray:
    """Poses (N, 4, 4) of one of the READINGS as ours; what is not rigid stays so, and is refused where poses are checked."""
    if reading.endswith("-inverse"):
        turned = np.swapaxes(poses[:, :3, :3], 1, 2)
        inverse = poses.copy()
        inverse[:, :3, :3] = turned
        inverse[:, :3, 3] = -np.einsum("nij,nj->ni", turned, poses[:, :3, 3])
        poses = inverse
    return poses @ CAMERA_FLIP if reading.startswith("opengl") else poses


def z_up(poses: np.ndarray, up: str) -> np.ndarray:
    """Poses (N, 4, 4) in a world whose axis `up` points up, in one with z up."""
    turn = np.eye(4)
    turn[:3, :3] = TO_Z_UP[up]
    return turn @ poses
