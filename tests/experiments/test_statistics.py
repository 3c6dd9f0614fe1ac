"""Compare the statistics functions with library functions, published examples and the values in the paper."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from experiments import statistics
from radartwin.errors import InputError


def related(n: int = 12, strength: float = 1.0, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    first = rng.normal(size=n)
    return first, strength * first + rng.normal(size=n)


def test_correlation_equals_scipy_and_has_interval_and_p() -> None:
    first, second = related()
    found, library = statistics.spearman(first, second, 0), stats.spearmanr(first, second)
    assert found.value == pytest.approx(library.statistic)  # type: ignore[attr-defined]
    assert found.low < found.value < found.high
    assert found.p(0.0) == pytest.approx(library.pvalue, rel=0.6)  # type: ignore[attr-defined]
    assert (found.n, found.test, found.scale) == (12, statistics.PERMUTATION, statistics.FISHER)
    assert found == statistics.spearman(first, second, 0)
    assert statistics.rank_correlation(first, np.exp(first)) == pytest.approx(1)
    # with few items, all permutations are counted, so that p is exact
    assert statistics.spearman(np.arange(5.0), np.arange(5.0), 0).p(0.0) == pytest.approx(2 / 120)


def test_rank_correlation_handles_ties() -> None:
    found = statistics.spearman([1.0, 1, 2], [1.0, 2, 3], 0)
    assert found.value == pytest.approx(np.sqrt(3) / 2)
    assert -1 <= found.low <= found.value <= found.high <= 1
    assert found.p(0.0) >= 1 / 3


def test_correlation_intervals_have_their_nominal_coverage() -> None:
    held, truth = 0, 6 / np.pi * np.arcsin(np.sqrt(0.5) / 2)  # rank correlation of normal variables with a correlation of sqrt(1/2)
    for seed in range(100):
        found = statistics.spearman(*related(12, 1.0, seed), seed)
        held += found.low <= truth <= found.high
    assert held >= 90


def distances(points: np.ndarray) -> np.ndarray:
    return np.abs(points[:, None] - points[None])


def test_mantel_separates_related_from_unrelated_matrices() -> None:
    rng = np.random.default_rng(1)
    points = rng.normal(size=12)
    same = statistics.mantel(distances(points), distances(points + 0.1 * rng.normal(size=12)), 0)
    assert same.value > 0.9
    assert same.p(0.0) == pytest.approx(2e-4, rel=0.1)  # no random permutation gives as high a correlation
    assert same.low < same.value < same.high
    other = [statistics.mantel(distances(points), distances(rng.normal(size=12)), seed).p(0.0) for seed in range(40)]
    assert 0.3 < np.mean(other) < 0.7  # without a relation, p is uniformly distributed


def test_mantel_ignores_scale_and_refuses_other_matrices() -> None:
    points = np.random.default_rng(2).normal(size=6)
    other = distances(np.roll(points, 1))
    first, second = (statistics.mantel(scale * distances(points), other, 0) for scale in (1.0, 30.0))
    assert second.value == pytest.approx(first.value)
    assert second.p(0.0) == pytest.approx(first.p(0.0))
    few = statistics.mantel(distances(points[:3]), other[:3, :3], 0)
    assert few.low <= few.value <= few.high
    with pytest.raises(InputError, match="square"):
        statistics.mantel(np.zeros((2, 2)), np.zeros((2, 2)), 0)
    with pytest.raises(InputError, match="symmetric"):
        statistics.mantel(np.triu(np.ones((4, 4))), np.ones((4, 4)), 0)
    with pytest.raises(InputError, match="equal"):
        statistics.mantel(1 - np.eye(4), distances(np.arange(4.0)), 0)


def test_a_share_has_the_exact_binomial_interval() -> None:
    found = statistics.share(23, 100)  # 0.23 of a hundred recordings
    library = stats.binomtest(23, 100).proportion_ci()
    assert (found.low, found.high) == pytest.approx((library.low, library.high))
    assert found.p(found.low) == pytest.approx(0.05)
    assert statistics.share(0, 5).low == 0
    with pytest.raises(InputError, match="one trial"):
        statistics.share(0, 0)


def test_coefficient_of_variation_matches_its_sample() -> None:
    found = statistics.coefficient_of_variation([1.0, 2.0, 3.0], 200, 0)
    assert found.value == pytest.approx(0.5)
    assert found.low <= 0.5 <= found.high
    assert statistics.coefficient_of_variation([5.0, 10.0, 15.0], 200, 0).high == pytest.approx(found.high)
    with pytest.raises(InputError, match="positive"):
        statistics.coefficient_of_variation([1.0, -1.0], 10, 0)


def test_coefficient_of_variation_of_four_values_has_a_true_interval() -> None:
    """The 95 % interval contains the true coefficient of variation in 92 to 98 % of 500 samples of four values."""
    rng, true = np.random.default_rng(5), 0.3
    inside = 0
    for _ in range(500):
        found = statistics.coefficient_of_variation(rng.lognormal(0, np.sqrt(np.log1p(true**2)), 4), 400, int(rng.integers(1000)))
        inside += found.low <= true <= found.high
    assert 0.92 < inside / 500 < 0.98
    assert statistics.coefficient_of_variation([1e-12, 1.0], 400, 0).high == np.inf


def test_ssim_is_one_for_equal_maps_and_falls_with_noise() -> None:
    rng = np.random.default_rng(3)
    image = np.clip(np.add.outer(np.linspace(0, 1, 40), np.zeros(20)), 0, 1)
    assert statistics.ssim(image, image) == pytest.approx(1)
    little, much = (statistics.ssim(image, np.clip(image + sigma * rng.normal(size=image.shape), 0, 1)) for sigma in (0.02, 0.3))
    assert much < little < 1
    assert statistics.ssim(image[:4, :4], image[:4, :4]) == pytest.approx(1)


def test_multi_scale_similarity_is_that_of_the_library_at_one_scale_and_falls_with_noise() -> None:
    from skimage.metrics import structural_similarity

    rng = np.random.default_rng(4)
    small = np.clip(rng.random((16, 20)) / 2 + 0.2, 0, 1)
    noisy = np.clip(small + 0.1 * rng.normal(size=small.shape), 0, 1)
    gaussian = {"gaussian_weights": True, "sigma": 1.5, "use_sample_covariance": False}
    _, library = structural_similarity(small, noisy, data_range=1.0, full=True, **gaussian)
    assert statistics.ms_ssim(small, noisy) == pytest.approx(library.mean())
    image = np.clip(np.add.outer(np.linspace(0, 1, 120), np.linspace(0, 0.5, 180)), 0, 1)
    little, much = (statistics.ms_ssim(image, np.clip(image + sigma * rng.normal(size=image.shape), 0, 1)) for sigma in (0.02, 0.3))
    assert 0 < much < little < statistics.ms_ssim(image, image) == pytest.approx(1)


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
