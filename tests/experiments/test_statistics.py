"""Compare the statistics functions with library functions, exact counts and the nominal coverage of intervals."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from experiments import statistics
from experiments.statistics import Estimate
from radartwin.errors import InputError


def related(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return twelve pairs of normal variables with a correlation of sqrt(1/2)."""
    first = rng.normal(size=12)
    return first, first + rng.normal(size=12)


def of_items(count: int) -> Callable[[np.random.Generator, int], Estimate]:
    return lambda rng, trial: statistics.mean(rng.standard_normal(count), 300, trial)


def of_draws(between: float, within: float) -> Callable[[np.random.Generator, int], Estimate]:
    """Return the mean over ten draws d of twelve items i with the values between * a_d + within * b_i."""

    def estimate(rng: np.random.Generator, trial: int) -> Estimate:
        values = between * rng.standard_normal((10, 1)) + within * rng.standard_normal(12)
        return statistics.over_draws([statistics.mean(items, 300, trial) for items in values], 300, trial)

    return estimate


def of_single_items(count: int) -> Callable[[np.random.Generator, int], Estimate]:
    return lambda rng, trial: statistics.over_draws([Estimate(at, at, at, 1) for at in rng.standard_normal(count)], 300, trial)


def of_variation(rng: np.random.Generator, trial: int) -> Estimate:
    return statistics.coefficient_of_variation(rng.lognormal(0, np.sqrt(np.log1p(0.3**2)), 4), 300, trial)


RANK_CORRELATION = float(6 / np.pi * np.arcsin(np.sqrt(0.5) / 2))  # of normal variables with a correlation of sqrt(1/2)
COVERAGE: list[tuple[Callable[[np.random.Generator, int], Estimate], float, int, float, float]] = [
    *((of_items(count), 0.0, 400, 0.89, 0.99) for count in (2, 3, 4, 12)),
    *((of_draws(*spreads), 0.0, 300, 0.86, 0.98) for spreads in ((1.0, 0.0), (0.3, 1.0))),
    *((of_single_items(count), 0.0, 400, 0.9, 1.0) for count in (2, 5)),
    (of_variation, 0.3, 500, 0.92, 0.98),
    (lambda rng, trial: statistics.spearman(*related(rng), trial), RANK_CORRELATION, 100, 0.9, 1.0),
]


@pytest.mark.parametrize(("estimate", "truth", "trials", "least", "most"), COVERAGE)
def test_intervals_have_their_coverage(
    estimate: Callable[[np.random.Generator, int], Estimate], truth: float, trials: int, least: float, most: float
) -> None:
    """A percentile bootstrap of twelve values covers 90 to 93 %."""
    rng = np.random.default_rng(0)
    estimates = [estimate(rng, trial) for trial in range(trials)]
    assert least <= np.mean([found.low <= truth <= found.high for found in estimates]) <= most


def test_correlation_equals_scipy_and_has_interval_and_p() -> None:
    first, second = related(np.random.default_rng(0))
    found, library = statistics.spearman(first, second, 0), stats.spearmanr(first, second)
    assert found.value == pytest.approx(library.statistic)  # type: ignore[attr-defined]
    assert found.low < found.value < found.high
    assert found.p(0.0) == pytest.approx(library.pvalue, rel=0.6)  # type: ignore[attr-defined]
    assert (found.n, found.test, found.scale) == (12, statistics.PERMUTATION, statistics.FISHER)
    assert found == statistics.spearman(first, second, 0)
    assert statistics.rank_correlation(first, np.exp(first)) == pytest.approx(1)
    # with few items, all permutations are counted, so that p is exact
    assert statistics.spearman(np.arange(5.0), np.arange(5.0), 0).p(0.0) == pytest.approx(2 / 120)
    ties = statistics.spearman([1.0, 1, 2], [1.0, 2, 3], 0)
    assert ties.value == pytest.approx(np.sqrt(3) / 2)
    assert -1 <= ties.low <= ties.value <= ties.high <= 1
    assert ties.p(0.0) >= 1 / 3


def distances(points: np.ndarray) -> np.ndarray:
    return np.abs(points[:, None] - points[None])


