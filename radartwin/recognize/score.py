"""What a share of right answers is worth: baselines by counting, exact tests, 95 % intervals.

The unit is the recording. Exact: binomial test against chance, Clopper-Pearson intervals, and for two recognisers on the same recordings
the exact McNemar test on those that only one of them gets right (paper, reconstruction ablation: paired exact test).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import InputError
from radartwin.recognize.samples import Samples


def uniform_chance(samples: Samples) -> float:
    """Expected share of right answers of a guess among the classes that occur in a recording's stratum."""
    recordings = samples.per_recording()
    counts = {stratum: np.unique(recordings.label[recordings.stratum == stratum]).size for stratum in np.unique(recordings.stratum)}
    return float(np.mean([1 / counts[stratum] for stratum in recordings.stratum]))


def majority_share(samples: Samples) -> float:
    """Share of right answers of who always says the most frequent class."""
    _, counts = np.unique(samples.per_recording().label, return_counts=True)
    return float(counts.max() / counts.sum())


def balanced_share(truth: NDArray, answer: NDArray) -> float:
    """Mean over classes of the share of right answers, so that a frequent class counts no more than a rare one."""
    return float(np.mean([(answer[truth == label] == label).mean() for label in np.unique(truth)]))


@dataclass(frozen=True)
class Share:
    """A share of right answers with its exact 95 % interval and the p of as many or more at chance."""

    right: int
    n: int
    low: float
    high: float
    p: float

    @property
    def value(self) -> float:
        return self.right / self.n


def share(right: NDArray[np.bool_], chance: float) -> Share:
    """One answer per recording against a chance level.

    >>> found = share(np.arange(100) < 30, 0.1)
    >>> found.value, bool(found.low < 0.3 < found.high), found.p < 1e-6
    (0.3, True, True)
    """
    from scipy.stats import binomtest

    if not len(right):
        raise InputError("there is no answer to score; give at least one recording")
    hits = int(right.sum())
    low, _, high = exact_interval(hits / len(right), len(right))
    return Share(hits, len(right), low, high, float(binomtest(hits, len(right), chance, alternative="greater").pvalue))


@dataclass(frozen=True)
class Paired:
    """Recordings that only the first, or only the second, gets right, and the two-sided p of so uneven a division."""

    first_only: int
    second_only: int
    p: float


def paired(first: NDArray[np.bool_], second: NDArray[np.bool_]) -> Paired:
    """Exact McNemar test of two recognisers on the same recordings.

    >>> paired(np.arange(40) < 23, (np.arange(40) >= 23) & (np.arange(40) < 29)).p < 0.003
    True
    """
    from scipy.stats import binomtest

    if len(first) != len(second):
        raise InputError(f"paired test: {len(first)} and {len(second)} answers are not of the same recordings")
    one, two = int((first & ~second).sum()), int((second & ~first).sum())
    return Paired(one, two, float(binomtest(one, one + two).pvalue) if one + two else 1.0)


def seed_mean(right: NDArray, cells: NDArray, resamples: int, seed: int, classes: NDArray | None = None) -> tuple[float, float, float]:
    """(low, mean, high) of a share over several seeds, 95 %, by a bootstrap over cells of recordings.

    Recordings of one object in one place share its simulation and are right or wrong together, so whole cells are drawn, not recordings;
    seeds are no new recordings and are averaged.

    Args:
        right: (seeds, N), or (N,); NaN where a seed did not score a recording. cells: (N,) which recordings belong together.
        classes: (N,) for the mean of the classes' shares (balanced accuracy); cells are then drawn within each class.
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
    """(low, difference of the means, high) of two groups of recordings, 95 %, by a bootstrap over the cells of each."""
    rng = np.random.default_rng([seed, 0xD1])
    (one, ones), (two, twos) = (_cell_means(v, c, resamples, rng) for v, c in zip((first, second), cells, strict=True))
    low, high = np.percentile(ones - twos, [2.5, 97.5])
    return min(float(low), one - two), one - two, max(float(high), one - two)


def _cell_means(values: NDArray, cells: NDArray, resamples: int, rng: np.random.Generator) -> tuple[float, NDArray[np.float64]]:
    """The mean over recordings, and that of each resampling of whole cells, (resamples,)."""
    _, cell = np.unique(cells, return_inverse=True)
    sums, sizes = np.bincount(cell, values), np.bincount(cell)
    drawn = rng.integers(0, len(sums), (resamples, len(sums)))
    return float(values.mean()), sums[drawn].sum(axis=1) / sizes[drawn].sum(axis=1)


def exact_interval(value: float, n: int) -> tuple[float, float, float]:
    """(low, value, high) of a share over n independent draws, 95 %, Clopper-Pearson; n * value need not be whole.

    >>> low, _, high = exact_interval(0.0, 36)
    >>> low, round(high, 3)
    (0.0, 0.097)
    """
    from scipy.stats import beta

    right = value * n
    low = float(beta.ppf(0.025, right, n - right + 1)) if right > 0 else 0.0
    high = float(beta.ppf(0.975, right + 1, n - right)) if right < n else 1.0
    return low, value, high


def confusion(truth: NDArray, answer: NDArray, classes: tuple[str, ...]) -> NDArray[np.float64]:
    """(K, K) shares of the answers (columns) per true class (rows); a row of a class without recordings is zero."""
    index = {label: number for number, label in enumerate(classes)}
    counts = np.zeros((len(classes), len(classes)))
    for one, other in zip(truth, answer, strict=True):
        counts[index[one], index[other]] += 1
    return counts / np.maximum(counts.sum(axis=1, keepdims=True), 1)
