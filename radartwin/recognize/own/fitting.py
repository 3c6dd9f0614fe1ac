"""Train a recogniser on simulated feature rows, and count its correct answers at distances that its training did not contain."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radartwin.recognize.encoder import Settings
from radartwin.recognize.model import Recogniser
from radartwin.recognize.probes import repeatability, standardised
from radartwin.recognize.samples import Samples
from radartwin.recognize.split import simulation_only
from radartwin.recognize.training import fit


@dataclass(frozen=True)
class Training:
    """How a recogniser is trained.

    Attributes:
        anchors: unit vector (T,) of each class, by class name.
        settings, seed: settings and seed of the encoder's training.
        features: how the features of a recording are computed, see `Recogniser.features`.
    """

    anchors: Mapping[str, NDArray[np.float32]]
    settings: Settings
    seed: int
    features: Mapping[str, Any]

    def recogniser(self, rows: Samples, provenance: Mapping[str, Any] | None = None) -> Recogniser:
        """Train on all rows, which are simulated. The mean of each feature is subtracted. The feature is then divided by its standard
        deviation over the rows or by its repeatability, whichever is larger.
        """
        floor = repeatability(rows.names)
        trained = fit(simulation_only(standardised(rows, floor)), self.anchors, self.settings, self.seed)
        prototypes = np.stack([self.anchors[label] for label in rows.classes])
        return Recogniser(
            trained.encoder, rows.classes, prototypes, self.settings.temperature, rows.names, dict(self.features),
            rows.values.mean(axis=0), np.maximum(rows.values.std(axis=0), floor), {**(provenance or {}), "epochs": trained.epochs},
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Answers for simulated revolutions at distances that the training did not contain.

    Attributes:
        classes: names of the K classes.
        counts: (D, K, K) number of revolutions for each of the D held-out distances, true class and answered class.
        distances: names of the D held-out distances.
    """

    classes: tuple[str, ...]
    counts: NDArray[np.int64]
    distances: tuple[str, ...]

    @property
    def revolutions(self) -> int:
        return int(self.counts.sum())

    @property
    def accuracy(self) -> float:
        """Return the share of correct answers over all held-out distances."""
        return float(np.trace(self.counts, axis1=1, axis2=2).sum() / self.counts.sum())

    @property
    def by_distance(self) -> dict[str, float]:
        """Return the share of correct answers at each held-out distance."""
        correct, all_answers = np.trace(self.counts, axis1=1, axis2=2), self.counts.sum(axis=(1, 2))
        return dict(zip(self.distances, (correct / all_answers).tolist(), strict=True))

    def to_dict(self) -> dict[str, Any]:
        return {"classes": list(self.classes), "distances": list(self.distances), "counts": self.counts.tolist()}

    @classmethod
    def from_dict(cls, described: Mapping[str, Any]) -> HeldOut:
        return cls(tuple(described["classes"]), np.array(described["counts"], dtype=np.int64), tuple(described["distances"]))


def held_out(rows: Samples, training: Training) -> HeldOut | None:
    """Leave out each distance in turn: train on the rows of all other distances, and classify the rows of the left-out distance.

    Returns: the answers; None if all rows have the same distance.
    """
    distances, classes = tuple(map(str, np.unique(rows.stratum))), rows.classes
    if len(distances) < 2:
        return None
    counts = np.zeros((len(distances), len(classes), len(classes)), dtype=np.int64)
    for number, distance in enumerate(distances):
        out = rows.stratum == distance
        answers = training.recogniser(rows.take(~out)).probabilities(rows.values[out]).argmax(axis=1)
        np.add.at(counts[number], (np.searchsorted(classes, rows.label[out]), answers), 1)
    return HeldOut(classes, counts, distances)
