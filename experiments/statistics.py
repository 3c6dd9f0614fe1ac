"""Statistical estimates as the tables print them: value, confidence interval, p value, and number of items.

Every random draw uses the seed that the caller gives. All intervals are 95 % confidence intervals.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from radartwin.errors import InputError
from radartwin.recognize import score

Alternative = Literal["greater", "less", "two-sided"]
PERMUTATIONS = 9_999  # number of random permutations of a test that does not use all permutations
ANY, SHARE, SIGNED = (-math.inf, math.inf), (0.0, 1.0), (-1.0, 1.0)  # limits; SIGNED is for correlations and differences of shares


@dataclass(frozen=True)
class Estimate:
    """An estimate from n items with its confidence interval, low <= value <= high.

    Attributes:
        p: p value against the hypothesis of no effect, and NaN if no test was made.
        freedom: degrees of freedom of the interval, from which `p_beyond` follows; None stands for n - 1.
        drawn: (resamples,) the estimates of the bootstrap samples, or None if the interval does not come from a bootstrap.
        limits: smallest and largest value that the quantity can have, such as -1 and 1 of a correlation.
        least_p: smallest p value that the test can give for so many items, such as 1/24 if it permutes four items; 0 without a test.
    """

    value: float
    low: float
    high: float
    n: int
    p: float = float("nan")
    drawn: NDArray[np.floating] | None = field(default=None, repr=False, compare=False)
    limits: tuple[float, float] = ANY
    freedom: float | None = None
    least_p: float = 0.0

    def p_beyond(self, bound: float) -> float:
        """Return the one-sided p value against the hypothesis that the true value is on the other side of `bound` than the estimate.

        The p value is that of Student's t distribution with the same interval, so that p is 0.025 if the bound is at an end of the
        interval. The p value does not come from the bootstrap samples, because the samples of few items or draws have no tails. NaN if the
        interval has no width.
        """
        from scipy.stats import t

        freedom = max(self.n - 1, 1) if self.freedom is None else self.freedom
        half = self.value - self.low if bound <= self.value else self.high - self.value
        if half <= 0:
            return math.nan
        return float(t.sf(abs(self.value - bound) / half * t.ppf(0.975, freedom), freedom))


def mean(
    samples: ArrayLike, resamples: int, seed: int, limits: tuple[float, float] = ANY,
    scale: Callable[[NDArray[np.float64]], NDArray[np.float64]] = np.asarray,
) -> Estimate:  # fmt: skip
    """Return the mean of the samples with its confidence interval from a bootstrap over the samples, widened for few samples.

    For a single sample, and for samples that are all equal, both bounds equal the mean.

    Args:
        scale: increasing function that converts means to the unit of the result, such as amplitudes to decibels. The interval is widened
            in this unit, because a widened interval of amplitudes could extend below zero.

    >>> mean([2.0], 100, 0).low
    2.0
    """
    from scipy.stats import bootstrap

    samples = np.asarray(samples, float)
    value = float(scale(samples.mean()))
    if len(samples) < 2:
        return replace(exact(value, len(samples)), limits=limits)
    if np.ptp(samples) == 0:
        return resampled(value, np.full(resamples, value), len(samples), limits)
    found: Any = bootstrap((samples,), np.mean, n_resamples=resamples, method="percentile", rng=np.random.default_rng(seed))
    drawn = widened(scale(found.bootstrap_distribution), value, len(samples))
    return resampled(value, np.clip(drawn, *limits), len(samples), limits)


def widening(n: int) -> float:
    """Return the factor by which deviations of a bootstrap over n items must grow, so that few items do not give too narrow an interval.

    The factor is sqrt(n/(n-1)) times the ratio of Student's t to the normal quantile. Without this factor, the 95 % interval of the mean of
    normally distributed items contains the true mean in only 49, 74, 78, 86 and 91 % of cases for n = 2, 3, 4, 6 and 12.

    For a single item, the function returns 1, because one item has no deviation from the mean.

    >>> round(widening(3), 2), round(widening(1000), 2), widening(1)
    (2.69, 1.0, 1.0)
    """
    from scipy.stats import norm, t

    if n < 2:
        return 1.0
    return float(np.sqrt(n / (n - 1)) * t.ppf(0.975, n - 1) / norm.ppf(0.975))


def widened(drawn: NDArray, value: float, n: int) -> NDArray:
    """Return the estimates `drawn` of the bootstrap samples of n items, with their deviations from the estimate `value` widened."""
    return value + widening(n) * (drawn - value)


def clustered(
    values: ArrayLike, clusters: ArrayLike, resamples: int, seed: int, classes: NDArray | None = None, limits: tuple[float, float] = ANY
) -> Estimate:
    """Return the mean of values (N,) or (seeds, N), with the interval of a bootstrap that draws whole clusters; n counts clusters.

    The interval is widened for few clusters. If the values are drawn within classes, the class with the fewest clusters decides.

    Args:
        clusters: (N,) cluster of each value. The recordings of one object are one cluster.
        classes: (N,) class of each value, for a mean over classes with clusters drawn within each class; None for a plain mean.
    """
    clusters = np.asarray(clusters)
    value, drawn = score.seed_mean(np.asarray(values, float), clusters, resamples, seed, classes)
    kinds = np.zeros(len(clusters), int) if classes is None else classes
    fewest = min(np.unique(clusters[kinds == one]).size for one in np.unique(kinds))
    return resampled(value, np.clip(widened(drawn, value, fewest), *limits), np.unique(clusters).size, limits)


def difference(first: NDArray, second: NDArray, resamples: int, seed: int) -> Estimate:
    """Return the mean of the items `first` minus the mean of the items `second`, with the interval of a bootstrap over both groups.

    The interval is widened for few items. n counts the items of the smaller group, because an interval needs more than one item in each
    group.

    >>> found = difference(np.array([3.0, 5.0]), np.array([1.0]), 100, 0)
    >>> found.value, found.low < 2, found.high > 4, found.n
    (3.0, True, True, 1)
    """
    rng = np.random.default_rng(seed)
    drawn = np.zeros(resamples)
    for some, sign in ((first, 1), (second, -1)):
        means = some[rng.integers(len(some), size=(resamples, len(some)))].mean(axis=1)
        drawn += sign * widened(means, float(some.mean()), len(some))
    return resampled(float(np.mean(first) - np.mean(second)), drawn, min(len(first), len(second)))


def exact(value: float, n: int) -> Estimate:
    """Return an estimate without an interval: both bounds equal the value `value`."""
    return Estimate(float(value), float(value), float(value), n)


def resampled(value: float, drawn: ArrayLike, n: int, limits: tuple[float, float] = ANY) -> Estimate:
    """Return an estimate of n items whose interval is the percentile interval of the resampled values `drawn`."""
    drawn = np.asarray(drawn, float)
    return Estimate(value, *_interval(drawn, value), n, limits=limits, drawn=drawn)


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
    found = resampled(value, _r(rankdata(first[chosen], axis=-1), rankdata(second[chosen], axis=-1)), len(first), SIGNED)
    if alternative is None:
        return found
    tested: Any = permutation_test(
        (rankdata(first),),
        lambda x, axis: _r(x, ranks),
        permutation_type="pairings",
        vectorized=True,
        alternative=alternative,
        rng=rng,
        n_resamples=PERMUTATIONS,
    )
    return replace(found, p=float(tested.pvalue), least_p=least_permutation_p(len(first)) * (2 if alternative == "two-sided" else 1))


def least_permutation_p(n: int, permutations: int = PERMUTATIONS) -> float:
    """Return the smallest p value of a test that permutes n items, in all ways or in `permutations` random ways.

    >>> round(least_permutation_p(4), 4), least_permutation_p(20)
    (0.0417, 0.0001)
    """
    return max(1 / math.factorial(n), 1 / (permutations + 1))


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
    return replace(
        resampled(value, drawn, count, SIGNED), p=(as_good + 1) / (permutations + 1), least_p=least_permutation_p(count, permutations)
    )


def share(successes: int, trials: int, chance: float = 0.5) -> Estimate:
    """Return the share of successes among the trials with its exact binomial confidence interval.

    p is the probability of at least as many successes if each trial succeeds with the probability `chance`.

    >>> round(share(9, 9).p, 6)
    0.001953
    """
    if not 0 <= successes <= trials or trials < 1:
        raise InputError(f"a share needs one trial or more: {successes} of {trials}")
    low, value, high = score.exact_interval(successes / trials, trials)
    least = score.binomial_p(trials, trials, chance)
    return Estimate(value, low, high, trials, score.binomial_p(successes, trials, chance), limits=SHARE, least_p=least)


def coefficient_of_variation(samples: ArrayLike, resamples: int, seed: int) -> Estimate:
    """Return the sample standard deviation of positive values divided by their mean.

    The interval is that of log-normally distributed values, whose coefficient of variation depends only on the standard deviation of their
    logarithms. It contains the true value in 93 to 96 % of cases for 3 to 11 such values, and in 83 to 90 % of cases for normally
    distributed values with a coefficient of variation of 0.3. A bootstrap interval contains the true value in only 47 to 60 % of cases for
    four values.
    """
    samples = np.asarray(samples, float)
    if len(samples) < 2 or not (samples > 0).all():
        raise InputError("a coefficient of variation needs two or more positive values")
    freedom = len(samples) - 1
    value = float(samples.std(ddof=1) / samples.mean())
    chi_squared = np.random.default_rng(seed).chisquare(freedom, resamples)
    with np.errstate(over="ignore"):  # two very different samples have no upper bound
        drawn = np.sqrt(np.expm1(np.log(samples).var(ddof=1) * freedom / chi_squared))
    return resampled(value, drawn, len(samples), (0.0, math.inf))


def holm(p: ArrayLike) -> NDArray[np.float64]:
    """Return Holm's corrected p values of a family of tests, in the order of the given p values.

    >>> holm([0.01, 0.04, 0.03]).round(3).tolist()
    [0.03, 0.06, 0.06]
    """
    p = np.asarray(p, float)
    order = np.argsort(p)
    out = np.empty(len(p))
    out[order] = np.minimum(np.maximum.accumulate(p[order] * np.arange(len(p), 0, -1)), 1.0)
    return out


def over_draws(found: Sequence[Estimate], resamples: int, seed: int) -> Estimate:
    """Join the estimates of several draws of the measurement to an estimate of their mean.

    The interval is a bootstrap over draws and items together (A. Owen, Annals of Applied Statistics 1 (2007) 386): each sample draws the
    estimates with replacement, and takes the same bootstrap sample of items from each drawn estimate. For an estimate without bootstrap
    samples, normally distributed samples with the width of its interval are used. All estimates use the same random numbers for these
    samples, because the draws may have the same items. The deviations of the estimates from their mean are multiplied by `widening` for the
    number of draws. The degrees of freedom follow Welch and Satterthwaite. The p value is twice the median of the p values, which is valid
    for any dependence between the draws (L. Rueschendorf, Advances in Applied Probability 14 (1982) 623). The attribute n is the smallest
    number of items of a draw, or the number of draws if every draw has a single item. Draws without items are left out. The bootstrap
    samples are clipped to the limits of the quantity.
    """
    found = [one for one in found if one.n] or found[:1]
    draws, first = len(found), found[0]
    figures = np.array([(one.value, one.low, one.high, one.p) for one in found])
    if draws == 1 or (all(one.drawn is None for one in found) and np.array_equal(figures, figures[[0] * draws], equal_nan=True)):
        return first  # the estimate does not depend on the draw
    rng = np.random.default_rng([seed, 0xD2])
    normal = rng.standard_normal(resamples)
    values, p = figures[:, 0], figures[:, 3]
    value = float(values.mean())
    samples = np.stack([_samples(one, normal) for one in found]) - values[:, None]
    chosen = rng.integers(draws, size=(draws, resamples))
    inner = samples[chosen, np.arange(resamples)].mean(axis=0)
    between = widening(draws) * (values[chosen].mean(axis=0) - value)
    items = min(one.n for one in found)
    with np.errstate(invalid="ignore"):  # some samples may be NaN or infinite
        within, across = float(np.nanvar(inner)), float(np.var(values, ddof=1)) / draws
    spread = within**2 / max(items - 1, 1) + across**2 / (draws - 1)
    freedom = (within + across) ** 2 / spread if 0 < spread < math.inf else draws - 1
    samples = np.clip(value + inner + between, *first.limits)
    joined = resampled(value, samples, draws if all(one.n == 1 for one in found) else items)
    doubled = float("nan") if np.isnan(p).any() else min(1.0, 2 * float(np.median(p)))
    least = min(1.0, 2 * float(np.median([one.least_p for one in found])))
    return replace(joined, p=doubled, limits=first.limits, freedom=freedom, least_p=least)


def _samples(found: Estimate, normal: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the bootstrap samples (resamples,) of an estimate. If it has none, return the samples `normal`, scaled to the width of its
    interval.
    """
    if found.drawn is not None:
        return np.resize(np.asarray(found.drawn, np.float64), len(normal))
    return found.value + normal * np.where(normal > 0, found.high - found.value, found.value - found.low) / 1.96


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


def _interval(drawn: NDArray, value: float) -> tuple[float, float]:
    """Compute the percentile interval of the resampled values `drawn`, extended if necessary so that it contains `value`.

    Resamples without a value (NaN) are left out. A bound is infinite if more than 2.5 % of the resampled values are.
    """
    drawn = np.sort(drawn[~np.isnan(drawn)])
    if not len(drawn):
        return value, value
    with np.errstate(invalid="ignore"):  # the interpolation between two equal infinities is NaN
        low, high = np.quantile(drawn, [0.025, 0.975])
    low, high = (drawn[round(at * (len(drawn) - 1))] if np.isnan(one) else one for one, at in ((low, 0.025), (high, 0.975)))
    return min(float(low), value), max(float(high), value)
