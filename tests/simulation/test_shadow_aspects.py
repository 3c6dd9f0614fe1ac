"""Interpolation of a turning target between its aspects, and the slow change of its shadow."""

import numpy as np
import pytest
from posing import turning

from experiments.validation.oracles import traced
from radartwin.radar.chirp import Radar
from radartwin.scene.objects.catalogue import catalogue
from radartwin.scene.surface import Surface
from radartwin.simulation.aspects import SHADOW_ASPECTS, SHADOW_ROUND, Aspects
from radartwin.simulation.backends.trace_settings import TraceSettings
from radartwin.simulation.backends.track_paths import Track
from radartwin.simulation.signal.synthesis import received


@pytest.mark.parametrize("traced", [64, 65])
def test_refined_aspects_of_a_band_limited_signal_are_exact(traced):
    rng = np.random.default_rng(1)
    orders = np.arange(-20, 21)
    weights = rng.standard_normal((len(orders), 2, 4, 3, 2)) @ [1, 1j]

    def signal(count):
        return np.tensordot(np.exp(1j * np.outer(2 * np.pi * np.arange(count) / count, orders)), weights, 1)

    refined = Aspects(signal(traced).astype(np.complex64)).refined(256)
    assert np.allclose(refined.signals, signal(256), atol=1e-4)


@pytest.mark.parametrize(("name", "aspects"), [("mug", SHADOW_ASPECTS), ("can_211_300", SHADOW_ROUND)])
def test_few_aspects_of_a_shadow_stand_for_many(name, aspects):
    """Interpolated between few angles of the turntable, the shadow of a target 3 mm off the axis agrees with the shadow at 384 angles."""
    radar = Radar.iwr1843("isotropic")
    walls = [Surface(traced.polygon(np.array(ring, float)), "metal", f"wall {i}", role="room") for i, ring in enumerate((
        [(3, -2, -1), (3, 2, -1), (3, 2, 2), (3, -2, 2)], [(0, 1, -1), (3, 1, -1), (3, 1, 2), (0, 1, 2)],
    ))]  # fmt: skip
    sensor, target = np.eye(4)[None], list(catalogue()[name].surfaces())
    drives = Track.of_drives(walls, radar, sensor, TraceSettings(max_bounces=2))

    def shadow(count):
        angle = 2 * np.pi * np.arange(count) / count
        poses = turning("z", angle)
        poses[:, :3, 3] = poses[:, :3, :3] @ [0.003, 0.0, -0.05] + [1.0, 0.02, 0.0]
        return received(drives.shadow(target, sensor, poses), radar, count, oscillator=None)[:, 0]

    many = shadow(384)
    assert np.linalg.norm(many - many.mean(axis=0)) > 0.001 * np.linalg.norm(many)
    assert np.linalg.norm(Aspects(shadow(aspects)).refined(384).signals - many) < 0.015 * np.linalg.norm(many)
