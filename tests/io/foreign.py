"""Make the files that an attacker could write: a mesh with texture pictures, and an index of photographs."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
from made_files import glb

THREE = {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}


def textured(images: list[dict[str, Any]], picture: bytes) -> bytes:
    """Return a .glb file of triangles, each with one of these texture images; the bytes of `picture` follow the geometry."""
    count, places = len(images), np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4").tobytes()
    return glb(
        {
            "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": list(range(count))}],
            "nodes": [{"mesh": i} for i in range(count)],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "material": i}]} for i in range(count)],
            "materials": [{"pbrMetallicRoughness": {"baseColorTexture": {"index": i}}} for i in range(count)],
            "textures": [{"source": i} for i in range(count)], "images": images,
            "accessors": [THREE, {"bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC2"}],
            "bufferViews": [
                {"buffer": 0, "byteLength": 36}, {"buffer": 0, "byteOffset": 36, "byteLength": 24},
                {"buffer": 0, "byteOffset": 60, "byteLength": len(picture)},
            ],
            "buffers": [{"byteLength": 60 + len(picture)}],
        },
        places + bytes(24) + picture + bytes(-len(picture) % 4),
    )  # fmt: skip


def photo_index(file: str) -> str:
    entry = {"file": file, "pose": np.eye(4).tolist(), "intrinsics": np.eye(3).tolist()}
    return json.dumps({"format": "radartwin-photos", "version": 1, "photos": [entry]})