def test_mantel_separates_related_from_unrelated_matrices_at_any_scale() -> None:
    rng = np.random.default_rng(1)
    points = rng.normal(size=12)
    near = distances(points + 0.1 * rng.normal(size=12))
    same, scaled = (statistics.mantel(scale * distances(points), near, 0) for scale in (1.0, 30.0))
    assert same.value > 0.9
    assert same.p(0.0) == pytest.approx(2e-4, rel=0.1)  # no random permutation gives as high a correlation
    assert same.low < same.value < same.high
    assert (scaled.value, scaled.p(0.0)) == pytest.approx((same.value, same.p(0.0)))
    other = [statistics.mantel(distances(points), distances(rng.normal(size=12)), seed).p(0.0) for seed in range(40)]
    assert 0.3 < np.mean(other) < 0.7  # without a relation, p is uniformly distributed
    few = statistics.mantel(distances(points[:3]), distances(np.roll(points[:3], 1)), 0)
    assert few.low <= few.value <= few.high


@pytest.mark.parametrize(
    ("call", "word"),
    [
        (lambda: statistics.mantel(np.zeros((2, 2)), np.zeros((2, 2)), 0), "square"),
        (lambda: statistics.mantel(np.triu(np.ones((4, 4))), np.ones((4, 4)), 0), "symmetric"),
        (lambda: statistics.mantel(1 - np.eye(4), distances(np.arange(4.0)), 0), "equal"),
        (lambda: statistics.share(0, 0), "one trial"),
        (lambda: statistics.coefficient_of_variation([1.0, -1.0], 10, 0), "positive"),
    ],
)
def test_samples_without_an_estimate_are_refused(call: Callable[[], object], word: str) -> None:
    with pytest.raises(InputError, match=word):
        call()


def test_a_share_has_the_exact_binomial_interval() -> None:
    found, library = statistics.share(23, 100), stats.binomtest(23, 100).proportion_ci()
    assert (found.low, found.high) == pytest.approx((library.low, library.high))
    assert found.p(found.low) == pytest.approx(0.05)
    assert statistics.share(0, 5).low == 0


def test_coefficient_of_variation_matches_its_sample_at_any_scale() -> None:
    found = statistics.coefficient_of_variation([1.0, 2.0, 3.0], 200, 0)
    assert found.value == pytest.approx(0.5)
    assert found.low <= 0.5 <= found.high
    assert statistics.coefficient_of_variation([5.0, 10.0, 15.0], 200, 0).high == pytest.approx(found.high)
    assert statistics.coefficient_of_variation([1e-12, 1.0], 400, 0).high == np.inf


def test_similarities_of_maps_are_those_of_the_library_and_fall_with_noise() -> None:
    from skimage.metrics import structural_similarity

    rng = np.random.default_rng(4)
    small = np.clip(rng.random((16, 20)) / 2 + 0.2, 0, 1)
    noisy = np.clip(small + 0.1 * rng.normal(size=small.shape), 0, 1)
    gaussian = {"gaussian_weights": True, "sigma": 1.5, "use_sample_covariance": False}
    library: Any = structural_similarity(small, noisy, data_range=1.0, full=True, **gaussian)
    assert statistics.ms_ssim(small, noisy) == pytest.approx(library[1].mean())
    image = np.clip(np.add.outer(np.linspace(0, 1, 120), np.linspace(0, 0.5, 180)), 0, 1)
    for similarity in (statistics.ssim, statistics.ms_ssim):
        little, much = (similarity(image, np.clip(image + sigma * rng.normal(size=image.shape), 0, 1)) for sigma in (0.02, 0.3))
        assert 0 < much < little < similarity(image, image) == pytest.approx(1)
    assert statistics.ssim(image[:4, :4], image[:4, :4]) == pytest.approx(1)


def test_dependent_values_of_a_cluster_count_as_one_item() -> None:
    """The interval of clusters of equal values is that of one value per cluster, also within classes and at a limit."""
    values = np.random.default_rng(3).uniform(size=12)
    once = statistics.mean(values, 4000, 0)
    four = statistics.clustered(np.repeat(values, 4), np.repeat(np.arange(12), 4), 4000, 0)
    assert (four.value, four.n) == (pytest.approx(once.value), 12)
    assert (four.low, four.high) == pytest.approx((once.low, once.high), abs=0.01)
    kinds = np.repeat(["a", "b"], 6)
    within = statistics.clustered(values, np.arange(12), 4000, 0, kinds)
    apart = statistics.clustered(values, np.arange(12), 4000, 0)
    assert within.high - within.low > apart.high - apart.low, "six clusters of a class widen more than twelve"
    right = np.arange(12) < 11
    assert statistics.clustered(right, np.arange(12), 400, 0, limits=statistics.SHARE).high == 1


