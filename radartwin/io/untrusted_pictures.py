"""Open pictures from untrusted sources: only the formats that scanners write, and at most Pillow's limit of 179 million pixels.

Pillow detects fifty formats by content and runs other programs for some, such as Ghostscript for EPS.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from PIL.Image import Image

FORMATS = ("PNG", "JPEG", "PPM", "TIFF")  # PPM includes PGM


def open_picture(path: Path) -> Image:
    """Open a picture and read its header; the pixels are read on first use. The caller closes the picture.

    Raises:
        FileNotFoundError: the file does not exist.
        OSError: the file has another format or too many pixels.
    """
    from PIL import Image

    try:
        return Image.open(path, formats=FORMATS)
    except (Image.DecompressionBombError, Image.DecompressionBombWarning) as error:
        raise OSError(f"it has too many pixels: {str(error).partition(',')[0]}") from error
