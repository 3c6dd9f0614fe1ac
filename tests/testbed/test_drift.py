"""The slow drift of a room: its size, its speed, and the error of interpolating signals between traced states."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from radartwin.constants import SPEED_OF_LIGHT
from radartwin.scene.scene import Surface
from radartwin.testbed import drift
from radartwin.testbed.drift import REACH, Drift, DriftErrors

ERRORS = DriftErrors()
WAVELENGTH_M = SPEED_OF_LIGHT / 79e9


def echo(shift_m: float) -> np.ndarray:
    """Return the signal (T, R, N) of an echo straight back to the radar, whose phase changes with twice the displacement."""
    return np.full((1, 1, 4), np.exp(-4j * np.pi * shift_m / WAVELENGTH_M), np.complex64)


@pytest.mark.parametrize(("strength", "count"), [(1, 3), (2, 5)])
def test_traced_states_interpolate_all_shifts_to_the_stated_error(strength: float, count: int) -> None:
    errors = ERRORS.scaled(strength)
    states = drift.traced(lambda state: echo(state * errors.creep_m), errors)
    course = np.linspace(-REACH, REACH, 201)
    exact = np.stack([echo(c * errors.creep_m) for c in course])
    error = np.abs(Drift(states, course).at() + echo(0.0) - exact)
    assert len(states) == count
    assert 0.002 < error.max() < 0.02
    assert error[[0, 100, 200]].max() < 1e-6
    assert np.abs(exact - exact[100]).max() > 0.5  # the change is much larger than the error of 0.02


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
