"""Architectures that training.py trains: their interface `Network`, and the two-layer network of `Encoder`.

A network draws initial weights, maps feature rows to embeddings with torch, and makes an encoder from trained weights. The training loop
therefore needs no knowledge of the layers.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from radartwin.recognize.encoder import WEIGHTS, Encoder, Settings

E_co = TypeVar("E_co", covariant=True)


class Network(Protocol[E_co]):
    """An architecture that `train` trains. Weights are torch tensors; `x` is a torch tensor of N feature rows (N, D)."""

    def initial(self, rng: np.random.Generator, size: int, out: int, settings: Settings) -> list[NDArray[np.float32]]:
        """Draw the initial weights for `size` features and embeddings of length `out`."""
        ...

    def forward(self, weights: Sequence[Any], x: Any) -> Any:
        """Map feature rows (N, D) to embeddings (N, T), which are unit vectors."""
        ...

    def augmented(self, rng: np.random.Generator, x: Any) -> Any:
        """Return randomly changed feature rows (N, D) for one training step, or `x` itself."""
        ...

    def encoder(self, weights: Sequence[NDArray[np.float32]]) -> E_co:
        """Return the encoder with the trained weights."""
        ...


class TwoLayers:
    """The network of `Encoder`: two linear layers with a rectifier between them."""

    def initial(self, rng: np.random.Generator, size: int, out: int, settings: Settings) -> list[NDArray[np.float32]]:
        return [
            weights
            for inputs, outputs in ((size, settings.hidden), (settings.hidden, out))
            for weights in uniform(rng, (outputs, inputs))
        ]  # fmt: skip

    def forward(self, weights: Sequence[Any], x: Any) -> Any:
        import torch
        from torch.nn.functional import linear, normalize

        return normalize(linear(torch.relu(linear(x, weights[0], weights[1])), weights[2], weights[3]), dim=1)

    def augmented(self, rng: np.random.Generator, x: Any) -> Any:
        return x

    def encoder(self, weights: Sequence[NDArray[np.float32]]) -> Encoder:
        return Encoder(dict(zip(WEIGHTS, weights, strict=True)))


TWO_LAYERS = TwoLayers()


def uniform(rng: np.random.Generator, shape: tuple[int, ...]) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Draw the weights (outputs, ...) and biases (outputs,) of a layer within +-1/sqrt(number of inputs), as torch.nn.Linear does."""
    bound = float(np.prod(shape[1:])) ** -0.5
    weights, biases = (rng.uniform(-bound, bound, size).astype(np.float32) for size in (shape, shape[:1]))
    return weights, biases
