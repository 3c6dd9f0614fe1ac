"""The learner `convolution`: a small convolutional network. Its input is a picture of a turntable revolution with two channels
(features/range_time.py).

Channel 0 of a picture (range over time) and channel 1 (range over Doppler frequency) have different rows. Each of the two input channels
therefore has its own branch. A branch has three convolutions with 16, 32 and 32 output channels. A linear layer maps both branches together
to the space of the text embeddings.

- The time branch is circular over the revolution. It keeps all rows and takes the largest and the mean value over time, so a start of the
  revolution that is later by whole rows does not change the embedding. Its kernels have dilations of 1, 2 and 4 rows. Each output value of
  the third convolution therefore depends on 15 of the 24 rows, more than half of a revolution.
- The Doppler branch halves the number of rows three times and does not average over the remaining rows, because the Doppler frequency is
  absolute.
- The first convolution of each branch keeps every third column (range bin), and each further convolution keeps every second one.

Training shifts channel 0 circularly by a random time, because the start angle of a measured revolution is unknown. The shift is a fraction
of a row, because a shift by whole rows does not change the embedding. The interpolation between rows is linear. The initial weights follow
K. He et al., Delving deep into rectifiers, ICCV 2015.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import InputError
from radartwin.features.range_time import SHAPE
from radartwin.recognize.encoder import Settings
from radartwin.recognize.learners.interface import Reads, TextClassifier, text_classifier
from radartwin.recognize.split import Split
from radartwin.recognize.training import fit_network, one_thread

CHANNELS = (1, 16, 32, 32)
SPACINGS = (1, 2, 4)  # distance of the time branch's kernel rows in each convolution
WIDTHS, STRIDES = (5, 3, 3), (3, 2, 2)  # columns of the kernels, and the columns from one output to the next
BLOCK = 512  # rows that are embedded together, to limit the memory


@dataclass(frozen=True)
class Convolution:
    """The convolutional network before its training.

    Attributes:
        shape: shape (2, H, W) of the pictures.
        batch, epochs, patience: upper limits of the settings of the same name. A convolution applies each weight to many cells, so it needs
            fewer epochs of more steps than the two-layer network. These limits were chosen by the accuracy on synthetic pictures of 12
            classes.
    """

    shape: tuple[int, int, int] = SHAPE
    batch: int = 64
    epochs: int = 12
    patience: int = 3
    reads: Reads = "pictures"

    def fit(self, split: Split, anchors: Mapping[str, NDArray], settings: Settings, seed: int) -> TextClassifier:
        if split.train.values.shape[1] != int(np.prod(self.shape)):
            raise InputError(f"convolution: rows of {split.train.values.shape[1]} values are not pictures of shape {self.shape}")
        limits = {name: min(getattr(settings, name), getattr(self, name)) for name in ("batch", "epochs", "patience")}
        trained = fit_network(_Branches(self.shape), split, anchors, replace(settings, **limits), seed)
        return text_classifier(trained.encoder, split, anchors, trained.epochs, settings)


@dataclass(frozen=True, eq=False)
class PictureEncoder:
    """A trained convolutional encoder of pictures (2, H, W). `weights` holds the arrays in the order of `_Branches.initial`."""

    shape: tuple[int, int, int]
    weights: tuple[NDArray[np.float32], ...]

    def embed(self, values: NDArray) -> NDArray[np.float32]:
        """Map flattened pictures (N, 2 * H * W) to embeddings (N, T), which are unit vectors."""
        import torch

        if values.ndim != 2 or values.shape[1] != int(np.prod(self.shape)):
            raise InputError(f"convolution: needs flattened pictures of shape {self.shape}, not rows of shape {values.shape}")
        network, weights = _Branches(self.shape), [torch.from_numpy(array) for array in self.weights]
        blocks = torch.from_numpy(values.astype(np.float32)).split(BLOCK)
        with one_thread(), torch.no_grad():
            return torch.cat([network.forward(weights, block) for block in blocks]).numpy()


@dataclass(frozen=True)
class _Branches:
    """The architecture, as the module's docstring describes it, for training.py."""

    shape: tuple[int, int, int]

    def initial(self, rng: np.random.Generator, size: int, out: int, settings: Settings) -> list[NDArray[np.float32]]:
        """Return weights and biases of three convolutions per branch and of the last layer, seven pairs."""
        kernels = [(outputs, inputs, 3, width) for (inputs, outputs), width in zip(itertools.pairwise(CHANNELS), WIDTHS, strict=True)]
        rows, columns = self.shape[1:]
        for stride in STRIDES:
            rows, columns = -(-rows // 2), -(-columns // stride)
        last = (out, CHANNELS[-1] * columns * (2 + rows))
        drawn: list[NDArray[np.float32]] = []
        for shape in (*kernels, *kernels, last):
            bound = (6 / np.prod(shape[1:])) ** 0.5
            drawn += [rng.uniform(-bound, bound, shape).astype(np.float32), np.zeros(shape[0], np.float32)]
        return drawn

    def forward(self, weights: Sequence[Any], x: Any) -> Any:
        import torch
        from torch.nn.functional import conv2d, linear, normalize, pad

        pictures = x.reshape(-1, *self.shape)
        time, doppler = pictures[:, :1], pictures[:, 1:]
        for number, (spacing, width, stride) in enumerate(zip(SPACINGS, WIDTHS, STRIDES, strict=True)):
            # The columns are padded with zeros, the rows of the time branch with the rows of the other end of the revolution.
            side, wrapped = width // 2, pad(time, (0, 0, spacing, spacing), mode="circular")
            kernel, bias = weights[2 * number : 2 * number + 2]
            time = torch.relu(conv2d(wrapped, kernel, bias, stride=(1, stride), padding=(0, side), dilation=(spacing, 1)))
            kernel, bias = weights[6 + 2 * number : 8 + 2 * number]
            doppler = torch.relu(conv2d(doppler, kernel, bias, stride=(2, stride), padding=(1, side)))
        joined = torch.cat([part.flatten(1) for part in (time.amax(dim=2), time.mean(dim=2), doppler)], dim=1)
        return normalize(linear(joined, weights[12], weights[13]), dim=1)

    def augmented(self, rng: np.random.Generator, x: Any) -> Any:
        """Return pictures whose channel 0 is shifted circularly by a random fraction of a row."""
        import torch

        pictures = x.reshape(-1, *self.shape)
        share = torch.from_numpy(rng.random((len(pictures), 1, 1), dtype=np.float32))
        time = pictures[:, 0]
        moved = (1 - share) * time + share * time.roll(1, dims=1)
        return torch.stack([moved, pictures[:, 1]], dim=1).flatten(1)

    def encoder(self, weights: Sequence[NDArray[np.float32]]) -> PictureEncoder:
        return PictureEncoder(self.shape, tuple(weights))
