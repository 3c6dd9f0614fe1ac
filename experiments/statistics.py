"""Statistical estimates as the tables print them: value, confidence interval with the test that it inverts, and number of items.

Every random draw uses the seed that the caller gives. All intervals are 95 % confidence intervals. A p value always follows from the
interval (`p_value`), so that the interval excludes a value exactly if its p value is below 0.05.
"""

import functools
import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from radartwin.errors import InputError
from radartwin.recognize import score

PERMUTATIONS = 9_999  # largest number of permutations of a test; fewer items are permuted in all ways
LEVEL = 0.95  # level of all intervals, except those of the primary claims (experiments.gaps.headline)
ANY, SHARE, SIGNED = (-math.inf, math.inf), (0.0, 1.0), (-1.0, 1.0)  # limits; SIGNED is for correlations and differences of shares
POSITIVE = (0.0, math.inf)
MS_WEIGHTS = (0.0448, 0.2856, 0.3001, 0.2363, 0.1333)  # of the scales of `ms_ssim`, from fine to coarse
# The scale on which an interval is symmetric, and its inverse: correlations have Fisher's z (a correlation of 1 counts as 1 - 1e-6), and
# ratios of positive quantities have their logarithm.
FISHER, LOG = "Fisher's z", "logarithm"
SCALES: dict[str, tuple[Callable[[Any], Any], Callable[[Any], Any]]] = {
    "": (np.asarray, np.asarray),
    FISHER: (lambda r: np.arctanh(np.clip(r, 1e-6 - 1, 1 - 1e-6)), np.tanh),
    LOG: (lambda ratio: np.log(np.maximum(ratio, 1e-300)), np.exp),
}
STUDENT, PERMUTATION, BINOMIAL = "Student's t", "permutation", "exact binomial"


@dataclass(frozen=True)
class Estimate:
    """An estimate from n items with its confidence interval, low <= value <= high. The arrays `drawn` (resamples,) and `shuffled`
    (permutations,) are the estimates of the bootstrap samples and with permuted objects, or None for another test.
    """

    value: float
    low: float
    high: float
    n: int
    drawn: NDArray[np.floating] | None = field(default=None, repr=False, compare=False)
    limits: tuple[float, float] = ANY  # smallest and largest value that the quantity can have
    freedom: float | None = None  # degrees of freedom of the interval, from which `p` and `at_level` follow; None stands for n - 1
    scale: str = ""  # scale on which the interval is symmetric, a key of SCALES
    shuffled: NDArray[np.floating] | None = field(default=None, repr=False, compare=False)
    closed: bool = False  # whether the objects are the classes of a closed set, so that only the spread over draws is an error
    test: str = STUDENT  # name of the test that the interval inverts
    unit: str = "recordings"  # what the test permutes or resamples

    @property
    def degrees(self) -> float:
        return max(self.n - 1, 1) if self.freedom is None else self.freedom

    def p(self, null: float) -> float:
        """Return the two-sided p value against `null`; NaN if the interval has no width. It is that of the permutation test if `null` is
        the mean of the permuted estimates, because an interval that ends at a limit of the quantity would give a smaller one.
        """
        if self.shuffled is not None and math.isclose(null, float(self.shuffled.mean()), abs_tol=1e-12):
            return permutation_p(self.value, self.shuffled)
        return p_value(self.value, self.low, self.high, null, self.degrees, self.scale)


def p_value(value: float, low: float, high: float, null: float, freedom: float, scale: str = "") -> float:
    """Return the two-sided p value of the t test that the 95 % interval inverts; NaN if the interval has no width on the side of `null`."""
    from scipy.special import stdtr

    middle, end, at = (float(SCALES[scale][0](number)) for number in (value, low if null <= value else high, null))
    if end == middle:
        return math.nan
    return float(2 * stdtr(freedom, -abs((middle - at) / (middle - end)) * _quantile(LEVEL, freedom)))


def _quantile(level: float, freedom: float) -> float:
    """Return the value that Student's t exceeds in size with the probability 1 - level."""
    from scipy.special import stdtrit

    return float(-stdtrit(freedom, (1 - level) / 2))


