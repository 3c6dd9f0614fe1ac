"""Make the shipped scanned rooms again, which `experiments.scans.virtual_scan` reads.

    python -m experiments.generators.scanned_rooms [ROOM ...]      writes experiments/scans/rooms/ROOM.zip in 73 to 150 core-seconds

The geometry is that of the reconstruction, bit by bit. The pictures of the surfaces, which no simulation reads, become JPEG, so that the
files have 68 to 294 kB instead of 0.3 to 1.0 MB. JPEG has no transparency, so that a viewer does not hatch the unscanned parts.
"""

import argparse
import hashlib
import io
import json
import tempfile
import zipfile
from pathlib import Path

from experiments.generators.glb_pictures import with_jpeg
from experiments.scans import virtual_scan
from radartwin.io import files
from radartwin.scene.storage import GEOMETRY, MANIFEST

ROOMS = ("lab", "squash_court", "atrium")


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


def main() -> None:
    parser = argparse.ArgumentParser(description="Scan and reconstruct the rooms that ship with the study.")
    parser.add_argument("rooms", nargs="*", choices=[*ROOMS, []], help="rooms to make (default: all)")
    for room in parser.parse_args().rooms or ROOMS:
        content = packed(room)
        files.write_atomically(virtual_scan.shipped_file(room), content)
        print(f"{room}: {len(content):,} bytes", flush=True)


if __name__ == "__main__":
    main()
