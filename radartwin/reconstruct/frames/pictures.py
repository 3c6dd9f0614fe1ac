"""Read and check the depth, colour and confidence pictures of frames, and make frames from the files of a folder."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from radartwin.errors import MissingError, ScanError
from radartwin.io.untrusted_pictures import open_picture
from radartwin.reconstruct.frames.frames import Frame, Frames

MEDIAN_DEPTH_M = (0.15, 8.0)  # plausible median of an indoor depth picture; phone LiDAR reaches 5 m, Kinects reach 8 m
CHECKED = 3  # number of non-empty depth pictures that are checked
UNITS_M = {0.001: "millimetres", 0.0002: "1/5000 m, as TUM RGB-D", 0.0001: "0.1 mm", 1.0: "metres", 0.01: "centimetres"}


def read_picture(path: Path) -> np.ndarray:
    """Read the pixels of any picture that Pillow can read."""
    return _opened(path, np.asarray)


def picture_size(path: Path) -> tuple[int, int]:
    """Read (width, height) from the file header."""
    return _opened(path, lambda picture: picture.size)


def _opened(path: Path, read: Callable[[Any], Any]) -> Any:
    try:
        with open_picture(path) as picture:
            return read(picture)
    except FileNotFoundError as error:
        raise MissingError(f"{path} does not exist; export the frames again, or leave this frame out") from error
    except (OSError, ValueError, SyntaxError) as error:
        raise ScanError(f"{path}: damaged picture ({error}); copy or export it again") from error


def read_depth(path: Path, unit_m: float) -> np.ndarray:
    """Read a depth picture of one channel. Return the depth (h, w) as float32 in metres; 0 at pixels without depth."""
    counts = read_picture(path)
    if counts.ndim != 2:
        raise ScanError(f"{path}: a depth picture has one channel, this picture has shape {counts.shape}; give a depth picture")
    depth = counts.astype(np.float32) * np.float32(unit_m)
    return np.where(np.isfinite(depth) & (depth > 0), depth, np.float32(0))


def read_colour(path: Path) -> np.ndarray:
    """Read a colour or grey picture with 8 bits per channel as colour (H, W, 3) uint8."""
    pixels = read_picture(path)
    if pixels.dtype != np.uint8 or pixels.ndim not in (2, 3):
        raise ScanError(f"{path}: a colour picture needs 8 bits per channel, not {pixels.dtype} of shape {pixels.shape}; export it again")
    return np.repeat(pixels[..., None], 3, axis=2) if pixels.ndim == 2 else np.ascontiguousarray(pixels[..., :3])


def check_depth(paths: Sequence[Path], unit_m: float, source: str, remedy: str = "give --depth-unit") -> None:
    """Raise a ScanError if all depth pictures are empty, or if the median depth of three non-empty pictures is implausible for a room.

    The function reads the first, the middle and the last picture first, and then pictures between them until three are not empty.
    """
    seen: list[np.ndarray] = []
    for path in (paths[i] for i in _bisected(len(paths))):
        depth = read_depth(path, unit_m)
        seen += [depth[depth > 0]] if (depth > 0).any() else []
        if len(seen) == CHECKED:
            break
    if not seen:
        raise ScanError(f"{source}: the depth pictures are empty ({paths[0].name} and all others); export the scan again")
    median = float(np.median(np.concatenate(seen)))
    if not plausible(median):
        fits = [f"{u:g} ({name}; {median / unit_m * u:.2g} m)" for u, name in UNITS_M.items() if plausible(median / unit_m * u)]
        reason = f"the median depth is {median:.3g} m with {unit_m:g} m per count, which is implausible for a room"
        raise ScanError(f"{source}: {reason}; the unit is wrong, {remedy} {' or '.join(fits) or 'in metres per count'}")


def plausible(median_m: float) -> bool:
    """Return whether the depth picture of a room can have the median depth `median_m`, in metres."""
    return MEDIAN_DEPTH_M[0] <= median_m <= MEDIAN_DEPTH_M[1]


def _bisected(count: int) -> list[int]:
    """Return the numbers 0 to count - 1 in the order first, middle, last, followed by the numbers between them in ever finer steps."""
    order, parts = dict.fromkeys([0, count // 2, count - 1]), 4
    while len(order) < count:
        order |= dict.fromkeys(min(count * k // parts, count - 1) for k in range(parts))
        parts *= 2
    return list(order)


class Files(NamedTuple):
    """The picture files of a frame; None for a picture that does not exist."""

    depth: Path | None
    colour: Path | None = None
    confidence: Path | None = None


def opened(
    folder: Path,
    names: Sequence[str],
    poses: np.ndarray,
    files: Sequence[Files],
    lens: Callable[[int, str, tuple[int, int]], np.ndarray],
    unit_m: float,
    colour_only: bool,
    scan_of: str,
    remedy: str = "give --depth-unit",
) -> Frames:
    """Open the frames of a folder, after a check of some depth pictures. The pictures of a frame are read when the frame is accessed.

    Args:
        lens: function that returns the intrinsics (3, 3) of frame i for its "depth" or "colour" picture of a size (width, height).
        unit_m: metres per count of the depth pictures.
        colour_only: whether to read no depth of frames that have a colour picture.
        remedy: what to do about an implausible depth unit, for the error message.
    """
    if files and not colour_only:
        check_depth([file.depth for file in files if file.depth is not None], unit_m, str(folder), remedy)

    def read(i: int) -> Frame:
        depth_file, colour_file, confidence_file = files[i]
        colour = None if colour_file is None else read_colour(colour_file)
        colour_lens = None if colour is None else lens(i, "colour", colour.shape[1::-1])
        if colour_only and colour is not None and colour_lens is not None:
            return Frame(names[i], poses[i], colour_lens, np.zeros(colour.shape[:2], np.float32), colour, colour_lens)
        assert depth_file is not None  # only frames with a colour picture lack depth
        depth = read_depth(depth_file, unit_m)
        confidence = None if confidence_file is None else read_picture(confidence_file)
        if confidence is not None and confidence.shape != depth.shape:
            raise ScanError(f"{confidence_file} has {confidence.shape} pixels but the depth {depth.shape}; export the frame again")
        return Frame(names[i], poses[i], lens(i, "depth", depth.shape[::-1]), depth, colour, colour_lens, confidence)

    return Frames(names, poses, read, str(folder), scan_of)
