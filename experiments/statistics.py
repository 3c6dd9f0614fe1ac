"""Statistical estimates as the tables print them: value, confidence interval, p value, and number of items.

Every random draw uses the seed that the caller gives. All intervals are 95 % confidence intervals.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from radartwin.errors import InputError
from radartwin.recognize import score

Alternative = Literal["greater", "less", "two-sided"]


@dataclass(frozen=True)
class Estimate:
    """An estimate from n items with its confidence interval, low <= value <= high.

    p is the p value against the hypothesis of no effect, and NaN if no test was made.
    """

    value: float
    low: float
    high: float
    n: int
    p: float = float("nan")


def bootstrap_mean(samples: np.ndarray, resamples: int, seed: int) -> tuple[float, float, float]:
    """Return (low, mean, high) of a 95 % percentile bootstrap over the samples. For a single sample, low, mean and high are equal.

    >>> bootstrap_mean(np.array([2.0]), 100, 0)
    (2.0, 2.0, 2.0)
    """
    from scipy.stats import bootstrap

    samples = np.asarray(samples, float)
    mean = float(samples.mean())
    if len(samples) < 2 or np.ptp(samples) == 0:
        return mean, mean, mean
    interval: Any = bootstrap(
        (samples,), np.mean, n_resamples=resamples, method="percentile", rng=np.random.default_rng(seed)
    ).confidence_interval
    return min(float(interval.low), mean), mean, max(float(interval.high), mean)


def mean(samples: ArrayLike, resamples: int, seed: int) -> Estimate:
    """Return the mean of the samples with its confidence interval from a bootstrap over the samples."""
    samples = np.asarray(samples, float)
    low, value, high = bootstrap_mean(samples, resamples, seed)
    return Estimate(value, low, high, len(samples))


def exact(value: float, n: int) -> Estimate:
    """Return an estimate without an interval: both bounds equal the value `value`."""
    return Estimate(float(value), float(value), float(value), n)


def resampled(value: float, drawn: ArrayLike, n: int) -> Estimate:
    """Return an estimate of n items whose interval is the percentile interval of the resampled values `drawn`."""
    return Estimate(value, *_interval(np.asarray(drawn, float), value, 0.025), n)


def spearman(first: ArrayLike, second: ArrayLike, resamples: int, seed: int, alternative: Alternative | None = "greater") -> Estimate:
    """Compute Spearman's rank correlation over items, with a bootstrap interval over items and a permutation p value.

    For few items, p is exact over all pairings of the two inputs; for more items, p uses 9,999 random pairings. With alternative=None no p
    value is computed. Raises InputError for fewer than three items, or if all values of one input are equal.
    """
    from scipy.stats import permutation_test, rankdata

    first, second = np.asarray(first, float), np.asarray(second, float)
    if first.shape != second.shape or first.ndim != 1 or len(first) < 3 or not (np.isfinite(first).all() and np.isfinite(second).all()):
        raise InputError(f"a correlation needs three or more finite pairs, not {first.shape} and {second.shape}")
    if np.ptp(first) == 0 or np.ptp(second) == 0:
        raise InputError("a correlation needs values that differ; one of the two is constant")
    rng = np.random.default_rng(seed)
    ranks = rankdata(second)
    value = float(_r(rankdata(first), ranks))
    chosen = rng.integers(len(first), size=(resamples, len(first)))
    low, high = _interval(_r(rankdata(first[chosen], axis=-1), rankdata(second[chosen], axis=-1)), value)
    if alternative is None:
        return Estimate(value, low, high, len(first))
    tested: Any = permutation_test(
        (rankdata(first),), lambda x, axis: _r(x, ranks), permutation_type="pairings", vectorized=True, alternative=alternative, rng=rng
    )
    return Estimate(value, low, high, len(first), float(tested.pvalue))


def correlation(first: NDArray, second: NDArray) -> float:
    """Return Pearson's correlation coefficient without an interval; 0 if all values of one input are equal."""
    return float(np.corrcoef(first, second)[0, 1]) if np.ptp(first) > 0 and np.ptp(second) > 0 else 0.0


