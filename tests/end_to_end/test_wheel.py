"""The wheel alone, in an environment without the checkout, simulates and processes."""

from __future__ import annotations

import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import pytest
from building import ROOT, build


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build("wheel", tmp_path_factory.mktemp("wheel"))


@pytest.fixture(scope="module")
def environment(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Create a virtual environment with the wheel. It uses the dependencies of this environment, but not the checkout."""
    folder = tmp_path_factory.mktemp("environment")
    venv.create(folder, with_pip=False, symlinks=True)
    packages = next(folder.glob("lib/python*/site-packages"))
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "install", "--quiet", "--no-deps", "--no-index"]
    subprocess.run([*pip, "--target", str(packages), str(wheel)], check=True, capture_output=True)
    # A .pth line adds this environment's packages, and not the .pth files in them: the editable install stays behind.
    (packages / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    return folder


def call(environment: Path, folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [str(environment / "bin" / "python"), "-m", "radartwin", *arguments]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120, check=False, env={"PATH": ""})


def test_the_wheel_holds_library_and_configuration_and_no_study(wheel: Path) -> None:
    names = zipfile.ZipFile(wheel).namelist()
    assert "radartwin/conf/config.yaml" in names
    assert "radartwin/conf/scene/plate.yaml" in names
    shipped = {path.relative_to(ROOT).as_posix() for path in (ROOT / "conf").rglob("*.yaml")}
    assert {name.removeprefix("radartwin/") for name in names if name.startswith("radartwin/conf/")} == shipped
    assert {name.partition("/")[0] for name in names if not name.startswith("radartwin-")} == {"radartwin"}


def test_the_installed_wheel_runs_without_the_checkout(environment: Path, tmp_path: Path) -> None:
    where = subprocess.run(
        [str(environment / "bin" / "python"), "-c", "import radartwin; print(radartwin.__file__)"],
        cwd=tmp_path, capture_output=True, text=True, check=True, env={"PATH": ""},
    ).stdout  # fmt: skip
    assert where.startswith(str(environment))
    assert call(environment, tmp_path, "--help").returncode == 0
    doctor = call(environment, tmp_path, "doctor")
    assert doctor.returncode == 0, doctor.stdout + doctor.stderr
    simulated = call(environment, tmp_path, "simulate", "scene=plate", "trajectory=static", "--out", "tiny")
    assert simulated.returncode == 0, simulated.stderr
    processed = call(environment, tmp_path, "process", "tiny")
    assert processed.returncode == 0, processed.stderr
    assert (tmp_path / "outputs" / "processed" / "tiny" / "peaks.csv").is_file()


def test_without_the_study_tables_say_where_to_find_it(environment: Path, tmp_path: Path) -> None:
    done = call(environment, tmp_path, "tables")
    assert done.returncode == 2
    assert "checkout" in done.stderr
    assert len(done.stderr.splitlines()) == 1
