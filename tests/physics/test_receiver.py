"""IF filter and phase noise of the receiver, which depend on the delay of an echo before sampling folds its beat frequency."""

import dataclasses

import numpy as np
import pytest
from physics_helpers import echoes_ahead

import radartwin as rt
from radartwin.errors import InputError
from radartwin.radar.chirp import Radar
from radartwin.radar.hardware import Hardware
from radartwin.radar.if_filter import IfFilter
from radartwin.radar.phase_noise import PhaseNoise
from radartwin.radar.recording import Recording
from radartwin.scene import objects
from radartwin.simulation.paths import Paths
from radartwin.simulation.signal.synthesis import received, synthesize, thermal_noise
from radartwin.testbed import testbed

C = 299_792_458.0
RADAR = Radar.iwr1843(element="isotropic")


def profile(iq):
    """Return the zero-padded Hann spectrum of one chirp and one channel, over the range in metres."""
    spectrum = np.fft.fft(iq[0, 0, 0, 0] * np.hanning(256), 8192) / np.hanning(256).sum()
    return np.arange(8192) / 8192 * RADAR.sample_rate_hz * C / (2 * RADAR.slope_hz_per_s), spectrum


def test_filter_removes_targets_beyond_the_band_which_would_fold():
    range_m, spectrum = profile(synthesize(echoes_ahead(12.0), RADAR))
    assert range_m[np.argmax(np.abs(spectrum))] == pytest.approx(12 - 5.21e6 * C / (2 * 70e12), abs=0.01)
    assert np.abs(spectrum).max() == pytest.approx(1, abs=0.02)
    radar = dataclasses.replace(RADAR, if_filter=IfFilter())
    for distance, least_db in ((12.0, 60.0), (11.2, 60.0), (11.0, 50.0), (10.6, 29.0)):
        assert 20 * np.log10(np.abs(profile(synthesize(echoes_ahead(distance), radar))[1]).max()) < -least_db + 0.3, distance


@pytest.mark.parametrize(("corners", "loss_db", "lead_deg"), [((), 0.0, 0.0), ((175e3,), 0.0673, 7.12), ((175e3, 350e3), 0.330, 21.16)])
def test_target_at_3_m_has_the_loss_and_phase_lead_of_the_high_pass(corners, loss_db, lead_deg):
    """The beat frequency is 1.401 MHz. A stage attenuates by 10 log10(1 + (fc/f)^2) and advances the phase by atan(fc/f)."""
    plain = synthesize(echoes_ahead(3.0), RADAR)[0, 0, 0, 0]
    magnitude, complete = (
        synthesize(echoes_ahead(3.0), dataclasses.replace(RADAR, if_filter=IfFilter(corners, zero_phase=z)))[0, 0, 0, 0] / plain
        for z in (True, False)
    )
    assert -20 * np.log10(np.abs(magnitude)).mean() == pytest.approx(loss_db, abs=1e-3)
    assert np.abs(np.angle(magnitude)).max() < 1e-4
    assert np.degrees(np.angle(complete)).mean() == pytest.approx(lead_deg, abs=0.02)
    np.testing.assert_allclose(np.abs(complete), np.abs(magnitude), rtol=1e-4)


def test_filter_of_real_samples_ends_at_half_the_sample_rate():
    real = dataclasses.replace(RADAR, real_sampling=True, if_filter=IfFilter(()))
    assert np.abs(synthesize(echoes_ahead(4.9), real)).max() == pytest.approx(1, abs=1e-3)
    assert np.abs(synthesize(echoes_ahead(6.0), real)).max() == pytest.approx(1e-3, rel=1e-3)


def test_filter_is_part_of_the_radar_description_and_off_by_default():
    assert RADAR.if_filter is None
    assert "if_filter" not in RADAR.to_dict()
    radar = dataclasses.replace(RADAR, if_filter=IfFilter((235e3, 700e3), 0.8, 40.0, False), phase_noise=PhaseNoise(-90.0))
    assert Radar.from_dict(radar.to_dict()) == radar
    assert hash(radar) != hash(RADAR)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"if_filter": 3}, "if_filter"),
        ({"if_filter": {"corner": 1}}, "unknown field 'corner'"),
        ({"if_filter": {"high_pass_hz": [-1]}}, "above zero"),
        ({"if_filter": {"pass_share": 1.0}}, "between 0 and 1"),
        ({"if_filter": {"stop_db": float("nan")}}, "stop_db"),
        ({"phase_noise": {"level_dbc_hz": "low"}}, "level_dbc_hz"),
        ({"phase_noise": {"corner_hz": 0.0}}, "corner_hz"),
    ],
)
def test_invalid_filter_or_phase_noise_is_named(change, words):
    with pytest.raises(InputError, match=words):
        Radar.from_dict({**RADAR.to_dict(), **change})


