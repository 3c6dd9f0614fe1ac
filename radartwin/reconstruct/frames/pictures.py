"""Pictures of frames from files: depth, colour, confidence; read by Pillow, checked, in our units."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from radartwin.errors import MissingError, ScanError
from radartwin.io.untrusted_pictures import open_picture

MEDIAN_DEPTH_M = (0.15, 8.0)  # what the middle of an indoor depth picture can be; phone LiDAR ends at 5 m, Kinects at 8 m
ENOUGH = 3  # depth pictures that tell the unit
UNITS_M = {0.001: "millimetres", 0.0002: "1/5000 m, as TUM RGB-D", 0.0001: "0.1 mm", 1.0: "metres", 0.01: "centimetres"}


def read_picture(path: Path) -> np.ndarray:
    """Any picture as Pillow gives it.

    Raises:
        MissingError: no such file.
        ScanError: not a picture, or one cut short.
    """
    try:
        with open_picture(path) as picture:
            return np.asarray(picture)
    except FileNotFoundError as error:
        raise MissingError(f"{path} is not there; export the frames again, or leave this frame out") from error
    except (OSError, ValueError, SyntaxError) as error:
        raise ScanError(f"{path}: damaged picture ({error}); copy or export it again") from error


def read_depth(path: Path, unit_m: float) -> np.ndarray:
    """Depth (h, w) float32 metres; 0 where there is none.

    Raises:
        ScanError: not one channel.
    """
    counts = read_picture(path)
    if counts.ndim != 2:
        raise ScanError(f"{path}: a depth picture has one channel, this one has shape {counts.shape}; is it a colour picture?")
    depth = counts.astype(np.float32) * np.float32(unit_m)
    return np.where(np.isfinite(depth) & (depth > 0), depth, np.float32(0))


def read_colour(path: Path) -> np.ndarray:
    """Colour (H, W, 3) uint8; grey pictures become grey colours.

    Raises:
        ScanError: neither grey nor colour of 8 bits.
    """
    pixels = read_picture(path)
    if pixels.dtype != np.uint8 or pixels.ndim not in (2, 3):
        raise ScanError(f"{path}: a colour picture has 8 bits a channel, this one is {pixels.dtype} of shape {pixels.shape}")
    return np.repeat(pixels[..., None], 3, axis=2) if pixels.ndim == 2 else np.ascontiguousarray(pixels[..., :3])


def picture_size(path: Path) -> tuple[int, int]:
    """(width, height) from the file's head."""
    try:
        with open_picture(path) as picture:
            return picture.size
    except FileNotFoundError as error:
        raise MissingError(f"{path} is not there; export the frames again, or leave this frame out") from error
    except (OSError, SyntaxError) as error:
        raise ScanError(f"{path}: damaged picture ({error}); copy or export it again") from error


def check_depth(paths: Sequence[Path], unit_m: float, source: str, remedy: str = "give --depth-unit") -> None:
    """Look at three depth pictures that show something, first, middle, last and then those between, before long work.

    Raises:
        ScanError: no depth in any of them all, or a median that no room has.
    """
    seen: list[np.ndarray] = []
    for path in (paths[i] for i in _spread(len(paths))):
        depth = read_depth(path, unit_m)
        seen += [depth[depth > 0]] if (depth > 0).any() else []
        if len(seen) == ENOUGH:
            break
    if not seen:
        raise ScanError(f"{source}: the depth pictures are empty ({paths[0].name} and all others); export the scan again")
    median = float(np.median(np.concatenate(seen)))
    if not plausible(median):
        fits = [f"{u:g} ({name}; {median / unit_m * u:.2g} m)" for u, name in UNITS_M.items() if plausible(median / unit_m * u)]
        raise ScanError(
            f"{source}: the median depth is {median:.3g} m with {unit_m:g} m per count, which no room has; "
            f"the unit is wrong, {remedy} {' or '.join(fits) or 'in metres per count'}"
        )


def plausible(median_m: float) -> bool:
    """Whether the middle of an indoor depth picture can be so far away."""
    return MEDIAN_DEPTH_M[0] <= median_m <= MEDIAN_DEPTH_M[1]


def _spread(count: int) -> list[int]:
    """0 to count - 1: the first, the middle, the last, then evenly between them, finer and finer."""
    order, parts = dict.fromkeys([0, count // 2, count - 1]), 4
    while len(order) < count:
        order |= dict.fromkeys(min(count * k // parts, count - 1) for k in range(parts))
        parts *= 2
    return list(order)
