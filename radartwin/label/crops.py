"""A picture cut out around a surface, with the surface outlined."""

from __future__ import annotations

import hashlib
import io
from dataclasses import dataclass

import numpy as np

from radartwin.label.raster import Camera

SIZE = 512  # pixels of a crop's longer side
QUALITY = 88
OUTLINE, HALO = (255, 0, 255), (0, 0, 0)


@dataclass(frozen=True, eq=False)
class Crop:
    """A picture of a surface: JPEG bytes, from a "photo" or the "mesh", and the share of its pixels that are the surface."""

    jpeg: bytes
    origin: str
    share: float

    @property
    def digest(self) -> str:
        return hashlib.sha256(self.jpeg).hexdigest()


def outlined(pixels: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """The picture (h, w, 3) with the edge of the mask (h, w) drawn over it; where the surface leaves the picture, along the border."""
    from scipy.ndimage import binary_dilation, binary_erosion, binary_opening

    cleaned = binary_opening(mask, iterations=1)
    if np.count_nonzero(cleaned) > 0.7 * np.count_nonzero(mask):
        mask = np.asarray(cleaned)  # without the specks of a ragged mesh, unless it is all specks
    edge = mask & np.logical_not(binary_erosion(mask, iterations=2))
    halo = np.logical_and(binary_dilation(edge, iterations=1), np.logical_not(edge))
    out = pixels.copy()
    out[halo] = HALO
    out[edge] = OUTLINE
    return out


def window(mask: np.ndarray, scout: Camera, camera: Camera, margin_of_size: float) -> tuple[float, float, float, float]:
    """Rectangle (left, top, right, bottom) of the camera's picture around the surface, in its pixels, never narrower than 1:2."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    per_pixel = camera.width / scout.width
    low = np.array([columns[0], rows[0]]) * per_pixel - 0.5
    high = (np.array([columns[-1], rows[-1]]) + 1) * per_pixel - 0.5
    size = high - low
    margin = np.maximum(margin_of_size * size, 0.12 * size.max() + 0.03 * camera.width)
    middle, half = (low + high) / 2, size / 2 + margin
    half = np.maximum(half, half.max() / 2)
    edge = np.array([camera.width - 0.5, camera.height - 0.5])
    low, high = np.maximum(middle - half, -0.5), np.minimum(middle + half, edge)
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def resized(pixels: np.ndarray, window: tuple[float, float, float, float], camera: Camera) -> np.ndarray:
    from PIL import Image

    left, top, right, bottom = (edge + 0.5 for edge in window)
    return np.asarray(
        Image.fromarray(pixels).resize((camera.width, camera.height), Image.Resampling.LANCZOS, box=(left, top, right, bottom))
    )


def jpeg(pixels: np.ndarray) -> bytes:
    from PIL import Image

    stream = io.BytesIO()
    Image.fromarray(pixels).save(stream, "JPEG", quality=QUALITY, subsampling=0)
    return stream.getvalue()
