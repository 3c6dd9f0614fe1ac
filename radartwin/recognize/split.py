"""Split feature rows into training and test rows. A split with training rows that its supervision level forbids raises LeakError.

The supervision levels follow the paper (scene-level recognition across supervision levels). Level `label_free` trains on simulated rows and
uses unlabelled measured rows only for normalisation. Level `calibrated` adds recordings of the calibration object, and this object is then
not tested. Level `few_shot` adds a given number of labelled measured recordings per class. Every classifier is trained on a `Split`, so
class labels of measured recordings cannot reach the training in any other way.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from radartwin.errors import InputError
from radartwin.recognize.samples import MEASURED, SIMULATED, Samples, Unlabelled

Level = Literal["label_free", "calibrated", "few_shot"]
LEVELS: tuple[Level, ...] = ("label_free", "calibrated", "few_shot")


class LeakError(InputError):
    """Raised if training would use test rows, or rows that the supervision level does not allow."""


@dataclass(frozen=True, eq=False)
class Split:
    """The feature rows that train a classifier and the feature rows that test the classifier.

    Attributes:
        level: supervision level: label_free, calibrated or few_shot.
        train: training rows with class labels: all simulated rows, and at level few_shot at most `shots` measured recordings per class.
        test: measured rows that the classifier is tested on; their class labels are only used to count correct predictions.
        shots: maximum number of measured recordings per class in the training rows, at level few_shot.
        calibration_object: object of the calibration recording at level calibrated; this object is not tested.
        tested: False for a training without measured recordings; `test` then has no rows.
        unlabelled: the test rows without class labels, which training may use for normalisation.
    Raises:
        LeakError: the supervision level forbids some of the training or test rows.
    """

    level: Level
    train: Samples
    test: Samples
    shots: int = 0
    calibration_object: str = ""
    tested: bool = True
    unlabelled: Unlabelled = field(init=False)

    def __post_init__(self) -> None:
        if self.level not in LEVELS:
            raise LeakError(f"supervision level {self.level!r} is unknown; choose {', '.join(LEVELS)}")
        if self.train.names != self.test.names:
            raise LeakError("training and test rows have different features; compute both with the same feature set")
        if not len(self.train) or bool(len(self.test)) != self.tested:
            raise LeakError("a split needs training rows and test rows" if self.tested else "a split without test needs training rows only")
        if (self.test.domain != MEASURED).any():
            raise LeakError("a simulated recording is in the test; score measured recordings only")
        if shared := np.intersect1d(self.train.source, self.test.source).tolist():
            raise LeakError(f"recording {shared[0]} is in training and in the test; split by recording, never by frame")
        self._check_labels()
        if (self.level == "calibrated") != bool(self.calibration_object):
            raise LeakError("supervision=calibrated needs a calibration object, and no other level may have one")
        if self.calibration_object and (self.test.label == self.calibration_object).any():
            raise LeakError(f"{self.calibration_object} is the calibration object and cannot be scored; leave it out of the test")
        object.__setattr__(self, "unlabelled", self.test.unlabelled())

    def _check_labels(self) -> None:
        """Check that the training rows have no measured class labels, or at level few_shot at most `shots` per class."""
        measured = self.train.domain == MEASURED
        if self.level != "few_shot":
            if self.shots:
                raise LeakError(
                    f"supervision={self.level} allows no labelled recordings, but shots is {self.shots}; set supervision.shots=0"
                )
            if measured.any():
                name = self.train.recording[measured][0]
                raise LeakError(f"measured recording {name} is in training, but supervision={self.level} allows no measured labels")
            return
        shots = {label: np.unique(self.train.recording[measured & (self.train.label == label)]).size for label in self.train.classes}
        if over := [label for label, count in shots.items() if count > self.shots]:
            raise LeakError(f"training has {shots[over[0]]} measured recordings of {over[0]}, but supervision.shots is {self.shots}")

    @property
    def simulated(self) -> Samples:
        return self.train.take(self.train.domain == SIMULATED)

    @property
    def labelled(self) -> Samples:
        """Return the measured training rows with class labels; there are none except at level few_shot."""
        return self.train.take(self.train.domain == MEASURED)


def label_free(simulated: Samples, measured: Samples) -> Split:
    """Return the division of the feature rows in which a classifier trains on simulated rows only and is tested on every measured
    recording.
    """
    return Split("label_free", simulated, measured)


def simulation_only(simulated: Samples) -> Split:
    """Return the division of simulated feature rows that a classifier trains on if there are no measured recordings."""
    return Split("label_free", simulated, simulated.take(np.zeros(len(simulated), dtype=bool)), tested=False)


def draw_shots(measured: Samples, shots: int, seed: int) -> tuple[Samples, Samples]:
    """Draw `shots` random recordings per class for training from one half of the class's sources; the other half is for testing.

    A source is a stored recording, from which several recordings may be cut. The test rows depend on `seed` but not on `shots`.

    Returns: the training rows and the test rows.
    Raises:
        InputError: half of a class's sources hold fewer recordings than `shots`.
    """
    rng = np.random.default_rng([seed, 0x5B])
    drawn: list[str] = []
    scored: list[str] = []
    for label in measured.classes:
        class_rows = measured.take(measured.label == label)
        sources = rng.permutation(np.unique(class_rows.source))
        pool = np.unique(class_rows.recording[np.isin(class_rows.source, sources[: len(sources) // 2])])
        if len(pool) < max(shots, 1):
            raise InputError(
                f"half of the stored recordings of {label} give {len(pool)} training recordings; lower supervision.shots from {shots}"
            )
        drawn.extend(rng.permutation(pool)[:shots])
        scored.extend(sources[len(sources) // 2 :])
    return measured.take(np.isin(measured.recording, drawn)), measured.take(np.isin(measured.source, scored))


def most_shots(measured: Samples) -> int:
    """Return the largest number of training recordings per class that `draw_shots` can draw with every seed."""
    fewest = []
    for label in measured.classes:
        class_rows = measured.take(measured.label == label)
        counts = sorted(np.unique(class_rows.recording[class_rows.source == source]).size for source in np.unique(class_rows.source))
        fewest.append(sum(counts[: len(counts) // 2]))
    return min(fewest)


def shuffled(samples: Samples, seed: int) -> Samples:
    """Return the rows with class labels permuted at random between stored recordings, so that a trained classifier can only guess."""
    _, first, inverse = np.unique(samples.source, return_index=True, return_inverse=True)
    permuted = np.random.default_rng([seed, 0x5F]).permutation(samples.label[first])
    return replace(samples, label=permuted[inverse])


def as_domains(samples: Samples) -> Samples:
    """Return the same rows with the domain (simulated or measured) as class label instead of the object."""
    return replace(samples, label=samples.domain.copy())
