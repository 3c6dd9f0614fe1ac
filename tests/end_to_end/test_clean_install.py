"""The source distribution installs into an empty environment of each installed Python version, and works there.

pip builds the wheel from the archive, as for any user, with the versions of constraints.txt. Then the installed package simulates and
processes a recording, and tests from the archive run against it. Each Python version takes a few gigabytes and minutes.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import tarfile
from collections.abc import Iterator
from pathlib import Path

import pytest
from building import build

pytestmark = pytest.mark.slow

SUPPORTED = ("3.11", "3.12", "3.13")
SAMPLE = ("tests/radar/test_radar.py", "tests/store/test_keys.py", "tests/physics/test_materials.py", "tests/physics/test_point_targets.py")


def python(version: str) -> Path | None:
    """Find an interpreter of this version on the PATH or in pyenv. A name on the PATH may be a shim without an interpreter."""
    pyenv = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv")) / "versions"
    for found in (shutil.which(f"python{version}"), *sorted(pyenv.glob(f"{version}.*/bin/python{version}"))):
        if found and subprocess.run([found, "-c", ""], capture_output=True, check=False).returncode == 0:
            return Path(found)
    return None


@pytest.fixture(scope="module")
def sdist(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build("sdist", tmp_path_factory.mktemp("sdist"))


@pytest.fixture
def environment(request: pytest.FixtureRequest, sdist: Path, tmp_path: Path) -> Iterator[tuple[Path, Path]]:
    """Return the scripts folder of an environment with the installed archive, and the folder of the unpacked archive."""
    interpreter = python(request.param)
    if interpreter is None:
        pytest.skip(f"Python {request.param} is not installed here; install it to test what the archive installs under it")
    with tarfile.open(sdist) as archive:
        archive.extractall(tmp_path / "archive", filter="data")
    (unpacked,) = (tmp_path / "archive").iterdir()
    place = tmp_path / "environment"
    clean = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV")}
    subprocess.run([interpreter, "-m", "venv", place], check=True, env=clean)
    pip = [place / "bin" / "python", "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "-c", unpacked / "constraints.txt"]
    installed = subprocess.run([*pip, sdist, "pytest", "pytest-xdist"], env=clean, capture_output=True, text=True, check=False)
    assert installed.returncode == 0, installed.stderr[-3000:]
    yield place / "bin", unpacked
    shutil.rmtree(place)


@pytest.mark.parametrize("environment", SUPPORTED, indirect=True)
def test_what_the_archive_installs_runs_and_passes_its_tests(environment: tuple[Path, Path], tmp_path: Path) -> None:
    scripts, unpacked = environment
    work = tmp_path / "work"
    work.mkdir()

    def call(*command: str | Path, cwd: Path = work) -> str:
        clean = {"PATH": os.pathsep.join((str(scripts), os.environ["PATH"])), "HOME": str(tmp_path)}
        done = subprocess.run(command, cwd=cwd, env=clean, capture_output=True, text=True, timeout=900, check=False)
        assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
        return done.stdout

    where = Path(call(scripts / "python", "-c", "import radartwin; print(radartwin.__file__)").strip())
    assert where.is_relative_to(scripts.parent)
    call(scripts / "radartwin", "doctor")
    call(scripts / "radartwin", "simulate", "scene=plate", "trajectory=static", "--out", "tiny")
    call(scripts / "radartwin", "process", "tiny")
    assert (work / "outputs" / "processed" / "tiny" / "peaks.csv").is_file()
    said = call(scripts / "pytest", "-q", *SAMPLE, cwd=unpacked)
    assert " passed" in said
    assert "failed" not in said
