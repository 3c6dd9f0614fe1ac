"""Test the interpolation of a rotating target's echo between traced rotation angles (aspects). The interpolation is exact for an echo that
consists of harmonics of the rotation, and stays within the stated error for traced targets.
"""

from dataclasses import replace

import numpy as np
import pytest
from posing import turning

import radartwin as rt
from radartwin.scene import objects
from radartwin.simulation.aspects import ASPECTS, MIN_ASPECTS, NEARLY_ROUND, Aspects, needed

K = 2 * np.pi * 77e9 / 299792458.0


def largest_error(reach_m, count=ASPECTS):
    """Return the largest interpolation error for a point that circles with radius `reach_m` in front of a distant sensor; the phase of its
    echo is 2 k R cos(angle).
    """
    wave = lambda angle: np.exp(2j * K * reach_m * np.cos(angle + 0.3))  # noqa: E731
    aspects = Aspects.traced(lambda angle: np.tile(wave(angle)[:, None, None, None], (1, 2, 1, 1)), count)
    angles = np.random.default_rng(0).uniform(-20, 20, (50, 3, 2))
    return np.abs(aspects.at(angles)[..., 0, 0] - wave(angles)).max()


@pytest.mark.parametrize(("reach_m", "expected"), [(0.01, MIN_ASPECTS), (0.075, 576), (0.12, 896)])
def test_number_of_aspects_follows_the_reach(reach_m, expected):
    assert needed([rt.Surface(objects.sphere(reach_m), "metal")]) == expected
    assert largest_error(reach_m, expected) < 0.002


def test_a_rough_body_of_revolution_needs_the_aspects_of_an_uneven_one():
    """The diffuse echo turns with the body."""
    can = rt.Surface(objects.cylinder(0.033, 0.1), "metal")
    assert needed([can], 1e-3, round_about_axis=True) == 64
    assert needed([can.replaced(roughness_m=1e-4)], 1e-3, round_about_axis=True) == NEARLY_ROUND


@pytest.mark.parametrize("off_m", [0.006, 0.02])
def test_round_targets_need_aspects_for_their_offset_only(off_m):
    count = needed([], off_m, round_about_axis=True)
    assert count <= 256
    assert largest_error(off_m, count) < 0.002


def test_symmetric_target_repeats_within_a_turn():
    wave = lambda angle: np.exp(1j * 40 * np.cos(4 * angle))[:, None, None, None]  # noqa: E731
    aspects = Aspects.traced(wave, 512, symmetry=4)
    angles = np.linspace(0, 2 * np.pi, 40)[:, None, None]
    np.testing.assert_allclose(aspects.at(angles)[:, 0, 0, 0, 0], wave(angles[:, 0, 0])[:, 0, 0, 0], atol=5e-3)
    np.testing.assert_allclose(aspects.at(angles + np.pi / 2), aspects.at(angles), atol=1e-3)


def test_traced_trihedral_is_within_the_stated_error():
    """For a target at rest at an angle, and for a frame in motion, whose chirps have angles of their own."""
    radar = replace(rt.Radar.iwr1843("isotropic"), num_chirps=4)
    scene = rt.Scene([rt.Surface(objects.trihedral(0.1), "metal", "target", role="object")])

    def chirp(angle):
        """Trace a frame with the target at rest: the frames follow so slowly that the target does not move within a frame."""
        slow = replace(radar, num_chirps=1, frame_rate_hz=1e-6)
        return rt.simulate(scene, slow, np.eye(4)[None], motion={"target": turning("z", angle, (1.5, 0, 0))}).iq[:, 0]

    aspects = Aspects.traced(chirp)
    level = np.sqrt(np.mean(np.abs(aspects.signals) ** 2))
    angles = np.random.default_rng(1).uniform(0, 2 * np.pi, 60)
    between = aspects.at(np.tile(angles[:, None, None], (1, 1, 2)))[:, 0] - chirp(angles)
    assert np.sqrt(np.mean(np.abs(between) ** 2)) < 0.03 * level
    # one revolution in 25 s at 10 Hz, near the angle at which the trihedral's echo is strongest
    rate = 2 * np.pi / 25
    frames = np.pi + rate * np.arange(6) / radar.frame_rate_hz
    moving = rt.simulate(scene, radar, np.eye(4)[None], motion={"target": turning("z", frames, (1.5, 0, 0))}).iq
    ours = aspects.at(frames[:, None, None] + rate * radar.chirp_times())
    inside = slice(1, -1)  # in the first and last frame, the tracer's velocity is a one-sided difference
    difference = np.sqrt(np.mean(np.abs(moving[inside] - ours[inside]) ** 2))
    assert difference < 0.05 * np.sqrt(np.mean(np.abs(moving[inside]) ** 2))
    assert len(aspects.signals) == ASPECTS
