"""Measure the run time of one call of `simulate` for objects in free space.

    python -m experiments.speed.one_call

Each object is measured in a process of its own. The script gives the CPU time of the first call and, for each other kind of call, the
smallest CPU time of REPEATS calls. Other programs on the computer hardly change these times.
"""

import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
import pandas as pd

import radartwin as rt
from radartwin.scene import objects
from radartwin.scene.trajectories import trajectory
from radartwin.simulation.backends.trace_settings import TraceSettings
from radartwin.simulation.signal.synthesis import received
from radartwin.simulation.simulate import trace_paths

REPEATS = 20
MANY = 100  # number of poses in the longest call
OBJECTS = {
    "sphere, radius 5 cm": lambda: objects.sphere(0.05),
    "corner reflector, 10 cm": lambda: objects.trihedral(0.1),
    "plate, 10 cm": lambda: objects.plate(0.1, 0.1),
}


def milliseconds(call: Callable[[int], object], repeats: int = REPEATS) -> float:
    """Return the smallest CPU time of call(0), call(1), ... in milliseconds."""
    times = []
    for i in range(repeats):
        began = time.process_time()
        call(i)
        times.append(time.process_time() - began)
    return 1e3 * min(times)


def ranges(first_m: float, poses: int = 1) -> np.ndarray:
    """Return sensor poses (poses, 4, 4) whose ranges begin at `first_m` and grow by 0.1 mm."""
    return np.array([trajectory.pose([-first_m - 1e-4 * k, 0.0, 0.0]) for k in range(poses)])


def measure(name: str) -> dict[str, float]:
    """Return the CPU time in milliseconds of each kind of call for one object."""
    scene, radar = rt.Scene([rt.Surface(OBJECTS[name](), "metal", "target")]), rt.Radar.iwr1843()
    times = {
        "first call": milliseconds(lambda _: rt.simulate(scene, radar, ranges(1.0)), 1),
        "same pose": milliseconds(lambda _: rt.simulate(scene, radar, ranges(1.0))),
        "new pose": milliseconds(lambda i: rt.simulate(scene, radar, ranges(1.001 + 0.001 * i))),
        "tracing": milliseconds(lambda i: trace_paths(scene, radar, ranges(1.101 + 0.001 * i), None, TraceSettings())),
    }
    paths = [trace_paths(scene, radar, ranges(1.2 + 0.001 * i), None, TraceSettings())[0] for i in range(REPEATS)]
    times["synthesis"] = milliseconds(lambda i: received(paths[i], radar, 1))
    for poses in (10, MANY):
        times[f"{poses} new poses"] = milliseconds(lambda i, poses=poses: rt.simulate(scene, radar, ranges(1.3 + 0.02 * i, poses)))
    times["each further pose"] = (times[f"{MANY} new poses"] - times["new pose"]) / (MANY - 1)
    return times


def main() -> None:
    with ProcessPoolExecutor(1, get_context("spawn"), max_tasks_per_child=1) as pool:
        rows = dict(zip(OBJECTS, pool.map(measure, OBJECTS), strict=True))
    print(pd.DataFrame(rows).round(1).to_string())


if __name__ == "__main__":
    main()
