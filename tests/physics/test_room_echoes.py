"""First-order echoes of each room are at the distances of its walls, and so are the peaks of a frame."""

import numpy as np
import pytest

import radartwin as rt
from radartwin.constants import SPEED_OF_LIGHT
from radartwin.scene import rooms
from radartwin.simulation.backends.mitsuba import MitsubaBackend, TraceSettings

HEIGHT_M = 0.4


def wall_distances(name, scene):
    """Of the sensor on its bench from the six sides, the tin in front of the court's front wall."""
    length, width, height = scene.provenance["size_m"]
    x = rooms.bench(name, HEIGHT_M).sensor_pose[0, 3]
    front = length - x - (0.045 if name == "squash_court" else 0.0)
    return np.array([front, x, width / 2, width / 2, HEIGHT_M, height - HEIGHT_M])


@pytest.mark.parametrize("name", ["lab", "atrium", "squash_court"])
def test_first_order_echoes_are_at_the_walls(name):
    scene = rooms.room(name, detail="shell")
    backend = MitsubaBackend(TraceSettings(room="panels", diffuse=False, coupling=False, max_bounces=1))
    (paths,) = backend.paths(scene, rt.Radar.iwr1843(element="isotropic"), rooms.bench(name, HEIGHT_M).sensor_pose[None])
    found = np.asarray(paths.length_m) / 2
    for distance in wall_distances(name, scene):
        assert np.abs(found - distance).min() < 2e-3, distance


@pytest.mark.parametrize("name", ["lab", "atrium", "squash_court"])
def test_range_profile_has_peaks_at_the_walls(name):
    """Every wall within the unambiguous range is 6 dB above the median of the range profile, within a bin."""
    scene = rooms.room(name, detail="shell")
    radar = rt.Radar.iwr1843(element="isotropic")
    backend = MitsubaBackend(TraceSettings(diffuse=False, max_bounces=1))
    iq = rt.simulate(scene, radar, rooms.bench(name, HEIGHT_M).sensor_pose[None], simulator=backend).iq
    assert np.isfinite(iq).all()
    window = np.hanning(iq.shape[-1])
    power = (np.abs(np.fft.fft(iq * window, axis=-1)) ** 2).mean(axis=(0, 1, 2, 3))
    bin_m = SPEED_OF_LIGHT / (2 * radar.slope_hz_per_s * radar.num_samples / radar.sample_rate_hz)
    for distance in np.unique(wall_distances(name, scene)):
        place = round(distance / bin_m)
        if place + 2 < len(power):
            assert power[place - 1 : place + 2].max() > 4 * np.median(power), distance
