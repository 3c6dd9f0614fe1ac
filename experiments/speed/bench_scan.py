"""Measure run time and memory of reconstructing a scan of half a million triangles, in a separate process.

    python experiments/speed/bench_scan.py [--faces 500000]

The scan consists of the true surfaces of a furnished room, cut into equal triangles, with colours and with the depth noise of a phone. The
parent process writes the scan, so that the memory of the child process is that of the command `radartwin reconstruct` only.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

FACES = 500_000
SEED = 0  # of the random colours and of the depth noise
NOISE_M = 0.005  # standard deviation of each vertex coordinate, as in the fused mesh of a phone LiDAR
CHILD = """
import json, sys, time
from experiments.speed.peak_memory import peak_gib
from radartwin.reconstruct.build import reconstruct
began = time.perf_counter()
scene = reconstruct(sys.argv[1], sys.argv[2])
print(json.dumps({"seconds": time.perf_counter() - began, "core_seconds": time.process_time(), "peak_gib": peak_gib(),
                  "surfaces": len(scene)}))
"""


def write_scan(path: Path, faces: int) -> int:
    """Write a furnished laboratory as a coloured mesh of about `faces` equal triangles, and return the actual number of triangles."""
    import trimesh

    from radartwin.scene import rooms

    pieces = [s.mesh for s in rooms.lab()]
    area = sum(float(m.area) for m in pieces)
    edge = 1.5 * float(np.sqrt(4 / np.sqrt(3) * area / faces))  # the split edges are between half the allowed length and that length
    rng = np.random.default_rng(SEED)
    fine, colours = [], []
    for k, piece in enumerate(pieces):
        bare = trimesh.Trimesh(piece.vertices, piece.faces, process=False)
        fine.append(bare.subdivide_to_size(edge, max_iter=20))
        colours.append(np.tile(np.random.default_rng([SEED, k]).integers(60, 220, 3), (len(fine[-1].vertices), 1)))
    whole: Any = trimesh.util.concatenate(fine)
    shade = np.clip(np.vstack(colours) + rng.normal(0, 5, (len(whole.vertices), 3)), 0, 255).astype(np.uint8)
    noisy = whole.vertices + NOISE_M * rng.standard_normal(whole.vertices.shape)
    mesh = trimesh.Trimesh(noisy, whole.faces, vertex_colors=shade, process=False)
    mesh.export(path)
    return len(mesh.faces)


def measure(faces: int = FACES) -> dict[str, float]:
    """Return faces, seconds, core_seconds and peak_gib of a reconstruction. The times include reading the scan file and writing the
    reconstructed scene.
    """
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "scan.ply"
        count = write_scan(path, faces)
        command = [sys.executable, "-c", CHILD, str(path), str(Path(folder) / "scene")]
        done = subprocess.run(command, check=True, capture_output=True, text=True)
    return {"faces": count, **json.loads(done.stdout.splitlines()[-1])}


def line(found: dict[str, float]) -> str:
    """Return one line of text with the values in the result of `measure`."""
    return (
        f"Reconstruction of a scan of {found['faces']:,.0f} faces: {found['seconds']:.0f} s ({found['core_seconds']:.0f} core-seconds), "
        f"peak {found['peak_gib']:.2f} GiB, {found['surfaces']:.0f} surfaces"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--faces", type=int, default=FACES)
    print(line(measure(parser.parse_args().faces)))


if __name__ == "__main__":
    main()
