"""Simulate a phone scan of a procedural room, reconstruct it and store it. The radar simulation knows the room only from this scan.

The phone with LiDAR moves through the room (radartwin.testbed.scanner) with depth noise, dropouts and pose drift of published size, times
`strength`. The frames are fused and segmented like those of a user. The folder `rooms` beside this file ships the rooms of strength 1 and
seed 0, which the study reads instead of scanning again; `python -m experiments.generators.scanned_rooms` makes them.
"""

from __future__ import annotations

import hashlib
import tempfile
import zipfile
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
SHIPPED = Path(__file__).resolve().parent / "rooms"
SHIPPED_STRENGTH, SHIPPED_SEED = 1.0, 0


def fetch(config: Config, store: Store, room: str, strength: float, seed: int | None = None, anew: bool = False) -> Product:
    """Return the scanned and reconstructed room as a stored result, from the shipped rooms (scene only) if one has its strength and seed.
    With `anew`, a scan is simulated, and the result also holds its mesh and photographs. At strength 0 it is the true furnished room.
    """
    spec = specification(config, room, strength, seed, anew)

    def build(folder: Path) -> None:
        if strength == 0:
            rooms.room(room, detail="furnished").save(folder / FOLDER)
        elif "shipped" in spec:
            unpack(shipped_file(room), folder / FOLDER)
        else:
            scanned(folder / FOLDER, room, strength, spec["seed"])

    return store.fetch(KIND, spec, ROOTS, build)


def key(config: Config, store: Store, room: str, strength: float) -> str:
    """Return the store key of the result that `fetch` returns for the same arguments, whether the result is stored or not."""
    return store.key(KIND, specification(config, room, strength), ROOTS)


def specification(config: Config, room: str, strength: float, seed: int | None = None, anew: bool = False) -> dict[str, Any]:
    """Return all parameters that determine a scan; a shipped room has the SHA-256 of its file under the key "shipped"."""
    seed = config.seed if seed is None else seed
    spec = {"room": room, "strength": strength, "seed": seed}
    if anew or not ships(room, strength, seed):
        return spec
    return spec | {"shipped": hashlib.sha256(shipped_file(room).read_bytes()).hexdigest()}


def ships(room: str, strength: float, seed: int) -> bool:
    """Return whether the repository ships this room as scanned with this strength and seed."""
    return (strength, seed) == (SHIPPED_STRENGTH, SHIPPED_SEED) and shipped_file(room).is_file()


def shipped_file(room: str) -> Path:
    """Return the path of the file that ships the scanned room."""
    return SHIPPED / f"{room}.zip"


def unpack(file: Path, folder: Path) -> None:
    """Unpack the scene of a shipped room into a scene folder."""
    with zipfile.ZipFile(file) as packed:
        packed.extractall(folder)


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
