"""`radartwin run --search` finds the best setting of a known function, resumes, and refuses wrong input in one line."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import own_experiment
import pytest

from radartwin.errors import ConfigError
from radartwin.runs.search import space

SEARCH = ["--search", "peak", "trajectory.height_m=interval(0.5,2.0)"]


def radartwin(arguments: list[str], environment: dict[str, str], output: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "radartwin", *arguments, "--output", str(output), "tracking=off"]
    return subprocess.run(command, env={**os.environ, **environment}, capture_output=True, text=True, timeout=300, check=False)


@pytest.mark.slow
def test_a_search_comes_close_to_the_known_optimum_and_resumes(tmp_path: Path) -> None:
    arguments, own = own_experiment.write(tmp_path / "mine")
    first = radartwin([*arguments, *SEARCH, "--trials", "5"], own, tmp_path / "out")
    assert "sweep: 5 done" in first.stdout, first.stderr
    second = radartwin([*arguments, *SEARCH, "--trials", "25"], own, tmp_path / "out")
    assert "sweep: 20 done" in second.stdout, second.stderr
    last = second.stdout.splitlines()[-1]
    assert last.startswith("search: 25 trials in ")
    best = float(last.partition("trajectory.height_m=")[2].partition(",")[0])
    assert best == pytest.approx(1.2, abs=0.1), "the metric is -(height - 1.2 m)^2"
    third = radartwin([*arguments, *SEARCH, "--trials", "25"], own, tmp_path / "out")
    assert third.stdout.splitlines()[-1] == last, "a finished search was taken up again"


@pytest.mark.parametrize(
    ("arguments", "word"),
    [
        (["--search", "peak", "seed=1"], "interval"),
        (["--search", "peak", "trajectory.heigth_m=interval(1,2)"], "did you mean height_m"),
        (["--search", "peek", "--trials", "1", "trajectory.height_m=interval(1,2)"], "it has correlation, peak"),
        (["--search", "peak", "--trials", "0", "trajectory.height_m=interval(1,2)"], "--trials 0"),
    ],
)
def test_an_impossible_search_prints_one_line(tmp_path: Path, arguments: list[str], word: str) -> None:
    run, own = own_experiment.write(tmp_path / "mine")
    done = radartwin([*run, *arguments], own, tmp_path / "out")
    assert done.returncode == 2
    assert done.stderr.splitlines()[-1].startswith("radartwin: ")
    assert word in done.stderr
    assert "Traceback" not in done.stderr


def test_overrides_define_the_search_space() -> None:
    searched: dict[str, Any]
    fixed, searched = space(["seed=3", "materials=vlm,void", "a.b=interval(1,2)", "c.d=tag(log,interval(0.1,10))", "e.f=range(1,4)"])
    assert fixed == ["seed=3"]
    assert searched["materials"].choices == ("vlm", "void")
    assert (searched["a.b"].low, searched["a.b"].high, searched["a.b"].log) == (1, 2, False)
    assert searched["c.d"].log
    assert searched["e.f"].choices == ("1", "2", "3")
    for wrong, word in (("tag(log,interval(0,10))", "above zero"), ("interval(2,1)", "smaller to a larger"), ("interval(1", "cannot read")):
        with pytest.raises(ConfigError, match=word):
            space([f"c.d={wrong}"])
