"""Who may be learned from: a split that refuses what its supervision level does not allow.

Levels (paper, scene-level recognition across supervision levels): `label_free` learns from simulation, and sees measured rows only without
their labels, for normalisation; `calibrated` adds recordings of the calibration object, which is then not scored; `few_shot` adds labelled
measured recordings, a number per class. Every recogniser is fitted to a `Split`, so a measured label has no other way into training.
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
        if shared := np.intersect1d(self.train.source, self.test.source).tolist():
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
    """`shots` recordings of each class drawn at random from one half of its sources, and all of the other half: (to learn from, to score).

    For one seed what is scored is the same for every number of shots.

    Raises:
        InputError: a class with one source alone, or with too few recordings in the half that is drawn from.
    """
    rng = np.random.default_rng([seed, 0x5B])
    chosen: list[str] = []
    scored: list[str] = []
    for label in measured.classes:
        own = measured.take(measured.label == label)
        sources = rng.permutation(np.unique(own.source))
        pool = np.unique(own.recording[np.isin(own.source, sources[: len(sources) // 2])])
        if len(pool) < max(shots, 1):
            raise InputError(f"{shots} labelled recordings of {label} are more than half of its sources hold ({len(pool)}); use fewer")
        chosen.extend(rng.permutation(pool)[:shots])
        scored.extend(sources[len(sources) // 2 :])
    return measured.take(np.isin(measured.recording, chosen)), measured.take(np.isin(measured.source, scored))


def most_shots(measured: Samples) -> int:
    """The largest number of recordings per class that `draw_shots` can draw with any seed."""
    fewest = []
    for label in measured.classes:
        own = measured.take(measured.label == label)
        counts = sorted(np.unique(own.recording[own.source == source]).size for source in np.unique(own.source))
        fewest.append(sum(counts[: len(counts) // 2]))
    return min(fewest)


def shuffled(samples: Samples, seed: int) -> Samples:
    """The same rows with the labels of their sources dealt anew: whatever is learned from them is at chance. Class sizes stay."""
    _, first, inverse = np.unique(samples.source, return_index=True, return_inverse=True)
    dealt = np.random.default_rng([seed, 0x5F]).permutation(samples.label[first])
    return replace(samples, label=dealt[inverse])


def mixed_domains(samples: Samples, seed: int) -> Samples:
    """Rows of both domains labelled by a domain dealt at random over recordings: a domain classifier on it is at chance."""
    return shuffled(as_domains(samples), seed)


def as_domains(samples: Samples) -> Samples:
    """Rows labelled by their domain instead of their object."""
    return replace(samples, label=samples.domain.copy())
