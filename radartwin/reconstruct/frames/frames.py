"""Colour-and-depth frames with poses: what a scan is before it is a mesh.

World: z up, metres. Camera poses are 4x4 camera-to-world with the camera's x right, y down, z forward (the OpenCV axes). A pixel's
centre has whole-numbered coordinates, so that the top left corner of the picture lies at (-0.5, -0.5). Depth is along the
camera's z, not along the ray. Which folder layouts are read is in `radartwin.reconstruct.frames.layouts`.
"""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import overload

import numpy as np

from radartwin.errors import MissingError, PoseError, ScanError

RIGID_TOLERANCE = 1e-3  # of the rotation's products; ARKit and text files with six digits stay below 1e-5


@dataclasses.dataclass(frozen=True, eq=False)
class Frame:
    """One view: where the camera was, what it saw.

    Attributes:
        name: unique within its frames.
        pose: (4, 4) camera-to-world, OpenCV axes, metres.
        intrinsics: (3, 3) pinhole matrix for `depth_m`, pixels.
        depth_m: (h, w) float32 along the camera's z; 0 where there is none.
        colour: (H, W, 3) uint8 sRGB, or None; same view as the depth, usually finer.
        colour_intrinsics: (3, 3) for `colour`, or None without colour.
        confidence: (h, w) uint8, 0 low, 1 medium, 2 high (as ARKit's ARConfidenceLevel), or None.
    """

    name: str
    pose: np.ndarray
    intrinsics: np.ndarray
    depth_m: np.ndarray
    colour: np.ndarray | None = None
    colour_intrinsics: np.ndarray | None = None
    confidence: np.ndarray | None = None