def at_level(value: float, low: float, high: float, level: float, freedom: float, scale: str = "") -> tuple[float, float]:
    """Return the ends of the interval at another level, given the ends of the 95 % interval. The limits of the quantity are not known here.

    >>> at_level(0.0, -1.0, 2.0, 0.95, 9)
    (-1.0, 2.0)
    """
    forward, back = SCALES[scale]
    ratio = _quantile(level, freedom) / _quantile(LEVEL, freedom)
    middle = float(forward(value))
    first, last = (float(back(middle + ratio * (float(forward(end)) - middle))) for end in (low, high))
    return min(first, value), max(last, value)


def students_t(samples: ArrayLike, limits: tuple[float, float] = ANY, unit: str = "draws") -> Estimate:
    """Return the mean of independent samples with its interval by Student's t distribution; equal samples decide nothing.

    >>> estimate = students_t([0.0, 0.1, 0.2], SIGNED)
    >>> round(estimate.low, 3), round(estimate.value, 3), round(estimate.high, 3)
    (-0.148, 0.1, 0.348)
    """
    samples = np.asarray(samples, float)
    value, count = float(samples.mean()), len(samples)
    half = float(_quantile(LEVEL, count - 1) * np.std(samples, ddof=1) / np.sqrt(count)) if _differ(samples) else math.inf
    low, high = np.clip([value - half, value + half], *limits)
    return Estimate(value, float(low), float(high), count, limits=limits, unit=unit)


def _differ(values: NDArray) -> bool:
    """Return whether values differ by more than rounding errors."""
    return bool(np.ptp(values) > 1e-12 * max(1.0, float(np.abs(values).max())))


def interval_of_p(value: float, null: float, p: float, n: int, limits: tuple[float, float] = ANY, scale: str = "") -> Estimate:
    """Return an estimate over n objects with the interval that agrees with the two-sided p value of a permutation test against `null`.

    The interval is test-based (O. Miettinen, American Journal of Epidemiology 103 (1976) 226): the standard error is the distance between
    the estimate and `null`, over the quantile of p. An estimate that is not beyond most permuted ones (p of at least 0.5) spans all values.
    """
    forward, back = SCALES[scale]
    freedom, middle = max(n - 1, 1), float(forward(value))
    error = abs(middle - float(forward(null))) / _quantile(1 - p, freedom) if p < 0.5 else math.inf
    low, high = np.clip(back(middle + error * _quantile(LEVEL, freedom) * np.array([-1, 1])), *limits)
    low, high = min(float(low), value), max(float(high), value)
    return Estimate(value, low, high, n, None, limits, freedom, scale, test=PERMUTATION, unit="objects")


def permuted(value: float, shuffled: NDArray, n: int, limits: tuple[float, float] = ANY, scale: str = "") -> Estimate:
    """Return an estimate over n objects with the interval that inverts its permutation test (see `interval_of_p`), given the estimates
    (permutations,) with permuted objects, the original order included. An estimate that is not beyond most of these has their standard
    deviation as standard error.
    """
    p = permutation_p(value, shuffled)
    estimate = interval_of_p(value, float(shuffled.mean()), p, n, limits, scale)
    if p >= 0.5 and np.ptp(shuffled) > 0:
        forward, back = SCALES[scale]
        half = float(np.std(forward(shuffled))) * _quantile(LEVEL, estimate.degrees)
        low, high = np.clip(back(float(forward(value)) + half * np.array([-1, 1])), *limits)
        estimate = replace(estimate, low=min(float(low), value), high=max(float(high), value))
    return replace(estimate, shuffled=shuffled)


def permutation_p(value: float, shuffled: NDArray) -> float:
    """Return twice the share of the permuted estimates that are at least as far on the side of the estimate, at most 1."""
    return min(1.0, 2 * min(float(np.mean(shuffled >= value - 1e-12)), float(np.mean(shuffled <= value + 1e-12))))


def orders(count: int, seed: int) -> NDArray[np.int64]:
    """Return permutations (permutations, count): all of them, or PERMUTATIONS random ones after the original order.

    >>> orders(3, 0).shape, orders(12, 0).shape
    ((6, 3), (10000, 12))
    """
    return _orders(count, seed, PERMUTATIONS)


