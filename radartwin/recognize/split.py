"""Who may be learned from: a split that refuses what its supervision level does not allow.

Levels (paper, scene-level recognition across supervision levels): `label_free` learns from simulation, and sees measured rows only without
their labels, for normalisation; `calibrated` adds recordings of the calibration object, which is then not scored; `few_shot` adds labelled
measured recordings, a number per class. Every recogniser is fitted to a `Split`, so a measured label has no other way into training.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from radartwin.errors import InputError
from radartwin.recognize.samples import MEASURED, SIMULATED, Samples, Unlabelled

Level = Literal["label_free", "calibrated", "few_shot"]
LEVELS: tuple[Level, ...] = ("label_free", "calibrated", "few_shot")


class LeakError(InputError):
    """Something would be learned from that the supervision level does not allow, or that is scored."""


@dataclass(frozen=True, eq=False)
class Split:
    """What is learned from, and what is scored.

    Attributes:
        level: what of the measured domain is known.
        train: labelled rows; simulated, and at few_shot `shots` measured recordings per class at most.
        test: measured rows to score; their labels are for scoring alone.
        shots: few_shot: measured recordings per class that training may hold.
        calibration_object: calibrated: what was recorded for calibration; it is not scored.
    Raises:
        LeakError: rows in training or in the test that the level forbids.
    """

    level: Level
    train: Samples
    test: Samples
    shots: int = 0
    calibration_object: str = ""
    unlabelled: Unlabelled = field(init=False)  # the rows to score as training may see them: for normalisation

    def __post_init__(self) -> None:
        if self.level not in LEVELS:
            raise LeakError(f"supervision level {self.level!r} is unknown; use one of {', '.join(LEVELS)}")
        if self.train.names != self.test.names:
            raise LeakError("training and test rows have different features; compute both with the same feature set")
        if not len(self.train) or not len(self.test):
            raise LeakError("a split needs rows to learn from and rows to score")
        if (self.test.domain != MEASURED).any():
            raise LeakError("a simulated recording is among those to score; score measured recordings alone")
        if shared := np.intersect1d(self.train.recording, self.test.recording).tolist():
            raise LeakError(f"recording {shared[0]} is learned from and scored; split by recording, never by frame")
        self._check_labels()
        if (self.level == "calibrated") != bool(self.calibration_object):
            raise LeakError("supervision=calibrated, and no other level, names its calibration object")
        if self.calibration_object and (self.test.label == self.calibration_object).any():
            raise LeakError(f"{self.calibration_object} was recorded for calibration and cannot be scored; leave it out of the test")
        object.__setattr__(self, "unlabelled", self.test.unlabelled())

    def _check_labels(self) -> None:
        """Measured labels in training: none, or `shots` recordings per class."""
        measured = self.train.domain == MEASURED
        if self.level != "few_shot":
            if self.shots:
                raise LeakError(f"supervision={self.level} has no labelled recordings, but shots is {self.shots}")
            if measured.any():
                name = self.train.recording[measured][0]
                raise LeakError(
                    f"measured recording {name} is among those to learn from, and supervision={self.level} knows no measured label"
                )
            return
        shots = {label: np.unique(self.train.recording[measured & (self.train.label == label)]).size for label in self.train.classes}
        if over := [label for label, count in shots.items() if count > self.shots]:
            raise LeakError(
                f"{shots[over[0]]} measured recordings of {over[0]} are to be learned from, but supervision.shots is {self.shots}"
            )

    @property
    def simulated(self) -> Samples:
        return self.train.take(self.train.domain == SIMULATED)

    @property
    def labelled(self) -> Samples:
        """The measured recordings that training may see with their labels; empty but at few_shot."""
        return self.train.take(self.train.domain == MEASURED)


def label_free(simulated: Samples, measured: Samples) -> Split:
    """Learn from simulation alone, score every measured recording."""
    return Split("label_free", simulated, measured)


def draw_shots(measured: Samples, shots: int, seed: int) -> tuple[Samples, Samples]:
    """`shots` recordings of each class drawn at random, and the others: (to learn from, to score), both balanced as drawn.

    Raises:
        InputError: a class that would leave no recording to score.
    """
    rng = np.random.default_rng([seed, shots])
    chosen: list[str] = []
    for label in measured.classes:
        recordings = np.unique(measured.recording[measured.label == label])
        if len(recordings) <= shots:
            raise InputError(f"{shots} labelled recordings of {label} leave none of its {len(recordings)} to score; use fewer")
        chosen.extend(rng.permutation(recordings)[:shots])
    taken = np.isin(measured.recording, chosen)
    return measured.take(taken), measured.take(~taken)


def shuffled(samples: Samples, seed: int) -> Samples:
    """The same recordings with their labels dealt anew: whatever is learned from them is at chance. Class sizes stay."""
    names, first, inverse = np.unique(samples.recording, return_index=True, return_inverse=True)
    dealt = np.random.default_rng([seed, 0x5F]).permutation(samples.label[first])
    assert len(dealt) == len(names)
    return Samples(samples.names, samples.values, samples.recording, samples.stratum, samples.domain, dealt[inverse])


def mixed_domains(samples: Samples, seed: int) -> Samples:
    """Rows of both domains labelled by a domain dealt at random over recordings: a domain classifier on it is at chance."""
    return shuffled(as_domains(samples), seed)


def as_domains(samples: Samples) -> Samples:
    """Rows labelled by their domain instead of their object."""
    return Samples(samples.names, samples.values, samples.recording, samples.stratum, samples.domain, samples.domain.copy())
