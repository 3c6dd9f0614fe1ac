"""Write the scan of `radartwin demo`: `python -m experiments.generators.demo_scan ../shared/data/scans/cc0_furnished_room/room.glb`.

The script keeps the triangles of a .glb and reduces its pictures to SCALE of their width and height, so that the file is below 1 MB.
"""

from __future__ import annotations

import io
import json
import struct
import sys
from pathlib import Path
from typing import Any

from PIL import Image

from radartwin.commands.demo import SCAN
from radartwin.io.files import write_atomically

SCALE, QUALITY = 0.375, 60  # of the pictures


def reduced(content: bytes) -> bytes:
    """Return a binary glTF with smaller pictures."""
    length = struct.unpack("<I", content[12:16])[0]
    document: dict[str, Any] = json.loads(content[20 : 20 + length])
    binary, kept, pictures = content[28 + length :], b"", {image["bufferView"] for image in document["images"]}
    for number, view in enumerate(document["bufferViews"]):
        part = binary[view.get("byteOffset", 0) :][: view["byteLength"]]
        if number in pictures:
            picture, stream = Image.open(io.BytesIO(part)), io.BytesIO()
            size = (round(SCALE * picture.width), round(SCALE * picture.height))
            picture.resize(size, Image.Resampling.LANCZOS).save(stream, "JPEG", quality=QUALITY)
            part = stream.getvalue()
        view |= {"byteOffset": len(kept), "byteLength": len(part)}
        kept += part + bytes(-len(part) % 4)
    document["buffers"] = [{"byteLength": len(kept)}]
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    sizes = struct.pack("<3I", 2, 28 + len(text) + len(kept), len(text))
    return b"glTF" + sizes + b"JSON" + text + struct.pack("<I", len(kept)) + b"BIN\0" + kept


if __name__ == "__main__":
    print(write_atomically(SCAN, reduced(Path(sys.argv[1]).read_bytes())))
