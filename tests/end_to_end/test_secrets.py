"""Keys and passwords of the environment appear in no log, run key, artifact or database."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import own_experiment
import pytest

SECRET = "s3cr3t-w0rd-of-the-test"


def radartwin(arguments: list[str], environment: dict[str, str], output: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "radartwin", *arguments, "--output", str(output)]
    return subprocess.run(command, env={**os.environ, **environment}, capture_output=True, text=True, timeout=300, check=False)


def test_a_sweep_writes_no_secret_of_the_environment(tmp_path: Path) -> None:
    arguments, own = own_experiment.write(tmp_path / "mine")
    (tmp_path / "mine" / "BREAK_1").touch()
    keys = {"RADARTWIN_VLM_KEY": SECRET, "MLFLOW_TRACKING_USERNAME": SECRET, "MLFLOW_TRACKING_PASSWORD": SECRET}
    done = radartwin([*arguments, "-m", "seed=0,1"], {**own, **keys}, tmp_path / "out")
    assert "sweep: 1 done, 0 cached, 1 failed" in done.stdout, done.stderr
    assert SECRET not in done.stdout + done.stderr
    written = [path for path in (tmp_path / "out").rglob("*") if path.is_file()]
    assert len(written) > 8, "a database, a result, logs"
    assert [path for path in written if SECRET.encode() in path.read_bytes()] == []


@pytest.mark.parametrize(
    "override",
    [
        f"tracking.uri=http://me:{SECRET}@127.0.0.1:9",
        f"materials.url=https://{SECRET}@127.0.0.1:9/v1",
        f"scene.llm_url=http://me:{SECRET}@127.0.0.1:9",
    ],
)
def test_an_address_with_a_password_is_refused_and_not_printed(override: str, tmp_path: Path) -> None:
    more = ["materials=vlm"] if override.startswith("materials") else []
    done = radartwin(["run", "experiment=environment", *more, override], {}, tmp_path / "out")
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
    assert "carries a name or password" in done.stderr
    assert SECRET not in done.stdout + done.stderr
    assert not (tmp_path / "out").exists()
