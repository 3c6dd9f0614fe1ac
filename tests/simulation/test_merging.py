"""Merged paths have nearly the signal of the paths that they replace."""

from dataclasses import replace

import numpy as np
import pytest

from radartwin.constants import SPEED_OF_LIGHT
from radartwin.radar.antenna import element_gain
from radartwin.radar.chirp import Radar
from radartwin.simulation.merging import merged
from radartwin.simulation.paths import Paths
from radartwin.simulation.signal.synthesis import received

RADAR = Radar.iwr1843()
POSES, COUNT = 3, 3000


def tubes(nodes: int, bistatic: bool) -> Paths:
    """Return the paths of random points of an object with a width of 0.1 m, 2 m from a radar that drives past it at 0.24 m/s.

    If `bistatic` is True, the paths depart towards the mirror image of the object.
    """
    rng = np.random.default_rng(nodes)
    shape = POSES * COUNT
    last = rng.uniform(-0.05, 0.05, (shape, 3)) + np.array([2.0, -0.3, -0.1])
    first = last * [1.0, -1.0, 1.0] + np.array([0.0, 0.8, 0.0]) if bistatic else last
    lengths = [np.linalg.norm(points, axis=1) for points in (first, last)]
    ways = [points / length[:, None] for points, length in zip((first, last), lengths, strict=True)]
    steps = RADAR.sampled_bandwidth_hz * (0.5 - 0.5 * np.cos(np.pi * (np.arange(nodes) + 0.5) / nodes))
    frequency = RADAR.start_frequency_hz + steps
    amplitude = rng.rayleigh(size=(shape, 1)) * np.exp(2j * np.pi * (rng.random((shape, 1)) + 0.02 * frequency / SPEED_OF_LIGHT))
    rate = -0.24 * (ways[0][:, 1] + ways[1][:, 1])
    return Paths(POSES, np.repeat(np.arange(POSES), COUNT), np.ones(shape, int), amplitude, frequency, *lengths, *ways, rate_mps=rate)


def gains(paths: Paths) -> np.ndarray:
    return element_gain(RADAR.element, paths.departure) * element_gain(RADAR.element, paths.arrival)


@pytest.mark.parametrize(("nodes", "bistatic", "fewer"), [(16, False, 8), (16, True, 3), (3, False, 3), (1, False, 1)])
def test_merged_paths_have_the_signal_of_all_paths(nodes, bistatic, fewer):
    """The error of each frame is below 1 % of the frame, although the random phases of the paths cancel nearly all of the signal."""
    paths = tubes(nodes, bistatic)
    found = merged(paths, RADAR, gains(paths))
    assert len(found) * fewer < len(paths)
    expected = received([paths], RADAR, POSES)
    error = np.linalg.norm((received([found], RADAR, POSES) - expected).reshape(POSES, -1), axis=1)
    assert (error < 0.01 * np.linalg.norm(expected.reshape(POSES, -1), axis=1)).all()


def test_separate_paths_stay_as_they_are():
    """Paths in different cells keep their values, also if the gain of the antenna is zero."""
    paths = tubes(16, True).where(np.array([0, COUNT, COUNT + 1]))
    paths = replace(paths, pose=np.array([0, 2, 2]), length_in_m=paths.length_in_m + np.arange(3))
    for gain in (gains(paths), np.zeros(3)):
        found = merged(paths, RADAR, gain)
        assert (found.pose == paths.pose).all()
        for name in ("amplitude", "length_in_m", "length_out_m", "departure", "arrival", "rate_mps"):
            assert getattr(found, name) == pytest.approx(getattr(paths, name), rel=1e-12, abs=1e-12)
    assert len(merged(paths.where(slice(0)), RADAR, np.zeros(0))) == 0
