"""Label-free transfer from simulated to measured frames: the protocol that the rover's recognition tables share.

Frames of the twin and of the measured recordings are rank-normalised separately within each distance. A random forest is trained on the
twin's frames; a measured recording gets the majority vote of its frames (paper, scene-level recognition, label-free). The raw baseline
matches whole range-time signatures at equal distance.
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
from radartwin.features import calibration
from radartwin.features.rank import rank_normalise
from radartwin.recognize.probes import forest, match_signatures
from radartwin.recognize.samples import Samples
from radartwin.recognize.split import Split, label_free

ENERGY = "_db"  # ending of the names of features that depend on energy and are calibrated by the reflector


@dataclass(frozen=True, eq=False)
class Frames:
    """Frames of both domains in one room and motion, with the store keys of their recordings."""

    simulated: Samples
    measured: Samples
    keys: tuple[str, ...]


def read(source: RecordingSource, room: str, motion: str, domain: str = "twin", materials: Any = None) -> Frames:
    """Frames of every case that both domains have. Raises InputError if there are none."""
    measured, simulated = readings.shared_cases(source, motion, room, domain)
    theirs = readings.frames(source, "measured", measured, motion)
    ours = readings.frames(source, domain, simulated, motion, materials)
    return Frames(ours.samples, theirs.samples, tuple(sorted((*ours.keys, *theirs.keys))))


def missing(campaign: Campaign, room: str, motion: str, domain: str = "twin", materials: Any = None) -> dict[str, RecordingTask]:
    """The recordings that `read` would simulate, so that those of several campaigns can be made together (campaign.make_together)."""
    measured, simulated = readings.shared_cases(campaign, motion, room, domain)
    ours = campaign.missing([(domain, case) for case in simulated], materials)
    return campaign.missing([("measured", case) for case in measured]) | ours


def ranked(samples: Samples) -> Samples:
    """Each feature's rank among the rows of its distance, from 0 to 1."""
    return samples.with_values(rank_normalise(samples.values, samples.stratum))


def ranked_split(frames: Frames, classes: Mapping[str, str] | None = None) -> Split:
    """Train on the twin's ranked frames, score the measured ones; `classes` replace the objects."""
    simulated, measured = ranked(frames.simulated), ranked(frames.measured)
    if classes is not None:
        simulated, measured = simulated.relabelled(classes), measured.relabelled(classes)
    return label_free(simulated, measured)


def predict(config: Config, split: Split, change: Callable[[Split, int], Split] = lambda split, seed: split) -> list[NDArray]:
    """The forest's predictions per recording, for each seed; `change` alters the split of a seed."""
    return [forest(change(split, seed), seed, config.supervision.trees) for seed in seeds(config)]


def predict_from_signatures(source: RecordingSource, room: str, motion: str) -> NDArray:
    """The object with the best matching simulated signature, for each measured recording."""
    measured, simulated = readings.shared_cases(source, motion, room)
    ours, theirs = readings.signatures(source, "twin", simulated), readings.signatures(source, "measured", measured)
    return match_signatures(label_free(ours.samples, theirs.samples))


def calibrated_split(
    source: RecordingSource, frames: Frames, room: str, motion: str, classes: Mapping[str, str], mapped: bool = True
) -> Split:
    """Train on the twin's frames in the units of the measured domain, after calibration by one unlabelled reflector recording.

    The calibration maps the features that depend on energy. The reflector is left out of training and test at every distance.
    Without `mapped` nothing is calibrated, for comparison.
    """
    simulated = frames.simulated
    if mapped:
        cases = {domain: [calibration_case(source, domain, room, motion)] for domain in ("twin", "measured")}
        ours, theirs = (readings.frames(source, domain, case, motion).samples.values for domain, case in cases.items())
        energy = np.array([name.endswith(ENERGY) for name in simulated.names])
        values = simulated.values.copy()
        values[:, energy] = calibration.fit(ours[:, energy], theirs[:, energy]).apply(values[:, energy])
        simulated = simulated.with_values(values)
    simulated, measured = simulated.without(REFLECTOR), frames.measured.without(REFLECTOR)
    return Split("calibrated", simulated.relabelled(classes), measured.relabelled(classes), calibration_object=REFLECTOR)


def calibration_case(source: RecordingSource, domain: str, room: str, motion: str) -> Case:
    """The first recording of the reflector at the middle distance. Raises InputError if there is none."""
    cases = sorted(source.cases(domain, room=room, motion=motion, object=REFLECTOR), key=lambda case: recording_name(domain, case))
    if not cases:
        raise InputError(f"calibration: the campaign has no {domain} {motion} recording of the {REFLECTOR} in {room}; record one")
    distances = sorted({case.distance_m for case in cases})
    return next(case for case in cases if case.distance_m == distances[len(distances) // 2])
