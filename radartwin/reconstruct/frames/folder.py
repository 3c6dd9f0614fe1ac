"""Read and write folders of colour-and-depth frames in RadarTwin's own file format.

    frames.json               {"format": "radartwin-frames", "version": 1, "up": "z", "camera": "x right, y down, z forward",
                               "depth_unit_m": 0.001, "scan_of": the scanned place or "",
                               "frames": [{"name", "pose" (4x4 rows, camera-to-world, metres),
                               "intrinsics" (3x3 rows), "colour_intrinsics" (3x3 rows or null), "depth", "colour", "confidence"
                               (file names relative to the folder, or null)}, ...]}
    depth/NAME.png            uint16, millimetres, 0 where there is no depth
    colour/NAME.jpg           8 bits, JPEG of quality 95
    confidence/NAME.png       uint8, 0 low, 1 medium, 2 high

frames.json is written last, so that an incomplete folder has no frames.json.
"""

from __future__ import annotations

import io
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from radartwin.errors import ScanError
from radartwin.io import untrusted_json
from radartwin.io.files import inside, make_folder, write_atomically
from radartwin.reconstruct.frames.frames import Frame, Frames, scan_digest
from radartwin.reconstruct.frames.pictures import Files, opened

FORMAT, VERSION = "radartwin-frames", 1
INDEX = "frames.json"
UNIT_M = 0.001
JPEG_QUALITY = 95


def save_frames(frames: Frames, folder: str | Path) -> Path:
    """Write frames in RadarTwin's own folder format. Depth is rounded to millimetres, and colour is stored as JPEG."""
    folder = Path(folder)
    make_folder(folder)
    (folder / INDEX).unlink(missing_ok=True)
    index = {
        "format": FORMAT, "version": VERSION, "up": "z", "camera": "x right, y down, z forward", "depth_unit_m": UNIT_M,
        "scan_of": frames.scan_of, "frames": [_save_frame(frame, folder) for frame in frames],
    }  # fmt: skip
    write_atomically(folder / INDEX, json.dumps(index, indent=1) + "\n")
    return folder


def _save_frame(frame: Frame, folder: Path) -> dict[str, Any]:
    if not re.fullmatch(r"[\w.-]+", frame.name):
        raise ScanError(f"frame '{frame.name}': use only letters, digits, - _ and . because the name becomes a file name")
    counts = np.minimum(np.rint(frame.depth_m / UNIT_M), 65535).astype(np.uint16)
    colour, lens, confidence = frame.colour, frame.colour_intrinsics, frame.confidence
    return {
        "name": frame.name,
        "pose": frame.pose.tolist(),
        "intrinsics": frame.intrinsics.tolist(),
        "colour_intrinsics": None if colour is None or lens is None else lens.tolist(),
        "depth": _write(counts, folder, f"depth/{frame.name}.png"),
        "colour": None if colour is None or lens is None else _write(colour, folder, f"colour/{frame.name}.jpg"),
        "confidence": None if confidence is None else _write(confidence, folder, f"confidence/{frame.name}.png"),
    }


def _write(pixels: np.ndarray, folder: Path, name: str) -> str:
    stream = io.BytesIO()
    if name.endswith(".jpg"):
        Image.fromarray(pixels).save(stream, "JPEG", quality=JPEG_QUALITY, subsampling=0)
    else:
        Image.fromarray(pixels).save(stream, "PNG", compress_level=1)
    write_atomically(folder / name, stream.getvalue())
    return name


def load_own(folder: Path, colour_only: bool) -> Frames:
    """Open a folder of frames that `save_frames` wrote."""
    try:
        index = untrusted_json.read(folder / INDEX)
        if (index["format"], index["version"]) != (FORMAT, VERSION):
            raise ScanError(f"{folder / INDEX}: format {index['format']} {index['version']}; this version reads {FORMAT} {VERSION}")
        unit, entries = float(index["depth_unit_m"]), list(index["frames"])
        scan_of = str(index.get("scan_of", "")) or scan_digest([folder / INDEX])
        names = [str(e["name"]) for e in entries]
        poses = np.array([e["pose"] for e in entries], dtype=np.float64).reshape(-1, 4, 4)
        lenses = {
            "depth": [np.array(e["intrinsics"], dtype=np.float64).reshape(3, 3) for e in entries],
            "colour": [np.array(e["colour_intrinsics"], dtype=np.float64).reshape(3, 3) if e["colour"] else np.eye(3) for e in entries],
        }
        kinds = ("depth", "colour", "confidence")
        files = [Files(*(inside(folder, str(e[kind])) if e[kind] or kind == "depth" else None for kind in kinds)) for e in entries]
    except ScanError:
        raise
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ScanError(f"{folder / INDEX}: damaged ({type(error).__name__}: {error}); save the frames again") from error
    remedy = f"correct depth_unit_m in {INDEX}:"
    return opened(folder, names, poses, files, lambda i, kind, _: lenses[kind][i], unit, colour_only, scan_of, remedy)
