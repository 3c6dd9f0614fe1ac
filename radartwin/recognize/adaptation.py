"""Bring measured feature rows to the scale of simulated rows without class labels, by the mean and spread of each feature.

Symbols: x_f -> feature f of a measured row; m_f, s_f -> its mean and standard deviation over the measured rows; M_f, S_f -> its mean and
standard deviation over the simulated rows; pi_k -> share of class k in the measured batch; p_k(x) -> class probability from a classifier
that was trained on simulated rows of equally frequent classes. An adapted row is M_f + S_f (x_f - m_f) / s_f.

`weighted_statistics` weights the simulated rows for M_f and S_f, so that class k has the share pi_k. The expectation-maximisation of
M. Saerens et al., Neural Computation 14, 2002, estimates pi_k from the probabilities p_k(x) of the measured rows. The probabilities depend
on the adapted rows, and the adapted rows depend on pi_k, so both steps alternate. A classifier is overconfident where simulation and
measurement differ, so the estimate is shrunk towards equal shares. With a shrinkage of 1, the classes have equal shares.

If the simulated rows are standardised and the shares are equal, an adapted row equals that of `probes.standardised` without a floor. Only
the measured rows change, so the classifier is trained once, on the simulated rows.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import InputError
from radartwin.recognize.samples import Samples, Unlabelled

Rows = TypeVar("Rows", bound=Unlabelled)

# Weight of equal shares in the estimated class shares. On synthetic Gaussian domains of 12 classes whose class means differ between the
# domains, the accuracy on batches of equal shares is at most 0.03 below that of plain statistics, and up to 0.10 below without shrinkage.
SHRINKAGE = 1 / 3
ROUNDS = 20  # largest number of alternations; on the same synthetic domains, 2 to 7 sufficed on average
CONVERGED = 1e-3  # change of a class share at which the alternation ends, a tenth of a row in a batch of a hundred rows


@dataclass(frozen=True, eq=False)
class Adapted(Generic[Rows]):
    """Measured rows on the scale of the simulated rows, and the share of each class that their adaptation assumed."""

    measured: Rows
    shares: Mapping[str, float]


def weighted_statistics(
    simulated: Samples, measured: Rows, probabilities: Callable[[Unlabelled], NDArray], shrinkage: float = SHRINKAGE
) -> Adapted[Rows]:
    """Adapt measured rows to the mean and spread of the simulated rows, which are weighted to the class shares of the measured batch.

    Args:
        simulated: training rows of the classifier, with class labels.
        measured: rows of one batch of F features; class labels of these rows are not used.
        probabilities: function that maps adapted rows to class probabilities (N, K) in the order of `simulated.classes`, for equally
            frequent classes, as `learners.Fitted.probabilities` does.
        shrinkage: weight of equal shares in the estimated shares, 0 to 1.
    Raises:
        InputError: a domain has no rows, the features differ, or the shrinkage is not between 0 and 1.
    """
    if not 0 <= shrinkage <= 1:
        raise InputError(f"adaptation: a shrinkage of {shrinkage:g} is not between 0 and 1")
    classes, kind = np.unique(simulated.label, return_inverse=True)
    counts = np.bincount(kind)
    shares = np.full(len(classes), 1 / len(classes))
    rows = measured.unlabelled() if isinstance(measured, Samples) else measured
    for _ in range(ROUNDS):
        before = shares
        shares = class_shares(probabilities(_adapted(simulated, rows, (shares / counts)[kind])), shrinkage)
        if np.abs(shares - before).max() < CONVERGED:
            break
    shares_by_class = dict(zip(map(str, classes), shares.tolist(), strict=True))
    return Adapted(_adapted(simulated, measured, (shares / counts)[kind]), shares_by_class)


def class_shares(probabilities: NDArray, shrinkage: float = SHRINKAGE) -> NDArray[np.float64]:
    """Estimate the class shares (K,) of a batch from class probabilities (N, K) for equal shares, by expectation-maximisation.

    The maximised quantity is the likelihood of the batch times a Dirichlet prior that equal shares maximise. For certain predictions (each
    probability 0 or 1), the result is `shrinkage` times equal shares plus `1 - shrinkage` times the counted shares.

    >>> class_shares(np.array([[1.0, 0.0], [1.0, 0.0], [1.0, 0.0], [0.0, 1.0]]), shrinkage=0.0).tolist()
    [0.75, 0.25]
    """
    number, classes = probabilities.shape
    shares = np.full(classes, 1 / classes)
    for _ in range(1000):
        joint = probabilities * shares
        counted = (joint / np.maximum(joint.sum(axis=1, keepdims=True), np.finfo(float).tiny)).sum(axis=0) / number
        following = shrinkage / classes + (1 - shrinkage) * counted
        if np.abs(following - shares).max() < CONVERGED / 100:
            return following
        shares = following
    return shares


def skewed(samples: Samples, seed: int, share: float = 1 / 3, kept: int = 1) -> Samples:
    """Draw a batch with unequal class shares: `kept` stored recordings of randomly chosen classes, and all rows of the other classes.

    Args:
        samples: rows of a batch with class labels.
        seed: seed of the random draw; the same seed and rows give the same batch.
        share: share of the classes with few recordings, rounded to at least one class.
        kept: number of stored recordings that such a class keeps.
    Raises:
        InputError: `share` is not above 0 and below 1, or `kept` is below 1.
    """
    if not (0 < share < 1 and kept >= 1):
        raise InputError(f"skewed batch: a share of {share:g} and {kept} recordings are impossible; give 0 < share < 1 and kept >= 1")
    rng = np.random.default_rng([seed, 0x5E])
    rare = rng.permutation(samples.classes)[: max(1, round(share * len(samples.classes)))]
    mask = ~np.isin(samples.label, rare)
    for label in rare:
        sources = np.unique(samples.source[samples.label == label])
        mask |= np.isin(samples.source, rng.permutation(sources)[:kept]) & (samples.label == label)
    return samples.take(mask)


def _adapted(simulated: Samples, measured: Rows, weights: NDArray) -> Rows:
    """Return the adapted measured rows for weights (N,) of the simulated rows, which sum to 1."""
    if simulated.names != measured.names or not len(simulated) or not len(measured):
        raise InputError("adaptation: both domains need rows of the same features; compute both with one feature set")
    centre = weights @ simulated.values
    spread = np.sqrt(weights @ (simulated.values - centre) ** 2)
    measured_spread = measured.values.std(axis=0)
    scaled = (measured.values - measured.values.mean(axis=0)) / np.where(measured_spread > 0, measured_spread, np.inf)
    return measured.with_values(centre + spread * scaled)
