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
from radartwin.simulation.backends.track import Track
from radartwin.simulation.simulate import simulate

RADAR = Radar.iwr1843()


def compile_all(backwards: bool = False) -> None:
    """Simulate a furnished room with a can at rest, in motion and on a drive, and objects in free space; `backwards` reverses the order."""
    parts = (_room_at_rest, _can_in_motion, _drive, _free_space)
    for simulated in reversed(parts) if backwards else parts:
        simulated()


def _room_at_rest() -> None:
    simulate(Scene([*_room(), _can().moved(_can_pose())]), RADAR, _poses(), max_bounces=2, noise=True)


def _can_in_motion() -> None:
    simulate(Scene([*_room(), _can()]), RADAR, _poses(), motion={"can": np.stack([_can_pose()] * 2)}, max_bounces=2)


def _drive() -> None:
    drives = Track.of_drives([*_room()], RADAR, _poses(), TraceSettings(max_bounces=2))
    drives.room(_poses())
    drives.over_room([_can().moved(_can_pose())]).seen(_poses(), RADAR.frame_rate_hz)
    drives.moving([_can()], _poses(), _can_pose()[None])


def _free_space() -> None:
    for mesh in (objects.trihedral(0.1), objects.sphere(0.05)):
        simulate(Scene([Surface(mesh, "metal", "target")]), RADAR, trajectory.pose([-1.0, 0.0, 0.0])[None])


def _room() -> Scene:
    return rooms.room("lab", detail="furnished")


def _can() -> Surface:
    return Surface(objects.cylinder(0.033, 0.12), "metal", "can", roughness_m=1e-4, role="object")


def _can_pose() -> np.ndarray:
    return trajectory.pose(rooms.bench("lab").target_position(1.0))


def _poses() -> np.ndarray:
    return trajectory.lateral_sweep(rooms.bench("lab").sensor_pose)[:2]


@contextlib.contextmanager
def compiling() -> Iterator[Callable[[], None]]:
    """Compile in two worker processes while the `with` block runs. The block gets a function that waits until both have ended."""
    pool = ProcessPool(min(2, cores()), import_main=False)
    started = [pool.submit(compile_all, backwards) for backwards in (False, True)]

    def wait() -> None:
        for one in started:
            one.result()

    try:
        yield wait
    finally:
        pool.end()


if __name__ == "__main__":
    from radartwin.simulation import compile_ahead  # the workers cannot import the functions of __main__

    with compile_ahead.compiling() as finished:
        finished()