@functools.lru_cache(maxsize=8)
def _orders(count: int, seed: int, most: int) -> NDArray[np.int64]:
    if math.factorial(count) <= most:
        return np.array(list(itertools.permutations(range(count))))
    rng = np.random.default_rng([seed, 0xA1])
    return np.concatenate([np.arange(count)[None], rng.permuted(np.tile(np.arange(count), (most, 1)), axis=1)])


def sign_flipped(values: NDArray, seed: int, limits: tuple[float, float] = ANY) -> Estimate:
    """Return the mean of paired differences of objects (objects,) with the permutation test that swaps the two members of pairs."""
    count = len(values)
    if 2**count <= PERMUTATIONS:
        signs = np.array(list(itertools.product((1, -1), repeat=count)))
    else:
        signs = np.random.default_rng([seed, 0xA2]).choice([1, -1], (PERMUTATIONS + 1, count))
        signs[0] = 1
    return permuted(float(values.mean()), signs @ values / count, count, limits)


def mean(
    samples: ArrayLike, resamples: int, seed: int, limits: tuple[float, float] = ANY,
    scale: Callable[[NDArray[np.float64]], NDArray[np.float64]] = np.asarray, on: str = "",
) -> Estimate:  # fmt: skip
    """Return the mean of the samples with its confidence interval from a bootstrap over the samples, widened for few samples.

    For a single sample, and for samples that are all equal, both bounds equal the mean. The interval is widened on the scale `on` of SCALES
    and in the unit to which the increasing function `scale` converts means, because amplitudes could otherwise extend below zero.

    >>> mean([2.0], 100, 0).low
    2.0
    """
    from scipy.stats import bootstrap

    samples = np.asarray(samples, float)
    value = float(scale(samples.mean()))
    if len(samples) < 2:
        return replace(exact(value, len(samples)), limits=limits, scale=on)
    if np.ptp(samples) == 0:
        return resampled(value, np.full(resamples, value), len(samples), limits)
    bootstrapped: Any = bootstrap((samples,), np.mean, n_resamples=resamples, method="percentile", rng=np.random.default_rng(seed))
    forward, back = SCALES[on]
    drawn = back(widened(forward(scale(bootstrapped.bootstrap_distribution)), float(forward(value)), len(samples)))
    return replace(resampled(value, np.clip(drawn, *limits), len(samples), limits), scale=on)


def widening(n: int) -> float:
    """Return the factor by which deviations of a bootstrap over n items must grow, so that few items do not give too narrow an interval.

    The factor is sqrt(n/(n-1)) times the ratio of Student's t to the normal quantile. Without this factor, the 95 % interval of the mean of
    normally distributed items contains the true mean in only 49, 74, 78, 86 and 91 % of cases for n = 2, 3, 4, 6 and 12.

    For a single item, the function returns 1, because one item has no deviation from the mean.

    >>> round(widening(3), 2), round(widening(1000), 2), widening(1)
    (2.69, 1.0, 1.0)
    """
    return math.sqrt(n / (n - 1)) * _tail(n - 1) if n > 1 else 1.0


def _tail(freedom: float) -> float:
    """Return the 97.5 % quantile of Student's t distribution over that of the normal distribution."""
    from scipy.stats import norm

    return float(_quantile(LEVEL, freedom) / norm.isf((1 - LEVEL) / 2))


def widened(drawn: NDArray, value: float, n: int) -> NDArray:
    """Return the estimates `drawn` of the bootstrap samples of n items, with their deviations from the estimate `value` widened."""
    return value + widening(n) * (drawn - value)


def clustered(
    values: ArrayLike, clusters: ArrayLike, resamples: int, seed: int, classes: NDArray | None = None, limits: tuple[float, float] = ANY
) -> Estimate:
    """Return the mean of values (N,) or (seeds, N), with the interval of a bootstrap that draws whole clusters (N,), such as the recordings
    of one object; n counts clusters. With `classes` (N,), it is a mean over classes, clusters are drawn within each class, and the class
    with the fewest clusters decides how much the interval is widened.
    """
    clusters = np.asarray(clusters)
    value, drawn = score.seed_mean(np.asarray(values, float), clusters, resamples, seed, classes)
    kinds = np.zeros(len(clusters), int) if classes is None else classes
    fewest = min(np.unique(clusters[kinds == kind]).size for kind in np.unique(kinds))
    estimate = resampled(value, np.clip(widened(drawn, value, fewest), *limits), np.unique(clusters).size, limits)
    return replace(estimate, freedom=max(fewest - 1, 1), unit="objects")


