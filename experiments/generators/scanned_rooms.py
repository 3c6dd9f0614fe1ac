"""Make the shipped scanned rooms again, which `experiments.scans.virtual_scan` reads.

    python -m experiments.generators.scanned_rooms [ROOM ...]      writes experiments/scans/rooms/ROOM.zip in 73 to 150 core-seconds

The geometry is that of the reconstruction, bit by bit. The pictures of the surfaces, which no simulation reads, become JPEG, so that the
files have 68 to 294 kB instead of 0.3 to 1.0 MB. JPEG has no transparency, so that a viewer does not hatch the unscanned parts.
"""

from __future__ import annotations

import argparse
import hashlib
import io
import json
import struct
import tempfile
import zipfile
from pathlib import Path

from PIL import Image

from experiments.scans import virtual_scan
from radartwin.io import files
from radartwin.scene.storage import GEOMETRY, MANIFEST

ROOMS = ("lab", "squash_court", "atrium")
GLTF = 0x46546C67, 2  # magic number and version of a .glb file
JSON_CHUNK, BINARY_CHUNK = 0x4E4F534A, 0x004E4942


def packed(room: str) -> bytes:
    """Scan a room as the study does, and return the content of its shipped file."""
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        virtual_scan.scanned(folder, room, virtual_scan.SHIPPED_STRENGTH, virtual_scan.SHIPPED_SEED)
        return pack((folder / GEOMETRY).read_bytes(), json.loads((folder / MANIFEST).read_text()))


def pack(glb: bytes, manifest: dict) -> bytes:
    """Return the content of the shipped file of a scene folder. The same scene gives the same bytes."""
    glb = with_jpeg(glb)
    manifest["sha256"] = hashlib.sha256(glb).hexdigest()
    manifest["provenance"]["scan"]["source"] = manifest["provenance"]["source"]  # without the temporary folder of the frames
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as archive:
        for name, content in ((GEOMETRY, glb), (MANIFEST, json.dumps(manifest, indent=1) + "\n")):
            archive.writestr(zipfile.ZipInfo(name), content, zipfile.ZIP_LZMA)
    return stream.getvalue()


def with_jpeg(glb: bytes) -> bytes:
    """Return a .glb file with its pictures as JPEG, and with all other content unchanged."""
    length = int.from_bytes(glb[12:16], "little")
    document, buffer = json.loads(glb[20 : 20 + length]), glb[28 + length :]
    pictures = {picture["bufferView"]: picture for picture in document["images"]}
    binary = b""
    for number, view in enumerate(document["bufferViews"]):
        content = buffer[view["byteOffset"] :][: view["byteLength"]]
        if number in pictures:
            stream = io.BytesIO()
            Image.open(io.BytesIO(content)).convert("RGB").save(stream, "JPEG")
            content = stream.getvalue()
            pictures[number]["mimeType"] = "image/jpeg"
        view |= {"byteOffset": len(binary), "byteLength": len(content)}
        binary += content + bytes(-len(content) % 4)
    document["buffers"] = [{"byteLength": len(binary)}]
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<2I", len(text), JSON_CHUNK) + text + struct.pack("<2I", len(binary), BINARY_CHUNK) + binary
    return struct.pack("<3I", *GLTF, 12 + len(chunks)) + chunks


def main() -> None:
    parser = argparse.ArgumentParser(description="Scan and reconstruct the rooms that ship with the study.")
    parser.add_argument("rooms", nargs="*", choices=[*ROOMS, []], help="rooms to make (default: all)")
    for room in parser.parse_args().rooms or ROOMS:
        content = packed(room)
        files.write_atomically(virtual_scan.shipped_file(room), content)
        print(f"{room}: {len(content):,} bytes", flush=True)


if __name__ == "__main__":
    main()
