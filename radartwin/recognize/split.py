"""Split rows into training and test rows. A split raises LeakError for training rows that its supervision level does not allow.

Levels (paper, scene-level recognition across supervision levels): `label_free` trains on simulation and uses unlabelled measured rows only
for normalisation. `calibrated` adds recordings of the calibration object, which is then not scored. `few_shot` adds a number of labelled
measured recordings per class. Every classifier is fitted to a `Split`, so measured labels cannot reach training in any other way.
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
    """Raised if training would use rows that the supervision level does not allow, or rows that are scored."""


@dataclass(frozen=True, eq=False)
class Split:
    """Training rows and test rows.

    Attributes:
        level: supervision level.
        train: labelled rows: all simulated rows, and at level few_shot at most `shots` measured recordings per class.
        test: measured rows to score; their labels are used for scoring only.
        shots: maximum number of measured recordings per class in training, at level few_shot.
        calibration_object: object of the calibration recording at level calibrated; it is not scored.
        unlabelled: the test rows without labels, which training may use for normalisation.
    Raises:
        LeakError: the level forbids some of the training or test rows.
    """

    level: Level
    train: Samples
    test: Samples
    shots: int = 0
    calibration_object: str = ""
    unlabelled: Unlabelled = field(init=False)

    def __post_init__(self) -> None:
        if self.level not in LEVELS:
            raise LeakError(f"supervision level {self.level!r} is unknown; choose {', '.join(LEVELS)}")
        if self.train.names != self.test.names:
            raise LeakError("training and test rows have different features; compute both with the same feature set")
        if not len(self.train) or not len(self.test):
            raise LeakError("a split needs training rows and test rows")
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
        """Check that training has no measured labels, or at level few_shot those of at most `shots` recordings per class."""
        measured = self.train.domain == MEASURED
        if self.level != "few_shot":
            if self.shots:
                raise LeakError(f"supervision={self.level} has no labelled recordings, but shots is {self.shots}")
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
        """Return the measured training rows; empty except at level few_shot."""
        return self.train.take(self.train.domain == MEASURED)


def label_free(simulated: Samples, measured: Samples) -> Split:
    """Return the split that trains on simulation only and scores every measured recording."""
    return Split("label_free", simulated, measured)


def draw_shots(measured: Samples, shots: int, seed: int) -> tuple[Samples, Samples]:
    """Draw `shots` random recordings per class from one half of the class's sources for training, and test on the other half.

    The test rows depend on the seed but not on `shots`.

    Returns: training rows and test rows.
    Raises:
        InputError: half of a class's sources hold fewer recordings than `shots`.
    """
    rng = np.random.default_rng([seed, 0x5B])
    chosen: list[str] = []
    scored: list[str] = []
    for label in measured.classes:
        own = measured.take(measured.label == label)
        sources = rng.permutation(np.unique(own.source))
        pool = np.unique(own.recording[np.isin(own.source, sources[: len(sources) // 2])])
        if len(pool) < max(shots, 1):
            raise InputError(f"half of the sources of {label} hold {len(pool)} recordings; lower supervision.shots from {shots}")
        chosen.extend(rng.permutation(pool)[:shots])
        scored.extend(sources[len(sources) // 2 :])
    return measured.take(np.isin(measured.recording, chosen)), measured.take(np.isin(measured.source, scored))


def most_shots(measured: Samples) -> int:
    """Return the largest number of recordings per class that `draw_shots` can draw with every seed."""
    fewest = []
    for label in measured.classes:
        own = measured.take(measured.label == label)
        counts = sorted(np.unique(own.recording[own.source == source]).size for source in np.unique(own.source))
        fewest.append(sum(counts[: len(counts) // 2]))
    return min(fewest)


def shuffled(samples: Samples, seed: int) -> Samples:
    """Return the same rows with labels permuted over sources, so that a classifier trained on them is correct only by chance."""
    _, first, inverse = np.unique(samples.source, return_index=True, return_inverse=True)
    permuted = np.random.default_rng([seed, 0x5F]).permutation(samples.label[first])
    return replace(samples, label=permuted[inverse])


def as_domains(samples: Samples) -> Samples:
    """Return the rows labelled by their domain instead of their object."""
    return replace(samples, label=samples.domain.copy())
