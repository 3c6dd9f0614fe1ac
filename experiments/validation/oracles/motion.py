"""Validation cases of a small moving sphere: Doppler, azimuth and phase per millimetre. Only code of this module evaluates the simulated
samples.
"""

import numpy as np

import radartwin as rt
from experiments.validation.oracles import traced
from experiments.validation.oracles.case import SPEED_OF_LIGHT, Case, Finding, worst
from radartwin.scene import objects

RADIUS_M = 0.01
RADAR = traced.ARRAY


def _seen(centres_m: np.ndarray, sensors: np.ndarray | None = None) -> np.ndarray:
    """Return samples (F, loops, tx, rx, samples) of a small metal sphere at the positions `centres_m` (F, 3)."""
    poses = np.array([traced.pose(centre) for centre in centres_m])
    scene = rt.Scene([rt.Surface(objects.sphere(RADIUS_M, 4), "metal", "ball")])
    sensor = np.eye(4)[None] if sensors is None else sensors
    return rt.simulate(scene, RADAR, sensor, motion={"ball": poses}, rays_per_wavelength2=16.0).iq


def _matched(iq: np.ndarray, range_m: float) -> np.ndarray:
    """Return the Hann-weighted correlation (...,) of samples (..., samples) with the echo of a point at the range `range_m`."""
    frequency = traced.frequencies(RADAR)
    return (iq * np.exp(-4j * np.pi * frequency / SPEED_OF_LIGHT * range_m) * np.hanning(len(frequency))).sum(axis=-1)


def _middle_hz() -> float:
    """Return the frequency in hertz to which the phase from `_matched` belongs: the Hann-weighted mean of the sweep."""
    frequency = traced.frequencies(RADAR)
    weight = np.hanning(len(frequency))
    return float((frequency * weight).sum() / weight.sum())


def _doppler(full: bool) -> Finding:
    """Compare the speed from the phase slope over the chirp loops of a frame with the true speed, for a moving sphere or moving sensor."""
    findings = []
    for speed in (0.2, -0.2, 1.0, -3.0, 6.0) if full else (0.2, -3.0):
        for moving in ("target", "sensor"):
            way = np.array([np.cos(0.35), np.sin(0.35), 0.0])
            along = way * speed / RADAR.frame_rate_hz * np.arange(3)[:, None]
            if moving == "target":
                iq = _seen(2 * way + along)[1]
            else:
                iq = _seen(np.repeat(2 * way[None], 3, axis=0), np.array([traced.pose(-shift) for shift in along]))[1]
            phase = np.unwrap(np.angle(_matched(iq[:, 0, 0], 2 - RADIUS_M + speed / RADAR.frame_rate_hz)))
            slope = np.polyfit(RADAR.chirp_times()[:, 0], phase, 1)[0]
            findings.append((speed, slope * SPEED_OF_LIGHT / (4 * np.pi * _middle_hz())))
    reference, simulated = max(findings, key=lambda pair: abs(pair[1] / pair[0] - 1))
    return Finding(reference, simulated, 100 * abs(simulated / reference - 1), len(findings))


def _azimuth(full: bool) -> Finding:
    """Compare the maximum of a Bartlett beamformer with the true azimuth, after the exact phase of the motion is removed."""
    findings = []
    virtual = RADAR.virtual_positions
    for azimuth in (-60, -35, -10, 0, 20, 45, 60) if full else (-35, 20):
        for speed in (0.0, 0.2, -3.0) if full else (0.2,):
            angle = np.radians(azimuth)
            way = np.array([np.cos(angle), np.sin(angle), 0.0])
            distance = 6.0
            iq = _seen(way * (distance + speed / RADAR.frame_rate_hz * np.arange(3)[:, None]))[1]
            frequency = _middle_hz()
            signal = _matched(iq, distance - RADIUS_M + speed / RADAR.frame_rate_hz)
            phase = 4 * np.pi * frequency / SPEED_OF_LIGHT * speed * (RADAR.chirp_times() - RADAR.chirp_times()[0, 0])
            channels = (signal * np.exp(-1j * phase)[:, :, None]).mean(axis=0).ravel()
            trial = np.radians(np.linspace(azimuth - 5, azimuth + 5, 2001))
            ways = np.stack([np.cos(trial), np.sin(trial), 0 * trial], axis=1)
            beam = np.abs(np.exp(2j * np.pi * frequency / SPEED_OF_LIGHT * ways @ virtual.T) @ channels)
            findings.append((float(azimuth), float(np.degrees(trial[beam.argmax()]))))
    return worst(findings)


def _phase(full: bool) -> Finding:
    """Compare the phase change per step of 1 mm away from the radar with 4 pi/lambda, at every sample of the sweep."""
    steps = np.arange(21 if full else 6) * 1e-3
    centres = np.array([[1.0 + step, 0.0, 0.0] for step in steps])
    frequency = traced.frequencies(RADAR)
    expected = 4 * np.pi * frequency[None] / SPEED_OF_LIGHT * steps[:, None]
    iq = np.array([_seen(centre[None])[0, 0, 0, 0] for centre in centres])
    difference = np.degrees(np.angle(iq * np.exp(-1j * expected) / iq[:1]))
    per_step = np.degrees(4 * np.pi * frequency.mean() / SPEED_OF_LIGHT * 1e-3)
    error = float(np.abs(np.diff(difference, axis=0)).max())
    return Finding(float(per_step), float(per_step) + error, error, difference.size)


def _friis(full: bool) -> Finding:
    """Compare the level of the sphere with lambda sqrt(sigma)/((4 pi)^1.5 R (R - r)), because its specular point is at R - r."""
    from experiments.validation.oracles.targets import mie_rcs

    pairs = []
    for distance in (0.5, 1.0, 2.0, 4.0, 8.0) if full else (1.0, 4.0):
        iq = _seen(np.array([[distance, 0.0, 0.0]]))[0, 0, 0, 0]
        wavelength = SPEED_OF_LIGHT / traced.frequencies(RADAR)
        section = np.mean([mie_rcs(RADIUS_M, float(sampled_m)) for sampled_m in wavelength[::8]])
        scaled = np.sqrt(section) * wavelength / (4 * np.pi) ** 1.5 / (distance * (distance - RADIUS_M))
        pairs.append((10 * np.log10(np.mean(scaled**2)), 10 * np.log10(np.mean(np.abs(iq) ** 2))))
    return worst(pairs)


KINEMATICS = "exact kinematics"
CASES = [
    Case("doppler", "motion", "radial speed of a small sphere, target or sensor moving", KINEMATICS, "speed (m/s)", 1.0, "%", _doppler),
    Case("azimuth", "motion", "azimuth of a small sphere, at rest and moving, TDM", KINEMATICS, "azimuth (deg)", 0.3, "deg", _azimuth),
    Case("phase-per-mm", "motion", "phase of a small sphere per millimetre, every sample", "4 pi/lambda", "phase step (deg)", 1.0, "deg",
         _phase),
    Case("samples-level", "motion", "level of the samples of a 1 cm sphere", "radar equation, Mie series (miepython)",
         "received over transmitted power (dB)", 0.25, "dB", _friis),
]  # fmt: skip
