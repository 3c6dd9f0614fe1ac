"""Pictures of strangers: the formats that scanners write, and no more pixels than Pillow takes for a picture (179 million).

Pillow knows fifty formats and asks other programs about some (Ghostscript for EPS), whatever a file's name ends in.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from PIL.Image import Image

FORMATS = ("PNG", "JPEG", "PPM", "TIFF")  # PPM is PGM too


def open_picture(path: Path) -> Image:
    """The picture, its head read and its pixels not yet; close it.

    Raises:
        FileNotFoundError; OSError: none of these formats, or too many pixels.
    """
    from PIL import Image

    try:
        return Image.open(path, formats=FORMATS)
    except (Image.DecompressionBombError, Image.DecompressionBombWarning) as error:
        raise OSError(f"it has too many pixels: {str(error).partition(',')[0]}") from error
