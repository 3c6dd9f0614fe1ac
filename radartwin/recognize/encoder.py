"""The contrastive encoder: it maps radar features to the vector space of the text embeddings of object descriptions.

Ref: paper, contrastive sim-real alignment; A. van den Oord et al., arXiv:1807.03748 (InfoNCE); A. Radford et al., CLIP, ICML 2021.
Symbols: x -> features (D,), z = f(x) / |f(x)| with f(x) = W2 relu(W1 x + b1) + b2, t_k -> unit text vector of object k, tau -> temperature.
The training loss of a feature row of object k is -log( exp(z.t_k / tau) / sum_j exp(z.t_j / tau) ). The paired loss term is InfoNCE
between simulated and measured feature rows of the same object under the same conditions; it needs labelled measured recordings.

Training (training.py) needs torch. A trained encoder consists of a few arrays, so computing embeddings with it needs only NumPy.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import InputError
from radartwin.recognize.samples import Samples, Unlabelled

WEIGHTS = ("hidden_weight", "hidden_bias", "output_weight", "output_bias")


@dataclass(frozen=True)
class Settings:
    """Settings of the encoder's training. experiments/recognition/recognition_choices.json gives the reason for each default value.

    No default value was chosen by looking at measured recordings.

    Attributes:
        hidden: number of units in the encoder's hidden layer.
        temperature: the temperature tau that divides similarities in the training loss.
        epochs: maximum number of training epochs; the exact number if no simulated recordings are held out.
        patience: training stops after this many epochs without a lower loss on the held-out simulated recordings.
        batch: number of feature rows per optimiser step.
        learning_rate, weight_decay: settings of the optimiser AdamW.
        paired: weight of the paired term (simulated against measured rows) in the training loss; 0 leaves the term out.
    """

    hidden: int = 128
    temperature: float = 0.07
    epochs: int = 100
    patience: int = 10
    batch: int = 512
    learning_rate: float = 3e-3
    weight_decay: float = 1e-4
    paired: float = 0.0


DEFAULTS = Settings()


@dataclass(frozen=True, eq=False)
class Encoder:
    """A trained encoder. `weights` maps the names in WEIGHTS to float32 arrays of shapes (H, D), (H,), (T, H) and (T,)."""

    weights: Mapping[str, NDArray[np.float32]]

    def __post_init__(self) -> None:
        shapes = {name: self.weights[name].shape for name in WEIGHTS if name in self.weights}
        hidden, text = (shapes.get(name, (0,))[0] for name in ("hidden_bias", "output_bias"))
        if len(shapes) != len(WEIGHTS) or shapes["hidden_weight"] != (hidden, self.size) or shapes["output_weight"] != (text, hidden):
            raise InputError(f"encoder: weights of shapes {shapes} are not those of two layers; train the model again")

    @property
    def size(self) -> int:
        return self.weights["hidden_weight"].shape[-1]

    def embed(self, values: NDArray) -> NDArray[np.float32]:
        """Map radar features (N, D) to embeddings (N, T), which are unit vectors."""
        if values.ndim != 2 or values.shape[1] != self.size:
            raise InputError(f"encoder: needs features of shape (N, {self.size}), not {values.shape}")
        w = self.weights
        hidden = np.maximum(values.astype(np.float32) @ w["hidden_weight"].T + w["hidden_bias"], 0)
        out = hidden @ w["output_weight"].T + w["output_bias"]
        return out / np.maximum(np.linalg.norm(out, axis=1, keepdims=True), np.finfo(np.float32).tiny)

    def embedded(self, samples: Samples) -> Samples:
        """Return the same rows with their radar features replaced by the encoder's embeddings."""
        vectors = self.embed(samples.values)
        return samples.with_values(vectors, [f"embedding {number}" for number in range(vectors.shape[1])])


def text_scores(vectors: NDArray, anchors: NDArray, temperature: float) -> NDArray[np.float64]:
    """Return class probabilities (N, K): a softmax over the similarities of N radar embeddings (N, T) to K class text vectors (K, T)."""
    from scipy.special import softmax

    return softmax(vectors.astype(np.float64) @ anchors.astype(np.float64).T / temperature, axis=1)


def nearest_text(encoder: Encoder, rows: Unlabelled, anchors: Mapping[str, NDArray], temperature: float) -> NDArray[np.str_]:
    """Return for each recording, (recordings,), the object whose text vector is nearest to most feature rows of the recording."""
    from radartwin.recognize.probes import vote

    classes = sorted(anchors)
    scores = text_scores(encoder.embed(rows.values), np.stack([anchors[label] for label in classes]), temperature)
    return vote(rows.recording, scores, np.array(classes))
