"""Statistics against the library's own, published examples and the figures the paper prints."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy import stats

from experiments import statistics
from radartwin.errors import InputError


def related(n: int = 12, strength: float = 1.0, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    first = rng.normal(size=n)
    return first, strength * first + rng.normal(size=n)


def test_correlations_are_the_librarys_with_an_interval_and_a_p_of_their_own() -> None:
    first, second = related()
    library: Any
    for ours, library in ((statistics.spearman, stats.spearmanr), (statistics.pearson, stats.pearsonr)):
        found = ours(first, second, 2000, 0)
        assert found.value == pytest.approx(library(first, second).statistic)
        assert found.low < found.value < found.high
        assert found.p == pytest.approx(library(first, second, alternative="greater").pvalue, rel=0.5)
        assert found.n == 12
        assert found == ours(first, second, 2000, 0)
    assert statistics.spearman(first, np.exp(first), 100, 0).value == pytest.approx(1)


def test_ties_and_draws_of_one_item_do_not_spoil_a_rank_correlation() -> None:
    found = statistics.spearman([1.0, 1, 2], [1.0, 2, 3], 500, 0)
    assert found.value == pytest.approx(np.sqrt(3) / 2)
    assert -1 <= found.low <= found.value <= found.high <= 1
    assert found.p >= 1 / 6


def test_the_p_of_a_correlation_is_exact_where_all_pairings_can_be_counted() -> None:
    assert statistics.spearman(np.arange(5.0), np.arange(5.0), 100, 0).p == pytest.approx(1 / 120)


def test_intervals_of_a_correlation_cover_the_truth_about_as_often_as_they_say() -> None:
    held = 0
    for seed in range(100):
        first, second = related(40, 1.0, seed)
        found = statistics.pearson(first, second, 300, seed, alternative=None)
        held += found.low <= np.sqrt(0.5) <= found.high
    assert 86 <= held <= 99  # 95 % less what a percentile bootstrap of 40 pairs loses


def distances(points: np.ndarray) -> np.ndarray:
    return np.abs(points[:, None] - points[None])


def test_mantel_finds_matrices_of_one_configuration_and_not_of_two() -> None:
    rng = np.random.default_rng(1)
    points = rng.normal(size=12)
    same = statistics.mantel(distances(points), distances(points + 0.1 * rng.normal(size=12)), 999, 0)
    assert same.value > 0.9
    assert same.p == pytest.approx(0.001)  # no drawn permutation is as good
    assert same.low < same.value < same.high
    other = [statistics.mantel(distances(points), distances(rng.normal(size=12)), 99, seed).p for seed in range(40)]
    assert 0.3 < np.mean(other) < 0.7  # uniform under no relation


def test_mantel_forgets_scale_and_refuses_what_is_no_distance_matrix() -> None:
    points = np.random.default_rng(2).normal(size=6)
    other = distances(np.roll(points, 1))
    first, second = (statistics.mantel(scale * distances(points), other, 50, 0) for scale in (1.0, 30.0))
    assert second.value == pytest.approx(first.value)
    assert second.p == first.p
    few = statistics.mantel(distances(points[:3]), other[:3, :3], 200, 0)  # some draws hold one object alone
    assert few.low <= few.value <= few.high
    with pytest.raises(InputError, match="square"):
        statistics.mantel(np.zeros((2, 2)), np.zeros((2, 2)), 9, 0)
    with pytest.raises(InputError, match="symmetric"):
        statistics.mantel(np.triu(np.ones((4, 4))), np.ones((4, 4)), 9, 0)
    with pytest.raises(InputError, match="equal"):
        statistics.mantel(1 - np.eye(4), distances(np.arange(4.0)), 9, 0)


def test_binomial_figures_are_those_of_the_paper() -> None:
    assert statistics.share(9, 9).p == pytest.approx(2**-9)
    recognised = statistics.share(23, 100, 1 / 11)  # 0.23 of about a hundred recordings against a chance of 0.091
    assert recognised.p < 1e-4
    assert recognised.low < 0.23 < recognised.high
    assert statistics.share(0, 5).low == 0
    with pytest.raises(InputError, match="one trial"):
        statistics.share(0, 0)


def test_the_coefficient_of_variation_is_that_of_its_sample() -> None:
    found = statistics.coefficient_of_variation([1.0, 2.0, 3.0], 200, 0)
    assert found.value == pytest.approx(0.5)
    assert found.low <= 0.5 <= found.high
    assert statistics.coefficient_of_variation([5.0, 10.0, 15.0], 200, 0).high == pytest.approx(found.high)
    with pytest.raises(InputError, match="positive"):
        statistics.coefficient_of_variation([1.0, -1.0], 10, 0)


def test_ssim_is_one_for_a_map_and_itself_and_falls_with_noise() -> None:
    rng = np.random.default_rng(3)
    image = np.clip(np.add.outer(np.linspace(0, 1, 40), np.zeros(20)), 0, 1)
    assert statistics.ssim(image, image) == pytest.approx(1)
    little, much = (statistics.ssim(image, np.clip(image + sigma * rng.normal(size=image.shape), 0, 1)) for sigma in (0.02, 0.3))
    assert much < little < 1
    assert statistics.ssim(image[:4, :4], image[:4, :4]) == pytest.approx(1)
