"""The learner `trees`: gradient-boosted trees on feature vectors, as a baseline that needs no text and no scaling of the features.

Ref: J. Friedman, Greedy function approximation: a gradient boosting machine, Annals of Statistics 29, 2001; G. Ke et al., LightGBM, NeurIPS
2017 (histograms), as scikit-learn's HistGradientBoostingClassifier implements them. The embedding of a row is the vector of its K log class
probabilities, so that the same probes classify it. The vector has one coordinate per training class, and a row of any other class has such
an embedding too.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import InputError
from radartwin.recognize.encoder import Settings
from radartwin.recognize.learners.interface import Reads
from radartwin.recognize.samples import Samples, Unlabelled
from radartwin.recognize.split import Split

SMALLEST = 1e-3  # smallest probability in an embedding; the training rows of a campaign (about 1440) do not support smaller ones
LEAF_ROWS = 20  # scikit-learn's default of the fewest training rows in a leaf


@dataclass(frozen=True, eq=False)
class Forest:
    """Trained trees. `model` is the scikit-learn classifier."""

    model: Any

    @property
    def classes(self) -> tuple[str, ...]:
        return tuple(map(str, self.model.classes_))

    def embedded(self, samples: Samples) -> Samples:
        names = [f"log probability {label}" for label in self.classes]
        return samples.with_values(np.log(np.maximum(self.probabilities(samples), SMALLEST)), names)

    def predict(self, rows: Unlabelled) -> NDArray[np.str_]:
        return np.array(self.classes)[self.probabilities(rows).argmax(axis=1)]

    def probabilities(self, rows: Unlabelled) -> NDArray[np.float64]:
        with _one_thread():
            return self.model.predict_proba(rows.values)


@dataclass(frozen=True)
class Trees:
    """Gradient-boosted trees before the training.

    The number of trees is fixed, because scikit-learn's early stopping holds out single rows, and noisy copies of a held-out row would
    remain in the training. Every class has the same total weight. The settings of the encoder and the text embeddings have no effect.

    Attributes:
        iterations: number of trees per class. The default is that of scikit-learn.
        learning_rate: factor of each tree's contribution. The default is that of scikit-learn.
        leaves: largest number of leaves of a tree, smaller than scikit-learn's 31, because a class has about a hundred training rows.
    """

    iterations: int = 100
    learning_rate: float = 0.1
    leaves: int = 8
    reads: Reads = "features"

    def fit(self, split: Split, anchors: Mapping[str, NDArray], settings: Settings, seed: int) -> Forest:
        from sklearn.ensemble import HistGradientBoostingClassifier

        rows = split.train
        if len(rows.classes) < 2:
            raise InputError(f"trees: all training rows have the class {''.join(rows.classes)}; give at least two classes")
        fewest = int(np.unique(rows.label, return_counts=True)[1].min())
        options: dict[str, Any] = {"early_stopping": False, "class_weight": "balanced", "random_state": seed}
        model = HistGradientBoostingClassifier(
            max_iter=self.iterations, learning_rate=self.learning_rate, max_leaf_nodes=self.leaves,
            min_samples_leaf=max(1, min(LEAF_ROWS, fewest // 2)), **options,
        )  # fmt: skip
        with _one_thread():
            return Forest(model.fit(rows.values, rows.label))


def _one_thread():
    """Return a context in which scikit-learn computes on one thread, because many workers train at the same time."""
    from threadpoolctl import threadpool_limits

    return threadpool_limits(1)