def test_a_bound_is_infinite_if_many_resamples_are() -> None:
    assert statistics.resampled(4.0, [2.0, 3.0, 4.0, np.inf], 4).high == np.inf
    assert statistics.resampled(4.0, [2.0, 3.0, 4.0, np.nan], 4).high == pytest.approx(4.0)


def test_equal_draws_have_the_interval_and_the_p_of_one_draw() -> None:
    """The figure belongs to the same items in every draw, so more draws do not make it more certain."""
    rng = np.random.default_rng(3)
    first, second = rng.standard_normal((2, 12))
    ordered = statistics.spearman(first, second + first, 0)
    for one in (statistics.mean(first, 500, 0), ordered):
        many = statistics.over_draws([one] * 3, 500, 0)
        assert (many.value, many.low, many.high) == pytest.approx((one.value, one.low, one.high))
    assert statistics.over_draws([ordered] * 10, 200, 0).p(0.0) == pytest.approx(ordered.p(0.0))
    bare = Estimate(0.5, 0.4, 0.6, 9)  # without resamples
    shifted = [replace(bare, value=0.5 + at, low=0.4 + at, high=0.6 + at) for at in np.linspace(-1e-9, 1e-9, 10)]
    for draws in ([bare] * 10, shifted):
        many = statistics.over_draws(draws, 20_000, 0)
        assert (many.low, many.high) == pytest.approx((0.4, 0.6), abs=0.005)


def test_draws_that_differ_by_rounding_alone_are_equal() -> None:
    """Six objects gain 0.1 in each of three draws, others in each draw; the three means differ by 7e-18."""
    sixes = ([0.1] * 6 + [0.0] * 6, [0.0] * 6 + [0.1] * 6, [0.1, 0.0] * 6)
    gains = [replace(statistics.sign_flipped(np.array(six), 0, statistics.SIGNED), closed=True) for six in sixes]
    assert 0 < np.ptp([gain.value for gain in gains]) < 1e-16
    joined = statistics.over_draws(gains, 500, 0)
    assert (joined.test, joined.unit) == ("permutation", "objects")
    assert joined.p(0.0) == pytest.approx(2 / 2**12)  # all twelve objects gain
    assert statistics.students_t([gain.value for gain in gains]).low == -np.inf


def test_single_empty_and_limited_draws() -> None:
    one, nothing = statistics.mean([1.0, 2.0, 4.0], 100, 0), Estimate(0.5, 0.0, 1.0, 0)
    assert statistics.over_draws([one], 100, 0) is one
    assert statistics.over_draws([nothing, one], 50, 0) is one
    assert statistics.over_draws([nothing] * 3, 50, 0) == nothing
    single = statistics.over_draws([statistics.mean([value], 50, 0) for value in (1.0, 2.0, 3.0)], 2000, 0)
    assert (single.value, single.n) == (2.0, 3), "one recording in each draw counts the draws"
    assert single.low < 1.3 < 2.7 < single.high
    limited = [replace(statistics.mean([at, at + 0.1], 100, 0), limits=statistics.SIGNED) for at in (0.1, 0.5, 0.9)]
    joined = statistics.over_draws(limited, 500, 0)
    assert (joined.high, joined.limits) == (1.0, statistics.SIGNED)


def test_a_ratio_is_judged_by_its_logarithm() -> None:
    """The interval of a ratio and that of its inverse have the same p value, and both ends stay positive at every level."""
    ratio, inverse = (statistics.p_value(*ends, 1.0, 9, statistics.LOG) for ends in ((3.0, 2.0, 4.5), (1 / 3, 1 / 4.5, 1 / 2)))
    assert ratio == pytest.approx(inverse)
    assert statistics.at_level(3.0, 0.5, 18.0, 0.9999, 9, statistics.LOG)[0] > 0
    assert statistics.mean([0.99, 0.9, 0.95], 500, 0, statistics.SIGNED, on=statistics.FISHER).high < 1
