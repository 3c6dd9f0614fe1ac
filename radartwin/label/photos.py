"""Read and write photographs of a scene with their camera poses: `photos/*.jpg` and `photos.json` in the scene folder. Read the scanned
mesh with its pictures, which replaces photographs if the scan is a mesh file.

The cameras follow the OpenCV convention: the pose is a 4x4 camera-to-world matrix with x right, y down, z forward. The camera intrinsics
are a 3x3 matrix in pixels of the stored picture, with the centre of the first pixel at (0, 0). Stored photographs have no lens distortion.
"""

from __future__ import annotations

import io
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from radartwin.errors import InputError, MissingError, PoseError
from radartwin.io import untrusted_json
from radartwin.io.files import inside, write_atomically
from radartwin.io.untrusted_pictures import open_picture
from radartwin.scene.scene import Scene

FORMAT, VERSION = "radartwin-photos", 1
INDEX, FOLDER = "photos.json", "photos"
TEXTURED = "scan_textured.glb"  # the scanned mesh with its pictures, in the coordinates of the scene
QUALITY = 92


@dataclass(frozen=True, eq=False)
class Photo:
    """One photograph: its JPEG file, its camera-to-world pose (4, 4), and its camera intrinsics (3, 3) in pixels."""

    path: Path
    pose: np.ndarray
    intrinsics: np.ndarray

    def pixels(self) -> np.ndarray:
        """Read the photograph's pixels, (H, W, 3) uint8."""
        try:
            with open_picture(self.path) as picture:
                return np.asarray(picture.convert("RGB"))
        except FileNotFoundError as error:
            raise MissingError(f"photograph {self.path} is missing, though {INDEX} names it; restore it") from error
        except (OSError, ValueError, SyntaxError) as error:
            raise InputError(f"photograph {self.path} cannot be read; restore it or remove it from {INDEX}") from error


def save_photos(folder: Path, pictures: Iterable[tuple[np.ndarray, np.ndarray, np.ndarray]]) -> None:
    """Write photographs to a scene folder: `pictures` yields triples of pixels (H, W, 3) uint8, pose (4, 4) and intrinsics (3, 3).

    The index file photos.json is written last, so that an interrupted write leaves no index of missing photographs.
    """
    entries = []
    for number, (pixels, pose, intrinsics) in enumerate(pictures):
        name = f"{FOLDER}/{number:05d}.jpg"
        write_atomically(folder / name, jpeg(np.ascontiguousarray(pixels), QUALITY))
        entries.append({"file": name, "pose": pose.tolist(), "intrinsics": intrinsics.tolist()})
    index = {"format": FORMAT, "version": VERSION, "photos": entries}
    write_atomically(folder / INDEX, json.dumps(index, indent=1) + "\n")


def jpeg(pixels: np.ndarray, quality: int) -> bytes:
    """Encode a picture (H, W, 3) uint8 as JPEG, without reducing the resolution of the colours."""
    from PIL import Image

    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, "JPEG", quality=quality, subsampling=0)
    return stream.getvalue()


def load_photos(folder: Path) -> Sequence[Photo]:
    """Load the photographs of a scene folder. If the folder has no photos.json, the result is empty."""
    path = folder / INDEX
    if not path.is_file():
        return []
    try:
        index = untrusted_json.read(path)
        if index["format"] != FORMAT or index["version"] != VERSION:
            raise KeyError("format")
        photos = [
            Photo(inside(folder, str(entry["file"])), np.array(entry["pose"], float), np.array(entry["intrinsics"], float))
            for entry in index["photos"]
        ]
    except InputError:
        raise
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path} is not a {FORMAT} version {VERSION} index; write it again with radartwin reconstruct") from error
    return [_checked(photo) for photo in photos]


def load_textured(folder: Path) -> Scene | None:
    """Load the scanned mesh with its pictures from a scene folder; None if the scan had no pictures."""
    path = folder / TEXTURED
    return Scene.load(path, material="plasterboard") if path.is_file() else None


def _checked(photo: Photo) -> Photo:
    pose, intrinsics = photo.pose, photo.intrinsics
    rigid = pose.shape == (4, 4) and np.isfinite(pose).all() and np.allclose(pose[:3, :3] @ pose[:3, :3].T, np.eye(3), atol=1e-3)
    if not rigid or np.linalg.det(pose[:3, :3]) < 0 or not np.allclose(pose[3], [0, 0, 0, 1]):
        raise PoseError(f"photograph {photo.path.name}: its pose is not a rigid 4x4 camera-to-world matrix; correct it in {INDEX}")
    if intrinsics.shape != (3, 3) or not np.isfinite(intrinsics).all() or intrinsics[0, 0] <= 0 or intrinsics[1, 1] <= 0:
        raise PoseError(
            f"photograph {photo.path.name}: its intrinsics are not a 3x3 matrix with positive focal lengths; correct them in {INDEX}"
        )
    return photo