def residual(range_m, noise, sample_rate_hz, samples):
    """Return the rms of phi(t) - phi(t - tau): the integral of S(f) 4 sin^2(pi f tau) over the offsets that the samples resolve."""
    f = np.linspace(0.5, 2 * samples + 0.5, 400_001)[1:] * sample_rate_hz / (4 * samples)
    plateau = 2 * 10 ** (noise.level_dbc_hz / 10) * (1 + (1e6 / noise.corner_hz) ** 2)
    density = plateau / (1 + (f / noise.corner_hz) ** 2) * 4 * np.sin(np.pi * f * 2 * range_m / C) ** 2
    return np.sqrt(np.trapezoid(density, f))


def phase_at(processes, share):
    """Return the phase noise at a share of the longest delay, from the processes of a Chebyshev series in the delay."""
    order = np.arange(len(processes))
    return np.einsum("kcn,k->cn", processes, np.cos(order * np.arccos(np.clip(2 * share - 1, -1, 1))))


@pytest.mark.parametrize("range_m", [0.1, 10.0])
def test_phase_noise_of_an_echo_matches_its_range_correlated_density(range_m):
    """The phase noise of an echo depends on its delay, and its level changes by 40 dB between 0.1 m and 10 m."""
    noise = PhaseNoise(-93.0)
    radar = dataclasses.replace(RADAR, phase_noise=noise)
    longest = 2 * 10.0 / C
    processes = noise.processes(6000, 256, RADAR.sample_rate_hz, longest, np.random.default_rng(0))
    phase = phase_at(processes, 2 * range_m / C / longest)
    assert phase.std() == pytest.approx(residual(range_m, noise, RADAR.sample_rate_hz, 256), rel=0.02)
    # In the samples of a single echo, noise over signal is j times that phase.
    frames = 40
    part = echoes_ahead(range_m)
    part = dataclasses.replace(part.where(np.zeros(frames, int)), poses=frames, pose=np.arange(frames))
    ratio = received([part], radar, frames, oscillator=np.random.default_rng(1)) / synthesize(part, radar) - 1
    assert np.abs(ratio.real).max() < 1e-3 * np.abs(ratio.imag).max()
    assert ratio.imag.std() == pytest.approx(residual(range_m, noise, RADAR.sample_rate_hz, 256), rel=0.05)


def test_many_echoes_have_the_phase_noise_of_their_own_delays():
    """The synthesis groups echoes in bands of similar delay. The resulting error is below its bound, a twentieth of the noise."""
    noise = PhaseNoise(-60.0)
    radar = dataclasses.replace(RADAR, phase_noise=noise)
    echoes = [echoes_ahead(range_m) for range_m in np.linspace(2.0, 6.0, 97)]
    together = Paths.concatenate(echoes)
    longest = together.length_m.max() / C
    processes = noise.processes(radar.num_chirps * radar.num_tx, 256, radar.sample_rate_hz, longest, np.random.default_rng(2))
    exact = 0
    for echo in echoes:
        phase = phase_at(processes, echo.length_m[0] / C / longest)
        exact = exact + 1j * phase.reshape(1, radar.num_chirps, radar.num_tx, 1, 256) * synthesize(echo, radar)
    ours = received([together], radar, 1, oscillator=np.random.default_rng(2)) - synthesize(together, radar)
    assert np.linalg.norm(ours - exact) < 0.05 * np.linalg.norm(exact)


def test_receivers_share_the_phase_noise_and_chirps_do_not():
    radar = dataclasses.replace(RADAR, phase_noise=PhaseNoise())
    ratio = (received([echoes_ahead(4.0)], radar, 2, oscillator=np.random.default_rng(0)) / synthesize(echoes_ahead(4.0), radar)).imag
    np.testing.assert_allclose(ratio[:, :, :, 0], ratio[:, :, :, 3], atol=1e-3 * ratio.std())
    assert abs(np.corrcoef(ratio[0, 0, 0, 0], ratio[0, 1, 0, 0])[0, 1]) < 0.5
    assert not np.allclose(ratio[0], ratio[1], atol=ratio.std())


