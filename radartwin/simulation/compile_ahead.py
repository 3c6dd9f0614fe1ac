"""Compile the functions of the simulator ahead of their first use, so that the first simulation does not wait for the compiler.

`python -m radartwin.simulation.compile_ahead` simulates small scenes that together call every compiled function. Numba keeps the machine
code in its cache (`radartwin.compiled`). If neither the source code nor Numba has changed since the last time, the command does nothing.
"""

import contextlib
import hashlib
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numba
import numpy as np

from radartwin import source_files
from radartwin.io.process_pool import ProcessPool
from radartwin.radar.chirp import Radar
from radartwin.scene import objects, rooms
from radartwin.scene.scene import Scene, Surface
from radartwin.scene.trajectories import trajectory
from radartwin.simulation.backends.trace_settings import TraceSettings
from radartwin.simulation.backends.track_paths import Track
from radartwin.simulation.signal.gridding import spread
from radartwin.simulation.simulate import simulate


def compile_all() -> None:
    """Compile all functions, unless the cache already has them or cannot be written."""
    if not (folder := spread.stats.cache_path):
        return
    done, digest = Path(folder) / "compile_ahead.sha256", _digest()
    if not done.is_file() or done.read_text() != digest:
        _simulate_scenes()
        done.write_text(digest)


def _simulate_scenes() -> None:
    """Simulate a bare room with a can at rest, in motion and on a drive, and objects in free space."""
    radar, room, bench = Radar.iwr1843(), rooms.room("lab", detail="shell"), rooms.bench("lab")
    poses, place = trajectory.lateral_sweep(bench.sensor_pose)[:2], trajectory.pose(bench.target_position(1.0))
    can = Surface(objects.cylinder(0.033, 0.12), "metal", "can", roughness_m=1e-4, role="object")
    simulate(Scene([*room, can.moved(place)]), radar, poses, max_bounces=2, noise=True)
    simulate(Scene([*room, can]), radar, poses, motion={"can": np.stack([place] * 2)}, max_bounces=2)
    track = Track.of_drives([*room], radar, poses, TraceSettings(max_bounces=2))
    track.room(poses)
    track.over_room([can.moved(place)]).seen(poses, radar.frame_rate_hz)
    track.moving([can], poses, place[None])
    for mesh in (objects.trihedral(0.1), objects.sphere(0.05)):
        simulate(Scene([Surface(mesh, "metal", "target")]), radar, trajectory.pose([-1.0, 0.0, 0.0])[None])


def _digest() -> str:
    """Return the digest of the source code of the simulator, of the versions of Python and Numba, and of the processor."""
    parts = [sys.version, numba.__version__, str(spread.targetctx.codegen().magic_tuple())]
    parts += [f"{name}\n{source_files.text(name)}" for name in sorted(source_files.closure(("radartwin.simulation.compile_ahead",)))]
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()


@contextlib.contextmanager
def compiling() -> Iterator[Callable[[], object]]:
    """Compile in a worker process while the `with` block runs. The block gets a function that waits until the worker has ended."""
    pool = ProcessPool(1, import_main=False)
    started = pool.submit(compile_all)
    try:
        yield started.result
    finally:
        pool.end()


if __name__ == "__main__":
    compile_all()
