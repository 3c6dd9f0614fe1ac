"""Add echoes of static objects that the scan does not contain: fixtures of a room that nobody modelled, in front of and behind the target.

The echoes come from points at random places, which all recordings of a draw share. The places are relative to the pose of the radar in the
middle of its course. All sizes are orders of magnitude: the paper names such fixtures and gives no number. The mean level of an echo does
not depend on its distance, so that the strength alone sets the level. The strength is the energy of all echoes over the energy of the same
recording outside the target gate.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from radartwin.features.processed import process
from radartwin.features.profile import FAR_M, NEAR_M, gate_energies
from radartwin.radar.chirp import Radar
from radartwin.radar.recording import Recording
from radartwin.simulation.paths import Paths
from radartwin.simulation.signal.synthesis import received

COUNT = 8  # number of echoes; their amplitudes are Rayleigh distributed, as those of fixtures of many scattering centres
NEAREST_M, FARTHEST_M = 0.5, 5.0  # distance from the place of the radar in the middle of its course
BESIDE_RAD, ABOVE_RAD = np.radians(45.0), np.radians(15.0)  # largest angle from the direction in which this radar looks
CLEAR_M = 0.25  # smallest distance from the target in range at any pose, so that no echo lies in the target gate
FRAMES = 24  # smallest number of frames from which the energy of the room is computed, unless there are fewer


def echoes(radar: Radar, sensor_poses: NDArray[np.float64], target_m: NDArray[np.float64], rng: np.random.Generator) -> Paths:
    """Draw the echoes as paths at each pose (F, 4, 4) of a radar, up to a common factor. An echo that comes near the range (F,) of the
    target is left out.
    """
    distance = rng.uniform(NEAREST_M, FARTHEST_M, COUNT)
    azimuth, elevation = (rng.uniform(-most, most, COUNT) for most in (BESIDE_RAD, ABOVE_RAD))
    level = rng.rayleigh(size=COUNT) * np.exp(2j * np.pi * rng.random(COUNT))
    way = np.stack([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], axis=1)
    middle = sensor_poses[len(sensor_poses) // 2]
    places = middle[:3, 3] + (distance[:, None] * way) @ middle[:3, :3].T
    # vectors from each pose to each place, in the coordinates of the radar at this pose
    ray = np.einsum("fji,fnj->fni", sensor_poses[:, :3, :3], places - sensor_poses[:, None, :3, 3]).reshape(-1, 3)
    length = np.linalg.norm(ray, axis=1)
    poses, ray = len(sensor_poses), ray / length[:, None]
    level = level * (np.abs(length.reshape(poses, COUNT) - target_m[:, None]) > CLEAR_M).all(axis=0)
    return Paths(
        poses, np.repeat(np.arange(poses), COUNT), np.ones(poses * COUNT, int), np.tile(level, poses)[:, None],
        np.array([radar.start_frequency_hz]), length, length, ray, ray, np.zeros(poses * COUNT),
    )  # fmt: skip


def added(
    clean: Recording, radar: Radar, sensor_poses: NDArray[np.float64], target_m: NDArray[np.float64], strength: float, seed: int
) -> Recording:
    """Return a recording (without receiver effects) with the echoes.

    Args:
        radar: radar with the front end that receives the echoes.
        sensor_poses: (F, 4, 4) or (1, 4, 4) poses of the radar.
        target_m: (F,) logged range of the target.
        strength: energy of the echoes over that outside the target gate.
    """
    rng = np.random.default_rng(np.random.SeedSequence([seed, *b"unscanned echoes"]))
    frames = len(clean.iq)
    seen_m = target_m if len(sensor_poses) == len(target_m) else np.mean(target_m, keepdims=True)
    more = received([echoes(radar, sensor_poses, seen_m, rng)], radar, len(sensor_poses))
    selection = slice(None, None, max(frames // FRAMES, 1))
    inside, whole = gate_energies(*_profiles(Recording(clean.iq[selection], clean.radar, None)), target_m[selection])
    power, range_m = _profiles(Recording(more[selection] if len(more) == frames else more, clean.radar, None))
    energy = power[:, (range_m >= NEAR_M) & (range_m <= FAR_M)].sum(axis=1).mean()
    amplitude = np.sqrt(strength * np.mean(whole - inside) / energy)
    return Recording(clean.iq + np.complex64(amplitude) * more, clean.radar, clean.sensor_poses, provenance=clean.provenance)


def _profiles(recording: Recording) -> tuple[NDArray, NDArray]:
    """Return the power (F, B) of a recording, and the range (B,) of its bins in metres."""
    processed = process(recording, doppler=False)
    return processed.power, processed.range_m
