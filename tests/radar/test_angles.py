"""Spectra over directions against closed forms: Dirichlet kernel, Capon of one source, the null of MUSIC, and the Cramer-Rao bound.

The oracles use their own phase: an antenna at y hears a plane wave from azimuth theta with the phase -k y sin(theta). All arrays here are
uniform lines along y, so that only psi = k d (sin theta - sin theta_0) enters the formulas.
"""

import numpy as np
import pytest
from made_files import refused
from scipy.stats import chi2

from radartwin.errors import InputError
from radartwin.radar.angles import AngleMethod, azimuth_spectrum, spectrum
from radartwin.radar.chirp import Radar
from radartwin.radar.covariance import Covariance, covariance, uniform_step
from radartwin.radar.processing import azimuth_row, unit_vectors

RADAR = Radar.iwr1843(element="isotropic")
FREQUENCY = RADAR.center_frequency_hz
K = 2 * np.pi * FREQUENCY / 299_792_458.0
SPACING = 299_792_458.0 / 77e9 / 2
GRID = np.radians(np.arange(-90.0, 90.5, 0.5))


def line(antennas=8):
    return np.column_stack([np.zeros(antennas), SPACING * np.arange(antennas), np.zeros(antennas)])


def wave(azimuth_deg, antennas=8):
    return np.exp(-1j * K * SPACING * np.arange(antennas) * np.sin(np.radians(azimuth_deg)))


def dirichlet(azimuth_deg, antennas=8):
    """Return |a^H a0|^2 on GRID, the square of the Dirichlet kernel."""
    half = K * SPACING * (np.sin(GRID) - np.sin(np.radians(azimuth_deg))) / 2
    near = np.abs(np.sin(half)) < 1e-9
    return np.where(near, antennas**2, (np.sin(antennas * half) / np.where(near, 1.0, np.sin(half))) ** 2)


def one_source(power, noise, azimuth_deg, antennas=8):
    a = wave(azimuth_deg, antennas)
    return Covariance(power * np.outer(a, a.conj()) + noise * np.eye(antennas), 1000)


def evaluated(signals, method, antennas=8):
    return spectrum(signals, line(antennas), FREQUENCY, method)(unit_vectors(GRID))


def draws(azimuth_deg, snr_db, shape, seed):
    """Return snapshots (*shape, 8) of a source with random phases in white noise of unit power."""
    rng = np.random.default_rng(seed)
    phases = np.exp(2j * np.pi * rng.random((*shape, 1)))
    noise = rng.standard_normal((*shape, 8)) + 1j * rng.standard_normal((*shape, 8))
    return 10 ** (snr_db / 20) * phases * wave(azimuth_deg) + noise / np.sqrt(2)


@pytest.mark.parametrize(("azimuth", "antennas"), [(0.0, 4), (37.0, 8)])
def test_bartlett_of_one_wave_is_the_dirichlet_kernel(azimuth, antennas):
    power = evaluated(one_source(0.25, 0.0, azimuth, antennas), AngleMethod(), antennas)
    # Both are exact, so that only rounding is left; 1e-12 of the maximum is a thousand times the rounding of a sum of 64 terms.
    np.testing.assert_allclose(power, 0.25 * dirichlet(azimuth, antennas) / antennas**2, atol=1e-12)
    assert power[np.argmin(np.abs(GRID - np.radians(azimuth)))] == pytest.approx(0.25, rel=1e-3)


