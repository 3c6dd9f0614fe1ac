"""The wheel simulates and processes in an environment without the checkout, and the source archive installs with every supported Python
version.

The slow test installs the source archive into an empty environment of each installed Python version: pip builds the wheel from the
archive with the versions of constraints.txt. For each Python version, the test needs a few gigabytes of disk space and a few minutes.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import time
import venv
import zipfile
from pathlib import Path
from typing import Literal

import pytest

ROOT = Path(__file__).resolve().parents[2]
SUPPORTED = ("3.11", "3.12", "3.13")
SAMPLE = [f"tests/{name}.py" for name in ("radar/test_radar", "store/test_digest", "physics/test_materials", "physics/test_point_targets")]


def build(kind: Literal["wheel", "sdist"], folder: Path) -> Path:
    """Build a distribution of the checkout in the folder, as pip does, and return the path of its archive."""
    code = f"import sys, hatchling.build as b; print(b.build_{kind}(sys.argv[1]))"
    subprocess.run([sys.executable, "-c", code, str(folder)], cwd=ROOT, capture_output=True, check=True)
    (archive,) = folder.iterdir()
    return archive


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build("wheel", tmp_path_factory.mktemp("wheel"))


@pytest.fixture(scope="module")
def environment(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Create a virtual environment with the wheel. The virtual environment uses the dependencies that the test's own environment has
    installed, but not the checkout.
    """
    folder = tmp_path_factory.mktemp("environment")
    venv.create(folder, with_pip=False, symlinks=True)
    packages = next(folder.glob("lib/python*/site-packages"))
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(packages)
    # A .pth line adds this environment's packages, and not the .pth files in them: the editable install stays behind.
    (packages / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return folder


def test_the_wheel_holds_library_and_configuration_and_no_study(wheel: Path) -> None:
    names = zipfile.ZipFile(wheel).namelist()
    shipped = {path.relative_to(ROOT).as_posix() for path in (ROOT / "conf").rglob("*.yaml")}
    assert {name.removeprefix("radartwin/") for name in names if name.startswith("radartwin/conf/")} == shipped
    assert {name.partition("/")[0] for name in names if not name.startswith("radartwin-")} == {"radartwin"}
    unshipped = ("__pycache__", ".lock")
    files = {path.relative_to(ROOT).as_posix() for path in (ROOT / "radartwin").rglob("*") if path.is_file()}
    assert {name for name in files if not any(word in name for word in unshipped)} <= set(names)


def python(environment: Path, folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run the environment's Python in a folder, without any other program on the path."""
    command = [str(environment / "bin" / "python"), *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=600, check=False, env={"PATH": ""})


def test_the_installed_wheel_works_without_the_checkout(environment: Path, tmp_path: Path) -> None:
    code = "import radartwin; from radartwin.cli import main; print([main([word]) for word in ('doctor', 'tables')])"
    done = python(environment, tmp_path, "-c", f"{code}; print(radartwin.__file__)")
    assert done.returncode == 0, done.stdout + done.stderr
    statuses, file = done.stdout.splitlines()[-2:]
    assert statuses == "[0, 2]", done.stdout + done.stderr  # the tables belong to the study
    assert file.startswith(str(environment))
    assert "checkout" in done.stderr.splitlines()[-1]


@pytest.mark.slow  # the environment has no compiled kernels
def test_the_installed_wheel_simulates_and_runs_the_demonstration(environment: Path, tmp_path: Path) -> None:
    began = time.monotonic()
    done = python(environment, tmp_path, "-m", "radartwin", "demo")
    assert done.returncode == 0, done.stdout + done.stderr
    print(f"the first demonstration took {time.monotonic() - began:.0f} s, with compilation")
    assert (tmp_path / "outputs" / "demo" / "index.html").is_file()
    benchmark = ["benchmark", "--method", "points", "--problem", "near"]
    for words in (["simulate", "scene=plate", "trajectory=static", "--out", "tiny"], ["process", "tiny"], benchmark):
        done = python(environment, tmp_path, "-m", "radartwin", *words)
        assert done.returncode == 0, done.stdout + done.stderr
    assert (tmp_path / "outputs" / "processed" / "tiny" / "peaks.csv").is_file()
    assert len((tmp_path / "outputs" / "benchmark" / "leaderboard.csv").read_text().splitlines()) == 2, "a head and one row"


def interpreter(version: str) -> Path | None:
    """Find an interpreter of this Python version on the PATH or in pyenv. A file on the PATH may be a pyenv shim without an interpreter
    behind it.
    """
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")) / "versions"
    for found in (shutil.which(f"python{version}"), *sorted(pyenv.glob(f"{version}.*/bin/python{version}"))):
        if found and subprocess.run([found, "-c", ""], capture_output=True, check=False).returncode == 0:
            return Path(found)
    return None


@pytest.mark.slow
@pytest.mark.parametrize("version", SUPPORTED)
def test_what_the_archive_installs_runs_and_passes_its_tests(version: str, tmp_path: Path) -> None:
    found = interpreter(version)
    if found is None:
        pytest.skip(f"Python {version} is not installed here; install it to test what the archive installs under it")
    for name in ("sdist", "work"):
        (tmp_path / name).mkdir()
    sdist, place = build("sdist", tmp_path / "sdist"), tmp_path / "environment"
    with tarfile.open(sdist) as archive:
        archive.extractall(tmp_path / "archive", filter="data")
    (unpacked,) = (tmp_path / "archive").iterdir()
    (tmp_path / "study").mkdir()
    (tmp_path / "study" / "experiments").symlink_to(unpacked / "experiments")  # oracles of the tests, which the wheel does not have

    def call(*command: str | Path, cwd: Path = tmp_path / "work") -> str:
        path = os.pathsep.join((str(place / "bin"), os.environ["PATH"]))
        clean = {"PATH": path, "HOME": os.environ["HOME"], "PYTHONPATH": str(tmp_path / "study")}
        done = subprocess.run(command, cwd=cwd, env=clean, capture_output=True, text=True, timeout=1800, check=False)
        assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
        return done.stdout

    call(found, "-m", "venv", place)
    pip = ("-m", "pip", "install", "--quiet", "--disable-pip-version-check", "-c", unpacked / "constraints.txt")
    call(place / "bin" / "python", *pip, sdist, "pytest", "pytest-xdist")
    assert Path(call("python", "-c", "import radartwin; print(radartwin.__file__)").strip()).is_relative_to(place)
    call("radartwin", "doctor")
    call("radartwin", "simulate", "scene=plate", "trajectory=static", "--out", "tiny")
    call("radartwin", "process", "tiny")
    assert (tmp_path / "work" / "outputs" / "processed" / "tiny" / "peaks.csv").is_file()
    said = call("pytest", "-q", *SAMPLE, cwd=unpacked)
    assert " passed" in said
    assert "failed" not in said
    shutil.rmtree(place)
