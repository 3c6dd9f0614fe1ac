"""Tests of the static echoes that the scan does not know: energy, places, and the recording without them."""

import numpy as np
import pytest

from radartwin.constants import SPEED_OF_LIGHT
from radartwin.features.processed import process
from radartwin.features.profile import FAR_M, NEAR_M
from radartwin.radar.chirp import Radar
from radartwin.radar.recording import Recording
from radartwin.testbed import unscanned

RADAR, FRAMES = Radar.iwr1843(), 4
POSES, TARGET_M = np.eye(4)[None], np.full(FRAMES, 2.0)


def tones(*ranges_m: float) -> Recording:
    """Return echoes of unit amplitude at these ranges, on all channels, with the beat frequency of a chirp of constant slope."""
    time = np.arange(RADAR.num_samples) / RADAR.sample_rate_hz
    beat = 2 * np.array(ranges_m)[:, None] * RADAR.slope_hz_per_s / SPEED_OF_LIGHT
    samples = np.exp(2j * np.pi * beat * time).sum(axis=0).astype(np.complex64)
    shape = (FRAMES, RADAR.num_chirps, RADAR.num_tx, RADAR.num_rx, RADAR.num_samples)
    return Recording(np.broadcast_to(samples, shape).copy(), RADAR, None)


def energy(recording: Recording) -> float:
    made = process(recording, doppler=False)
    return float(made.power[:, (made.range_m >= NEAR_M) & (made.range_m <= FAR_M)].sum(axis=1).mean())


@pytest.mark.parametrize("strength", [1.0, 3.0])
def test_the_energy_of_the_echoes_is_that_of_the_room_times_the_strength(strength):
    target, room = tones(2.0), tones(3.0, 4.5)
    clean = Recording(target.iq + room.iq, RADAR, None)
    made = unscanned.added(clean, RADAR, POSES, TARGET_M, strength, 5)
    more = Recording(made.iq - clean.iq, RADAR, None)
    assert energy(more) == pytest.approx(strength * energy(room), rel=0.01)
    assert np.ptp(more.iq, axis=0).max() < 1e-3 * np.abs(more.iq).max()  # the echoes are static
    again, other = (unscanned.added(clean, RADAR, POSES, TARGET_M, strength, seed).iq for seed in (5, 6))
    assert np.array_equal(again, made.iq)
    assert not np.allclose(other, made.iq)


def test_echoes_lie_on_both_sides_of_the_target_and_not_at_it_on_a_drive_too():
    drive, target_m = np.tile(np.eye(4), (20, 1, 1)), np.linspace(1.5, 0.5, 20)
    drive[:, 0, 3] = 1.5 - target_m
    for poses, at_m in ((POSES, np.array([2.0])), (drive, target_m)):
        drawn = [unscanned.echoes(RADAR, poses, at_m, np.random.default_rng(seed)) for seed in range(50)]
        apart = np.concatenate([(one.length_in_m - at_m[one.pose])[np.abs(one.amplitude[:, 0]) > 0] for one in drawn])
        assert (np.abs(apart) > unscanned.CLEAR_M).all()
        assert all(np.linalg.norm(one.departure, axis=1) == pytest.approx(1.0) for one in drawn)
        if poses is POSES:
            assert 0.2 < np.mean(apart < 0) < 0.45  # a third of the distances from 0.5 to 5 m lies before the target
