"""Compile the functions of the simulator ahead of their first use, so that the first simulation does not wait for the compiler.

`python -m radartwin.simulation.compile_ahead` simulates small scenes that together call every compiled function. Numba keeps the machine
code in its cache (`radartwin.compiled`). The command takes one to two minutes the first time and some seconds after that.
"""

import numpy as np

from radartwin.radar.chirp import Radar
from radartwin.scene import objects, rooms
from radartwin.scene.scene import Scene, Surface
from radartwin.scene.trajectories import trajectory
from radartwin.simulation.backends.trace_settings import TraceSettings
from radartwin.simulation.drives import Drives
from radartwin.simulation.simulate import simulate


def compile_all() -> None:
    """Simulate a furnished room with a can at rest, in motion and on a drive, and objects in free space."""
    radar, bench = Radar.iwr1843(), rooms.bench("lab")
    room, at = rooms.room("lab", detail="furnished"), trajectory.pose(bench.target_position(1.0))
    poses = trajectory.lateral_sweep(bench.sensor_pose)[:2]
    can = Surface(objects.cylinder(0.033, 0.12), "metal", "can", roughness_m=1e-4, role="object")
    simulate(Scene([*room, can.moved(at)]), radar, poses, max_bounces=2, noise=True)
    simulate(Scene([*room, can]), radar, poses, motion={"can": np.stack([at, at])}, max_bounces=2)
    drives = Drives([*room], radar, poses, TraceSettings(max_bounces=2))
    drives.room(poses)
    drives.over_room([can.moved(at)]).seen(poses, radar.frame_rate_hz)
    drives.moving([can], poses, at[None])
    for mesh in (objects.trihedral(0.1), objects.sphere(0.05)):
        simulate(Scene([Surface(mesh, "metal", "target")]), radar, trajectory.pose([-1.0, 0.0, 0.0])[None])


if __name__ == "__main__":
    compile_all()
