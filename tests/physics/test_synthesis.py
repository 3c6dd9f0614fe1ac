"""Compare the IQ samples that are synthesised from paths with the direct sum over the definition of the signal."""

import dataclasses
import subprocess
import sys

import numpy as np
import pytest
from physics_helpers import echoes_ahead, relative_error

from radartwin import compiled
from radartwin.errors import InputError
from radartwin.radar.chirp import Radar
from radartwin.simulation import variant
from radartwin.simulation.paths import Paths
from radartwin.simulation.reflection_table import chebyshev_nodes
from radartwin.simulation.signal import synthesis
from radartwin.simulation.signal.synthesis import synthesize, thermal_noise

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
    """Return the signal by its definition, with exact element distances, motion within the chirp and polynomial amplitudes."""
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


@pytest.mark.usefixtures("spreading")
@pytest.mark.parametrize(("rate", "nodes"), [(0.0, 1), (0.2, 4), (20.0, 1), (20.0, 4)])
def test_synthesis_matches_the_direct_sum(rate, nodes):
    radar = Radar.iwr1843(element="isotropic")
    paths = random_paths(40, 3, rate, nodes)
    # the required error is 1e-3; an interpolation kernel with 6 taps gives 1e-5
    assert relative_error(synthesize(paths, radar), direct_sum(paths, radar)) < 1e-4


@pytest.mark.parametrize(("nodes", "thickness_m", "rate"), [(16, 0.01, 0.2), (52, 0.06, 0.0), (76, 0.1, 5.0)])
def test_multiple_echoes_of_a_slab_match_paths_of_their_own(nodes, thickness_m, rate):
    """A path whose amplitude over frequency is that of several delayed echoes has the signal of as many paths without dispersion."""
    radar = Radar.iwr1843(element="isotropic")
    alone = dataclasses.replace(random_paths(12, 1, rate), departure=(way := np.tile([1.0, 0.0, 0.0], (12, 1))), arrival=way)
    band = radar.start_frequency_hz + np.array([0, radar.slope_hz_per_s * radar.num_samples / radar.sample_rate_hz])
    frequencies = chebyshev_nodes(band[0], band[1], nodes)
    delays = 2 * thickness_m * np.arange(6)
    echoes = 0.6 ** np.arange(6) * np.exp(2j * np.pi * frequencies[:, None] * delays / C)
    one = dataclasses.replace(alone, amplitude=alone.amplitude * echoes.sum(axis=1), frequencies_hz=frequencies)
    several = [
        dataclasses.replace(alone, amplitude=alone.amplitude * 0.6**k, length_in_m=alone.length_in_m + delay)
        for k, delay in enumerate(delays)
    ]
    assert relative_error(*(synthesize(paths, radar, elements="planar") for paths in (one, several))) < 1e-4


def test_element_pattern_applies_at_both_ends():
    paths = echoes_ahead(2.0)
    ratio = np.abs(synthesize(paths, Radar.iwr1843())).max() / np.abs(synthesize(paths, Radar.iwr1843(element="isotropic"))).max()
    assert 20 * np.log10(ratio) == pytest.approx(2 * 10.5, abs=0.05)


def test_noise_power_is_kTBF():
    """The thermal noise power is -98.5 dBm in 5.21 MHz, given relative to 12 dBm transmit power, with a noise figure of 15 dB."""
    noise = thermal_noise((200_000,), Radar.iwr1843(), np.random.default_rng(1))
    expected = 10 * np.log10(1.380649e-23 * 290 * 5.21e6 * 1e3) + 15 - 12
    assert 10 * np.log10((np.abs(noise) ** 2).mean()) == pytest.approx(expected, abs=0.05)


@pytest.mark.parametrize("samples", [1, 2, 7, 100, 257])
def test_synthesis_matches_for_any_radar_dimensions(samples):
    """The FFT grids of the synthesis have even and odd powers of two as sizes, and some chirps have fewer samples than their grid."""
    array = {"tx_positions_m": ((0, 0.01, 0.002),), "rx_positions_m": ((0, 0, 0), (0, 0.002, 0), (0, 0.004, 0))}
    radar = dataclasses.replace(Radar.iwr1843(element="isotropic"), num_samples=samples, num_chirps=3, **array)
    paths = random_paths(30, 2, 0.5, 2)
    assert relative_error(synthesize(paths, radar), direct_sum(paths, radar)) < 1e-4


@pytest.mark.usefixtures("spreading")
def test_frames_with_many_and_with_no_paths_match(monkeypatch):
    radar = Radar.iwr1843(element="isotropic")
    paths = random_paths(60, 2, 0.2)
    paths = dataclasses.replace(paths, poses=4, pose=2 * paths.pose)
    expected = direct_sum(paths, radar)
    monkeypatch.setattr("radartwin.simulation.signal.synthesis._PATHS_PER_TASK", 7)
    monkeypatch.setattr("radartwin.simulation.signal.synthesis._GRID_BYTES", 1)
    iq = synthesize(paths, radar)
    assert relative_error(iq, expected) < 1e-4
    assert not iq[[1, 3]].any()


def test_many_paths_are_added_in_pieces(monkeypatch):
    parts, radar = [random_paths(300, 3, 1.0, nodes=5), random_paths(50, 3, 0.0, seed=1)], Radar.iwr1843()
    whole = synthesize(parts, radar)
    monkeypatch.setattr(synthesis, "MOST_PATHS", 70)
    assert np.abs(synthesize(parts, radar) - whole).max() < 1e-5 * np.abs(whole).max()


