"""Convert the axis conventions of scans: the world axis that points up, and the axes and direction of the camera poses.

This library uses a world with z up and camera-to-world poses with the OpenCV camera axes (x right, y down, z forward). OpenGL, ARKit and
Blender use camera axes with y up and z backward. Structure-from-motion tools such as COLMAP write world-to-camera poses.
"""

from __future__ import annotations

import numpy as np

from radartwin.scene.mesh_file import TO_Z_UP

CAMERA_FLIP = np.diag([1.0, -1.0, -1.0, 1.0])  # converts OpenGL camera axes to OpenCV axes and back
# The values of the command-line option `--poses` and their meaning.
POSE_CONVENTIONS = {
    "opencv": "camera-to-world, x right, y down, z forward",
    "opengl": "camera-to-world, x right, y up, z back",
    "opencv-inverse": "world-to-camera, x right, y down, z forward",
    "opengl-inverse": "world-to-camera, x right, y up, z back",
}


def camera_to_world(poses: np.ndarray, convention: str) -> np.ndarray:
    """Convert poses (N, 4, 4) from one of POSE_CONVENTIONS to camera-to-world with OpenCV axes. The function does not check the poses."""
    if convention.endswith("-inverse"):
        rotation = np.swapaxes(poses[:, :3, :3], 1, 2)
        inverse = poses.copy()
        inverse[:, :3, :3] = rotation
        inverse[:, :3, 3] = -np.einsum("nij,nj->ni", rotation, poses[:, :3, 3])
        poses = inverse
    return poses @ CAMERA_FLIP if convention.startswith("opengl") else poses


def z_up(poses: np.ndarray, up: str) -> np.ndarray:
    """Rotate the world frame of poses (N, 4, 4) so that the world axis `up` becomes z."""
    rotation = np.eye(4)
    rotation[:3, :3] = TO_Z_UP[up]
    return rotation @ poses
