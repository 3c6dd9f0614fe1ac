"""Add echoes of static objects that the scan does not contain: fixtures of a room that nobody modelled, in front of and behind the target.

Each echo comes from a point at a random place, and its amplitude is Rayleigh distributed. The strength of this gap is the energy of all
echoes together over the energy outside the target gate without them. The echoes of a draw stay at their places in all its recordings.
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

COUNT = 8  # number of echoes; order of magnitude
NEAREST_M, FARTHEST_M = 0.5, 5.0  # distance from the place of the radar in the middle of its course
BESIDE_RAD, ABOVE_RAD = np.radians(45.0), np.radians(15.0)  # largest angle from the line of sight of this radar
CLEAR_M = 0.25  # smallest distance from the target in range, so that no echo lies in the target gate
FRAMES = 24  # number of frames from which the energy of the room is computed


def echoes(radar: Radar, sensor_poses: NDArray[np.float64], target_m: float, rng: np.random.Generator) -> Paths:
    """Draw the echoes as paths at each pose (F, 4, 4) of a radar, up to a common factor. An echo near the range `target_m` is left out."""
    distance = rng.uniform(NEAREST_M, FARTHEST_M, COUNT)
    azimuth, elevation = (rng.uniform(-most, most, COUNT) for most in (BESIDE_RAD, ABOVE_RAD))
    level = rng.rayleigh(size=COUNT) * np.exp(2j * np.pi * rng.random(COUNT))
    level, distance = level * (np.abs(distance - target_m) > CLEAR_M), distance[:, None]
    way = np.stack([np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)], axis=1)
    middle = sensor_poses[len(sensor_poses) // 2]
    places = middle[:3, 3] + (distance * way) @ middle[:3, :3].T
    # vectors from each pose to each place, in the coordinates of the radar at this pose
    ray = np.einsum("fji,fnj->fni", sensor_poses[:, :3, :3], places - sensor_poses[:, None, :3, 3]).reshape(-1, 3)
    length = np.linalg.norm(ray, axis=1)
    poses, ray = len(sensor_poses), ray / length[:, None]
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
        strength: energy of the echoes over that outside the target gate; 0 returns the recording itself.
        seed: seed of the draw.
    """
    if strength == 0:
        return clean
    rng = np.random.default_rng(np.random.SeedSequence([seed, *b"unscanned echoes"]))
    frames = len(clean.iq)
    more = received([echoes(radar, sensor_poses, float(np.mean(target_m)), rng)], radar, len(sensor_poses))
    some = slice(None, None, max(frames // FRAMES, 1))
    inside, whole = gate_energies(*_profiles(Recording(clean.iq[some], clean.radar, None)), target_m[some])
    power, range_m = _profiles(Recording(more[some] if len(more) == frames else more, clean.radar, None))
    energy = power[:, (range_m >= NEAR_M) & (range_m <= FAR_M)].sum(axis=1).mean()
    amplitude = np.sqrt(strength * np.mean(whole - inside) / energy)
    return Recording(clean.iq + np.complex64(amplitude) * more, clean.radar, clean.sensor_poses, provenance=clean.provenance)


def _profiles(recording: Recording) -> tuple[NDArray, NDArray]:
    """Return the power (F, B) of a recording, and the range (B,) of its bins in metres."""
    processed = process(recording, doppler=False)
    return processed.power, processed.range_m
