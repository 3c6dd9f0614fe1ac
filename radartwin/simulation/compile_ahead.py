"""Compile the functions of the simulator ahead of their first use, so that the first simulation does not wait for the compiler.

`python -m radartwin.simulation.compile_ahead` simulates small scenes that together call every compiled function. Numba keeps the machine
code in its cache (`radartwin.compiled`). Two processes simulate the scenes in opposite orders, so that they compile different functions at
the same time. The command takes a minute the first time and some seconds after that.
"""

import contextlib
from collections.abc import Callable, Iterator

import numpy as np

from radartwin.compiled import cores
from radartwin.io.process_pool import ProcessPool
from radartwin.radar.chirp import Radar
from radartwin.scene import objects, rooms
from radartwin.scene.scene import Scene, Surface
from radartwin.scene.trajectories import trajectory
from radartwin.simulation.backends.trace_settings import TraceSettings
from radartwin.simulation.backends.track_paths import Track
from radartwin.simulation.simulate import simulate


def compile_all(backwards: bool = False) -> None:
    """Simulate a furnished room with a can at rest, in motion and on a drive, and objects in free space; `backwards` reverses the order."""
    radar, room, bench = Radar.iwr1843(), rooms.room("lab", detail="furnished"), rooms.bench("lab")
    poses, place = trajectory.lateral_sweep(bench.sensor_pose)[:2], trajectory.pose(bench.target_position(1.0))
    can = Surface(objects.cylinder(0.033, 0.12), "metal", "can", roughness_m=1e-4, role="object")
    bodies = [Scene([Surface(mesh, "metal", "target")]) for mesh in (objects.trihedral(0.1), objects.sphere(0.05))]

    def drive() -> None:
        track = Track.of_drives([*room], radar, poses, TraceSettings(max_bounces=2))
        track.room(poses)
        track.over_room([can.moved(place)]).seen(poses, radar.frame_rate_hz)
        track.moving([can], poses, place[None])

    parts: list[Callable[[], object]] = [
        lambda: simulate(Scene([*room, can.moved(place)]), radar, poses, max_bounces=2, noise=True),
        lambda: simulate(Scene([*room, can]), radar, poses, motion={"can": np.stack([place] * 2)}, max_bounces=2),
        drive,
        lambda: [simulate(body, radar, trajectory.pose([-1.0, 0.0, 0.0])[None]) for body in bodies],
    ]
    for part in reversed(parts) if backwards else parts:
        part()


@contextlib.contextmanager
def compiling() -> Iterator[Callable[[], object]]:
    """Compile in two worker processes while the `with` block runs. The block gets a function that waits until both have ended."""
    pool = ProcessPool(min(2, cores()), import_main=False)
    started = [pool.submit(compile_all, backwards) for backwards in (False, True)]
    try:
        yield lambda: [future.result() for future in started]
    finally:
        pool.end()


if __name__ == "__main__":
    from radartwin.simulation import compile_ahead  # the workers cannot import the functions of __main__

    with compile_ahead.compiling() as finished:
        finished()
