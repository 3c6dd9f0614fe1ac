"""Define colour-and-depth frames with camera poses, and convert poses of other conventions.

The world frame has z up and is in metres. Poses are 4x4 camera-to-world matrices with OpenCV camera axes (x right, y down, z forward).
OpenGL, ARKit and Blender use camera axes with y up and z backward. Structure-from-motion tools such as COLMAP write world-to-camera poses.
Pixel centres have integer coordinates, so the top left corner of a picture lies at (-0.5, -0.5). Depth is measured along the camera's z
axis, not along the ray. `frames.layouts.load_frames` reads a folder of frames, and `frames.folder.save_frames` writes a folder of frames.
"""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import overload

import numpy as np

from radartwin.errors import MissingError, PoseError, ScanError
from radartwin.io.one_line import plural
from radartwin.scene.mesh_file import TO_Z_UP

CAMERA_FLIP = np.diag([1.0, -1.0, -1.0, 1.0])  # converts OpenGL camera axes to OpenCV axes and back
# The values of the command-line option `--poses` and their meaning.
POSE_CONVENTIONS = {
    "opencv": "camera-to-world, x right, y down, z forward",
    "opengl": "camera-to-world, x right, y up, z back",
    "opencv-inverse": "world-to-camera, x right, y down, z forward",
    "opengl-inverse": "world-to-camera, x right, y up, z back",
}
RIGID_TOLERANCE = 1e-3  # largest deviation of R^T R from the identity; ARKit poses and text files with six digits deviate by less than 1e-5


@dataclasses.dataclass(frozen=True, eq=False)
class Frame:
    """A colour-and-depth view of a scan, taken from a single camera pose.

    Attributes:
        name: name of the frame, different for each frame of a scan.
        pose: (4, 4) camera-to-world, OpenCV axes, metres.
        intrinsics: (3, 3) pinhole matrix of the depth picture, pixels.
        depth_m: (h, w) float32 depth along the camera's z axis, metres; 0 at pixels without depth.
        colour: (H, W, 3) uint8 sRGB picture of the same view, usually with more pixels than `depth_m`; None if the frame has no colour.
        colour_intrinsics: (3, 3) pinhole matrix of `colour`; None if `colour` is None.
        confidence: (h, w) uint8 confidence of each depth pixel: 0 low, 1 medium, 2 high (as ARKit's ARConfidenceLevel); None if unknown.
    """

    name: str
    pose: np.ndarray
    intrinsics: np.ndarray
    depth_m: np.ndarray
    colour: np.ndarray | None = None
    colour_intrinsics: np.ndarray | None = None
    confidence: np.ndarray | None = None


class Frames(Sequence[Frame]):
    """A sequence of frames in the order of recording. Each access to a frame reads the frame from its files again.

    Args:
        read: function that returns frame i.
        poses: (N, 4, 4) camera-to-world poses in metres; they replace the poses of the frames that `read` returns.
        source: name of the folder of frames in error messages.
        scan_of: identifier of the scanned room: the name of a procedural room, or the digest of a real scan's files; empty if unknown.
    Raises:
        ScanError: there are no frames, a name is repeated, or the numbers of poses and names differ.
        PoseError: a pose is not finite, is mirrored, or is not rigid.
    """

    def __init__(
        self, names: Iterable[str], poses: np.ndarray, read: Callable[[int], Frame], source: str = "frames", scan_of: str = ""
    ) -> None:
        self.names = tuple(names)
        self.source, self.scan_of = source, scan_of
        self._read = read
        if not self.names:
            raise ScanError(f"{source}: no frames; give a folder with depth pictures and poses")
        if len(set(self.names)) < len(self.names):
            raise ScanError(f"{source}: two frames have the same name; give each frame its own name")
        if len(poses) != len(self.names):
            counts = f"{plural(len(self.names), 'frame')} and {plural(len(poses), 'pose')}"
            raise ScanError(f"{source}: {counts}; give one pose per frame, in the same order")
        self.poses = check_poses(np.asarray(poses, dtype=np.float64), source, self.names)

    @classmethod
    def of(cls, frames: Iterable[Frame], source: str = "frames", scan_of: str = "") -> Frames:
        """Make a `Frames` sequence from frames that are already in memory."""
        frames = list(frames)
        poses = np.array([f.pose for f in frames]).reshape(-1, 4, 4)
        return cls((f.name for f in frames), poses, frames.__getitem__, source, scan_of)

    def __len__(self) -> int:
        return len(self.names)

    @overload
    def __getitem__(self, index: int) -> Frame: ...
    @overload
    def __getitem__(self, index: slice) -> Frames: ...
    def __getitem__(self, index: int | slice) -> Frame | Frames:
        selection = range(len(self.names))[index]
        if isinstance(selection, int):
            return dataclasses.replace(self._read(selection), pose=self.poses[selection])
        picked = list(selection)
        return Frames([self.names[i] for i in picked], self.poses[picked], lambda i: self._read(picked[i]), self.source, self.scan_of)

    def __iter__(self) -> Iterator[Frame]:  # that of Sequence would take an IndexError of a reader for the end
        return (self[i] for i in range(len(self)))

    def with_poses(self, poses: np.ndarray) -> Frames:
        """Return the same frames with their poses replaced by `poses` (N, 4, 4), camera-to-world."""
        return Frames(self.names, poses, self._read, self.source, self.scan_of)


