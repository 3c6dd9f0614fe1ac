"""Simulate a phone scan of a procedural room, reconstruct the scan and store it. The radar simulation knows the room only from this
simulated scan.

The simulated phone with LiDAR moves through the room (radartwin.testbed.scanner). The depth noise, dropouts and pose drift of the
simulated phone have the size that publications report, and `strength` scales all these errors. The depth frames are fused and segmented in
the same way as those of a user's own scan.
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
    """Return the scanned and reconstructed room as a stored result. A scan that is not in the store is computed; `seed=None` uses the
    configured seed.

    At strength 0 the stored result is the true furnished room itself, without the clutter that the phone scans at other strengths.
    """
    spec = specification(config, room, strength, seed)

    def build(folder: Path) -> None:
        if strength == 0:
            rooms.room(room, detail="furnished").save(folder / FOLDER)
        else:
            scanned(folder / FOLDER, room, strength, spec["seed"])

    return store.fetch(KIND, spec, ROOTS, build)


def key(config: Config, store: Store, room: str, strength: float) -> str:
    """Return the store key of the result that `fetch` returns for the same arguments, whether the result is stored or not."""
    return store.key(KIND, specification(config, room, strength), ROOTS)


def specification(config: Config, room: str, strength: float, seed: int | None = None) -> dict[str, Any]:
    """Return all parameters that determine a scan. These parameters are the specification from which the store key is computed."""
    return {"room": room, "strength": strength, "seed": config.seed if seed is None else seed}


def scanned(out: Path, room: str, strength: float, seed: int) -> Scene:
    """Simulate the scan of a room, reconstruct it into the folder `out`, and return the reconstructed scene."""
    from radartwin.reconstruct.build import reconstruct
    from radartwin.reconstruct.frames.folder import save_frames
    from radartwin.testbed.scanner import scan

    frames, _ = scan(rooms.room(room, detail="cluttered"), seed, strength)
    with tempfile.TemporaryDirectory() as folder:
        save_frames(frames, Path(folder) / room)
        return reconstruct(Path(folder) / room, out)


def scene_of(product: Product) -> Scene:
    """Load the reconstructed scene from a stored result."""
    return Scene.load(product.path / FOLDER)
