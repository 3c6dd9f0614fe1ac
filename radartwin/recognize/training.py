"""Train the contrastive encoder on a split: AdamW minimises the InfoNCE loss, with early stopping on held-out simulated recordings.

NumPy draws the initial weights, the held-out recordings and the order of the feature rows from one seed. torch computes on one thread, so
the same seed gives the same bytes.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import InputError
from radartwin.recognize.encoder import DEFAULTS, WEIGHTS, Encoder, Settings
from radartwin.recognize.samples import MEASURED, SIMULATED, Samples
from radartwin.recognize.split import Split


@dataclass(frozen=True, eq=False)
class Trained:
    """A trained encoder and the number of epochs of its training."""

    encoder: Encoder
    epochs: int


def fit(split: Split, anchors: Mapping[str, NDArray], settings: Settings = DEFAULTS, seed: int = 0) -> Trained:
    """Train the encoder on the training rows of `split`. All features of the training rows must have comparable scales.

    If the training rows include simulated rows, the encoder is trained twice. The first training holds out one simulated recording per
    class and finds the epoch with the lowest loss on the held-out recordings. The second training uses all training rows for this number of
    epochs. Without simulated rows, the encoder is trained once, for `settings.epochs` epochs.

    Args:
        split: training and test rows; `fit` uses only the training rows.
        anchors: text embedding of every class in the training rows, a unit vector (T,) by class name.
        settings: settings of the training.
        seed: seed of all random numbers in the training.
    Raises:
        InputError: a class has no text embedding, or `settings.paired` is above 0 without labelled measured recordings.
    """
    rows = split.train
    if missing := [label for label in rows.classes if label not in anchors]:
        raise InputError(f"encoder: {missing[0]} has no text anchor; give a description of it")
    if settings.paired and not len(split.labelled):
        raise InputError("encoder.paired needs labelled measured recordings; use supervision=few_shot, or encoder.paired=0")
    held = held_out(split.simulated, seed)
    epochs = settings.epochs
    if held:
        mask = np.isin(rows.recording, list(held))
        losses = train(rows.take(~mask), rows.take(mask), anchors, settings, seed, settings.epochs)[1]
        epochs = int(np.argmin(losses)) + 1
    encoder, _ = train(rows, None, anchors, settings, seed, epochs)
    return Trained(encoder, epochs)


def held_out(simulated: Samples, seed: int) -> frozenset[str]:
    """Draw one simulated recording of each class that has several simulated recordings. Return the names of the drawn recordings."""
    rng = np.random.default_rng([seed, 0xE5])
    drawn = []
    for label in simulated.classes:
        recordings = np.unique(simulated.recording[simulated.label == label])
        if len(recordings) > 1:
            drawn.append(str(rng.choice(recordings)))
    return frozenset(drawn)


def train(
    rows: Samples, held: Samples | None, anchors: Mapping[str, NDArray], settings: Settings, seed: int, epochs: int
) -> tuple[Encoder, tuple[float, ...]]:
    """Train an encoder for `epochs` epochs; training ends earlier if the held-out loss does not decrease for `settings.patience` epochs.

    Returns: the encoder after the last epoch, and the loss on the held-out rows `held` after each epoch.
    """
    import torch

    rng = np.random.default_rng([seed, 0xEC])
    classes = sorted({*rows.classes, *(held.classes if held is not None else ())})
    texts = torch.from_numpy(np.stack([anchors[label] for label in classes]).astype(np.float32))
    index = {label: number for number, label in enumerate(classes)}
    x, y = _tensors(rows, index)
    weight = torch.bincount(y, minlength=len(classes)).float().reciprocal()
    weight = torch.where(torch.isfinite(weight), weight, 0.0)  # every class has the same total weight
    cases = _cases(rows) if settings.paired else []
    losses: list[float] = []
    with _one_thread():
        layers = _layers(rng, x.shape[1], settings.hidden, texts.shape[1])
        optimiser = torch.optim.AdamW(layers, lr=settings.learning_rate, weight_decay=settings.weight_decay)
        for _ in range(epochs):
            order = torch.from_numpy(rng.permutation(len(x)))
            for batch in order.split(settings.batch):
                z = _forward(layers, x[batch])
                loss = text_loss(z, y[batch], texts, weight, settings)
                if cases:
                    pairs = np.array([[rng.choice(ours), rng.choice(theirs)] for ours, theirs in cases])
                    loss = loss + settings.paired * _pair_loss(*(_forward(layers, x[column]) for column in pairs.T), settings.temperature)
                optimiser.zero_grad()
                loss.backward()
                optimiser.step()
            if held is not None:
                with torch.no_grad():
                    hx, hy = _tensors(held, index)
                    losses.append(float(text_loss(_forward(layers, hx), hy, texts, torch.ones_like(weight), settings)))
                if len(losses) - 1 - int(np.argmin(losses)) >= settings.patience:
                    break
        arrays = [layer.detach().numpy().copy() for layer in layers]
    return Encoder(dict(zip(WEIGHTS, arrays, strict=True))), tuple(losses)


def _tensors(rows: Samples, index: Mapping[str, int]):
    import torch

    return torch.from_numpy(rows.values.astype(np.float32)), torch.tensor([index[label] for label in rows.label])


def _layers(rng: np.random.Generator, size: int, hidden: int, out: int):
    """Draw the weights and biases of both layers uniformly in +-1/sqrt(number of inputs), as torch.nn.Linear does."""
    import torch

    layers = []
    for inputs, outputs in ((size, hidden), (hidden, out)):
        bound = inputs**-0.5
        for shape in ((outputs, inputs), (outputs,)):
            layers.append(torch.from_numpy(rng.uniform(-bound, bound, shape).astype(np.float32)).requires_grad_())
    return layers


def _forward(layers, x):
    import torch
    from torch.nn.functional import linear, normalize

    return normalize(linear(torch.relu(linear(x, layers[0], layers[1])), layers[2], layers[3]), dim=1)


def text_loss(z, y, texts, weight, settings: Settings):
    """Return the InfoNCE loss of N radar embeddings (N, T) against the text embeddings (K, T) of all classes.

    If `settings.symmetric` is True, return the mean of two InfoNCE losses: radar embeddings against text embeddings, and text against
    radar.
    """
    import torch
    from torch.nn.functional import cross_entropy

    logits = z @ texts.T / settings.temperature
    loss = cross_entropy(logits, y, weight=weight)
    if not settings.symmetric:
        return loss
    own = torch.nn.functional.one_hot(y, len(texts)).T.float()
    own, logits = own[own.sum(dim=1) > 0], logits.T[own.sum(dim=1) > 0]
    to_rows = -(own * logits.log_softmax(dim=1)).sum(dim=1) / own.sum(dim=1)
    return (loss + to_rows.mean()) / 2


def _pair_loss(simulated, measured, temperature: float):
    """Return the InfoNCE loss between paired embeddings, averaged over simulated-to-measured and measured-to-simulated direction."""
    import torch
    from torch.nn.functional import cross_entropy

    logits = simulated @ measured.T / temperature
    own = torch.arange(len(logits))
    return (cross_entropy(logits, own) + cross_entropy(logits.T, own)) / 2


def _cases(rows: Samples) -> list[tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """Return arrays (simulated, measured) of row indices for each object and stratum that has both simulated and measured rows."""
    found = []
    for label, stratum in sorted(set(zip(rows.label, rows.stratum, strict=True))):
        here = (rows.label == label) & (rows.stratum == stratum)
        ours, theirs = (np.flatnonzero(here & (rows.domain == domain)) for domain in (SIMULATED, MEASURED))
        if len(ours) and len(theirs):
            found.append((ours, theirs))
    return found


@contextlib.contextmanager
def _one_thread() -> Iterator[None]:
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)
