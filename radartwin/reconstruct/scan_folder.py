"""Write a reconstructed scene to a folder: scene.glb, manifest.json, the coloured scan and photographs.

`scan.ply` is the scan as it was read or fused, in metres with z up. `scan_surfaces.npy` holds, for each face of the scan, the index of its
surface in the manifest, or -1. The old manifest is removed first and the new manifest is written last, so that readers reject a folder
whose writing was interrupted.
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
from radartwin.label.photos import save_photos
from radartwin.reconstruct.distance import farthest_points
from radartwin.reconstruct.frames.frames import Frames
from radartwin.scene.scene import Scene

MESH_FILE, FACE_SURFACES_FILE = "scan.ply", "scan_surfaces.npy"
PHOTOS = 40  # largest number of saved pictures
TURN_M = 1.5  # a shift of this length counts as much as a rotation by one radian


def save_reconstruction(
    scene: Scene, folder: Path, mesh: trimesh.Trimesh, surface_of_face: np.ndarray, frames: Frames | None, progress: Progress
) -> None:
    """Write the scene, the scan and the photographs. `surface_of_face` (F,) is the surface index of each face of the scan's mesh.

    Raises:
        OutputError: the folder cannot be written.
    """
    make_folder(folder)
    sweep(folder)
    scan = bytes(export_ply(mesh, encoding="binary", vertex_normal=False))
    faces = io.BytesIO()
    np.save(faces, surface_of_face.astype(np.int32))
    try:
        (folder / "manifest.json").unlink(missing_ok=True)
        (folder / "photos.json").unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(f"{folder}: cannot replace the scene in it ({error.strerror}); choose another folder") from error
    write_atomically(folder / MESH_FILE, scan)
    write_atomically(folder / FACE_SURFACES_FILE, faces.getvalue())
    if frames is not None:
        save_photos(folder, _photos(frames, progress))
    scene.save(folder)


def distinct_views(poses: np.ndarray, count: int) -> list[int]:
    """Return the ascending indices of at most `count` poses (N, 4, 4) that differ most in position and direction."""
    features = np.column_stack([poses[:, :3, 3], TURN_M * poses[:, :3, 2]])
    return sorted(set(farthest_points(features, count)))


def _photos(frames: Frames, progress: Progress):
    """Yield up to PHOTOS pictures as (colour, pose, intrinsics). Twice as many frames are read, because some may have no colour."""
    saved = 0
    for i in progress.over(distinct_views(frames.poses, 2 * PHOTOS), "photographs"):
        frame = frames[i]
        if frame.colour is not None and frame.colour_intrinsics is not None and saved < PHOTOS:
            saved += 1
            yield frame.colour, frame.pose, frame.colour_intrinsics
