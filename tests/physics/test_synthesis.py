"""IQ from paths against the direct sum of the signal's definition."""

import numpy as np
import pytest

from radartwin.radar.chirp import Radar
from radartwin.simulation.paths import Paths
from radartwin.simulation.synthesis import synthesize, thermal_noise

C = 299_792_458.0


def random_paths(count, poses, rate, nodes=1, seed=0):
    rng = np.random.default_rng(seed)
    unit = [d / np.linalg.norm(d, axis=1, keepdims=True) for d in rng.normal(size=(2, count, 3))]
    radar = Radar.iwr1843()
    frequencies = radar.center_frequency_hz + np.linspace(-1, 1, nodes) * 1e9 if nodes > 1 else np.array([radar.center_frequency_hz])
    amplitude = rng.normal(size=(count, nodes)) + 1j * rng.normal(size=(count, nodes))
    lengths = rng.uniform(0.3, 8, (2, count))
    return Paths(
        poses, np.sort(rng.integers(0, poses, count)), np.ones(count, int), amplitude, frequencies,
        lengths[0], lengths[1], unit[0], unit[1], rng.uniform(-rate, rate, count),
    )  # fmt: skip


def direct_sum(paths, radar):
    """The definition, path by path: exact element distances, motion within the chirp, polynomial amplitudes."""
    out = np.zeros((paths.poses, radar.num_chirps, radar.num_tx, radar.num_rx, radar.num_samples), complex)
    t = np.arange(radar.num_samples) / radar.sample_rate_hz
    f = radar.start_frequency_hz + radar.slope_hz_per_s * t
    start = radar.chirp_times()[:, :, None, None, None]
    for i in range(len(paths)):
        tx = np.linalg.norm(paths.length_in_m[i] * paths.departure[i] - radar.tx_positions, axis=1)[None, :, None, None]
        rx = np.linalg.norm(paths.length_out_m[i] * paths.arrival[i] - radar.rx_positions, axis=1)[None, None, :, None]
        length = tx + rx + paths.rate_mps[i] * (start[..., 0] + t)
        centre = paths.frequencies_hz.mean()
        coefficients = np.polyfit((paths.frequencies_hz - centre) / 1e9, paths.amplitude[i], len(paths.frequencies_hz) - 1)
        out[paths.pose[i]] += np.polyval(coefficients, (f - centre) / 1e9) * np.exp(2j * np.pi * f * length / C)
    return out


@pytest.mark.parametrize("rate", [0.0, 0.2, 2.0, 20.0])
@pytest.mark.parametrize("nodes", [1, 4])
def test_synthesis_is_the_direct_sum(rate, nodes):
    radar = Radar.iwr1843(element="isotropic")
    paths = random_paths(40, 3, rate, nodes)
    expected = direct_sum(paths, radar)
    error = np.linalg.norm(synthesize(paths, radar) - expected) / np.linalg.norm(expected)
    assert error < 1e-4  # the target is 1e-3; 6 taps give 1e-5


def test_no_paths_give_silence():
    assert not synthesize(random_paths(0, 2, 0.0), Radar.iwr1843()).any()


def test_element_pattern_multiplies_both_ways():
    paths = random_paths(1, 1, 0.0)
    forward = np.array([[1.0, 0.0, 0.0]])
    paths = Paths(**{**vars(paths), "departure": forward, "arrival": forward})
    ratio = np.abs(synthesize(paths, Radar.iwr1843())).max() / np.abs(synthesize(paths, Radar.iwr1843(element="isotropic"))).max()
    assert 20 * np.log10(ratio) == pytest.approx(2 * 10.5, abs=0.05)


def test_noise_power_is_kTBF():
    """-98.5 dBm in 5.21 MHz at 15 dB noise figure, 12 dBm transmitted."""
    noise = thermal_noise((200_000,), Radar.iwr1843(), np.random.default_rng(1))
    expected = 10 * np.log10(1.380649e-23 * 290 * 5.21e6 * 1e3) + 15 - 12
    assert 10 * np.log10((np.abs(noise) ** 2).mean()) == pytest.approx(expected, abs=0.05)


def test_equal_input_gives_equal_bytes():
    paths, radar = random_paths(5000, 4, 1.0), Radar.iwr1843()
    assert synthesize(paths, radar).tobytes() == synthesize(paths, radar).tobytes()
