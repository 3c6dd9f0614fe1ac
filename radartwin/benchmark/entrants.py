"""Run a simulator on the problems of the benchmark, and measure its seconds per frame.

A method is scored with the radar of the problem, a single element, and timed with the whole IWR1843 (ARRAY) on the same scenario, from the
scene to the samples, without the compilation of kernels. Of RF-Genesis as published, one of 128 equal sums per frame is timed.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from radartwin.benchmark.frozen_problems import Problem, Scenario
from radartwin.errors import InputError
from radartwin.radar.chirp import Radar
from radartwin.scene.scene import Scene
from radartwin.simulation.backends import rfgenesis
from radartwin.simulation.backends.backend import backend
from radartwin.simulation.backends.backend import names as simulator_names
from radartwin.simulation.backends.rfgenesis_signal import direct_frame
from radartwin.simulation.backends.sionna_scene import quiet
from radartwin.simulation.poses import ObjectPoses
from radartwin.simulation.simulate import simulate

ARRAY = Radar.iwr1843()
ASIDE_M = 1e-6  # shift of the radar between calls, so that no call reuses cached paths
BUDGET_S = 2.0  # if the scored frames take less than this, all frames of the recording are timed, REPEATS times
REPEATS = 2  # the fastest repetition counts, because other programs on the machine only add time


@dataclass(frozen=True)
class Method:
    """A simulator with one choice of settings. If `published` is True, the timed method is RF-Genesis with its own signal generator."""

    name: str
    backend: str
    settings: Mapping[str, Any] = field(default_factory=dict)
    published: bool = False

    def signals(self, scenario: Scenario) -> np.ndarray:
        """Return the simulated samples (S, N) of the frames for which the benchmark has a reference signal."""
        return self._iq(scenario, scenario.radar, scenario.scored)[:, 0, 0, 0]

    def seconds_per_frame(self, scenario: Scenario) -> float:
        """Return the wall seconds per frame of the IWR1843 in the scenario."""
        if self.published:
            settings = backend(self.backend, **self.settings).settings
            sensor, motion = scenario.poses(1)
            return published_seconds(scenario.scene, sensor[:1], motion, settings, ARRAY, time.perf_counter)
        warm_s = self._timed(scenario, scenario.scored)  # compiles the kernels
        if warm_s * scenario.scored > BUDGET_S:
            return self._timed(scenario, scenario.scored)
        return min(self._timed(scenario, scenario.frames) for _ in range(REPEATS))

    def _timed(self, scenario: Scenario, frames: int) -> float:
        began = time.perf_counter()
        self._iq(scenario, ARRAY, frames, ASIDE_M * next(_calls))
        return (time.perf_counter() - began) / frames

    def _iq(self, scenario: Scenario, radar: Radar, frames: int, aside_m: float = 0.0) -> np.ndarray:
        sensor, motion = scenario.poses(frames)
        sensor = sensor.copy()
        sensor[:, 1, 3] += aside_m
        with quiet():  # the leaderboard shows the errors that Sionna's warnings announce
            simulator = backend(self.backend, **self.settings)
            return simulate(scenario.scene, radar, sensor, motion=motion, simulator=simulator).iq


_calls = itertools.count(1)
OURS = "ours"
METHODS = (
    Method(OURS, "mitsuba"),
    Method("points", "points"),
    Method("rfgenesis", "rfgenesis", {"version": "shipped"}, published=True),
    Method("rfgenesis_corrected", "rfgenesis", {"version": "corrected"}),
    Method("sionna", "sionna", {"separation_m": 0.03}),
    # Sionna searches for paths with the receiver 1 mm aside, and a diffracted path keeps the edge point of this search. A larger separation
    # would shift this point.
    Method("sionna_diffraction", "sionna", {"separation_m": 0.001, "diffraction": True}),
)


def method(name: str) -> Method:
    """Return a method by name: one of METHODS, or a simulator with its default settings. Raises InputError for an unknown name."""
    known = {entrant.name: entrant for entrant in METHODS}
    if name in known and name not in simulator_names(built_in=False):
        return known[name]
    if name not in simulator_names():
        choices = dict.fromkeys([*known, *simulator_names()])
        raise InputError(f"--method {name} is neither a folder nor a method; choose a folder with signals or one of {', '.join(choices)}")
    backend(name)
    return Method(name, name)


def solve(method: Method, problem: Problem) -> tuple[dict[str, np.ndarray], float]:
    """Run a method on a problem. Returns its signals (S, N) by scenario, and the mean of its seconds per frame."""
    signals = {scenario.name: method.signals(scenario) for scenario in problem.scenarios}
    seconds = [method.seconds_per_frame(scenario) for scenario in problem.scenarios]
    return signals, float(np.mean(seconds))


def published_seconds(
    scene: Scene, sensor: np.ndarray, motion: ObjectPoses, settings: rfgenesis.RFGenesisSettings, radar: Radar, clock: Callable[[], float]
) -> float:
    """Return the seconds per frame of RF-Genesis with its own signal generator, from one frame: trace time plus the time of all sums."""
    began = clock()
    hits = rfgenesis.trace(scene, radar, sensor, motion, settings)
    traced = clock() - began
    seen = hits.distance[0] > rfgenesis.MIN_VISIBLE
    distance = hits.distance[0, seen]
    points = distance[:, None] * hits.directions[seen]
    single_channel = replace(radar, num_chirps=1, tx_positions_m=radar.tx_positions_m[:1], rx_positions_m=radar.rx_positions_m[:1])
    began = clock()
    direct_frame(points, points, distance, single_channel)
    return traced + (clock() - began) * radar.num_chirps * radar.num_tx * radar.num_rx
