"""Label-free transfer from simulated to measured frames: the protocol that the rover's tables share.

Frames of the twin and of the measured recordings are rank-normalised apart, each within its distance; a random forest learns the twin's
frames, and the majority of a measured recording's frames is its answer (paper, scene-level recognition, label-free). The raw baseline
matches whole range-time signatures at equal distance.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from experiments.recognition import readings
from experiments.recognition.protocol import CALIBRATION_OBJECT, seeds
from experiments.recognition.readings import Campaign, Case, recording_name
from radartwin.config.config import Config
from radartwin.errors import InputError
from radartwin.features import calibration
from radartwin.features.rank import rank_normalise
from radartwin.recognize.probes import forest, match_signatures
from radartwin.recognize.samples import Samples
from radartwin.recognize.split import Split, label_free

if TYPE_CHECKING:
    from experiments.campaign.campaign import Campaign as Kept
    from experiments.campaign.schedule import RecordingTask

ENERGY = "_db"  # ends the names of features that depend on energy, and that the reflector calibrates


@dataclass(frozen=True, eq=False)
class Frames:
    """Frames of both domains in one room and motion, as read, with the keys of their recordings."""

    simulated: Samples
    measured: Samples
    keys: tuple[str, ...]


def read(campaign: Campaign, room: str, motion: str, domain: str = "twin", materials: Any = None) -> Frames:
    """Frames of every case that both domains have. Raises InputError where there are none."""
    measured, simulated = readings.shared_cases(campaign, motion, room, domain)
    theirs = readings.frames(campaign, "measured", measured, motion)
    ours = readings.frames(campaign, domain, simulated, motion, materials=materials)
    return Frames(ours.samples, theirs.samples, tuple(sorted((*ours.keys, *theirs.keys))))


def missing(campaign: Kept, room: str, motion: str, domain: str = "twin", materials: Any = None) -> dict[str, RecordingTask]:
    """What `read` would have to make, for several campaigns to make it together (experiments/campaign/campaign.py)."""
    measured, simulated = readings.shared_cases(campaign, motion, room, domain)
    ours = campaign.missing([(domain, case) for case in simulated], materials)
    return campaign.missing([("measured", case) for case in measured]) | ours


def ranked(samples: Samples) -> Samples:
    """Each feature's rank among the rows of its domain and distance, from 0 to 1."""
    return samples.with_values(rank_normalise(samples.values, samples.stratum))


def ranked_split(frames: Frames, classes: Mapping[str, str] | None = None) -> Split:
    """Learn the twin's ranked frames, score the measured ones; `classes` replace the objects."""
    simulated, measured = ranked(frames.simulated), ranked(frames.measured)
    if classes is not None:
        simulated, measured = simulated.relabelled(classes), measured.relabelled(classes)
    return label_free(simulated, measured)


def answers(config: Config, split: Split, change: Callable[[Split, int], Split] = lambda split, seed: split) -> list[NDArray]:
    """The forest's answer per recording, once for each seed."""
    return [forest(change(split, seed), seed, config.supervision.trees) for seed in seeds(config)]


def raw_answers(campaign: Campaign, room: str, motion: str) -> tuple[NDArray, Samples]:
    """The object whose simulated signature each measured recording matches, and the recordings."""
    measured, simulated = readings.shared_cases(campaign, motion, room)
    ours, theirs = readings.signatures(campaign, "twin", simulated), readings.signatures(campaign, "measured", measured)
    split = label_free(ours.samples, theirs.samples)
    return match_signatures(split), split.test


def calibrated_split(campaign: Campaign, frames: Frames, room: str, motion: str, classes: Mapping[str, str], mapped: bool = True) -> Split:
    """Learn the twin's frames in the measured domain's units, by one unlabelled recording of the corner reflector.

    The recording is the first one at the middle distance. Features that do not depend on energy stay as they are; the reflector is neither
    learned nor scored, at any distance. With mapped=False nothing is calibrated, for comparison.
    """
    simulated = frames.simulated
    if mapped:
        ours, theirs = (_reflector(campaign, domain, room, motion) for domain in ("twin", "measured"))
        energy = np.array([name.endswith(ENERGY) for name in simulated.names])
        values = simulated.values.copy()
        values[:, energy] = calibration.fit(ours[:, energy], theirs[:, energy]).apply(values[:, energy])
        simulated = simulated.with_values(values)
    simulated, measured = simulated.without(CALIBRATION_OBJECT), frames.measured.without(CALIBRATION_OBJECT)
    return Split("calibrated", simulated.relabelled(classes), measured.relabelled(classes), calibration_object=CALIBRATION_OBJECT)


def _reflector(campaign: Campaign, domain: str, room: str, motion: str) -> NDArray:
    """Frames of the calibration recording in one domain."""
    case = calibration_case(campaign, domain, room, motion)
    return readings.frames(campaign, domain, [case], motion).samples.values


def calibration_case(campaign: Campaign, domain: str, room: str, motion: str) -> Case:
    """The first recording of the reflector at the middle distance."""
    cases = sorted(
        campaign.cases(domain, room=room, motion=motion, object=CALIBRATION_OBJECT), key=lambda case: recording_name(domain, case)
    )
    if not cases:
        raise InputError(f"calibration: the campaign has no {domain} {motion} recording of the {CALIBRATION_OBJECT} in {room}")
    middle = sorted({case.distance_m for case in cases})[len({case.distance_m for case in cases}) // 2]
    return next(case for case in cases if case.distance_m == middle)