def difference(first: NDArray, second: NDArray, resamples: int, seed: int) -> Estimate:
    """Return the mean of the items `first` minus the mean of the items `second`, with the interval of a bootstrap over both groups.

    The interval is widened for few items. n counts the items of the smaller group, because an interval needs more than one item in each
    group.

    >>> estimate = difference(np.array([3.0, 5.0]), np.array([1.0]), 100, 0)
    >>> estimate.value, estimate.low < 2, estimate.high > 4, estimate.n
    (3.0, True, True, 1)
    """
    rng = np.random.default_rng(seed)
    drawn = np.zeros(resamples)
    for items, sign in ((first, 1), (second, -1)):
        means = items[rng.integers(len(items), size=(resamples, len(items)))].mean(axis=1)
        drawn += sign * widened(means, float(items.mean()), len(items))
    return replace(resampled(float(np.mean(first) - np.mean(second)), drawn, min(len(first), len(second))), unit="objects")


def exact(value: float, n: int) -> Estimate:
    """Return an estimate without an interval: both bounds equal the value `value`."""
    return Estimate(float(value), float(value), float(value), n)


def resampled(value: float, drawn: ArrayLike, n: int, limits: tuple[float, float] = ANY) -> Estimate:
    """Return an estimate of n items whose interval is the percentile interval of the resampled values `drawn`."""
    drawn = np.asarray(drawn, float)
    return Estimate(value, *_interval(drawn, value), n, limits=limits, drawn=drawn)


def bootstrap(estimate: Callable[..., Any], resamples: int, seed: int, *samples: NDArray) -> Estimate:
    """Return estimate(*samples), a reduction along the last axis, with the interval of a bootstrap over the items of all samples (items,).

    >>> bootstrap(partial(np.median, axis=-1), 100, 0, np.array([1.0, 3.0, 4.0])).value
    3.0
    """
    count = len(samples[0])
    index = np.random.default_rng(seed).integers(count, size=(resamples, count))
    return resampled(float(estimate(*samples)), estimate(*(sample[index] for sample in samples)), count)


def ratio(above: NDArray, below: NDArray, resamples: int, seed: int) -> Estimate:
    """Return sum(above) / sum(below) over the items, with the interval of a bootstrap over items.

    >>> ratio(np.array([1.0, 3.0]), np.array([1.0, 1.0]), 100, 0).value
    2.0
    """
    return bootstrap(lambda numerator, denominator: numerator.sum(axis=-1) / denominator.sum(axis=-1), resamples, seed, above, below)


def rank_correlation(first: ArrayLike, second: ArrayLike) -> float:
    """Return Spearman's rank correlation. Raises InputError for fewer than three items, or if all values of one input are equal."""
    from scipy.stats import rankdata

    first, second = np.asarray(first, float), np.asarray(second, float)
    if first.shape != second.shape or first.ndim != 1 or len(first) < 3 or not (np.isfinite(first).all() and np.isfinite(second).all()):
        raise InputError(f"a correlation needs three or more finite pairs, not {first.shape} and {second.shape}")
    if np.ptp(first) == 0 or np.ptp(second) == 0:
        raise InputError("a correlation needs values that differ; one of the two is constant")
    return float(pearson(rankdata(first), rankdata(second)))


def spearman(first: ArrayLike, second: ArrayLike, seed: int) -> Estimate:
    """Compute Spearman's rank correlation over objects with its permutation test on Fisher's scale (see `permuted`)."""
    from scipy.stats import rankdata

    value, ranks = rank_correlation(first, second), rankdata(second)
    return permuted(value, pearson(rankdata(first), ranks[orders(len(ranks), seed)]), len(ranks), SIGNED, FISHER)


def correlation(first: NDArray, second: NDArray) -> float:
    """Return Pearson's correlation coefficient without an interval; 0 if all values of one input are equal."""
    return float(np.corrcoef(first, second)[0, 1]) if np.ptp(first) > 0 and np.ptp(second) > 0 else 0.0


