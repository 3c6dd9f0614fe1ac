"""Whole simulations from scene to samples: tests of level, phase, motion, angle, visibility and determinism."""

import dataclasses
import os
import subprocess
import sys

import numpy as np
import pytest
from physics_helpers import at

import radartwin as rt
from radartwin.scene import objects
from radartwin.scene.trajectories import trajectory

RADAR = rt.Radar.iwr1843(element="isotropic")


def level_near(samples, range_m, within_m):
    """Return the highest level of a range profile near a range."""
    away_m = np.abs(np.arange(256) * RADAR.unambiguous_range_m / 256 - range_m)
    return np.abs(np.fft.fft(samples * np.hanning(256)))[away_m < within_m].max()


def test_object_and_sensor_moving_together_pass_behind_a_screen():
    """Sensor and object keep their relative pose, but a screen hides the object on a part of the motion."""
    screen = rt.Surface(objects.box([0.5, -0.2, -0.3], [0.52, 0.2, 0.3]), "wood", "screen")
    along = np.array([at(0.0, y) for y in (-1.0, 0.0, 1.0)])
    facing_back = along @ trajectory.pose([1.0, 0, 0], np.diag([-1.0, -1.0, 1.0]))
    scene = rt.Scene([screen, rt.Surface(objects.plate(0.05, 0.05), "metal", "plate")])
    iq = rt.simulate(scene, RADAR, along, motion={"plate": facing_back}).iq
    level = [level_near(frame[0, 0, 0], 1.0, 0.07) for frame in iq]
    assert level[0] == pytest.approx(level[2], rel=0.05)
    assert level[1] < 0.1 * level[0]


def test_long_thin_and_large_round_targets_are_traced_finely():
    """A surface larger than half a metre must not count as a wall because of its size."""
    for mesh, position in ((objects.cylinder(0.02, 0.75), at(-2.0, 0.026)), (objects.sphere(0.3), at(-2.0))):
        levels = [
            np.abs(rt.simulate(rt.Scene([rt.Surface(mesh, "metal", "t", role=role)]), RADAR, position[None]).iq).max()
            for role in ("auto", "object")
        ]
        assert levels[0] == pytest.approx(levels[1], rel=0.02)


def test_real_sampling_has_no_imaginary_part():
    scene = rt.Scene([rt.Surface(objects.plate(0.1, 0.1), "metal", "target")])
    iq = rt.simulate(scene, dataclasses.replace(RADAR, real_sampling=True), at(-1.0)[None]).iq
    assert iq.any()
    assert not iq.imag.any()


def test_small_object_survives_beside_a_bright_wall():
    """The tracer prunes weak paths separately for each part of the scene."""
    ball = objects.sphere(0.03).apply_transform(at(1.5))
    wall = objects.plate(6.0, 6.0).apply_transform(at(4.0))
    alone = rt.simulate(rt.Scene([rt.Surface(ball, "metal", "ball")]), RADAR, np.eye(4)[None])
    scene = rt.Scene([rt.Surface(ball, "metal", "ball"), rt.Surface(wall, "metal", "wall")])
    both = rt.simulate(scene, RADAR, np.eye(4)[None])
    a, b = (level_near(r.iq[0, 0, 0, 0], 1.5, 0.1) for r in (alone, both))
    assert 20 * np.log10(b / a) == pytest.approx(0, abs=0.5)


def test_old_llvm_is_refused_before_it_loads(tmp_path):
    """With LLVM 15 and 16, Dr.Jit would abort the process."""
    fake = tmp_path / "libLLVM-15.so"
    fake.touch()
    code = (
        "import os, numpy as np, radartwin as rt; from radartwin.scene import objects\n"
        "from radartwin.errors import BackendError\n"
        "try: rt.rcs(objects.plate(.1, .1), [1, 0, 0])\n"
        "except BackendError as error: print(error)"
    )
    environment = {**os.environ, "DRJIT_LIBLLVM_PATH": str(fake)}
    environment["PATH"] = "/usr/bin:/bin"
    out = subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, timeout=60, check=True)
    assert "LLVM 17" in out.stdout
    assert "libLLVM-15.so" in out.stdout
