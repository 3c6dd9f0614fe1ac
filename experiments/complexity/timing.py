"""Run time of models per frame of a whole recording, estimated from a short recording and a longer one.

The run time of a recording has a fixed part, such as the room that is traced once for a radar at rest, and a part per frame. Both are
estimated from recordings of a probe's frames and of half as many. The models take turns, several times. A few frames are recorded first,
so that all kernels are compiled. Cached paths are dropped before each first recording.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from experiments.speed.machine import machine
from experiments.speed.measuring import clock
from radartwin.adaptive.model import DEFAULT, Model
from radartwin.adaptive.probe import Probe
from radartwin.store import array_cache
from radartwin.store.products import Store, save_json

ROOTS = ("experiments.complexity.timing",)
FRAMES = 250, 50  # of a revolution, of a drive
FIRST = 4  # frames that are recorded to compile the kernels


def whole(probe: Probe) -> int:
    """Number of frames of the recording behind a probe."""
    return FRAMES[0] if probe.log.angle_rad is not None else FRAMES[1]


def seconds(probe_of: Callable[[int | None, bool], Probe], models: Sequence[Model], rounds: int, store: Store) -> dict[Model, list[float]]:
    """Core seconds per frame of a whole recording, by model and round.

    Args:
        probe_of: (number of frames, or None for those of a probe) -> probe.
    """
    many = probe_of(None, False)
    few = probe_of((many.frames + 1) // 2, False)
    ordered = sorted(set(models), key=lambda model: model.told)
    spec: dict[str, Any] = {**few.described(), "families": None, "models": ordered, "rounds": rounds, "machine": machine()}

    def build(folder: Path) -> None:
        first = probe_of(FIRST, False)
        for model in ordered:
            first.record(model)
        few.record(DEFAULT)  # so that memory that stays allocated is not counted for the first model
        found = [[_once(few, many, model) for model in ordered] for _ in range(rounds)]
        save_json(folder, "seconds", found)

    found = store.fetch("timing", spec, ROOTS, build).read_json("seconds")
    return {model: [each[number] for each in found] for number, model in enumerate(ordered)}


def _once(few: Probe, many: Probe, model: Model) -> float:
    with tempfile.TemporaryDirectory() as empty, array_cache.in_folder(empty):
        first = _clocked(few, model)
        short = _clocked(few, model) if few.log.angle_rad is not None else first  # the room of a radar at rest is already traced
        long = _clocked(many, model)
    frames = whole(few)
    each = max(long - short, 0.0) / (many.frames - few.frames)
    return (first + (frames - few.frames) * each) / frames


def _clocked(probe: Probe, model: Model) -> float:
    began = clock()
    probe.record(model)
    return clock() - began


def ratio(one: Sequence[float], other: Sequence[float]) -> float:
    """Ratio of two models' run times, the median over rounds."""
    return float(np.median(np.array(one) / np.array(other)))
