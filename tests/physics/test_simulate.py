"""Whole simulations from scene to samples: tests of level, phase, motion, angle, visibility and determinism."""

import os
import subprocess
import sys

import numpy as np
import pytest
from physics_helpers import at

import radartwin as rt
from radartwin.materials import reflection
from radartwin.scene import objects
from radartwin.scene.trajectories import trajectory

C = 299_792_458.0
RADAR = rt.Radar.iwr1843(element="isotropic")


def profile(samples, bins=8192):
    taper = np.hanning(samples.shape[-1])
    return np.fft.fft(samples * taper, bins) / taper.sum()


@pytest.mark.parametrize("material", ["metal", "plasterboard", rt.Layered([("plasterboard", 0.0125)])])
def test_large_wall_matches_its_image(material):
    """The remaining difference comes from the edges of the wall."""
    wall = rt.Scene([rt.Surface(objects.plate(8.0, 8.0), material, "wall")])
    recording = rt.simulate(wall, RADAR, at(-2.0)[None])
    f = RADAR.start_frequency_hz + RADAR.slope_hz_per_s * np.arange(256) / RADAR.sample_rate_hz
    te, _ = reflection(material, np.array(1.0), f)
    mirrored = RADAR.rx_positions * [-1, 1, 1] + [4.0, 0, 0]
    length = np.linalg.norm(RADAR.tx_positions[:, None] - mirrored[None], axis=2)[..., None]
    expected = np.conj(te) * C / f / (4 * np.pi * length) * np.exp(2j * np.pi * f * length / C)
    inner = slice(32, 224)
    assert np.linalg.norm((recording.iq[0, 0] - expected)[..., inner]) / np.linalg.norm(expected[..., inner]) < 0.08


def test_object_and_sensor_moving_together_pass_behind_a_screen():
    """Sensor and object keep their relative pose, but a screen hides the object on a part of the motion."""
    screen = rt.Surface(objects.box([0.5, -0.2, -0.3], [0.52, 0.2, 0.3]), "wood", "screen")
    along = np.array([at(0.0, y) for y in (-1.0, 0.0, 1.0)])
    facing_back = along @ trajectory.pose([1.0, 0, 0], np.diag([-1.0, -1.0, 1.0]))
    scene = rt.Scene([screen, rt.Surface(objects.plate(0.05, 0.05), "metal", "plate")])
    iq = rt.simulate(scene, RADAR, along, motion={"plate": facing_back}).iq
    bins = np.arange(256) * RADAR.unambiguous_range_m / 256
    level = [np.abs(profile(frame[0, 0, 0], 256))[np.abs(bins - 1.0) < 0.07].max() for frame in iq]
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


def test_small_object_survives_beside_a_bright_wall():
    """The tracer prunes weak paths separately for each part of the scene."""
    ball = objects.sphere(0.03).apply_transform(at(1.5))
    wall = objects.plate(6.0, 6.0).apply_transform(at(4.0))
    alone = rt.simulate(rt.Scene([rt.Surface(ball, "metal", "ball")]), RADAR, np.eye(4)[None])
    scene = rt.Scene([rt.Surface(ball, "metal", "ball"), rt.Surface(wall, "metal", "wall")])
    both = rt.simulate(scene, RADAR, np.eye(4)[None])
    bins = np.arange(256) * RADAR.unambiguous_range_m / 256
    near = np.abs(bins - 1.5) < 0.1
    a, b = (np.abs(profile(r.iq[0, 0, 0, 0], 256))[near].max() for r in (alone, both))
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
