"""Tests of the CFAR detector: its false-alarm rate, the threshold factor from the textbook, and the axes of the detections."""

import numpy as np
import pytest
from made_files import refused

from radartwin.errors import InputError
from radartwin.radar.cfar import ca_cfar, ca_factor


@pytest.mark.parametrize(("cells", "rate"), [(8, 1e-2), (32, 1e-6)])
def test_single_look_cell_averaging_has_the_textbook_factor(cells, rate):
    assert ca_factor(cells, rate) == pytest.approx(cells * (rate ** (-1 / cells) - 1), rel=1e-9)


@pytest.mark.parametrize("looks", [1, 8])
def test_false_alarm_rate_in_noise_is_the_requested_rate(looks):
    noise = np.random.default_rng(7).gamma(looks, 1 / looks, size=(200, 500))
    hits, threshold = ca_cfar(noise, guard=(1, 2), training=(3, 4), false_alarm=1e-3, looks=looks, wrap=(True, False))
    assert hits.shape == threshold.shape == noise.shape
    # 100 expected. Cells share training cells, so the spread exceeds Poisson's: 5 sigma.
    assert 50 < hits.sum() < 150


def test_circular_axes_take_training_cells_from_the_other_end_and_min_factor_bounds_the_threshold():
    power = np.ones(64)
    power[60:] = 100.0
    circular, open_ = (ca_cfar(power, guard=(0,), training=(4,), false_alarm=1e-2, looks=1, wrap=(wraps,))[1] for wraps in (True, False))
    assert circular[0] > 10 * open_[0]
    threshold = ca_cfar(np.ones(64), guard=(1,), training=(4,), false_alarm=1e-5, looks=10_000, min_factor=2.0, wrap=(False,))[1]
    np.testing.assert_allclose(threshold, 2.0)


@pytest.mark.parametrize("window", [{"guard": (20,), "training": (20,)}, {"guard": (1,), "training": (0,)}])
def test_impossible_windows_are_refused(window):
    refused(["do not fit"], ca_cfar, np.ones(64), **window, false_alarm=1e-5, looks=1, wrap=(False,), error=InputError)
