"""Classify measured rover recordings by a random forest that is trained on simulated frames only. All rover recognition tables use this
code.

The features of simulated and measured frames are replaced by their ranks, separately for each domain and distance. The random forest is
trained on the simulated frames. A measured recording gets the class that most of its frames get (paper: scene-level recognition,
label-free). The "raw" baseline method chooses the object whose simulated range-time signature at the same distance is most similar.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments.campaign.campaign import Campaign
from experiments.campaign.cases import REFLECTOR, Case
from experiments.campaign.schedule import RecordingTask
from experiments.campaign.source import RecordingSource
from experiments.recognition import readings
from experiments.recognition.protocol import seeds
from experiments.recognition.readings import recording_name
from radartwin.config.config import Config
from radartwin.errors import InputError
from radartwin.features.normalise import fit_map, rank_normalise
from radartwin.recognize.probes import forest, match_signatures
from radartwin.recognize.samples import Samples
from radartwin.recognize.split import Split, label_free

ENERGY = "_db"  # ending of the names of features that depend on energy; the reflector calibrates these features


@dataclass(frozen=True, eq=False)
class Frames:
    """Feature rows per frame of both domains in one room and motion, with the store keys of their recordings."""

    simulated: Samples
    measured: Samples
    keys: tuple[str, ...]


def read(source: RecordingSource, room: str, motion: str, domain: str = "twin", materials: Any = None) -> Frames:
    """Read the frames of every case that both domains contain. Raises InputError if both domains have no case in common."""
    measured, simulated = readings.shared_cases(source, motion, room, domain)
    theirs = readings.frames(source, "measured", measured, motion)
    ours = readings.frames(source, domain, simulated, motion, materials)
    return Frames(ours.samples, theirs.samples, tuple(sorted((*ours.keys, *theirs.keys))))


def missing(campaign: Campaign, room: str, motion: str, domain: str = "twin", materials: Any = None) -> dict[str, RecordingTask]:
    """Return {store key: task} of the recordings that `read` would simulate. Pass the result to campaign.make_together."""
    measured, simulated = readings.shared_cases(campaign, motion, room, domain)
    ours = campaign.missing([(domain, case) for case in simulated], materials)
    return campaign.missing([("measured", case) for case in measured]) | ours


def ranked(samples: Samples) -> Samples:
    """Replace each feature value by its rank, scaled to 0 to 1, among the rows at equal distance."""
    return samples.with_values(rank_normalise(samples.values, samples.stratum))


def ranked_split(frames: Frames, classes: Mapping[str, str] | None = None) -> Split:
    """Return the split that trains on ranked simulated frames and tests on ranked measured frames. `classes` maps objects to classes."""
    simulated, measured = ranked(frames.simulated), ranked(frames.measured)
    if classes is not None:
        simulated, measured = simulated.relabelled(classes), measured.relabelled(classes)
    return label_free(simulated, measured)


def predict(config: Config, split: Split, change: Callable[[Split, int], Split] = lambda split, seed: split) -> list[NDArray]:
    """Return the random forest's predictions (recordings,) for each seed. The function `change(split, seed)` may alter the training and
    test rows before training.
    """
    return [forest(change(split, seed), seed, config.supervision.trees) for seed in seeds(config)]


def predict_from_signatures(source: RecordingSource, room: str, motion: str) -> NDArray:
    """Predict for each measured recording the object whose simulated range-time signature is most similar."""
    measured, simulated = readings.shared_cases(source, motion, room)
    ours, theirs = readings.signatures(source, "twin", simulated), readings.signatures(source, "measured", measured)
    return match_signatures(label_free(ours.samples, theirs.samples))


def calibrated_split(
    source: RecordingSource, frames: Frames, room: str, motion: str, classes: Mapping[str, str], mapped: bool = True
) -> Split:
    """Return the split that trains on simulated frames after calibration by one reflector recording, whose class label is not used.

    The calibration shifts those simulated features that depend on echo energy to the measured level of the reflector. The corner reflector
    is left out of training and test data at every distance. `mapped=False` skips the calibration, for comparison.
    """
    simulated = frames.simulated
    if mapped:
        cases = {domain: [calibration_case(source, domain, room, motion)] for domain in ("twin", "measured")}
        ours, theirs = (readings.frames(source, domain, case, motion).samples.values for domain, case in cases.items())
        energy = np.array([name.endswith(ENERGY) for name in simulated.names])
        values = simulated.values.copy()
        values[:, energy] = fit_map(ours[:, energy], theirs[:, energy]).apply(values[:, energy])
        simulated = simulated.with_values(values)
    simulated, measured = simulated.without(REFLECTOR), frames.measured.without(REFLECTOR)
    return Split("calibrated", simulated.relabelled(classes), measured.relabelled(classes), calibration_object=REFLECTOR)


def calibration_case(source: RecordingSource, domain: str, room: str, motion: str) -> Case:
    """Return the first recording of the corner reflector at its middle distance. Raises InputError if there is no such recording."""
    cases = sorted(source.cases(domain, room=room, motion=motion, object=REFLECTOR), key=lambda case: recording_name(domain, case))
    if not cases:
        raise InputError(f"calibration: the campaign has no {domain} {motion} recording of the {REFLECTOR} in {room}; record one")
    distances = sorted({case.distance_m for case in cases})
    return next(case for case in cases if case.distance_m == distances[len(distances) // 2])
