"""Classify a recording in any format that `load_capture` reads with an exported model: compute the model's features of the recording, and
class probabilities from the features.

A recording from outside the study has no log of its motion. Therefore the user gives the nominal motion, or this module estimates it. On a
turntable, the target is assumed at the range where the echo changes most over the frames. For a moving radar, the target is assumed to be
the strongest continuous track in range. The module `radartwin.radar.captures` determines a capture's order of I and Q and its radar.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import InputError
from radartwin.features import families, peak_track
from radartwin.features.log import Nominal
from radartwin.features.processed import Processed, process
from radartwin.features.profile import FAR_M, NEAR_M
from radartwin.radar.captures import load_capture
from radartwin.radar.chirp import Radar
from radartwin.recognize.model import Recogniser

_TURNS = "rotation"
FEWEST_SHARE = 0.8  # smallest number of frames per revolution, relative to the training; the entropy then changes by less than 5 %


@dataclass(frozen=True, eq=False)
class Answer:
    """Object classes of a recording with their probabilities, most likely first, and the target distance at the start (given or
    estimated).
    """

    classes: tuple[str, ...]
    probabilities: NDArray[np.float64]
    distance_m: float


def classify(
    recording: str | Path,
    model: Recogniser | str | Path,
    radar: Radar | str | Path | None = None,
    *,
    distance_m: float | None = None,
    period_s: float | None = None,
    **options: Any,
) -> Answer:
    """Classify a recording, which may be a recording of this package, a mmWave Studio capture or a .npy cube.

    Args:
        recording: path of the recording.
        model: the recogniser, or the folder of a saved recogniser.
        radar: radar of the recording, or its file.
        distance_m: distance from the radar to the target at the start; None estimates it.
        period_s: duration of one turntable revolution, for a model of turntable recordings; None takes the period stored with the model.
        options: board, iq_swapped, cut, frames and say, as for `load_capture`.
    Raises:
        UserError: the recording or the model cannot be read (see `load_capture` and `Recogniser.load`), this version does not know the
            model's features, or the recording is too short or shows no target.
    """
    recogniser = model if isinstance(model, Recogniser) else Recogniser.load(model)
    processed = process(load_capture(recording, radar, **options), doppler=False)
    log = nominal(processed, recogniser, distance_m, period_s)
    processed, log = thinned(processed, log, recogniser)
    name, without = str(recogniser.features.get("set", "")), tuple(map(str, recogniser.features.get("without", ())))
    try:
        names, values = families.vector(processed, log, name, without)
    except InputError as error:
        raise InputError(f"{recording}: {error}") from error
    if tuple(names) != recogniser.names:
        raise InputError(f"the model's features {', '.join(recogniser.names[:3])} ... are not in this version; train the model again")
    probabilities = recogniser.probabilities(values[None])[0]
    order = np.argsort(-probabilities, kind="stable")
    return Answer(tuple(recogniser.classes[i] for i in order), probabilities[order], float(log.distance_m[0]))


def nominal(processed: Processed, recogniser: Recogniser, distance_m: float | None, period_s: float | None) -> Nominal:
    """Return the nominal motion of a recording without a motion log. Raise InputError if distance or period do not fit the recording."""
    rate, frames = processed.radar.frame_rate_hz, processed.num_frames
    if distance_m is not None and not NEAR_M <= distance_m <= FAR_M:
        raise InputError(f"the target distance {distance_m:g} m is not between {NEAR_M} and {FAR_M} m; give it in metres")
    if recogniser.features.get("set") != _TURNS:
        if period_s is not None:
            raise InputError("a period is given, but the model is not for turntable recordings; leave the period out")
        low, high = (NEAR_M, FAR_M) if distance_m is None else (distance_m - peak_track.SEARCH_M, distance_m + peak_track.SEARCH_M)
        return Nominal(rate, np.clip(peak_track.track(processed, low, high, rate), NEAR_M, FAR_M).astype(np.float64), None)
    period = float(recogniser.features.get("period_s", 25.0)) if period_s is None else period_s
    if not 0 < period < np.inf:
        raise InputError(f"the period {period:g} s is not a finite time above zero; give the seconds of one revolution")
    if frames < period * rate - 0.5:
        raise InputError(
            f"{frames} frames at {rate:g} per second last {frames / rate:.1f} s, but a revolution takes {period:g} s; record a whole "
            "revolution or give the period of your turntable"
        )
    where = changing_range(processed) if distance_m is None else distance_m
    return Nominal(rate, np.full(frames, where, dtype=np.float64), 2 * np.pi * np.arange(frames, dtype=np.float64) / (period * rate))


def thinned(processed: Processed, log: Nominal, recogniser: Recogniser) -> tuple[Processed, Nominal]:
    """Reduce a turntable recording to the number of frames per revolution of the model's training, if the model states this number.

    Crest factor and entropy of a revolution depend on its number of frames. The function keeps the frames nearest to equal angles. A
    recording with at most as many frames per revolution as the training is not changed.

    Raises:
        InputError: the recording has fewer frames per revolution than FEWEST_SHARE of the training.
    """
    frames = recogniser.features.get("frames_per_turn")
    if frames is None or log.angle_rad is None:
        return processed, log
    if not isinstance(frames, int) or frames < 1:
        raise InputError(f"the model's number of frames per revolution, {frames!r}, is not a whole number above zero; train it again")
    recorded = 2 * np.pi / float(log.angle_rad[1] - log.angle_rad[0])
    if recorded < FEWEST_SHARE * frames:
        raise InputError(
            f"the recording has {recorded:.0f} frames per revolution, but the model was trained with {frames}; turn more slowly, record "
            f"more frames per second, or train with --frames {recorded:.0f}"
        )
    if recorded <= frames:
        return processed, log
    indices = np.round(np.arange(int(processed.num_frames * frames / recorded + 1e-6)) * recorded / frames).astype(int)
    indices = indices[indices < processed.num_frames]
    rate = log.frame_rate_hz * frames / recorded
    return processed.frames(indices), Nominal(rate, log.distance_m[indices], 2 * np.pi * np.arange(len(indices)) / frames)


def changing_range(processed: Processed) -> float:
    """Return the range in metres at which the echo changes most over the frames.

    A target on a turntable is at this range, a wall is not.

    Raises:
        InputError: the echo does not change over the frames at any range.
    """
    moving = np.mean(np.abs(processed.channels - processed.channels.mean(axis=0)) ** 2, axis=(0, 1))
    inside = (processed.range_m >= NEAR_M) & (processed.range_m <= FAR_M)
    moving = np.where(inside, moving, 0.0)
    if not moving.max() > 0:
        raise InputError("no echo of the recording changes, so the turning target is not found; give its distance (--distance)")
    return float(processed.range_m[int(moving.argmax())])
