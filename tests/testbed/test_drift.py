"""The slow drift of a room: its size, its speed, and the error of interpolating signals between traced states."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from radartwin.constants import SPEED_OF_LIGHT
from radartwin.radar.chirp import Radar
from radartwin.scene.scene import Scene, Surface
from radartwin.simulation.simulate import simulate
from radartwin.testbed import drift
from radartwin.testbed.drift import REACH, Drift, DriftErrors

ERRORS = DriftErrors()
WAVELENGTH_M = SPEED_OF_LIGHT / 79e9


def echo(shift_m: float) -> np.ndarray:
    """Return the signal (T, R, N) of an echo straight back to the radar, whose phase changes with twice the displacement."""
    return np.full((1, 1, 4), np.exp(-4j * np.pi * shift_m / WAVELENGTH_M), np.complex64)


def test_three_states_interpolate_all_shifts_to_the_stated_error() -> None:
    states = drift.traced(lambda state: echo(state * ERRORS.creep_m), ERRORS)
    course = np.linspace(-REACH, REACH, 201)
    blended = Drift(states, course).at() + echo(0.0)
    exact = np.stack([echo(c * ERRORS.creep_m) for c in course])
    worst = np.abs(blended - exact).max()
    assert 0.002 < worst < 0.02
    assert np.abs(blended - exact)[[0, 100, 200]].max() < 1e-6
    assert np.abs(exact - exact[100]).max() > 0.5  # the change is much larger than the error of 0.02


def test_doubled_drift_has_more_states_and_the_same_error() -> None:
    twice = ERRORS.scaled(2)
    states = drift.traced(lambda state: echo(state * twice.creep_m), twice)
    course = np.linspace(-REACH, REACH, 201)
    exact = np.stack([echo(c * twice.creep_m) for c in course])
    assert len(states) == 5
    assert np.abs(Drift(states, course).at() + echo(0.0) - exact).max() < 0.02


def test_course_is_slow_bounded_and_reproducible() -> None:
    times = np.arange(3000) / 10
    found = np.array([drift.course(times, ERRORS, seed) for seed in range(200)])
    assert np.abs(found).max() <= REACH
    assert found.std() == pytest.approx(0.9, abs=0.1)  # standard deviation of a normal process that is reflected at two standard deviations
    assert np.abs(np.diff(found, axis=1)).max() < 0.3  # no jump from frame to frame
    turns = found[:, ::250]
    assert np.abs(turns[:, 1] - turns[:, 0]).mean() > 0.3  # the state differs after one revolution
    assert np.array_equal(found[3], drift.course(times, ERRORS, 3))


def test_named_objects_shift_level_in_their_own_directions() -> None:
    surfaces = [Surface(trimesh.creation.box([0.1, 0.1, 0.1]), "metal", name) for name in ("bin", "box", "wall")]
    moved = drift.shifted(surfaces, {"bin", "box"}, -1.5, ERRORS, 7)
    shifts = [b.mesh.vertices.mean(axis=0) - a.mesh.vertices.mean(axis=0) for a, b in zip(surfaces, moved, strict=True)]
    assert [np.linalg.norm(s) for s in shifts] == pytest.approx([1.5e-4, 1.5e-4, 0.0])
    assert np.abs([s[2] for s in shifts]).max() < 1e-12
    assert np.linalg.norm(shifts[0] - shifts[1]) > 1e-5
    assert [s.name for s in drift.shifted(surfaces, {"bin"}, 0.0, ERRORS, 7)] == ["bin", "box", "wall"]


def test_interpolated_sphere_matches_a_traced_one() -> None:
    radar = Radar.iwr1843(element="isotropic")
    sphere = Surface(trimesh.creation.icosphere(4, 0.1).apply_translation([1.5, 0.2, 0.0]), "metal", "ball")

    def signal(state: float) -> np.ndarray:
        moved = drift.shifted([sphere], {"ball"}, state, ERRORS, 1)
        return simulate(Scene(moved), radar, np.eye(4)[None], max_bounces=1).iq[0, 0]

    states = drift.traced(signal, ERRORS)
    between = states[1] + Drift(states, np.array([1.1])).at()[0]
    exact = signal(1.1)
    assert np.linalg.norm(between - exact) < 0.03 * np.linalg.norm(exact)
    assert np.linalg.norm(states[1] - exact) > 0.05 * np.linalg.norm(exact)
    iq = np.zeros((2, 3, *exact.shape), np.complex64)
    Drift(states, np.array([0.0, REACH])).add_to(iq)
    assert np.abs(iq[0]).max() == 0
    assert np.allclose(iq[1], states[2] - states[1], atol=1e-9)
