"""Statistics of the share of correct predictions: chance levels, exact tests, 95 % confidence intervals.

Each classified recording counts as one prediction. The exact methods are the binomial test against chance and Clopper-Pearson intervals.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from radartwin.recognize.samples import Samples


def uniform_chance(samples: Samples) -> float:
    """Return the expected share of correct predictions if each class of a recording's stratum is guessed with equal probability."""
    recordings = samples.per_recording()
    counts = {stratum: np.unique(recordings.label[recordings.stratum == stratum]).size for stratum in np.unique(recordings.stratum)}
    return float(np.mean([1 / counts[stratum] for stratum in recordings.stratum]))


def majority_share(samples: Samples) -> float:
    """Return the share of correct predictions if every recording is assigned to the most frequent class."""
    _, counts = np.unique(samples.per_recording().label, return_counts=True)
    return float(counts.max() / counts.sum())


def seed_mean(
    right: NDArray, groups: NDArray, resamples: int, seed: int, classes: NDArray | None = None
) -> tuple[float, NDArray[np.float64]]:
    """Return the mean share of correct predictions over several seeds, and the means (resamples,) of bootstrap samples.

    A seed is the random seed of one training. The bootstrap draws whole groups of recordings, for example all recordings of an object,
    because their errors are correlated. The results of all seeds are averaged before the bootstrap, because further seeds add no
    recordings.

    Args:
        right: (seeds, N) or (N,), 1 for a correct prediction, 0 for a wrong prediction, NaN if a seed did not test the recording.
        groups: (N,) group of each recording; recordings with equal entries are drawn together.
        classes: (N,) class of each recording, to compute balanced accuracy with groups drawn within each class; None for plain accuracy.
    """
    right = np.atleast_2d(np.asarray(right, dtype=np.float64))
    scored = ~np.isnan(right).all(axis=0)
    per_recording = np.nanmean(right[:, scored], axis=0)
    kinds = np.zeros(scored.sum(), dtype=int) if classes is None else np.unique(classes[scored], return_inverse=True)[1]
    rng = np.random.default_rng([seed, 0xB0])
    parts = [_group_means(per_recording[kinds == kind], groups[scored][kinds == kind], resamples, rng) for kind in range(kinds.max() + 1)]
    return float(np.mean([mean for mean, _ in parts])), np.mean([means for _, means in parts], axis=0)


def _group_means(values: NDArray, groups: NDArray, resamples: int, rng: np.random.Generator) -> tuple[float, NDArray[np.float64]]:
    """Return the mean over all recordings, and the means (resamples,) of bootstrap samples that draw whole groups of recordings."""
    _, group = np.unique(groups, return_inverse=True)
    sums, sizes = np.bincount(group, values), np.bincount(group)
    drawn = rng.integers(0, len(sums), (resamples, len(sums)))
    return float(values.mean()), sums[drawn].sum(axis=1) / sizes[drawn].sum(axis=1)


def exact_interval(value: float, n: int) -> tuple[float, float, float]:
    """Return (low, value, high): a share of successes in n independent trials, and its 95 % Clopper-Pearson interval.

    The number of successes, n * value, need not be an integer.

    >>> low, _, high = exact_interval(0.0, 36)
    >>> low, round(high, 3)
    (0.0, 0.097)
    """
    from scipy.stats import beta

    right = value * n
    low = float(beta.ppf(0.025, right, n - right + 1)) if right > 0 else 0.0
    high = float(beta.ppf(0.975, right + 1, n - right)) if right < n else 1.0
    return low, value, high
