"""A reconstructed scene on the disk: beside scene.glb and manifest.json the coloured scan it came from, and photographs.

`scan.ply` is the scan as read or fused, metres, z up; `scan_surfaces.npy` says for each of its faces which surface of the manifest
it became, -1 for none. The manifest is removed first and written last, so an interrupted folder is refused and never half true.
"""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import trimesh
from trimesh.exchange.ply import export_ply

from radartwin.errors import OutputError
from radartwin.io.files import make_folder, sweep, write_atomically
from radartwin.io.progress import Progress
from radartwin.reconstruct.frames.frames import Frames
from radartwin.scene.scene import Scene

MESH_FILE, OWNER_FILE = "scan.ply", "scan_surfaces.npy"
PHOTOS = 40  # kept of the frames' pictures
TURN_M = 1.5  # turning by one radian is as far as moving by this


def save_reconstruction(
    scene: Scene, folder: Path, mesh: trimesh.Trimesh, owner: np.ndarray, frames: Frames | None, progress: Progress
) -> None:
    """Write everything; `owner` (F,) is the surface of each face of the scan's mesh.

    Raises:
        OutputError: the folder cannot be written.
    """
    make_folder(folder)
    sweep(folder)
    scan = bytes(export_ply(mesh, encoding="binary", vertex_normal=False))
    faces = io.BytesIO()
    np.save(faces, owner.astype(np.int32))
    try:
        (folder / "manifest.json").unlink(missing_ok=True)
        (folder / "photos.json").unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(f"{folder}: cannot replace the scene in it ({error.strerror}); choose another folder") from error
    write_atomically(folder / MESH_FILE, scan)
    write_atomically(folder / OWNER_FILE, faces.getvalue())
    if frames is not None:
        _save_photos(frames, folder, progress)
    scene.save(folder)


def spread_out(poses: np.ndarray, count: int) -> list[int]:
    """Indices of at most `count` poses (N, 4, 4) that differ most in place and direction, in order."""
    features = np.column_stack([poses[:, :3, 3], TURN_M * poses[:, :3, 2]])
    chosen = [0]
    nearest = np.linalg.norm(features - features[0], axis=1)
    while len(chosen) < min(count, len(poses)):
        chosen.append(int(nearest.argmax()))
        nearest = np.minimum(nearest, np.linalg.norm(features - features[chosen[-1]], axis=1))
    return sorted(set(chosen))


def _save_photos(frames: Frames, folder: Path, progress: Progress) -> None:
    from radartwin.label.photos import save_photos

    def pictures():
        # Only some frames may have colour: twice as many are looked at as are kept.
        kept = 0
        for i in progress.over(spread_out(frames.poses, 2 * PHOTOS), "photographs"):
            frame = frames[i]
            if frame.colour is not None and frame.colour_intrinsics is not None and kept < PHOTOS:
                kept += 1
                yield frame.colour, frame.pose, frame.colour_intrinsics

    save_photos(folder, pictures())
