"""Faults planted in the physics, one at a time in a copy of the tree: the quick physics tests must catch each.

    make mutants                              all of them
    python tests/mutants/plant.py layers rcs  those in files whose path holds one of the words

Prints a line per fault and ends with status 1 if one was not caught, or no longer finds its place.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
LIMIT_S = 900


@dataclass(frozen=True)
class Fault:
    """One change of one line, what it means, and the tests that should notice."""

    path: str
    right: str
    wrong: str
    meaning: str
    tests: str


MATERIALS, RCS, TUBES = "tests/physics/test_materials.py", "tests/physics/test_rcs.py", "tests/physics/test_tubes.py"
SYNTHESIS, DIFFUSE, IMAGES = "tests/physics/test_synthesis.py", "tests/physics/test_diffuse.py", "tests/physics/test_images.py"
LAYERS = "radartwin/materials/layers.py"

FAULTS = (
    Fault(LAYERS, "r_te = (kz[outer] - kz[inner])", "r_te = (kz[inner] - kz[outer])", "TE reflection has the wrong sign", MATERIALS),
    Fault(
        LAYERS,
        "media[inner] * kz[outer] - media[outer] * kz[inner]) / d",
        "media[inner] * kz[inner] - media[outer] * kz[outer]) / d",
        "TM reflection swaps the wave numbers",
        MATERIALS,
    ),
    Fault(LAYERS, "once = np.exp(-1j * k0", "once = np.exp(1j * k0", "a lossy layer amplifies", MATERIALS),
    Fault(
        LAYERS,
        "te, through_te = (r_te + te * once**2)",
        "te, through_te = (r_te + te * once)",
        "a layer is passed once, not twice",
        MATERIALS,
    ),
    Fault(LAYERS, "t_te * once * through_te", "t_te * through_te", "a layer is passed without phase or loss", MATERIALS),
    Fault(
        LAYERS,
        "sin2 = 1 - np.asarray(cos_incidence, float) ** 2",
        "sin2 = 1 - np.asarray(cos_incidence, float)",
        "sine of the wrong angle",
        MATERIALS,
    ),
    Fault(
        "radartwin/materials/itu.py",
        "return real - 1j * conductivity",
        "return real - 2j * conductivity",
        "twice the conductivity",
        MATERIALS,
    ),
    Fault(
        "radartwin/materials/itu.py",
        "return real - 1j * conductivity",
        "return real + 1j * conductivity",
        "gain instead of loss",
        MATERIALS,
    ),
    Fault(
        "radartwin/materials/roughness.py",
        "return np.exp(-2 * (wavenumber",
        "return np.exp(-1 * (wavenumber",
        "Ament's factor on power",
        MATERIALS,
    ),
    Fault(
        "radartwin/simulation/rcs.py",
        "return float(4 * np.pi * abs(2 * wavenumber * total) ** 2)",
        "return float(4 * np.pi * abs(wavenumber * total) ** 2)",
        "far-field cross-section 6 dB low",
        RCS,
    ),
    Fault("radartwin/simulation/rcs.py", "stand_off**4", "stand_off**3", "near field falls with the wrong power of distance", RCS),
    Fault(
        "radartwin/simulation/rcs.py",
        "np.exp(1j * wavenumber * (hits.length_in_m + hits.length_out_m))",
        "np.exp(1j * wavenumber * (hits.length_in_m - hits.length_out_m))",
        "the way back is not added to the way there",
        RCS,
    ),
    Fault("radartwin/simulation/synthesis.py", "motion = 2 * np.pi * reach", "motion = np.pi * reach", "half the Doppler shift", SYNTHESIS),
    Fault(
        "radartwin/simulation/synthesis.py",
        "np.float32(np.sqrt(received / transmitted / 2))",
        "np.float32(np.sqrt(received / transmitted))",
        "noise 3 dB high",
        SYNTHESIS,
    ),
    Fault(
        "radartwin/simulation/diffuse.py",
        "(wavelength_m / product) ** 2 / (16 * np.pi**3)",
        "(wavelength_m / product) ** 2 / (64 * np.pi**3)",
        "scattered power 6 dB low",
        DIFFUSE,
    ),
    Fault(
        "radartwin/simulation/diffuse.py",
        "np.sqrt(power[kept]) * scatterers",
        "power[kept] * scatterers",
        "power taken for amplitude",
        DIFFUSE,
    ),
    Fault(
        "radartwin/simulation/aperture.py",
        "return 1j * d / math.pi * np.exp(0.5j",
        "return -1j * d / math.pi * np.exp(0.5j",
        "the edge wave has the wrong sign",
        IMAGES,
    ),
    Fault(
        "radartwin/simulation/tubes.py",
        "wavenumber = dr.opaque(mi.Float, 2 * np.pi * self.frequency_hz",
        "wavenumber = dr.opaque(mi.Float, np.pi * self.frequency_hz",
        "half the wavenumber in the tubes",
        f"{RCS} {TUBES}",
    ),
    Fault(
        "radartwin/radar/antenna.py",
        "np.log(10) / 20 *",
        "np.log(10) / 10 *",
        "the gain counted twice",
        "tests/unit/test_radar.py tests/physics/test_receiver.py",
    ),
    Fault(
        "radartwin/radar/processing.py",
        "turn = np.exp(-2j * np.pi * doppler_hz",
        "turn = np.exp(2j * np.pi * doppler_hz",
        "the transmitters' delay corrected the wrong way",
        "tests/physics/test_point_targets.py",
    ),
)


def ended(tests: Sequence[str], tree: Path) -> int | None:
    """Exit status of pytest on these files of the tree; None if it did not come to an end."""
    command = [sys.executable, "-m", "pytest", "-q", "-x", "--no-header", "-p", "no:cacheprovider", *tests]
    environment = {**os.environ, "PYTHONPATH": str(tree), "NUMBA_CACHE_DIR": str(tree / "numba")}
    try:
        return subprocess.run(command, cwd=tree, env=environment, capture_output=True, timeout=LIMIT_S, check=False).returncode
    except subprocess.TimeoutExpired:
        return None


def caught(fault: Fault, tree: Path) -> tuple[str, float]:
    """What became of the fault in the copied tree: caught, NOT CAUGHT, or NO PLACE where its line has changed."""
    path, started = tree / fault.path, time.monotonic()
    sound = path.read_text(encoding="utf-8")
    if sound.count(fault.right) != 1:
        return "NO PLACE", 0.0
    path.write_text(sound.replace(fault.right, fault.wrong), encoding="utf-8")
    try:
        status = ended(fault.tests.split(), tree)
    finally:
        path.write_text(sound, encoding="utf-8")
    said = {0: "NOT CAUGHT", 1: "caught", None: "caught"}.get(status, f"pytest {status}")  # a test that hangs has noticed
    return said, time.monotonic() - started


def main(words: Sequence[str]) -> int:
    chosen = [fault for fault in FAULTS if not words or any(word in fault.path for word in words)]
    missed = 0
    with tempfile.TemporaryDirectory() as folder:
        tree = Path(folder) / "tree"
        ignored = shutil.ignore_patterns(".git", ".venv", "outputs", "__pycache__", "results")
        shutil.copytree(ROOT, tree, ignore=ignored)
        tests = sorted({test for fault in chosen for test in fault.tests.split()})
        if ended(tests, tree) != 0:
            print(f"mutants: without a fault these do not pass: {' '.join(tests)}")
            return 1
        for fault in chosen:
            status, seconds = caught(fault, tree)
            missed += status != "caught"
            print(f"{status:10s} {seconds:6.1f} s  {fault.path}: {fault.meaning}", flush=True)
    print(f"mutants: {len(chosen) - missed} of {len(chosen)} caught")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