def scan_digest(files: Iterable[Path]) -> str:
    """Return a digest that identifies a real scan, computed from the contents of its mesh file or of the files that hold its poses."""
    digest = hashlib.sha256()
    for file in files:
        try:
            digest.update(file.read_bytes())
        except FileNotFoundError as error:
            raise MissingError(f"{file} does not exist; check the path, or export the scan again") from error
    return f"sha256:{digest.hexdigest()[:16]}"


def check_poses(poses: np.ndarray, source: str, names: Sequence[str]) -> np.ndarray:
    """Return poses (N, 4, 4) with exactly orthonormal rotations. Raises a PoseError if a pose is not rigid."""
    if poses.ndim != 3 or poses.shape[1:] != (4, 4):
        raise PoseError(f"{source}: poses have shape {poses.shape}; give (N, 4, 4) camera-to-world matrices")
    for name, pose in zip(names, poses, strict=True):
        rotation = pose[:3, :3]
        if not np.isfinite(pose).all():
            raise PoseError(f"{source}: the pose of frame {name} is not finite; leave the frame out or export it again")
        if np.abs(rotation.T @ rotation - np.eye(3)).max() > RIGID_TOLERANCE or np.abs(pose[3] - [0, 0, 0, 1]).max() > RIGID_TOLERANCE:
            raise PoseError(f"{source}: the pose of frame {name} is not a rotation and a shift; give rigid camera-to-world matrices")
        if np.linalg.det(rotation) < 0:
            raise PoseError(f"{source}: the pose of frame {name} mirrors (determinant -1); one axis is flipped, export right-handed poses")
    left, _, right = np.linalg.svd(poses[:, :3, :3])
    clean = poses.copy()
    clean[:, :3, :3], clean[:, 3] = left @ right, [0, 0, 0, 1]
    return clean


def rescaled(intrinsics: np.ndarray, size: tuple[int, int], to: tuple[int, int]) -> np.ndarray:
    """Convert the intrinsics (3, 3) of a picture with `size` (width, height) pixels to the intrinsics of the same view at the size `to`."""
    scale = np.divide(to, size)
    moved = np.array(intrinsics, dtype=np.float64)
    moved[:2, :2] *= scale[:, None]
    moved[:2, 2] = (moved[:2, 2] + 0.5) * scale - 0.5
    return moved


def points(frame: Frame) -> np.ndarray:
    """Return the world points (h, w, 3) of the depth pixels in metres; NaN at pixels without depth."""
    v, u = np.indices(frame.depth_m.shape)
    k = frame.intrinsics
    depth = np.where(frame.depth_m > 0, frame.depth_m, np.nan).astype(np.float64)
    y = (v - k[1, 2]) / k[1, 1]
    x = (u - k[0, 2] - k[0, 1] * y) / k[0, 0]
    return np.stack([x * depth, y * depth, depth], axis=-1) @ frame.pose[:3, :3].T + frame.pose[:3, 3]


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
