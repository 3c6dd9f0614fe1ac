"""The noise of noisy copies has the requested power, the correlation of the range window, and is independent between copies."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from radartwin.features.processed import Processed, process
from radartwin.radar.chirp import Radar
from radartwin.radar.recording import Recording
from radartwin.recognize.augment import added_noise, noisy

RADAR = Radar.iwr1843()


def echo(noise: float = 0.0, frames: int = 24, amplitude: float = 0.0) -> Processed:
    """Return a recording of a single echo on the centre of a range bin, with white noise of variance `noise` per sample."""
    rng = np.random.default_rng(1)
    shape = (frames, RADAR.num_chirps, RADAR.num_tx, RADAR.num_rx, RADAR.num_samples)
    iq = np.broadcast_to(amplitude * np.exp(2j * np.pi * 30 * np.arange(RADAR.num_samples) / RADAR.num_samples), shape)
    return process(Recording(iq + np.sqrt(noise / 2) * (rng.normal(size=shape) + 1j * rng.normal(size=shape)), RADAR), doppler=False)


def test_noise_has_the_requested_power_including_the_recordings_own():
    quiet = replace(echo(), noise=None)
    for processed, present in ((quiet, 0.0), (replace(quiet, noise=np.full(len(quiet.range_m), 3e-6, np.float32)), 3e-6)):
        added = noisy(processed, 1e-5, np.random.default_rng(0))
        assert added.power.mean() == pytest.approx(1e-5 - present, rel=0.05)
        assert added.noise_floor.mean() == pytest.approx(1e-5, rel=1e-5)
    loud = replace(quiet, noise=np.full(len(quiet.range_m), 1e-4, np.float32))
    assert np.array_equal(noisy(loud, 1e-5, np.random.default_rng(0)).channels, loud.channels)


def test_noise_is_correlated_like_receiver_noise():
    """White noise that is transformed by `process` has the same correlation between neighbouring range bins, 2/3 for a Hann window."""
    received, added = echo(noise=1e-3), noisy(replace(echo(), noise=None), 1e-5, np.random.default_rng(0))
    for noise in (received, added):
        bins = noise.channels.reshape(-1, noise.channels.shape[-1])
        correlation = np.abs((bins[:, 1:] * bins[:, :-1].conj()).mean()) / (np.abs(bins) ** 2).mean()
        assert correlation == pytest.approx(2 / 3, abs=0.04)


def test_copies_differ_are_reproducible_and_have_the_power_of_their_channels():
    processed = replace(echo(amplitude=1e-2, frames=20), noise=None)
    first, second, again = (noisy(processed, 1e-6, np.random.default_rng(seed)) for seed in (7, 8, 7))
    assert not np.array_equal(first.channels, second.channels)
    assert np.array_equal(first.channels, again.channels)
    assert first.power == pytest.approx((np.abs(first.channels) ** 2).mean(axis=1), rel=1e-3, abs=1e-12)


def test_simulated_targets_get_the_measured_signal_to_noise_ratio():
    simulated, measured, floor = np.array([1.0, 2.0, 4.0]), np.array([10.0, 20.0, 40.0]), 0.5
    assert np.median(simulated) / added_noise(simulated, measured, floor) == pytest.approx(np.median(measured) / floor)
    with pytest.raises(ValueError, match="no energy above the noise"):
        added_noise(np.zeros(3), measured, floor)
