"""Compare rank normalisation and the calibration with a corner reflector with values computed by hand."""

from __future__ import annotations

import numpy as np
import pytest

from radartwin.features.normalise import fit_map, rank_normalise


def test_ranks_do_not_change_under_increasing_functions() -> None:
    values, group = np.random.default_rng(0).normal(size=(40, 3)), np.zeros(40)
    changed = np.column_stack([np.exp(values[:, 0]), values[:, 1] ** 3 - 7, 0.01 * values[:, 2]])
    assert np.array_equal(rank_normalise(values, group), rank_normalise(changed, group))
    assert rank_normalise(-values, group) == pytest.approx(1 - rank_normalise(values, group))


def test_groups_are_ranked_separately() -> None:
    matrix = np.array([[1.0], [2.0], [100.0], [300.0], [200.0]])
    ranked = rank_normalise(matrix, np.array(["0.5 m", "0.5 m", "2 m", "2 m", "2 m"]))
    assert ranked[:, 0] == pytest.approx([1 / 4, 3 / 4, 1 / 6, 5 / 6, 1 / 2])


def test_calibration_maps_each_feature_to_the_measured_scale() -> None:
    rng = np.random.default_rng(3)
    simulated = rng.normal([-40.0, 0.2], [3.0, 0.05], size=(200, 2))
    slope, offset = np.array([0.5, 2.0]), np.array([-12.0, 0.1])
    measured = (simulated * slope + offset)[rng.permutation(200)[:150]]  # the measured frames are a random subset in random order
    calibration = fit_map(simulated, measured)
    assert calibration.slope == pytest.approx(slope, rel=0.1)
    assert calibration.apply(simulated).mean(axis=0) == pytest.approx(measured.mean(axis=0))
    assert calibration.apply(simulated).std(axis=0) == pytest.approx(measured.std(axis=0))


def test_constant_feature_is_only_shifted() -> None:
    simulated = np.column_stack([np.full(5, 3.0), np.arange(5.0)])
    calibration = fit_map(simulated, np.column_stack([np.arange(5.0), np.full(5, 7.0)]))
    assert calibration.slope.tolist() == [1.0, 0.0]
    assert calibration.apply(np.array([4.0, 9.0])).tolist() == [3.0, 7.0]
    assert fit_map(np.array([[1.0]]), np.array([[5.0]])).apply(np.array([2.0])).tolist() == [6.0]
