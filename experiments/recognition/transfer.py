"""Classify measured rover recordings by a random forest that is trained on simulated frames only, as all rover recognition tables do.

Features are replaced by their ranks, separately for each domain and distance. A measured recording gets the class that most of its frames
get (paper: scene-level recognition, label-free). The baseline "raw" chooses the object whose simulated range-time signature at the same
distance is most similar. The drives of a split are those of one room, motion and simulation.
"""

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from experiments.campaign.cases import MEASURED, REFLECTOR
from experiments.campaign.frame import Frame
from experiments.recognition.protocol import seeds
from experiments.recognition.readings import frames, reflector, signatures
from radartwin.config.config import Config
from radartwin.features.normalise import fit_map, rank_normalise
from radartwin.recognize.probes import forest, match_signatures
from radartwin.recognize.samples import Samples
from radartwin.recognize.split import Split, label_free

ENERGY = "_db"  # ending of the names of features that depend on energy; the reflector calibrates these features


def of_domains(drives: Frame, read: Callable[[Frame], Samples] = frames) -> tuple[Samples, Samples]:
    """Return the feature rows of the simulated and of the measured drives."""
    return read(drives[drives.domain != MEASURED]), read(drives[drives.domain == MEASURED])


def ranked(samples: Samples) -> Samples:
    """Replace each feature value by its rank, scaled to 0 to 1, among the rows at equal distance."""
    return samples.with_values(rank_normalise(samples.values, samples.stratum))


def ranked_split(drives: Frame, classes: Mapping[str, str] | None = None) -> Split:
    """Return the split that trains on ranked simulated frames and tests on ranked measured frames. `classes` maps objects to classes."""
    ranked_domains = [ranked(rows) for rows in of_domains(drives)]
    return label_free(*(ranked_domains if classes is None else [rows.relabelled(classes) for rows in ranked_domains]))


def predict(config: Config, split: Split, change: Callable[[Split, int], Split] = lambda split, seed: split) -> list[NDArray]:
    """Return the forest's predictions (recordings,) for each seed, after `change(split, seed)` of the rows."""
    return [forest(change(split, seed), seed, config.supervision.trees) for seed in seeds(config)]


def predict_from_signatures(drives: Frame) -> NDArray:
    """Predict for each measured recording the object whose simulated range-time signature is most similar."""
    return match_signatures(label_free(*of_domains(drives, signatures)))


def calibrated_split(drives: Frame, classes: Mapping[str, str], mapped: bool = True) -> Split:
    """Return the split that trains on simulated frames after calibration by one reflector recording, whose class label is not used.

    The calibration shifts those simulated features that depend on echo energy to the measured level of the reflector. The corner reflector
    is left out of training and test data at every distance. `mapped=False` skips the calibration, for comparison.
    """
    simulated, measured = of_domains(drives)
    if mapped:
        simulated_levels, measured_levels = (rows.values for rows in of_domains(reflector(drives)))
        energy = np.array([name.endswith(ENERGY) for name in simulated.names])
        values = simulated.values.copy()
        values[:, energy] = fit_map(simulated_levels[:, energy], measured_levels[:, energy]).apply(values[:, energy])
        simulated = simulated.with_values(values)
    simulated, measured = simulated.without(REFLECTOR), measured.without(REFLECTOR)
    return Split("calibrated", simulated.relabelled(classes), measured.relabelled(classes), calibration_object=REFLECTOR)
