"""The contrastive encoder: it maps radar features into the space of the text embeddings of object descriptions.

Ref: paper, contrastive sim-real alignment; A. van den Oord et al., arXiv:1807.03748 (InfoNCE); A. Radford et al., CLIP, ICML 2021.
Symbols: x -> features (D,), z = f(x) / |f(x)| with f(x) = W2 relu(W1 x + b1) + b2, t_k -> unit text vector of object k, tau -> temperature.
Loss of a row of object k: -log( exp(z.t_k / tau) / sum_j exp(z.t_j / tau) ). The symmetric loss adds the same from text to radar over the
rows of a batch. The paired term is InfoNCE between simulated and measured rows of the same case (object and stratum); it needs labelled
measured recordings.

Training (training.py) needs torch. A trained encoder is a few arrays, so computing embeddings needs NumPy only.
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
    """Settings of the training. None was chosen on measured recordings: experiments/recognition/recognition_choices.json has the reasons.

    Attributes:
        hidden: width of the hidden layer.
        temperature: tau.
        epochs: maximum number of epochs; without held-out simulated rows, the exact number.
        patience: training stops after this many epochs without a lower loss on the held-out simulated rows.
        batch: rows per step.
        learning_rate, weight_decay: settings of AdamW.
        symmetric: whether to add InfoNCE from text to radar.
        paired: weight of the paired term in the loss; 0 leaves it out.
    """

    hidden: int = 128
    temperature: float = 0.07
    epochs: int = 100
    patience: int = 10
    batch: int = 512
    learning_rate: float = 3e-3
    weight_decay: float = 1e-4
    symmetric: bool = False
    paired: float = 0.0


DEFAULTS = Settings()


@dataclass(frozen=True, eq=False)
class Encoder:
    """A trained encoder. `weights` holds float32 arrays by the names in WEIGHTS, of shapes (H, D), (H,), (T, H) and (T,)."""

    weights: Mapping[str, NDArray[np.float32]]

    def __post_init__(self) -> None:
        shapes = {name: self.weights[name].shape for name in WEIGHTS if name in self.weights}
        hidden, text = (shapes.get(name, (0,))[0] for name in ("hidden_bias", "output_bias"))
        if len(shapes) != len(WEIGHTS) or shapes["hidden_weight"] != (hidden, self.size) or shapes["output_weight"] != (text, hidden):
            raise InputError(f"encoder: weights of shapes {shapes} are not those of two layers; export the model again")

    @property
    def size(self) -> int:
        return self.weights["hidden_weight"].shape[-1]

    def embed(self, values: NDArray) -> NDArray[np.float32]:
        """Map features (N, D) to embeddings, unit vectors (N, T)."""
        if values.ndim != 2 or values.shape[1] != self.size:
            raise InputError(f"encoder: needs features of shape (N, {self.size}), not {values.shape}")
        w = self.weights
        hidden = np.maximum(values.astype(np.float32) @ w["hidden_weight"].T + w["hidden_bias"], 0)
        out = hidden @ w["output_weight"].T + w["output_bias"]
        return out / np.maximum(np.linalg.norm(out, axis=1, keepdims=True), np.finfo(np.float32).tiny)

    def embedded(self, samples: Samples) -> Samples:
        """Return the same rows with their embeddings as features."""
        vectors = self.embed(samples.values)
        return samples.with_values(vectors, [f"embedding {number}" for number in range(vectors.shape[1])])


def text_scores(vectors: NDArray, anchors: NDArray, temperature: float) -> NDArray[np.float64]:
    """Return class probabilities (N, K): the softmax over classes of the similarity of embeddings (N, T) to text vectors (K, T)."""
    from scipy.special import softmax

    return softmax(vectors.astype(np.float64) @ anchors.astype(np.float64).T / temperature, axis=1)


def nearest_text(encoder: Encoder, rows: Unlabelled, anchors: Mapping[str, NDArray], temperature: float) -> NDArray[np.str_]:
    """Return for each recording, (recordings,), the object whose description is nearest to most rows of the recording."""
    from radartwin.recognize.probes import vote

    classes = sorted(anchors)
    scores = text_scores(encoder.embed(rows.values), np.stack([anchors[label] for label in classes]), temperature)
    return vote(rows.recording, scores, np.array(classes))