def mantel(first: ArrayLike, second: ArrayLike, seed: int) -> Estimate:
    """Mantel test: correlation of two (n, n) distance matrices over the same objects. Ref: N. Mantel, Cancer Research 27 (1967).

    The test permutes the objects of one matrix (see `permuted`). Raises InputError for other matrices, or for equal distances.
    """
    first, second = (np.asarray(matrix, float) for matrix in (first, second))
    count = len(first)
    if first.shape != (count, count) or second.shape != first.shape or count < 3:
        raise InputError(f"Mantel test: give two square matrices of the same three or more objects, not {first.shape} and {second.shape}")
    if not all(np.isfinite(m).all() and np.allclose(m, m.T) for m in (first, second)):
        raise InputError("Mantel test: a distance matrix must be finite and symmetric")
    rows, columns = np.triu_indices(count, 1)
    if not (np.ptp(first[rows, columns]) and np.ptp(second[rows, columns])):
        raise InputError("Mantel test: all distances of one matrix are equal")
    shuffled = orders(count, seed)
    shuffled = pearson(first[rows, columns], second[shuffled[:, rows], shuffled[:, columns]])
    return permuted(float(pearson(first[rows, columns], second[rows, columns])), shuffled, count, SIGNED, FISHER)


def share(successes: float, trials: int) -> Estimate:
    """Return the share of successes among the trials with its exact binomial confidence interval.

    >>> share(9, 9).low > 0.66
    True
    """
    if not 0 <= successes <= trials or trials < 1:
        raise InputError(f"a share needs one trial or more: {successes} of {trials}")
    low, value, high = score.exact_interval(successes / trials, trials)
    return Estimate(value, low, high, trials, limits=SHARE, test=BINOMIAL, unit="trials")


