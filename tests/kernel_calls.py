"""Calls of the functions that a GPU can compute, recorded while the processor simulates a small furnished room."""

import sys
from collections import defaultdict
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import trimesh

import radartwin as rt
from radartwin.scene import objects
from radartwin.scene.trajectories import trajectory
from radartwin.simulation.flat import parallel

WALLS_M, CUPBOARD_M = (4.0, 3.0, 2.5), (0.4, 0.5, 0.9)


class Call(NamedTuple):
    """A call of `parallel.compute`: the function, its arguments, and its results before and after the call."""

    function: Any
    count: int
    arguments: tuple
    before: list[np.ndarray]
    after: list[np.ndarray]
    work: Callable[[int], Any]

    @property
    def name(self) -> str:
        """Return the name of the function with its module, for example "field.evaluate"."""
        return f"{self.function.py_func.__module__.rpartition('.')[2]}.{self.function.py_func.__name__}"


def recorded() -> dict[str, list[Call]]:
    """Return all calls by the name of their function, computed on the processor.

    The paths have up to two reflections or diffractions, and some cross a pane.
    """
    calls: dict[str, list[Call]] = defaultdict(list)
    computed, few = parallel.compute, parallel.FEW

    def compute(function: Any, count: int, arguments: tuple, results: Any, work: Any, **how: Any) -> None:
        before = [values.copy() for values in results]
        computed(function, count, arguments, results, work, **how)
        call = Call(function, count, tuple(arguments), before, [values.copy() for values in results], work)
        if count:
            calls[call.name].append(call)

    walls = trimesh.creation.box(WALLS_M)
    walls.invert()
    cupboard = trimesh.creation.box(CUPBOARD_M).apply_transform(trajectory.pose([0.6, -0.7, -0.3]))
    pane = objects.plate(0.5, 0.5).apply_transform(trajectory.pose([0.4, 0.5, 0.1]))
    room = [
        rt.Surface(walls, "concrete", "walls", role="room"),
        rt.Surface(cupboard, "wood", "cupboard", role="room"),
        rt.Surface(pane, "glass", "pane", role="room"),
    ]
    can = rt.Surface(objects.cylinder(0.033, 0.12), "metal", "can", roughness_m=1e-4, role="object")
    radar, poses = rt.Radar.iwr1843(), np.stack([trajectory.pose([-1.2, 0.1 + 0.02 * i, 0.05]) for i in range(3)])
    parallel.compute, parallel.FEW = compute, sys.maxsize
    try:
        rt.simulate(rt.Scene(room), radar, poses[:1], max_bounces=2)
        rt.simulate(rt.Scene([*room, can.moved(trajectory.pose([0.8, 0.7, 0.1]))]), radar, poses, max_bounces=2)
    finally:
        parallel.compute, parallel.FEW = computed, few
    return dict(calls)


def kinds(calls: list[Call]) -> dict[str, int]:
    """Return the number of existing paths of `field.evaluate` without an edge, with one edge and with two edges."""
    found = {"no edge": 0, "one edge": 0, "two edges": 0}
    for call in calls:
        edge = call.arguments[8][call.arguments[10]][call.after[1][:, 0] > 0]
        for name, number in zip(found, range(3), strict=True):
            found[name] += int(((edge >= 0).sum(axis=1) == number).sum())
    return found


def largest_error(found: list[np.ndarray], expected: list[np.ndarray]) -> float:
    """Return the largest difference of results, relative to the largest magnitude of each result. Missing values must agree."""
    errors = [0.0]
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(np.isnan(one), np.isnan(other))
        there = ~np.isnan(other)
        if there.any() and np.abs(other[there]).max() > 0:
            errors.append(float(np.abs(one - other)[there].max() / np.abs(other[there]).max()))
    return max(errors)
