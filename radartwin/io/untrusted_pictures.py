"""Open pictures from untrusted sources, of the formats that scanners write, and at most Pillow's limit of 179 million pixels.

Without a list of formats, Pillow would run other programs for some formats, such as Ghostscript for EPS.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from PIL.Image import Image

FORMATS = ("PNG", "JPEG", "PPM", "TIFF")  # PPM includes PGM


def open_picture(path: Path) -> Image:
    """Open a picture and read its header; the caller closes it. Raises OSError for another format or too many pixels."""
    from PIL import Image

    try:
        return Image.open(path, formats=FORMATS)
    except (Image.DecompressionBombError, Image.DecompressionBombWarning) as error:
        raise OSError(f"it has too many pixels: {str(error).partition(',')[0]}") from error
