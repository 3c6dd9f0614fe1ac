"""The command line prints help, runs doctor, and turns a scene into a processed recording."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

Command = Callable[..., subprocess.CompletedProcess[str]]
HEAVY = ("hydra", "omegaconf", "mlflow", "mitsuba", "drjit", "numpy", "scipy", "trimesh", "matplotlib", "pandas", "plotly")
ROOT = Path(__file__).resolve().parents[2]


def test_help_takes_less_than_half_a_second(radartwin: Command) -> None:
    radartwin("--help")  # the first start compiles the modules
    best = min(_timed(radartwin) for _ in range(3))
    assert best < 0.5


def _timed(radartwin: Command) -> float:
    started = time.perf_counter()
    assert radartwin("--help").returncode == 0
    return time.perf_counter() - started


def test_package_and_command_line_import_no_heavy_library() -> None:
    code = f"import sys, radartwin, radartwin.cli, radartwin.errors; print([m for m in {HEAVY} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


def test_overrides_are_accepted_on_both_sides_of_an_option(radartwin: Command) -> None:
    done = radartwin("run", "experiment=environment", "-m", "materials=cheese")
    assert "materials=cheese is not an option" in done.stderr
    unknown = radartwin("run", "experiment=environment", "--unknown")
    assert unknown.returncode == 2
    assert "--unknown" in unknown.stderr


def test_help_of_run_lists_the_experiments(radartwin: Command) -> None:
    listed = radartwin("run", "--help").stdout.split("Experiments:")[1]
    for file in (ROOT / "conf" / "experiment").glob("*.yaml"):
        assert file.stem in listed


def test_doctor_refuses_a_file_as_output(radartwin: Command, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    done = radartwin("doctor", "--output", "file")
    assert done.returncode == 2
    assert "is not a folder" in done.stdout
    assert "mlflow.db" not in done.stdout


def test_doctor_finds_this_machine_usable(radartwin: Command) -> None:
    done = radartwin("doctor")
    assert done.returncode == 0, done.stdout
    for word in ("python", "mitsuba 3.9.1", "llvm", "variant", "disk", "tracking", "doctor: usable"):
        assert word in done.stdout


@pytest.mark.parametrize("arguments", [["doctor"], ["simulate", "scene=plate", "trajectory=static"]])
def test_old_llvm_is_named_with_the_remedy(tmp_path: Path, arguments: list[str]) -> None:
    old = tmp_path / "libLLVM-14.so"
    old.write_bytes(b"")
    command = [sys.executable, "-m", "radartwin", *arguments]
    # An empty PATH hides the driver of a GPU.
    environment = {"DRJIT_LIBLLVM_PATH": str(old), "PATH": "", "PYTHONPATH": str(Path(__file__).parents[2])}
    done = subprocess.run(command, env=environment, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    printed = done.stdout + done.stderr
    assert str(old) in printed
    assert "libllvm19" in printed
    assert "Traceback" not in printed
    assert [p.name for p in tmp_path.iterdir()] == [old.name], "a partial file was written"


def test_plate_is_found_at_its_distance(radartwin: Command, tmp_path: Path) -> None:
    simulated = radartwin("simulate", "scene=plate", "trajectory=static", "trajectory.distance_m=1.5")
    assert simulated.returncode == 0, simulated.stderr
    recording = tmp_path / "outputs" / "recordings" / "plate"
    processed = radartwin("process", recording)
    assert processed.returncode == 0, processed.stderr
    folder = tmp_path / "outputs" / "processed" / "plate"
    assert {"peaks.csv", "range_time.png", "range_doppler.png", "range_azimuth.png"} == {p.name for p in folder.iterdir()}
    header, first = (folder / "peaks.csv").read_text().splitlines()[:2]
    assert header == "range_m,doppler_mps,azimuth_deg,power_db"
    distance, speed, azimuth, _ = (float(cell) for cell in first.split(","))
    assert distance == pytest.approx(1.5, abs=0.02), "half a range bin"
    assert speed == pytest.approx(0, abs=0.01)
    assert azimuth == pytest.approx(0, abs=1)
    assert processed.stdout.split()[:4] == header.split(",")
    assert float(processed.stdout.split()[4]) == pytest.approx(distance, abs=1e-3), "the printed table equals the file"
