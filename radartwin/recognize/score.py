"""Statistics of the share of correct predictions: chance levels, exact tests, 95 % confidence intervals.

Each recording counts as one prediction. Exact methods: binomial test against chance, Clopper-Pearson intervals, and the McNemar test for
two classifiers on the same recordings (paper, reconstruction ablation: paired exact test).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import InputError
from radartwin.recognize.samples import Samples


def uniform_chance(samples: Samples) -> float:
    """Return the expected share of correct predictions of a uniform guess among the classes of each recording's stratum."""
    recordings = samples.per_recording()
    counts = {stratum: np.unique(recordings.label[recordings.stratum == stratum]).size for stratum in np.unique(recordings.stratum)}
    return float(np.mean([1 / counts[stratum] for stratum in recordings.stratum]))


def majority_share(samples: Samples) -> float:
    """Return the share of correct predictions if every prediction is the most frequent class."""
    _, counts = np.unique(samples.per_recording().label, return_counts=True)
    return float(counts.max() / counts.sum())


def binomial_p(successes: int, n: int, chance: float) -> float:
    """Return the exact probability of at least this many successes in n independent trials with success probability `chance`.

    >>> binomial_p(30, 100, 0.1) < 1e-6
    True
    """
    from scipy.stats import binomtest

    return float(binomtest(successes, n, chance, alternative="greater").pvalue)


@dataclass(frozen=True)
class Paired:
    """Numbers of recordings that only the first or only the second classifier labels correctly, and the two-sided exact p-value."""

    first_only: int
    second_only: int
    p: float


def paired(first: NDArray[np.bool_], second: NDArray[np.bool_]) -> Paired:
    """Compare two classifiers on the same recordings by the exact McNemar test. Each array says whether a prediction is correct.

    >>> paired(np.arange(40) < 23, (np.arange(40) >= 23) & (np.arange(40) < 29)).p < 0.003
    True
    """
    from scipy.stats import binomtest

    if len(first) != len(second):
        raise InputError(f"paired test: {len(first)} and {len(second)} predictions are not of the same recordings")
    one, two = int((first & ~second).sum()), int((second & ~first).sum())
    return Paired(one, two, float(binomtest(one, one + two).pvalue) if one + two else 1.0)


def seed_mean(right: NDArray, cells: NDArray, resamples: int, seed: int, classes: NDArray | None = None) -> tuple[float, float, float]:
    """Return (low, mean, high): the mean share of correct predictions over several seeds, and its 95 % confidence interval.

    The interval is from a bootstrap over cells of recordings. It draws whole cells because recordings of one object at one place share a
    simulation, so their errors are correlated. Seeds are averaged because they add no recordings.

    Args:
        right: (seeds, N) or (N,), whether a prediction is correct; NaN if a seed did not score a recording.
        cells: (N,) recordings with equal entries belong together.
        classes: (N,) for balanced accuracy; cells are then drawn within each class.
    """
    right = np.atleast_2d(np.asarray(right, dtype=np.float64))
    scored = ~np.isnan(right).all(axis=0)
    per_recording = np.nanmean(right[:, scored], axis=0)
    kinds = np.zeros(scored.sum(), dtype=int) if classes is None else np.unique(classes[scored], return_inverse=True)[1]
    rng = np.random.default_rng([seed, 0xB0])
    parts = [_cell_means(per_recording[kinds == kind], cells[scored][kinds == kind], resamples, rng) for kind in range(kinds.max() + 1)]
    mean, drawn = float(np.mean([one for one, _ in parts])), np.mean([many for _, many in parts], axis=0)
    low, high = np.percentile(drawn, [2.5, 97.5])
    return min(float(low), mean), mean, max(float(high), mean)


def mean_difference(
    first: NDArray, second: NDArray, cells: tuple[NDArray, NDArray], resamples: int, seed: int
) -> tuple[float, float, float]:
    """Return (low, difference, high): the difference of the means of two groups of recordings, and its 95 % confidence interval.

    The interval is from a bootstrap over the cells of each group.
    """
    rng = np.random.default_rng([seed, 0xD1])
    (one, ones), (two, twos) = (_cell_means(v, c, resamples, rng) for v, c in zip((first, second), cells, strict=True))
    low, high = np.percentile(ones - twos, [2.5, 97.5])
    return min(float(low), one - two), one - two, max(float(high), one - two)


def _cell_means(values: NDArray, cells: NDArray, resamples: int, rng: np.random.Generator) -> tuple[float, NDArray[np.float64]]:
    """Return the mean over recordings, and the means (resamples,) after resampling whole cells."""
    _, cell = np.unique(cells, return_inverse=True)
    sums, sizes = np.bincount(cell, values), np.bincount(cell)
    drawn = rng.integers(0, len(sums), (resamples, len(sums)))
    return float(values.mean()), sums[drawn].sum(axis=1) / sizes[drawn].sum(axis=1)


def exact_interval(value: float, n: int) -> tuple[float, float, float]:
    """Return (low, value, high): a share of successes in n independent trials, and its 95 % Clopper-Pearson interval.

    n * value need not be an integer.

    >>> low, _, high = exact_interval(0.0, 36)
    >>> low, round(high, 3)
    (0.0, 0.097)
    """
    from scipy.stats import beta

    right = value * n
    low = float(beta.ppf(0.025, right, n - right + 1)) if right > 0 else 0.0
    high = float(beta.ppf(0.975, right + 1, n - right)) if right < n else 1.0
    return low, value, high
