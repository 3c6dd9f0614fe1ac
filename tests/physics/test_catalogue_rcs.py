"""Radar cross-sections of catalogue objects around their vertical axis."""

import numpy as np
import pytest
from physics_helpers import WAVELENGTH, db

import radartwin as rt
from radartwin.scene import objects

ASPECTS = np.radians([0.0, 15.0, 31.0, 60.0, 77.0])


def around(name):
    """Return the RCS in dBm^2 of an object at the angles ASPECTS, seen horizontally from the height at which the radar aims."""
    body = objects.make(name)[0]
    mesh = body.mesh.copy().apply_translation([0, 0, -objects.entry(name).aim_m])
    return np.array([db(rt.rcs(mesh, [np.cos(a), np.sin(a), 0.0], material=body.material)) for a in ASPECTS])


@pytest.mark.parametrize(("name", "radius", "straight"), [("can_211_400", 0.03295, 0.0940), ("drink_can_355", 0.03305, 0.0862)])
def test_cans_match_cylinders_of_their_straight_wall(name, radius, straight):
    """The broadside cross-section of a cylinder is 2 pi r h^2 / lambda. Seams, neck and base of a can may add 1 dB."""
    level = around(name)
    assert level.mean() == pytest.approx(db(2 * np.pi * radius * straight**2 / WAVELENGTH), abs=1.0)
    assert np.ptp(level) < 0.2  # the facets of the mesh cause no ripple over the angle


def test_bottles_vary_with_their_angle():
    assert np.ptp(around("mustard")) > 6
