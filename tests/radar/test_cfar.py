"""CFAR: its false-alarm rate, the published threshold factors, and targets that mask each other."""

import math

import numpy as np
import pytest

from radartwin.errors import InputError
from radartwin.radar.cfar import ca_cfar, ca_factor, os_cfar, os_factor


@pytest.mark.parametrize(("cells", "rate"), [(8, 1e-2), (16, 1e-4), (32, 1e-6)])
def test_single_look_cell_averaging_has_the_textbook_factor(cells, rate):
    assert ca_factor(cells, rate) == pytest.approx(cells * (rate ** (-1 / cells) - 1), rel=1e-9)


@pytest.mark.parametrize(("cells", "rank"), [(16, 12), (24, 18), (32, 16)])
def test_single_look_ordered_statistic_has_rohlings_false_alarm_rate(cells, rank):
    factor = os_factor(cells, rank, 1e-4)
    rate = math.prod((cells - i) / (cells - i + factor) for i in range(rank))
    # The factor comes from 4000 midpoints; their error in the rate is under two per cent.
    assert rate == pytest.approx(1e-4, rel=0.02)


@pytest.mark.parametrize("cfar", [ca_cfar, os_cfar])
@pytest.mark.parametrize("looks", [1, 8])
def test_false_alarm_rate_in_noise_is_the_requested_rate(cfar, looks):
    noise = np.random.default_rng(7).gamma(looks, 1 / looks, size=(200, 500))
    hits, threshold = cfar(noise, guard=(1, 2), training=(3, 4), false_alarm=1e-3, looks=looks, wrap=(True, False))
    assert hits.shape == threshold.shape == noise.shape
    # 100 expected. Cells share training cells, so the spread exceeds Poisson's: 5 sigma.
    assert 50 < hits.sum() < 150


@pytest.mark.parametrize("cfar", [ca_cfar, os_cfar])
def test_threshold_is_proportional_to_the_noise_level(cfar):
    noise = np.random.default_rng(8).gamma(8, 1 / 8, size=400)
    options = {"guard": 2, "training": 8, "false_alarm": 1e-4, "looks": 8}
    np.testing.assert_allclose(cfar(1e-9 * noise, **options)[1], 1e-9 * cfar(noise, **options)[1], rtol=1e-9)


def test_ordered_statistic_detects_two_close_targets_that_cell_averaging_masks():
    power = np.ones(200)
    power[[100, 106]] = 60.0
    options = {"guard": 2, "training": 8, "false_alarm": 1e-5, "looks": 1}
    assert not ca_cfar(power, **options)[0][100]
    assert os_cfar(power, **options)[0][[100, 106]].all()


def test_circular_axes_take_training_cells_from_the_other_end():
    power = np.ones(64)
    power[60:] = 100.0
    options = {"guard": 0, "training": 4, "false_alarm": 1e-2}
    assert ca_cfar(power, wrap=(True,), **options)[1][0] > 10 * ca_cfar(power, wrap=(False,), **options)[1][0]


def test_min_factor_bounds_the_threshold_from_below():
    threshold = ca_cfar(np.ones(64), guard=1, training=4, looks=10_000, min_factor=2.0)[1]
    np.testing.assert_allclose(threshold, 2.0)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"guard": 20, "training": 20}, "does not fit"),
        ({"guard": 1, "training": 0}, "training"),
        ({"guard": (1, 1), "training": 4}, "axis"),
        ({"guard": 1, "training": 4, "false_alarm": 0.0}, "false_alarm"),
        ({"guard": 1, "training": 4, "looks": 0}, "looks"),
    ],
)
def test_impossible_windows_are_refused(options, message):
    for cfar in (ca_cfar, os_cfar):
        with pytest.raises(InputError, match=message):
            cfar(np.ones(64), **options)
