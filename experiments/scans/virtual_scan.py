"""Scan a procedural room with a virtual phone, reconstruct the scan and store it. The twin knows the room only from this scan.

The phone with LiDAR moves through the room (radartwin.testbed.scanner). Its noise, dropouts and drift follow published evaluations, and
`strength` scales all of them. Its frames are fused, segmented and outlined like those of a user.
"""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

from radartwin.scene import rooms
from radartwin.scene.scene import Scene
from radartwin.store.products import Product, Store

if TYPE_CHECKING:
    from radartwin.config.config import Config

ROOTS = ["experiments.scans.virtual_scan"]
KIND = "scan"
FOLDER = "scene"


def fetch(config: Config, store: Store, room: str, strength: float, seed: int | None = None) -> Product:
    """Return a scanned and reconstructed room, from the store or computed now. `seed` defaults to the configuration's seed.

    At strength 0 the product is the true furnished room itself, without the clutter of the scanned room.
    """
    spec = specification(config, room, strength, seed)

    def build(folder: Path) -> None:
        if strength == 0:
            rooms.room(room, detail="furnished").save(folder / FOLDER)
        else:
            scanned(folder / FOLDER, room, strength, spec["seed"])

    return store.fetch(KIND, spec, ROOTS, build)


def key(config: Config, store: Store, room: str, strength: float) -> str:
    """Return the store key of the product of `fetch`, whether the product exists or not."""
    return store.key(KIND, specification(config, room, strength), ROOTS)


def specification(config: Config, room: str, strength: float, seed: int | None = None) -> dict[str, Any]:
    """Return all parameters that determine a scan, for its store key."""
    return {"room": room, "strength": strength, "seed": config.seed if seed is None else seed}


def scanned(out: Path, room: str, strength: float, seed: int) -> Scene:
    """Scan a room, reconstruct it into the folder `out`, and return the scene."""
    from radartwin.reconstruct.build import reconstruct
    from radartwin.reconstruct.frames.folder import save_frames
    from radartwin.testbed.scanner import scan

    frames, _ = scan(rooms.room(room, detail="cluttered"), seed, strength)
    with tempfile.TemporaryDirectory() as folder:
        save_frames(frames, Path(folder) / room)
        return reconstruct(Path(folder) / room, out)


def scene_of(product: Product) -> Scene:
    """Load the reconstructed scene of a product."""
    return Scene.load(product.path / FOLDER)