def test_bytes_do_not_depend_on_the_number_of_cores(monkeypatch):
    paths, radar = random_paths(20_000, 5, 1.0), Radar.iwr1843()
    several = synthesize(paths, radar).tobytes()
    monkeypatch.setattr(compiled, "cores", lambda: 1)
    assert synthesize(paths, radar).tobytes() == several


@pytest.mark.parametrize("rate", [0.0, 2.0])
@pytest.mark.parametrize("elements", ["exact", "planar"])
def test_both_spreadings_agree(monkeypatch, rate, elements):
    """The compiled loops add in single precision; the difference grows with the number of paths of a frame."""
    variant.activate()
    radar, rng = Radar.iwr1843(), np.random.default_rng(4)
    points, images = random_paths(5000, 3, rate, 3), random_paths(5000, 3, rate, seed=1)
    gain = np.exp(1j * rng.uniform(0, 6, (5000, 8))) * rng.uniform(0.5, 3, (5000, 8))
    images = dataclasses.replace(images, mirror=np.repeat(np.diag([1.0, -1.0, 1.0])[None], 5000, 0), gain=gain)
    loops, drjit = (
        monkeypatch.setattr(variant, "on_gpu", lambda gpu=gpu: gpu) or synthesize([points, images], radar, elements=elements)
        for gpu in (False, True)
    )
    assert relative_error(drjit, loops) < 1e-6


@pytest.mark.usefixtures("spreading")
def test_frames_are_added_to_the_given_array():
    paths, radar = random_paths(50, 2, 0.1), Radar.iwr1843()
    there = np.full((2, 16, 2, 4, 256), 3j, np.complex64)
    alone = synthesize(paths, radar)
    assert synthesize(paths, radar, out=there) is there
    np.testing.assert_allclose(there - 3j, alone, atol=1e-5 * np.abs(alone).max())
    with pytest.raises(InputError, match="shape"):
        synthesize(paths, radar, out=there[:1])


@pytest.mark.parametrize(("range_m", "degrees"), [(0.2, 5.4747), (1.0, 1.0950), (5.0, 0.2190)])
def test_planar_elements_have_the_error_of_the_wavefront_curvature(range_m, degrees):
    """The largest phase error over the array is the value in reference/array_phase_error_deg.csv."""
    radar = Radar.iwr1843(element="isotropic")
    exact, planar = (synthesize(echoes_ahead(range_m), radar, elements=e)[0, 0, :, :, 0] for e in ("exact", "planar"))
    error = np.degrees(np.abs(np.angle(exact * planar.conj())).max())
    assert error == pytest.approx(degrees, rel=0.01)


def test_compiled_code_works_without_a_writable_cache():
    code = (
        "import numba.core.caching as c\n"
        "c.CacheImpl._locator_classes = []\n"
        "for k in c.CacheImpl.__subclasses__(): k._locator_classes = []\n"
        "from radartwin.compiled import compiled\n"
        "@compiled\n"
        "def twice(x): return 2 * x\n"
        "assert twice(4) == 8\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize("elements", ["exact", "planar"])
def test_paths_of_images_start_at_the_mirrored_transmitter(elements):
    """For an image path, the transmitter elements form the mirrored array at the end of the path."""
    radar = Radar.iwr1843(element="isotropic")
    paths = random_paths(25, 2, 0.3)
    normal = paths.departure
    mirror = np.eye(3) - 2 * np.einsum("ni,nj->nij", normal, normal)
    paths = dataclasses.replace(paths, mirror=mirror, length_in_m=paths.length_in_m + 0.3)
    t = np.arange(256) / radar.sample_rate_hz
    f = radar.start_frequency_hz + radar.slope_hz_per_s * t
    expected = np.zeros((2, 16, 2, 4, 256), complex)
    for p in range(len(paths)):
        image = paths.length_m[p] * paths.arrival[p] + radar.tx_positions @ mirror[p].T
        still = np.linalg.norm(image[:, None] - radar.rx_positions, axis=-1)[None, :, :, None]
        length = still + paths.rate_mps[p] * (radar.chirp_times()[:, :, None, None] + t)
        expected[paths.pose[p]] += paths.amplitude[p, 0] * np.exp(2j * np.pi * f * length / C)
    error = relative_error(synthesize(paths, radar, elements=elements), expected)
    if elements == "exact":
        assert error < 1e-4
    else:
        outermost = sum(np.linalg.norm(positions, axis=1).max() for positions in (radar.tx_positions, radar.rx_positions))
        assert 1e-4 < error < (np.pi * f.max() / C * outermost**2 / paths.length_m).max()  # curvature of the nearest wavefront


@pytest.mark.parametrize(("name", "value"), [("amplitude", np.nan), ("length_in_m", np.inf), ("rate_mps", np.nan)])
def test_paths_that_are_not_finite_are_refused(name, value):
    paths = random_paths(5, 1, 0.1)
    broken = getattr(paths, name).copy()
    broken[2] = value
    with pytest.raises(InputError, match="not finite"):
        synthesize(dataclasses.replace(paths, **{name: broken}), Radar.iwr1843())


def test_weak_echoes_beside_a_strong_one_keep_their_band_and_motion():
    """The floor under a strong echo is that of the interpolation kernel, -97 dB."""
    radar = Radar.iwr1843(element="isotropic")
    weak, strong = random_paths(1, 1, 0.4, 5, seed=2), random_paths(1, 1, 0.4, 5, seed=3)
    weak = dataclasses.replace(weak, amplitude=1e-3 * weak.amplitude)
    both = Paths.concatenate([weak, strong])
    error = synthesize(both, radar) - direct_sum(both, radar)
    assert np.linalg.norm(error) < 1.5e-5 * np.linalg.norm(direct_sum(strong, radar))