class Frames(Sequence[Frame]):
    """Frames in the order they were taken, each read from the disk when it is asked for, and not kept.

    Args:
        names: one per frame, all different.
        poses: (N, 4, 4) camera-to-world.
        read: gives frame i.
        source: what messages call it.
        scan_of: what was scanned: a procedural room, or the digest of a real scan's files; empty where nobody knows.
    Raises:
        ScanError: no frames, a name twice, or another number of poses than of names.
        PoseError: a pose that is not finite, mirrored or not rigid.
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
            raise ScanError(f"{source}: two frames have one name; give each its own")
        if len(poses) != len(self.names):
            raise ScanError(f"{source}: {len(self.names)} frames and {len(poses)} poses; give one pose per frame, in the same order")
        self.poses = check_poses(np.asarray(poses, dtype=np.float64), source, self.names)

    @classmethod
    def of(cls, frames: Iterable[Frame], source: str = "frames", scan_of: str = "") -> Frames:
        """Frames that are already in memory."""
        kept = list(frames)
        poses = np.array([f.pose for f in kept]).reshape(-1, 4, 4)
        return cls((f.name for f in kept), poses, kept.__getitem__, source, scan_of)

    @classmethod
    def load(
        cls,
        folder: str | Path,
        intrinsics: Sequence[float] | None = None,
        depth_unit_m: float | None = None,
        up: str | None = None,
        colour_only: bool = False,
        poses: str | None = None,
    ) -> Frames:
        """Open a folder of frames; which of the known layouts it has is told from its files.

        Known: the export of 3d Scanner App (ARKit), TUM RGB-D, the pose.txt layout (color/, depth/, pose.txt), and our own
        (`save`). Poses, counts and some depth pictures are checked here; each frame's pictures when it is read.

        Args:
            intrinsics: (fx, fy, cx, cy) in pixels of the depth picture, for layouts that do not say (pose.txt, TUM); without it
                the folder's intrinsics.json is read: {"fx": , "fy": , "cx": , "cy": }.
            depth_unit_m: metres per count of the depth pictures, where the layout's own (1 mm; TUM 1/5000 m) is not true.
            up: the world axis of the poses that points up (x, y, z, -x, -y, -z). Known for ARKit and our own; for the others
                the axis nearest to the cameras' mean upward direction.
            poses: what the poses are where the layout does not say (pose.txt, TUM): one of `radartwin.reconstruct.axes.READINGS`,
                "opencv" unless given.
            colour_only: ignore depth (none need be there): for `radartwin.reconstruct.fusion.monocular`.
        Raises:
            MissingError: no such folder, or a picture of it is gone.
            ScanError: unknown layout, no poses, counts that differ, no intrinsics, damaged pictures, empty depth, implausible unit,
                an option that the layout does not read.
            PoseError: poses that are mirrored or not rigid.
        """
        from radartwin.reconstruct.frames.layouts import load_frames

        return load_frames(Path(folder), intrinsics, depth_unit_m, up, colour_only, poses)

    def save(self, folder: str | Path) -> Path:
        """Write our own layout, see `radartwin.reconstruct.frames.folder`; depth is rounded to millimetres, colour is JPEG.

        Raises:
            OutputError: the folder cannot be written; without its frames.json, written last, a folder is not complete.
        """
        from radartwin.reconstruct.frames.folder import save_frames

        return save_frames(self, Path(folder))

    def __len__(self) -> int:
        return len(self.names)

    @overload
    def __getitem__(self, index: int) -> Frame: ...
    @overload
    def __getitem__(self, index: slice) -> Frames: ...
    def __getitem__(self, index: int | slice) -> Frame | Frames:
        chosen = range(len(self.names))[index]
        if isinstance(chosen, int):
            return dataclasses.replace(self._read(chosen), pose=self.poses[chosen])
        picked = list(chosen)
        return Frames([self.names[i] for i in picked], self.poses[picked], lambda i: self._read(picked[i]), self.source, self.scan_of)

    def __iter__(self) -> Iterator[Frame]:
        return (self[i] for i in range(len(self)))

    def with_poses(self, poses: np.ndarray) -> Frames:
        """The same pictures at other poses (N, 4, 4)."""
        return Frames(self.names, poses, self._read, self.source, self.scan_of)


def scan_digest(files: Iterable[Path]) -> str:
    """A name for a real scan, whatever its folder is called: of the bytes of a mesh, or of the files that hold the poses.

    Raises:
        MissingError: one of them is gone.
    """
    total = hashlib.sha256()
    for file in files:
        try:
            total.update(file.read_bytes())
        except FileNotFoundError as error:
            raise MissingError(f"{file} is not there; check the path, or export the scan again") from error
    return f"sha256:{total.hexdigest()[:16]}"


def check_poses(poses: np.ndarray, source: str, names: Sequence[str]) -> np.ndarray:
    """The poses (N, 4, 4), rotations made exactly orthonormal (the nearest by singular values).

    Raises:
        PoseError: wrong shape, not finite, mirrored (determinant -1), or not rigid.
    """
    if poses.ndim != 3 or poses.shape[1:] != (4, 4):
        raise PoseError(f"{source}: poses have shape {poses.shape}; give (N, 4, 4) camera-to-world matrices")
    for name, pose in zip(names, poses, strict=True):
        rotation = pose[:3, :3]
        if not np.isfinite(pose).all():
            raise PoseError(f"{source}: the pose of frame {name} is not finite; leave the frame out or export again")
        if np.abs(rotation.T @ rotation - np.eye(3)).max() > RIGID_TOLERANCE or np.abs(pose[3] - [0, 0, 0, 1]).max() > RIGID_TOLERANCE:
            raise PoseError(f"{source}: the pose of frame {name} is not a rotation and a shift; give rigid camera-to-world matrices")
        if np.linalg.det(rotation) < 0:
            raise PoseError(f"{source}: the pose of frame {name} mirrors (determinant -1); one axis is flipped, export right-handed poses")
    left, _, right = np.linalg.svd(poses[:, :3, :3])
    clean = poses.copy()
    clean[:, :3, :3], clean[:, 3] = left @ right, [0, 0, 0, 1]
    return clean


def rescaled(intrinsics: np.ndarray, size: tuple[int, int], to: tuple[int, int]) -> np.ndarray:
    """Intrinsics (3, 3) of a picture of `size` (width, height) for the same view at the size `to`."""
    scale = np.divide(to, size)
    moved = np.array(intrinsics, dtype=np.float64)
    moved[:2, :2] *= scale[:, None]
    moved[:2, 2] = (moved[:2, 2] + 0.5) * scale - 0.5
    return moved


def points(frame: Frame) -> np.ndarray:
    """The depth picture's pixels in the world, (h, w, 3) metres; NaN where there is no depth."""
    v, u = np.indices(frame.depth_m.shape)
    k = frame.intrinsics
    depth = np.where(frame.depth_m > 0, frame.depth_m, np.nan).astype(np.float64)
    y = (v - k[1, 2]) / k[1, 1]
    x = (u - k[0, 2] - k[0, 1] * y) / k[0, 0]
    return np.stack([x * depth, y * depth, depth], axis=-1) @ frame.pose[:3, :3].T + frame.pose[:3, 3]