def coefficient_of_variation(samples: ArrayLike, resamples: int, seed: int) -> Estimate:
    """Return the sample standard deviation of positive values divided by their mean.

    The interval is that of log-normal values, which contains the true value in 93 to 96 % of cases for 3 to 11 values (normal values: 83
    to 90 %), where a bootstrap contains it in 47 to 60 % of cases for four values.
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


def over_draws(estimates: Sequence[Estimate], resamples: int, seed: int) -> Estimate:
    """Join the estimates of several draws of the measurement to an estimate of their mean. Draws without items are left out.

    - Objects that are the classes of a closed set: Student's t over draws.
    - The same permutations in all draws: the permuted estimates are averaged too, so that the test permutes the pooled answers.
    - Otherwise: a bootstrap over draws and items together (A. Owen, Annals of Applied Statistics 1 (2007) 386), with the same sample of
      items in each draw. The spread of the items also spreads the draws; this part counts once. The sum of both deviations is widened for
      the degrees of freedom of Welch and Satterthwaite. n is the smallest number of items, or that of draws if each has a single item.
    """
    estimates = [e for e in estimates if e.n] or estimates[:1]
    draws, first = len(estimates), estimates[0]
    ends = np.array([(e.value, e.low, e.high) for e in estimates])
    values, items = ends[:, 0], min(e.n for e in estimates)
    if draws == 1 or (all(e.drawn is None for e in estimates) and np.array_equal(ends, ends[[0] * draws], equal_nan=True)):
        return first  # the estimate does not depend on the draw
    if first.closed and _differ(values):
        return replace(students_t(values, first.limits), closed=True)
    if all(e.shuffled is not None and e.shuffled.shape == first.shuffled.shape for e in estimates):  # type: ignore[union-attr]
        return permuted(float(values.mean()), np.mean([e.shuffled for e in estimates], axis=0), items, first.limits, first.scale)  # type: ignore[arg-type]
    rng = np.random.default_rng([seed, 0xD2])
    normal = rng.standard_normal(resamples)
    value, (forward, back) = float(values.mean()), SCALES[first.scale]
    values = forward(values)
    wide = np.array([_tail(e.degrees) for e in estimates])
    drawn = [  # the bootstrap samples, or `normal` scaled to the width of the interval
        np.resize(np.asarray(e.drawn, np.float64), resamples) if e.drawn is not None
        else e.value + normal * np.where(normal > 0, e.high - e.value, e.value - e.low) / 1.96 for e in estimates
    ]  # fmt: skip
    samples = (forward(np.stack(drawn)) - values[:, None]) / wide[:, None]
    index = rng.integers(draws, size=(draws, resamples))
    inner = samples[index, np.arange(resamples)].mean(axis=0)
    between = math.sqrt(draws / (draws - 1)) * (values[index].mean(axis=0) - values.mean())
    with np.errstate(invalid="ignore"):  # some samples may be NaN or infinite
        within, across = float(np.nanvar(inner)), float(np.var(values, ddof=1)) / draws
        counted = (float(np.nanmean(np.nanvar(samples, axis=1))) - within) / (draws - 1)  # part of `across` that `within` contains
    if across > 0:
        between *= math.sqrt(max(1 - counted / across, 0.0))
        across = max(across - counted, 0.0)
    spread = within**2 / max(items - 1, 1) + across**2 / (draws - 1)
    freedom = (within + across) ** 2 / spread if 0 < spread < math.inf else draws - 1
    single = all(e.n == 1 for e in estimates)
    samples = back(forward(value) + _tail(freedom) * (inner + between))
    joined = resampled(value, np.clip(samples, *first.limits), draws if single else items, first.limits)
    return replace(joined, freedom=freedom, scale=first.scale, unit="draws" if single else f"draws and {first.unit}")


def ssim(first: NDArray, second: NDArray) -> float:
    """Return the structural similarity (SSIM) of two maps with values from 0 to 1. The SSIM window is at most seven cells wide."""
    from skimage.metrics import structural_similarity

    size = min(7, *(side - 1 + side % 2 for side in first.shape))
    similarity: Any = structural_similarity(first, second, data_range=1.0, win_size=size)
    return float(similarity)


def ms_ssim(first: NDArray, second: NDArray) -> float:
    """Return the multi-scale structural similarity of maps with values from 0 to 1, without scales below the window of 11 cells.
    Ref: Z. Wang, E. Simoncelli, A. Bovik, Asilomar Conference on Signals, Systems and Computers (2003) 1398.
    """
    from scipy.ndimage import gaussian_filter, uniform_filter

    smooth, (bright, contrast) = partial(gaussian_filter, sigma=1.5, truncate=3.5), (0.01**2, 0.03**2)
    weights = [weight for k, weight in enumerate(MS_WEIGHTS) if min(first.shape) >> k >= 11] or list(MS_WEIGHTS[:1])
    product = 1.0
    for scale, weight in enumerate(weights):
        mean_1, mean_2 = smooth(first), smooth(second)
        var_1, var_2 = smooth(first**2) - mean_1**2, smooth(second**2) - mean_2**2
        index = (2 * (smooth(first * second) - mean_1 * mean_2) + contrast) / (var_1 + var_2 + contrast)  # contrast and structure
        if scale == len(weights) - 1:  # luminance, at the coarsest scale only
            index = index * (2 * mean_1 * mean_2 + bright) / (mean_1**2 + mean_2**2 + bright)
        product *= max(float(index.mean()), 0.0) ** (weight / sum(weights))
        first, second = (uniform_filter(image, 2)[::2, ::2] for image in (first, second))
    return product


def pearson(first: NDArray, second: NDArray) -> NDArray:
    """Compute Pearson's correlation coefficient along the last axis; NaN where all values of one input are equal."""
    first, second = first - first.mean(axis=-1, keepdims=True), second - second.mean(axis=-1, keepdims=True)
    norm = np.sqrt(np.sum(first**2, axis=-1) * np.sum(second**2, axis=-1))
    return np.divide(np.sum(first * second, axis=-1), norm, out=np.full(np.shape(norm), np.nan), where=norm > 0)[()]


def _interval(drawn: NDArray, value: float) -> tuple[float, float]:
    """Compute the percentile interval of resampled values without NaN, extended to contain `value`; an end may be infinite."""
    drawn = np.sort(drawn[~np.isnan(drawn)])
    if not len(drawn):
        return value, value
    with np.errstate(invalid="ignore"):  # the interpolation between two equal infinities is NaN
        low, high = np.quantile(drawn, [0.025, 0.975])
    low, high = (drawn[round(at * (len(drawn) - 1))] if np.isnan(bound) else bound for bound, at in ((low, 0.025), (high, 0.975)))
    return min(float(low), value), max(float(high), value)
