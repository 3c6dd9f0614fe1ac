"""What a recording shows, by a model: recording -> features of the model's set -> probabilities of its classes.

A recording from outside has no log of a campaign, so its nominal motion is what the user says of it, or what it shows: a turntable's target
is where the echo changes most over the frames, and a moving radar's is the strongest continuous path. How a stranger's I and Q are ordered,
and what its radar is, `radartwin.radar.captures` finds out.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import InputError
from radartwin.features import sets, track
from radartwin.features.log import Nominal
from radartwin.features.processed import Processed, process
from radartwin.features.profile import FAR_M, NEAR_M
from radartwin.radar.captures import load_capture
from radartwin.radar.chirp import Radar
from radartwin.recognize.model import Recogniser

_TURNS = "rotation"


@dataclass(frozen=True, eq=False)
class Answer:
    """Classes with their probabilities, likeliest first, and the distance at which the target was taken to be at the start."""

    classes: tuple[str, ...]
    probabilities: NDArray[np.float64]
    distance_m: float


def classify(
    recording: str | Path,
    model: Recogniser | str | Path,
    radar: Radar | str | Path | None = None,
    *,
    iq_swapped: bool | None = None,
    distance_m: float | None = None,
    period_s: float | None = None,
) -> Answer:
    """Classify a recording of this package, a mmWave Studio capture or a .npy cube.

    Args:
        model: a recogniser, or the folder of one.
        radar, iq_swapped: as `load_capture`.
        distance_m: from the radar to the target at the start; None finds it.
        period_s: of one revolution, for a model of turntable recordings; None takes the model's.
    Raises:
        UserError: as `load_capture` and `Recogniser.load`; a model whose features this version does not know; a recording that is too
            short, or shows no target.
    """
    recogniser = model if isinstance(model, Recogniser) else Recogniser.load(model)
    processed = process(load_capture(recording, radar, iq_swapped=iq_swapped), doppler=False)
    log = nominal(processed, recogniser, distance_m, period_s)
    name, without = str(recogniser.features.get("set", "")), tuple(map(str, recogniser.features.get("without", ())))
    try:
        names, values = sets.vector(processed, log, name, without)
    except InputError as error:
        raise InputError(f"{recording}: {error}") from error
    if tuple(names) != recogniser.names:
        raise InputError(f"the model's features {', '.join(recogniser.names[:3])} ... are not those of this version; export it again")
    probabilities = recogniser.probabilities(values[None])[0]
    order = np.argsort(-probabilities, kind="stable")
    return Answer(tuple(recogniser.classes[i] for i in order), probabilities[order], float(log.distance_m[0]))


def nominal(processed: Processed, recogniser: Recogniser, distance_m: float | None, period_s: float | None) -> Nominal:
    """The motion of a recording that nobody logged."""
    rate, frames = processed.radar.frame_rate_hz, processed.num_frames
    if distance_m is not None and not NEAR_M <= distance_m <= FAR_M:
        raise InputError(f"a target at {distance_m:g} m is not between {NEAR_M} and {FAR_M} m; give its distance in metres")
    if recogniser.features.get("set") != _TURNS:
        if period_s is not None:
            raise InputError("a period was given, but the model is not of turntable recordings; leave it out")
        low, high = (NEAR_M, FAR_M) if distance_m is None else (distance_m - track.SEARCH_M, distance_m + track.SEARCH_M)
        return Nominal(rate, np.clip(track.track(processed, low, high, rate), NEAR_M, FAR_M).astype(np.float64), None)
    period = float(recogniser.features.get("period_s", 25.0)) if period_s is None else period_s
    if not 0 < period < np.inf:
        raise InputError(f"a revolution of {period:g} s is not a time; give seconds")
    if frames < period * rate - 0.5:
        raise InputError(
            f"{frames} frames at {rate:g} per second are {frames / rate:.1f} s, and a revolution takes {period:g} s; record a whole one, "
            "or give the period of yours"
        )
    where = changing_range(processed) if distance_m is None else distance_m
    return Nominal(rate, np.full(frames, where, dtype=np.float64), 2 * np.pi * np.arange(frames, dtype=np.float64) / (period * rate))


def changing_range(processed: Processed) -> float:
    """Range (m) of the echo that changes most over the frames: what turns, not the walls.

    Raises:
        InputError: nothing changes.
    """
    moving = np.mean(np.abs(processed.channels - processed.channels.mean(axis=0)) ** 2, axis=(0, 1))
    inside = (processed.range_m >= NEAR_M) & (processed.range_m <= FAR_M)
    moving = np.where(inside, moving, 0.0)
    if not moving.max() > 0:
        raise InputError("nothing in the recording changes, so the turning target is not found; give its distance")
    return float(processed.range_m[int(moving.argmax())])
