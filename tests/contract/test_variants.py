"""Both Mitsuba variants, CPU and GPU, pass the tests of the simulator and give equal samples, each in processes of its own."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from radartwin.simulation import variant

ROOT = Path(__file__).resolve().parents[2]
TESTS = (
    "contract/test_simulators.py",
    "physics/test_synthesis.py",
    "physics/test_tubes.py",
    "physics/test_diffuse.py",
    "physics/test_drives.py",
)
VARIANTS = ("llvm", "cuda")
SAMPLES = """
import sys, numpy as np, radartwin as rt
from radartwin.scene import objects
from radartwin.scene.trajectories import trajectory
radar, poses = rt.Radar.iwr1843(), np.stack([trajectory.pose([-1.0, 0.01 * f, 0.0]) for f in range(3)])
targets = [rt.Surface(mesh, material, "target", role="object")
           for mesh in (objects.sphere(0.05), objects.trihedral(0.1), objects.cylinder(0.033, 0.12)) for material in ("metal", "glass")]
plate = objects.plate(3.0, 3.0).apply_transform(trajectory.pose([1.0, 0.0, 0.0]))
wall = rt.Surface(plate, "concrete", "wall", role="room", roughness_m=3e-4)
scenes = [*([target] for target in targets), [wall], [targets[-1], wall]]
np.savez(sys.argv[2], *(rt.simulate(rt.Scene(scene), radar, poses, variant=sys.argv[1]).iq for scene in scenes))
"""
needs_gpu = pytest.mark.skipif(not variant.has_cuda(), reason="this computer has no NVIDIA GPU")


def environment(name: str) -> dict[str, str]:
    """Return the environment of a process with a variant. A process of the CPU variant sees no GPU, so that "auto" selects the CPU."""
    return {**os.environ, "PYTHONPATH": str(ROOT), **({"CUDA_VISIBLE_DEVICES": ""} if name == "llvm" else {})}


@pytest.mark.gpu
@needs_gpu
@pytest.mark.parametrize("name", VARIANTS)
def test_simulator_passes_its_tests(name):
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *(f"tests/{file}" for file in TESTS)]
    answer = subprocess.run(command, cwd=ROOT, env=environment(name), capture_output=True, text=True, check=False)
    assert answer.returncode == 0, answer.stdout[-4000:]


@pytest.mark.gpu
@needs_gpu
def test_variants_give_equal_samples(tmp_path):
    """The devices intersect rays in single precision with different rounding, so that a few tubes at silhouettes meet other facets."""
    samples = []
    for name in VARIANTS:
        file = tmp_path / f"{name}.npz"
        subprocess.run([sys.executable, "-c", SAMPLES, name, str(file)], cwd=ROOT, env=environment(name), check=True)
        samples.append(list(np.load(file).values()))
    for cpu, gpu in zip(*samples, strict=True):
        assert np.linalg.norm(gpu - cpu) < 0.01 * np.linalg.norm(cpu)


@pytest.mark.parametrize(("visible", "found"), [(None, True), ("0", True), ("", False), ("-1", False)])
def test_hidden_gpus_are_not_used(monkeypatch, tmp_path, visible, found):
    program = tmp_path / "nvidia-smi"
    program.write_text("#!/bin/sh\necho 'GPU 0: fake'\n")
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CUDA_VISIBLE_DEVICES", raising=False)
    if visible is not None:
        monkeypatch.setenv("CUDA_VISIBLE_DEVICES", visible)
    assert variant.has_cuda() == found
