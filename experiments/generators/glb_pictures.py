"""Replace the pictures of a binary glTF file by smaller JPEG pictures. All other content stays bit by bit."""

import io
import json
import struct

from PIL import Image

GLTF = 0x46546C67, 2  # magic number and version of a .glb file
JSON_CHUNK, BINARY_CHUNK = 0x4E4F534A, 0x004E4942


def with_jpeg(glb: bytes, scale: float = 1.0, quality: int = 75) -> bytes:
    """Return the content of a .glb file whose pictures are JPEG of this quality, with `scale` times their width and height."""
    length = int.from_bytes(glb[12:16], "little")
    document, buffer = json.loads(glb[20 : 20 + length]), glb[28 + length :]
    pictures = {picture["bufferView"]: picture for picture in document["images"]}
    binary = b""
    for number, view in enumerate(document["bufferViews"]):
        content = buffer[view.get("byteOffset", 0) :][: view["byteLength"]]
        if number in pictures:
            picture, stream = Image.open(io.BytesIO(content)).convert("RGB"), io.BytesIO()
            size = (round(scale * picture.width), round(scale * picture.height))
            picture.resize(size, Image.Resampling.LANCZOS).save(stream, "JPEG", quality=quality)
            content = stream.getvalue()
            pictures[number]["mimeType"] = "image/jpeg"
        view |= {"byteOffset": len(binary), "byteLength": len(content)}
        binary += content + bytes(-len(content) % 4)
    document["buffers"] = [{"byteLength": len(binary)}]
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<2I", len(text), JSON_CHUNK) + text + struct.pack("<2I", len(binary), BINARY_CHUNK) + binary
    return struct.pack("<3I", *GLTF, 12 + len(chunks)) + chunks