@pytest.mark.parametrize("loading", [0.0, 0.05])
@pytest.mark.parametrize("snr", [0.1, 1000.0])
def test_capon_of_one_source_in_white_noise_is_its_closed_form(snr, loading):
    """R^-1 by the Sherman-Morrison formula: P = s / (M - g |a^H a0|^2 / (1 + M g)), with s the noise power and g = power / s."""
    noise = 2.0
    power = evaluated(one_source(snr * noise, noise, -20.0), AngleMethod("capon", loading))
    loaded = noise + loading * (snr * noise + noise)  # the mean eigenvalue is power + noise
    g = snr * noise / loaded
    np.testing.assert_allclose(power, loaded / (8 - g * dirichlet(-20.0) / (1 + 8 * g)), rtol=1e-9)
    assert np.degrees(GRID[np.argmax(power)]) == pytest.approx(-20.0, abs=0.25)
    if not loading:
        assert power.max() == pytest.approx(noise * (snr + 1 / 8), rel=1e-3), "source power plus an eighth of the noise"


@pytest.mark.parametrize("azimuths", [(12.0,), (-50.0, 0.0, 9.5)])
def test_music_without_noise_has_its_null_exactly_at_the_sources(azimuths):
    matrix = np.sum([np.outer(wave(a), wave(a).conj()) for a in azimuths], axis=0)
    at = spectrum(Covariance(matrix, 1000), line(), FREQUENCY, AngleMethod("music", sources=len(azimuths)))
    # The form a^H E E^H a / M is the rounding error of a sum of 64 terms of at most 1/8, below 1e-15 (5 units in the last place of 1).
    assert (at(unit_vectors(np.radians(azimuths))) > 1e15).all()
    away = [a for a in np.degrees(GRID) if min(abs(a - b) for b in azimuths) > 2]
    assert at(unit_vectors(np.radians(away))).max() < 1e4, "1 / (1 - share in the signal subspace) away from the sources"


def test_music_of_one_source_is_one_over_one_minus_the_dirichlet_share():
    ratio = evaluated(one_source(3.0, 0.5, 24.75), AngleMethod("music", sources=1))
    np.testing.assert_allclose(ratio, 1 / (1 - dirichlet(24.75) / 64), rtol=1e-9)


@pytest.mark.parametrize("name", ["bartlett", "music", "capon"])
def test_variance_of_one_source_reaches_the_cramer_rao_bound(name):
    """Stoica and Nehorai 1989: the variance of psi is 6 / (K SNR M (M^2 - 1)), and that of MUSIC is (1 + 1 / (M SNR)) times as large."""
    snapshots, snr, trials = 32, 10.0, 1500
    bound = 6 / (snapshots * snr * 8 * 63) * (1 + 1 / (8 * snr))
    spread = np.sqrt(bound) / (K * SPACING)  # of sin(theta)
    sine = np.sin(np.radians(25.0)) + spread * np.linspace(-6, 6, 301)
    signals = covariance(draws(25.0, 10.0, (trials, snapshots), seed=3))
    power = spectrum(signals, line(), FREQUENCY, AngleMethod(name, sources=1))(unit_vectors(np.arcsin(sine)))
    error = (sine[np.argmax(power, axis=1)] - np.sin(np.radians(25.0))) * K * SPACING
    ratio = np.mean(error**2) / bound
    low, high = chi2.ppf([0.0005, 0.9995], trials) / trials  # 0.88 to 1.12, so a correct estimator fails in 1 of 1000 seeds
    assert low < ratio
    # For one source, the maximum of the Bartlett spectrum is the maximum-likelihood estimate, and MUSIC is as accurate for many snapshots.
    # Capon inverts a matrix of only four times as many snapshots as antennas; the bound holds for it from below alone.
    assert ratio < (2.0 if name == "capon" else high)


@pytest.mark.parametrize("phase", [0.3, 2.5])
def test_coherent_sources_need_smoothing(phase):
    both = wave(-7.0) + np.exp(1j * phase) * wave(7.0)
    signals = Covariance(np.outer(both, both.conj()) + 1e-3 * np.eye(8), 1000)
    sources = unit_vectors(np.radians([-7.0, 7.0]))
    plain = spectrum(signals, line(), FREQUENCY, AngleMethod("music", sources=2))(sources)
    smooth = spectrum(signals, line(), FREQUENCY, AngleMethod("music", subarray=6, sources=2))(sources)
    both_ways = spectrum(signals, line(), FREQUENCY, AngleMethod("music", subarray=6, forward_backward=True, sources=2))(sources)
    assert plain.max() < 100, "the signal subspace has one dimension, so no source lies in it"
    # With the exact matrix, smoothing gives the exact signal subspace of the sub-array. The ratio of noise to the weaker signal eigenvalue
    # amplifies the rounding of 1e-16.
    assert smooth.min() > 1e12
    assert both_ways.min() > 1e12


