"""The interface of all learners: train on a split, then embed feature rows and predict the class of each row.

A table can therefore train several kinds of learner on the same split and classify their embeddings with the same probes (probes.py).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from radartwin.recognize.encoder import Settings, text_scores
from radartwin.recognize.samples import Samples, Unlabelled
from radartwin.recognize.split import Split

Reads = Literal["features", "pictures"]


class Fitted(Protocol):
    """A trained learner. `classes` holds the names of the K training classes, sorted."""

    @property
    def classes(self) -> tuple[str, ...]: ...

    def embedded(self, samples: Samples) -> Samples:
        """Return the same rows with their values replaced by embeddings (N, T). The class labels of the rows are not used."""
        ...

    def predict(self, rows: Unlabelled) -> NDArray[np.str_]:
        """Return for each row (N,) the most likely training class. No measured class label is used."""
        ...

    def probabilities(self, rows: Unlabelled) -> NDArray[np.float64]:
        """Return the class probabilities (N, K) of each row, for equally frequent classes."""
        ...


class Learner(Protocol):
    """A kind of classifier before its training.

    Attributes:
        reads: the rows that the learner takes. "features" are feature vectors of comparable scales, as `probes.standardised` returns them.
            "pictures" are flattened pictures (`features.range_time.flattened`), with levels from 0 to 1 that are not scaled further.
    """

    @property
    def reads(self) -> Reads: ...

    def fit(self, split: Split, anchors: Mapping[str, NDArray], settings: Settings, seed: int) -> Fitted:
        """Train on the training rows of `split` only.

        Args:
            split: training rows with class labels, and test rows, which the training does not use.
            anchors: text embedding of every class in the training rows, a unit vector (T,) by class name.
            seed: seed of all random numbers in the training; the same seed gives the same bytes.
        Raises:
            InputError: the training rows do not fit the learner, or a class has no text embedding.
        """
        ...


class Embedder(Protocol):
    """An encoder, which maps radar features (N, D) to embeddings (N, T), unit vectors in the space of the text embeddings."""

    def embed(self, values: NDArray) -> NDArray[np.float32]: ...


@dataclass(frozen=True, eq=False)
class TextClassifier:
    """A trained encoder with the text embeddings of the training classes. A row's class is the class of the nearest text embedding.

    Attributes:
        encoder: the trained encoder.
        classes: names of the K training classes, sorted.
        texts: (K, T) text embedding of each class.
        epochs: number of epochs of the training.
        temperature: divisor of the similarities in the softmax over the classes.
    """

    encoder: Embedder
    classes: tuple[str, ...]
    texts: NDArray[np.float32]
    epochs: int
    temperature: float

    def embedded(self, samples: Samples) -> Samples:
        vectors = self.encoder.embed(samples.values)
        return samples.with_values(vectors, [f"embedding {number}" for number in range(vectors.shape[1])])

    def predict(self, rows: Unlabelled) -> NDArray[np.str_]:
        return np.array(self.classes)[self.probabilities(rows).argmax(axis=1)]

    def probabilities(self, rows: Unlabelled) -> NDArray[np.float64]:
        return text_scores(self.encoder.embed(rows.values), self.texts, self.temperature)


def text_classifier(encoder: Embedder, split: Split, anchors: Mapping[str, NDArray], epochs: int, settings: Settings) -> TextClassifier:
    """Return the classifier by nearest text embedding among the classes of the split's training rows."""
    classes = split.train.classes
    texts = np.stack([anchors[label] for label in classes]).astype(np.float32)
    return TextClassifier(encoder, classes, texts, epochs, settings.temperature)
