"""Train an encoder on a split: AdamW minimises the InfoNCE loss, with early stopping on held-out simulated recordings.

All architectures (networks.py) share one training loop. NumPy draws the initial weights, the held-out recordings and the order of the
feature rows from one seed. torch computes on one thread, so the same seed gives the same bytes.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import InputError
from radartwin.recognize.encoder import DEFAULTS, Encoder, Settings
from radartwin.recognize.losses import pair_loss, text_loss
from radartwin.recognize.networks import TWO_LAYERS, Network
from radartwin.recognize.samples import MEASURED, SIMULATED, Samples
from radartwin.recognize.split import Split

E = TypeVar("E")
# An additional loss term of a training step, computed from a random generator and the function that maps tensors (N, D) to (N, T).
Term = Callable[[np.random.Generator, Callable[[Any], Any]], Any]


@dataclass(frozen=True, eq=False)
class Trained(Generic[E]):
    """A trained encoder and the number of epochs of its training."""

    encoder: E
    epochs: int


def fit(split: Split, anchors: Mapping[str, NDArray], settings: Settings = DEFAULTS, seed: int = 0) -> Trained[Encoder]:
    """Train the two-layer encoder on the training rows of `split`. Arguments and errors are those of `fit_network`."""
    return fit_network(TWO_LAYERS, split, anchors, settings, seed)


def fit_network(network: Network[E], split: Split, anchors: Mapping[str, NDArray], settings: Settings, seed: int) -> Trained[E]:
    """Train a network on the training rows of `split`. All features of the training rows must have comparable scales.

    If the training rows include simulated rows, the network is trained twice. The first training holds out one simulated recording per
    class and finds the epoch with the lowest loss on the held-out recordings. The second training uses all training rows for this number of
    epochs. Without simulated rows, the network is trained once, for `settings.epochs` epochs.

    Args:
        network: architecture of the encoder.
        split: training and test rows; `fit_network` uses only the training rows.
        anchors: text embedding of every class in the training rows, a unit vector (T,) by class name.
        settings: settings of the training.
        seed: seed of all random numbers in the training.
    Raises:
        InputError: a class has no text embedding, or `settings.paired` is above 0 without labelled measured recordings.
    """
    rows = split.train
    if missing := [label for label in rows.classes if label not in anchors]:
        raise InputError(f"encoder: class {missing[0]} has no text embedding; give a description of the class")
    if settings.paired and not len(split.labelled):
        raise InputError("encoder.paired needs labelled measured recordings; use supervision=few_shot, or encoder.paired=0")
    held = held_out(split.simulated, seed)
    epochs = settings.epochs
    if held:
        mask = np.isin(rows.recording, list(held))
        losses = train(network, rows.take(~mask), rows.take(mask), anchors, settings, seed, settings.epochs)[1]
        epochs = int(np.argmin(losses)) + 1
    weights, _ = train(network, rows, None, anchors, settings, seed, epochs)
    return Trained(network.encoder(weights), epochs)


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
    network: Network[Any], rows: Samples, held: Samples | None, anchors: Mapping[str, NDArray], settings: Settings, seed: int, epochs: int,
    term: Term | None = None, start: Sequence[NDArray[np.float32]] | None = None,
) -> tuple[list[NDArray[np.float32]], tuple[float, ...]]:  # fmt: skip
    """Train a network for `epochs` epochs; training ends earlier if the held-out loss does not decrease for `settings.patience` epochs.

    Args:
        term: loss term that is added in each training step; None adds the paired term if `settings.paired` is above 0.
        start: weights at the start of the training; None draws them.
    Returns: the weights after the last epoch, and the loss on the held-out rows `held` after each epoch.
    """
    import torch

    rng = np.random.default_rng([seed, 0xEC])
    classes = sorted({*rows.classes, *(held.classes if held is not None else ())})
    texts = torch.from_numpy(np.stack([anchors[label] for label in classes]).astype(np.float32))
    index = {label: number for number, label in enumerate(classes)}
    x, y = _tensors(rows, index)
    weight = torch.bincount(y, minlength=len(classes)).float().reciprocal()
    weight = torch.where(torch.isfinite(weight), weight, 0.0)  # every class has the same total weight
    if term is None and settings.paired:
        term = _paired_term(rows, x, settings)
    losses: list[float] = []
    with one_thread():
        drawn = network.initial(rng, x.shape[1], texts.shape[1], settings)
        layers = [torch.from_numpy(array.copy()).requires_grad_() for array in (drawn if start is None else start)]
        optimiser = torch.optim.AdamW(layers, lr=settings.learning_rate, weight_decay=settings.weight_decay)
        for _ in range(epochs):
            order = torch.from_numpy(rng.permutation(len(x)))
            for batch in order.split(settings.batch):
                loss = text_loss(network.forward(layers, network.augmented(rng, x[batch])), y[batch], texts, weight, settings.temperature)
                if term is not None:
                    loss = loss + term(rng, lambda rows: network.forward(layers, rows))
                optimiser.zero_grad()
                loss.backward()
                optimiser.step()
            if held is not None:
                with torch.no_grad():
                    hx, hy = _tensors(held, index)
                    losses.append(float(text_loss(network.forward(layers, hx), hy, texts, torch.ones_like(weight), settings.temperature)))
                if len(losses) - 1 - int(np.argmin(losses)) >= settings.patience:
                    break
    return [layer.detach().numpy().copy() for layer in layers], tuple(losses)


def _tensors(rows: Samples, index: Mapping[str, int]):
    import torch

    return torch.from_numpy(rows.values.astype(np.float32)), torch.tensor([index[label] for label in rows.label])


def _paired_term(rows: Samples, x: Any, settings: Settings) -> Term | None:
    """Return the InfoNCE term of a simulated and a measured row of each case (object and stratum), or None if no case has both domains."""
    cases = _cases(rows)

    def term(rng: np.random.Generator, forward: Callable[[Any], Any]) -> Any:
        pairs = np.array([[rng.choice(simulated), rng.choice(measured)] for simulated, measured in cases])
        return settings.paired * pair_loss(forward(x[pairs[:, 0]]), forward(x[pairs[:, 1]]), settings.temperature)

    return term if cases else None


def _cases(rows: Samples) -> list[tuple[NDArray[np.intp], NDArray[np.intp]]]:
    """Return arrays (simulated, measured) of row indices for each object and stratum that has both simulated and measured rows."""
    cases = []
    for label, stratum in sorted(set(zip(rows.label, rows.stratum, strict=True))):
        here = (rows.label == label) & (rows.stratum == stratum)
        simulated, measured = (np.flatnonzero(here & (rows.domain == domain)) for domain in (SIMULATED, MEASURED))
        if len(simulated) and len(measured):
            cases.append((simulated, measured))
    return cases


@contextlib.contextmanager
def one_thread() -> Iterator[None]:
    """Let torch compute on one thread, and restore the number of threads afterwards."""
    import torch

    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)
