"""The command line starts fast, prints help, runs `radartwin doctor`, and computes a processed recording from a scene."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from radartwin.io.files import read_arrays

HEAVY = ("hydra", "omegaconf", "mlflow", "mitsuba", "drjit", "numpy", "scipy", "trimesh", "matplotlib", "pandas", "plotly")
ROOT = Path(__file__).resolve().parents[2]


def test_help_takes_less_than_half_a_second() -> None:
    """The test measures processor time, because other processes on the machine do not change it."""

    def seconds() -> float:
        before = os.times()
        subprocess.run([sys.executable, "-m", "radartwin", "--help"], capture_output=True, check=True)
        after = os.times()
        return after.children_user + after.children_system - before.children_user - before.children_system

    seconds()  # the first start compiles the modules
    assert min(seconds() for _ in range(3)) < 0.5


def test_package_and_command_line_import_no_heavy_library() -> None:
    code = f"import sys, radartwin, radartwin.cli, radartwin.errors; print([m for m in {HEAVY} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


def test_help_of_run_lists_the_experiments(inside) -> None:
    listed = inside("run", "--help").stdout.split("Experiments:")[1]
    for file in (ROOT / "conf" / "experiment").glob("*.yaml"):
        assert file.stem in listed


def test_doctor_refuses_a_file_as_output(inside, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    done = inside("doctor", "--output", "file")
    assert done.returncode == 2
    assert "is not a folder" in done.stdout
    assert "mlflow.db" not in done.stdout


def test_doctor_finds_this_machine_usable(inside) -> None:
    done = inside("doctor")
    assert done.returncode == 0, done.stdout
    for word in ("python", "mitsuba 3.9.1", "llvm", "variant", "disk", "tracking", "doctor: this machine can run simulations"):
        assert word in done.stdout


def test_doctor_names_an_old_llvm_with_the_remedy(inside, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    old = tmp_path / "libLLVM-14.so"
    old.write_bytes(b"")
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", str(old))
    monkeypatch.setenv("PATH", "")  # an empty PATH hides the driver program of a GPU
    done = inside("doctor")
    assert done.returncode == 2
    assert str(old) in done.stdout
    assert "libllvm19" in done.stdout


def test_a_closed_output_is_no_success() -> None:
    """The reader of the output, such as `head`, may end before the command has finished its work."""
    reader, writer = os.pipe()
    os.close(reader)
    command = [sys.executable, "-u", "-m", "radartwin", "doctor"]
    done = subprocess.run(command, stdout=writer, stderr=subprocess.PIPE, text=True, timeout=120, check=False)
    os.close(writer)
    assert done.returncode == 1
    assert done.stderr == "radartwin: the program that reads the output has closed the pipe, so the command stopped\n"


def test_plate_is_found_at_its_distance(inside, tmp_path: Path) -> None:
    simulated = inside("simulate", "scene=plate", "trajectory=static", "trajectory.distance_m=1.5")
    assert simulated.returncode == 0, simulated.stderr
    processed = inside("process", "outputs/recordings/plate")
    assert processed.returncode == 0, processed.stderr
    folder = tmp_path / "outputs" / "processed" / "plate"
    assert {"peaks.csv", "points.npz", "range_time.png", "range_doppler.png", "range_azimuth.png"} == {p.name for p in folder.iterdir()}
    header, first = (folder / "peaks.csv").read_text().splitlines()[:2]
    assert header == "range_m,doppler_mps,azimuth_deg,power_db"
    distance, speed, azimuth, _ = (float(cell) for cell in first.split(","))
    assert distance == pytest.approx(1.5, abs=0.02), "half a range bin"
    assert speed == pytest.approx(0, abs=0.01)
    assert azimuth == pytest.approx(0, abs=1)
    assert processed.stdout.split()[:4] == header.split(",")
    assert float(processed.stdout.split()[4]) == pytest.approx(distance, abs=1e-3), "the printed table equals the file"
    for angle in ("bartlett", "music"):
        assert inside("process", "outputs/recordings/plate", "--angle", angle, "--out", angle).returncode == 0
        stored = read_arrays(tmp_path / angle / "points.npz")
        x, y, z, velocity, intensity = stored["points"][stored["first"][0]]
        assert (x, y, z) == pytest.approx((1.5, 0.0, 0.0), abs=0.03)
        assert velocity == pytest.approx(0, abs=0.01)
        assert intensity > 30
        assert len(stored["first"]) == len(stored["time_s"]) + 1
    assert (tmp_path / "bartlett" / "peaks.csv").read_bytes() == (folder / "peaks.csv").read_bytes(), "bartlett is the default"
