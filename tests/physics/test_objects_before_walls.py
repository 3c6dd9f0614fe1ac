"""Compare the echo of a wall behind flat objects with two-way Kirchhoff quadrature: shadow and paths over object and wall together."""

import numpy as np
import pytest
from scipy.signal import fftconvolve

import radartwin as rt
from experiments.validation.oracles import traced
from radartwin.constants import SPEED_OF_LIGHT
from radartwin.scene import objects, rooms
from radartwin.simulation.backends.mitsuba import MitsubaBackend, TraceSettings

RADAR = traced.MONOSTATIC
K = 2 * np.pi * RADAR.center_frequency_hz / SPEED_OF_LIGHT
PLACE, WALL = 0.9, 2.6  # distances of object and wall in metres
BACKEND = MitsubaBackend(TraceSettings(room="panels", diffuse=False))
# A plate without thickness, and two plates with narrow sides that the radar sees at grazing incidence
PLATES = {
    "sheet": objects.plate(0.09, 0.13),
    "0.1 mm": objects.box((-1e-4, -0.045, -0.065), (0, 0.045, 0.065)),
    "1 mm": objects.box((-1e-3, -0.045, -0.065), (0, 0.045, 0.065)),
}


def two_ways(screen, y, z, place=PLACE, wall=WALL):
    """Return the echo of a mirror at x = `wall` behind a black screen at x = `place`, relative to the free echo.

    The quadrature runs over the screen and over its image: the field passes both. screen: (Y, Z) whether a cell of the grid of y (Y,) and
    z (Z,) is covered.
    """
    area, between, rest = (y[1] - y[0]) * (z[1] - z[0]), 2 * (wall - place), 2 * wall - place
    near, far = (np.sqrt(d * d + y[:, None] ** 2 + z**2) for d in (place, rest))
    factor = K / (2j * np.pi) * area
    source = screen * np.exp(1j * K * near) / near * 0.5 * (1 + place / near)
    once = factor * (source * np.exp(1j * K * far) / far).sum()
    aside = [np.arange(1 - len(axis), len(axis)) * (axis[1] - axis[0]) for axis in (y, z)]
    way = np.sqrt(between**2 + aside[0][:, None] ** 2 + aside[1] ** 2)
    second = fftconvolve(source, factor * np.exp(1j * K * way) / way, mode="full")[len(y) - 1 :, len(z) - 1 :][: len(y), : len(z)]
    twice = factor * (source * second).sum()
    return 1 - (2 * once - twice) * 2 * wall * np.exp(-2j * K * wall)


def behind(mesh, poses, named=True):
    """Return the echoes (F,) of a metal wall behind a metal object at F poses, relative to the free wall."""
    wall = rt.Surface(rooms.rectangle([WALL, -4, -4], np.eye(3)[1], np.eye(3)[2], (8, 8)), "metal", "wall", role="room")
    free = echo(BACKEND.paths(rt.Scene([wall]), RADAR, np.eye(4)[None]), 0)
    if named:
        thing = rt.Surface(mesh, "metal", "thing", role="object")
        parts = BACKEND.paths(rt.Scene([wall, thing]), RADAR, np.repeat(np.eye(4)[None], len(poses), 0), {"thing": poses})
        return np.array([echo(parts, frame) for frame in range(len(poses))]) / free
    things = [rt.Surface(mesh.copy().apply_transform(pose), "metal", "thing", role="object") for pose in poses]
    return np.array([echo(BACKEND.paths(rt.Scene([wall, thing]), RADAR, np.eye(4)[None]), 0) for thing in things]) / free


def echo(parts, frame, within=0.02):
    """Return the field of the paths of a frame whose length is that of the wall's echo, within 2 cm."""
    chosen = [part.frames(frame, frame + 1) if part.poses > 1 else part for part in parts]
    return traced.field([part.where(np.abs(part.length_m - 2 * WALL) < within) for part in chosen], RADAR.center_frequency_hz)


def at(places):
    poses = np.tile(np.eye(4), (len(places), 1, 1))
    poses[:, :3, 3] = places
    return poses


@pytest.mark.parametrize("name", PLATES)
def test_plate_before_a_wall_matches_two_way_kirchhoff_at_every_offset(name):
    """A plate moves sideways past the line to the wall. Its edge passes this line at 45 mm."""
    offsets = np.arange(0, 0.2501, 0.0025)
    y, z = (np.arange(-half + 2.5e-4, half, 5e-4) for half in (0.045, 0.065))
    exact = np.array([two_ways(np.ones((len(y), len(z))), y + offset, z) for offset in offsets])
    poses = at([(PLACE, offset, 0.0) for offset in offsets])
    found = behind(PLATES[name], poses)
    assert np.abs(found - exact).max() < 0.1
    some = np.flatnonzero(np.isin(np.round(offsets * 1e4), [0, 450, 475, 500, 1000, 2000]))
    assert behind(PLATES[name], poses[some], named=False) == pytest.approx(found[some], abs=1e-3)
