"""The person in the room: cross-section, a free place, sway and phase of the echo."""

from dataclasses import replace

import numpy as np
import pytest

from radartwin.constants import SPEED_OF_LIGHT
from radartwin.radar.chirp import Radar
from radartwin.scene import rooms
from radartwin.scene.collision import overlap_m
from radartwin.scene.scene import Scene
from radartwin.scene.trajectories.trajectory import pose
from radartwin.simulation.simulate import simulate
from radartwin.testbed import bystander


@pytest.mark.slow
def test_the_person_echoes_like_an_adult():
    """At 76 to 81 GHz, published cross-sections of adults lie between -12 and -3 dBsm in the mean over directions."""
    radar = replace(Radar.iwr1843(), num_chirps=1)
    away, echoes = 3.0, []
    for degrees in range(0, 360, 15):
        cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
        at = pose([away, 0.0, -1.0], np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]]))
        iq = simulate(Scene([bystander.body().moved(at)]), radar, np.eye(4)[None], rays_per_wavelength2=0.1).iq
        echoes.append(np.mean(np.abs(iq) ** 2))
    wavelength = SPEED_OF_LIGHT / radar.center_frequency_hz
    section = np.mean(echoes) * (4 * np.pi) ** 3 * away**4 / wavelength**2 / 10 ** (2 * 10.5 / 10)
    assert -12 < 10 * np.log10(section) < -3


@pytest.mark.parametrize("room", ["lab", "squash_court", "atrium"])
def test_the_person_stands_in_free_space_beside_the_track(room):
    bench, whole = rooms.bench(room), rooms.room(room, detail="cluttered")
    target = bench.target_position(2.0)
    places = [bystander.place(whole, bench.sensor_pose[None], target, np.random.default_rng(seed)) for seed in range(3)]
    for at in places:
        body = bystander.body().moved(at)
        assert not any(overlap_m(body.mesh, s.mesh) for s in whole)
        away = np.linalg.norm(at[:2, 3] - bench.sensor_pose[:2, 3])
        assert bystander.NEAR_M <= away <= bystander.FAR_M
        assert np.linalg.norm(at[:2, 3] - target[:2]) > bystander.APART_M
    assert np.linalg.norm(places[0] - places[1]) > 0.05


def test_sway_has_its_deviation_and_memory_and_turns_the_echo_like_a_nearer_person():
    """A displacement towards the radar changes the phase of a point's echo by that of the shorter path, 2 times the displacement."""
    sway = bystander.sway(np.arange(20_000) / 10.0, 2.0, np.random.default_rng(0))
    assert sway.std() == pytest.approx(2 * bystander.SWAY_M, rel=0.1)
    assert np.corrcoef(sway[:-10], sway[10:])[0, 1] == pytest.approx(np.exp(-1), abs=0.06)
    radar, length, towards = replace(Radar.iwr1843(), num_chirps=1), 6.0, 0.003
    frequency = radar.start_frequency_hz + radar.slope_hz_per_s * np.arange(radar.num_samples) / radar.sample_rate_hz

    def point(path_m):
        return np.exp(2j * np.pi * frequency * path_m / SPEED_OF_LIGHT).astype(np.complex64)[None, None, None, None]

    iq = np.zeros((2, 1, 1, 1, radar.num_samples), np.complex64)
    bystander.Echo(point(length), np.array([0.0, towards])).add_to(iq, radar)
    np.testing.assert_allclose(iq, np.concatenate([point(length), point(length - 2 * towards)]), atol=2e-4)