def test_smoothing_of_uncorrelated_sources_is_the_matrix_of_a_shorter_line():
    matrix = sum(p * np.outer(wave(a), wave(a).conj()) for p, a in ((2.0, 10.0), (1.0, -40.0))) + 0.1 * np.eye(8)
    smooth = Covariance(matrix, 5).smoothed(5, forward_backward=True)
    np.testing.assert_allclose(smooth.matrix, matrix[:5, :5], atol=1e-12)
    assert smooth.count == 5 * 4 * 2


def test_azimuth_spectrum_takes_the_azimuth_row_of_a_raised_array():
    from radartwin.radar.boards import IWR1843BOOST

    radar = Radar.from_dict({**RADAR.to_dict(), "tx_positions_m": IWR1843BOOST.tx_positions_m})
    assert len(azimuth_row(radar)) == 8
    towards = np.array([np.cos(0.3), np.sin(0.3), 0.0])
    snapshots = np.exp(-1j * K * radar.virtual_positions @ towards).reshape(1, 3, 4)
    assert GRID[np.argmax(azimuth_spectrum(snapshots, radar, GRID))] == pytest.approx(0.3, abs=0.005)


def uneven():
    positions = line()
    positions[3, 1] += 0.2 * SPACING
    return positions


NOISY = covariance(draws(10.0, 10.0, (4,), seed=1))
REFUSED = {
    "unknown method": (lambda: AngleMethod("fft"), "bartlett, capon, music"),
    "negative loading": (lambda: AngleMethod("capon", -0.1), "loading"),
    "broken sub-array": (lambda: AngleMethod("capon", subarray=2.5), "subarray"),  # type: ignore[arg-type]
    "sources in words": (lambda: AngleMethod("music", sources="two"), "sources"),  # type: ignore[arg-type]
    "negative sources": (lambda: AngleMethod("music", sources=-1), "sources"),
    "few snapshots": (lambda: evaluated(NOISY, AngleMethod("capon")), "4 snapshots of 8 antennas", "loading"),
    "no noise": (lambda: evaluated(one_source(1.0, 0.0, 0.0), AngleMethod("capon")), "no inverse", "loading"),
    "many sources": (lambda: evaluated(one_source(1.0, 1.0, 0.0), AngleMethod("music", sources=8)), "at least 9 antennas"),
    "sources beyond the snapshots": (lambda: evaluated(NOISY, AngleMethod("music", sources=5)), "5 snapshots"),
    "uneven line": (lambda: spectrum(NOISY, uneven(), FREQUENCY, AngleMethod("capon", subarray=5)), "not equally spaced"),
    "antennas in one place": (lambda: uniform_step(np.zeros((4, 3))), "not equally spaced"),
    "large sub-array": (lambda: evaluated(NOISY, AngleMethod("capon", subarray=9)), "use 2 to 8"),
    "another array": (lambda: evaluated(NOISY, AngleMethod(), antennas=7), "has 8 antennas"),
    "not finite": (lambda: covariance(np.full((2, 8), np.nan)), "NaN"),
    "no snapshots": (lambda: covariance(np.zeros((0, 8))), "snapshot"),
    "another radar": (lambda: azimuth_spectrum(np.zeros((1, 3, 4)), RADAR, GRID), "2 tx"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_impossible_estimates_are_refused_with_a_remedy(case):
    call, *words = REFUSED[case]
    refused(words, call, error=InputError)
