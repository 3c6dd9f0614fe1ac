"""Range-profile features against closed forms."""

import numpy as np
import pytest

from radartwin.errors import InputError
from radartwin.features.profile import beyond_target_share, gate, profile_correlation, range_time
from radartwin.radar.chirp import Radar
from radartwin.radar.recording import Recording

RADAR = Radar.iwr1843(element="isotropic")


def tones(amplitudes, frames=2):
    """Recording of point echoes at whole range bins: {bin: amplitude}, the same on every chirp and channel."""
    n = np.arange(RADAR.num_samples)
    signal = sum(a * np.exp(2j * np.pi * b * n / RADAR.num_samples) for b, a in amplitudes.items())
    shape = (frames, RADAR.num_chirps, RADAR.num_tx, RADAR.num_rx, RADAR.num_samples)
    return Recording(np.broadcast_to(signal, shape).astype(np.complex64), RADAR)


def test_power_of_a_tone_on_a_bin_is_its_amplitude_squared():
    power, axis = range_time(tones({40: 1e-3}))
    assert power.shape == (2, 256)
    assert axis[40] == pytest.approx(40 * RADAR.range_resolution_m)
    assert power[:, 40] == pytest.approx(1e-6, rel=1e-4)


def test_share_beyond_the_target_is_the_energy_behind_the_gate():
    power, axis = range_time(tones({40: 2.0, 60: 1.0, 20: 1.0}))
    target = 40 * RADAR.range_resolution_m
    assert beyond_target_share(power[0], axis, target) == pytest.approx(1 / 6, rel=1e-3)  # 1 of 4 + 1 + 1
    assert beyond_target_share(7 * power[0], axis, target) == pytest.approx(beyond_target_share(power[0], axis, target), rel=1e-12)


def test_gate_is_three_bins_to_either_side():
    axis = np.arange(20.0)
    assert np.flatnonzero(gate(axis, 9.2)).tolist() == [6, 7, 8, 9, 10, 11, 12]


def test_correlation_is_one_with_itself_scaled_and_minus_one_with_its_mirror():
    axis = np.linspace(0, 6, 200)
    power = 1 + np.exp(-((axis - 2) ** 2))
    assert profile_correlation(power, 5 * power, axis) == pytest.approx(1)
    assert profile_correlation(power, 5 * power, axis, "db") == pytest.approx(1)
    assert profile_correlation(power, (3 - np.sqrt(power)) ** 2, axis) == pytest.approx(-1)


def test_unknown_scale_is_named():
    with pytest.raises(InputError, match="loudness"):
        profile_correlation(np.ones(3), np.ones(3), np.ones(3), "loudness")


def test_channels_with_opposite_phases_keep_their_power():
    """The channels of a target off boresight are averaged in power, not in amplitude."""
    tone = tones({40: 1e-3})
    sign = np.where(np.arange(RADAR.num_rx) % 2, -1, 1).astype(np.complex64)
    power, _ = range_time(Recording(tone.iq * sign[:, None], RADAR))
    assert power[:, 40] == pytest.approx(1e-6, rel=1e-4)
