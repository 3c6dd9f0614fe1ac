"""Measure the run time of simulation models per frame of a whole recording, from a short and a longer simulated recording.

A longer recording and one of FEW frames give the fixed part of the run time (such as tracing the room once for a radar at rest) and the
part per frame. The models are timed in turn, in several rounds, each with an empty cache and after the kernels are compiled. Only the
default on a turntable compiles its kernels while it is timed, because its first recording counts for a 250th of the result.
"""

import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from experiments.speed.machine import machine
from experiments.speed.measuring import clock
from radartwin.adaptive.probe import Probe
from radartwin.adaptive.scene_settings import DEFAULT, Model
from radartwin.store import array_cache
from radartwin.store.products import Store, save_json

ROOTS = ("experiments.complexity.timing",)
FRAMES = 250, 50  # number of frames of a revolution, and of a drive
FEW = 10  # frames of the shorter recording, in two blocks (`simulate.FIRST_FRAMES`) as those of the longer one


def seconds(
    probe_of: Callable[[int | None, bool], Probe], models: Sequence[Model], rounds: int, store: Store, frames: int | None = None
) -> dict[Model, list[float]]:
    """Return the run time in core-seconds per frame of a whole recording: for each model, a list with one value per round.

    Args:
        probe_of: function (number of frames, whether to take frames between the probe's frames) -> probe.
        frames: number of frames of the longer recording; None for all of the probe.
    """
    few, many = probe_of(FEW, False), probe_of(frames, False)
    ordered = sorted(set(models), key=lambda model: model.told)
    timed = {"models": ordered, "frames": many.frames, "rounds": rounds, "machine": machine()}
    spec: dict[str, Any] = {**few.described(), "families": None, **timed}

    def build(folder: Path) -> None:
        for model in ordered:  # compiles kernels and allocates memory that later recordings reuse
            if model != DEFAULT or few.log.angle_rad is None:
                few.record(model)
        times_s = [[_once(few, many, model) for model in ordered] for _ in range(rounds)]
        save_json(folder, "seconds", times_s)

    times_s = store.fetch("timing", spec, ROOTS, build).read_json("seconds")
    return {model: [each[number] for each in times_s] for number, model in enumerate(ordered)}


def _once(few: Probe, many: Probe, model: Model) -> float:
    with tempfile.TemporaryDirectory() as empty, array_cache.in_folder(empty):
        turning = few.log.angle_rad is not None
        first = _clocked(few, model)
        short = _clocked(few, model) if turning else first  # the room of a radar at rest is already traced
        long = _clocked(many, model)
    frames = FRAMES[not turning]  # of the whole recording
    each = max(long - short, 0.0) / (many.frames - few.frames)
    return (first + (frames - few.frames) * each) / frames


def _clocked(probe: Probe, model: Model) -> float:
    began = clock()
    probe.record(model)
    return clock() - began


def ratio(first: Sequence[float], second: Sequence[float]) -> float:
    """Return the run time of the `first` model divided by that of the `second`, as the median over rounds."""
    return float(np.median(np.array(first) / np.array(second)))