def test_phase_noise_needs_noise_and_repeats_with_the_seed():
    plate = rt.Scene([rt.Surface(objects.plate(0.1, 0.1).apply_translation([1.5, 0, 0]), "metal", "plate")])
    quiet, loud = Radar.iwr1843(), dataclasses.replace(Radar.iwr1843(), phase_noise=PhaseNoise(-60.0))
    pose = np.eye(4)[None]
    assert np.array_equal(rt.simulate(plate, quiet, pose).iq, rt.simulate(plate, loud, pose).iq)
    first, again = (rt.simulate(plate, loud, pose, noise=True, seed=3).iq for _ in range(2))
    assert np.array_equal(first, again)
    assert not np.allclose(first, rt.simulate(plate, quiet, pose, noise=True, seed=3).iq)


STAGES_HZ = (175e3, 350e3)
FILTERED = dataclasses.replace(RADAR, if_filter=IfFilter(STAGES_HZ))
THERMAL = 1.380649e-23 * 290 * 5.21e6 * 10**1.5 / (1e-3 * 10**1.2)  # k T0 fs F over the transmitted power, for 15 dB and 12 dBm


def density(noise):
    """Return the noise power density at the 256 spectral lines of a chirp, averaged over all chirps; white noise of power 1 gives 1."""
    window = np.hanning(256)
    spectrum = np.fft.fft(noise.reshape(-1, 256) * window / np.linalg.norm(window))
    return (np.abs(spectrum) ** 2).mean(axis=0)


def high_pass(beat_hz):
    """Return the power gain of two first-order high-pass stages in closed form."""
    return np.prod([beat_hz**2 / (beat_hz**2 + corner**2) for corner in STAGES_HZ], axis=0)


@pytest.mark.parametrize("real", [False, True])
def test_thermal_noise_has_the_power_gain_of_the_filter_at_every_beat_frequency(real):
    """At 0.95 and 0.98 of the band, the low-pass filter attenuates by 60 dB sin^2 of 45 and 72 degrees. The band of real samples ends at
    half the sample rate.
    """
    noise = thermal_noise((20_000, 256), dataclasses.replace(FILTERED, real_sampling=real), np.random.default_rng(3 if real else 1))
    found = 10 * np.log10(density(np.real(noise) if real else noise) / THERMAL * (2 if real else 1))
    for line in (8, 11, 23, 69, 110) if real else (8, 11, 15, 23, 46, 69, 115, 200, 229):  # from 163 kHz (0.35 m) to 4.66 MHz (10 m)
        assert found[line] == pytest.approx(10 * np.log10(high_pass(line * 5.21e6 / 256)), abs=0.15 if real else 0.1)
    if real:
        assert found[122] == pytest.approx(-32, abs=3)  # 0.953 of the band
        return
    assert found[243] == pytest.approx(-30, abs=1.5)
    assert found[251] == pytest.approx(-54, abs=2)
    assert found[1] < -35
    ends = np.mean(noise[:, 0] * noise[:, -1].conj()) / THERMAL
    assert abs(ends) < 4 / np.sqrt(len(noise))  # the first and the last sample are independent


def test_testbed_filters_thermal_noise_and_leaves_quantisation_noise_white():
    """At zero beat frequency only the ADC's rounding noise of a sixth of a squared count remains."""
    hardware = dataclasses.replace(Hardware(), coupling_db=-np.inf, offset_dbfs=-np.inf, gain_imbalance_db=0.0, phase_imbalance_deg=0.0)
    silent = Recording(np.zeros((200, 16, 2, 4, 256), np.complex64), RADAR)
    found = density(testbed.received(silent, hardware, 5).iq)
    assert hardware.scale is not None
    rounding = hardware.scale**2 / 6
    for line in (11, 23, 69, 200):
        expected = THERMAL * high_pass(line * 5.21e6 / 256) + rounding
        assert 10 * np.log10(found[line] / expected) == pytest.approx(0, abs=0.15)
    assert 10 * np.log10(found[0] / rounding) == pytest.approx(0, abs=0.3)