def mantel(first: ArrayLike, second: ArrayLike, permutations: int, seed: int) -> Estimate:
    """Mantel test: correlation of two (n, n) distance matrices over the same objects. Ref: N. Mantel, Cancer Research 27 (1967).

    p is the share of random permutations of the objects whose correlation is at least as high as that of the original order. The original
    order counts as one permutation, so p is at least 1 / (permutations + 1). The confidence interval of the Mantel correlation comes from
    a bootstrap over objects; pairs of an object with itself are left out. Raises InputError if the inputs are not distance matrices of the
    same three or more objects, or if all distances of one matrix are equal.
    """
    first, second = (np.asarray(matrix, float) for matrix in (first, second))
    count = len(first)
    if first.shape != (count, count) or second.shape != first.shape or count < 3:
        raise InputError(f"Mantel test: give two square matrices of the same three or more objects, not {first.shape} and {second.shape}")
    if not all(np.isfinite(m).all() and np.allclose(m, m.T) for m in (first, second)):
        raise InputError("Mantel test: a distance matrix must be finite and symmetric")
    upper = np.triu_indices(count, 1)
    value = float(_r(first[upper], second[upper]))
    if np.isnan(value):
        raise InputError("Mantel test: all distances of one matrix are equal")
    rng = np.random.default_rng(seed)
    shuffled = [rng.permutation(count) for _ in range(permutations)]
    as_good = sum(bool(_r(first[upper], second[np.ix_(order, order)][upper]) >= value - 1e-12) for order in shuffled)
    drawn = []
    for _ in range(permutations):
        chosen = rng.integers(count, size=count)
        a, b = chosen[upper[0]], chosen[upper[1]]
        if np.sum(a != b) > 2:  # a sample that repeats one object has no pairs
            drawn.append(_r(first[a, b][a != b], second[a, b][a != b]))
    low, high = _interval(np.array(drawn), value)
    return Estimate(value, low, high, count, (as_good + 1) / (permutations + 1))


def share(successes: int, trials: int, chance: float = 0.5) -> Estimate:
    """Return the share of successes among the trials with its exact binomial confidence interval.

    p is the probability of at least as many successes if each trial succeeds with the probability `chance`.

    >>> round(share(9, 9).p, 6)
    0.001953
    """
    if not 0 <= successes <= trials or trials < 1:
        raise InputError(f"a share needs one trial or more: {successes} of {trials}")
    low, value, high = score.exact_interval(successes / trials, trials)
    return Estimate(value, low, high, trials, score.binomial_p(successes, trials, chance))


def coefficient_of_variation(samples: ArrayLike, resamples: int, seed: int) -> Estimate:
    """Return the sample standard deviation of positive values divided by their mean, with a bootstrap interval."""
    samples = np.asarray(samples, float)
    if len(samples) < 2 or not (samples > 0).all():
        raise InputError("a coefficient of variation needs two or more positive values")
    value = float(samples.std(ddof=1) / samples.mean())
    drawn = samples[np.random.default_rng(seed).integers(len(samples), size=(resamples, len(samples)))]
    return Estimate(value, *_interval(drawn.std(axis=1, ddof=1) / drawn.mean(axis=1), value), len(samples))


def ssim(first: NDArray, second: NDArray) -> float:
    """Return the structural similarity (SSIM) of two maps with values from 0 to 1. The SSIM window is at most seven cells wide."""
    from skimage.metrics import structural_similarity

    size = min(7, *(side - 1 + side % 2 for side in first.shape))
    similarity: Any = structural_similarity(first, second, data_range=1.0, win_size=size)
    return float(similarity)


def _r(first: NDArray, second: NDArray) -> NDArray:
    """Compute Pearson's correlation coefficient along the last axis; NaN where all values of one input are equal."""
    first, second = first - first.mean(axis=-1, keepdims=True), second - second.mean(axis=-1, keepdims=True)
    norm = np.sqrt(np.sum(first**2, axis=-1) * np.sum(second**2, axis=-1))
    return np.divide(np.sum(first * second, axis=-1), norm, out=np.full(np.shape(norm), np.nan), where=norm > 0)[()]


def _interval(drawn: NDArray, value: float, tail: float = (1 - 0.95) / 2) -> tuple[float, float]:
    """Compute the percentile interval of the finite resampled values `drawn`, extended if necessary so that it contains `value`.

    The default tail probability differs from 0.025 by rounding only. This rounding is kept because it decides the last digits of the
    confidence intervals in the committed tables.
    """
    drawn = drawn[np.isfinite(drawn)]
    if not len(drawn):
        return value, value
    low, high = np.quantile(drawn, [tail, 0.975])
    return min(float(low), value), max(float(high), value)
