"""`radartwin run --search` finds the highest value of a known function, resumes, and names an unknown metric."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import own_experiment
import pytest

from radartwin.errors import ConfigError
from radartwin.runs.optimise import space

INTERVAL = "trajectory.height_m=interval(0.5,2.0)"


@pytest.fixture
def own(here: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Return the arguments of a search over a user's experiment, whose metric is -(height - 1.2 m)^2."""
    arguments, environment = own_experiment.write(here / "mine")
    monkeypatch.setenv("OWN_EXPERIMENT", environment["OWN_EXPERIMENT"])
    return [*arguments, "tracking=off", "--search"]


@pytest.mark.slow
def test_a_search_comes_close_to_the_known_optimum_and_resumes(inside, own: list[str]) -> None:
    first = inside(*own, "peak", INTERVAL, "--trials", "5")
    assert "sweep: 5 done" in first.stdout, first.stderr
    second = inside(*own, "peak", INTERVAL, "--trials", "25")
    assert "sweep: 20 done" in second.stdout, second.stderr
    last = second.stdout.splitlines()[-1]
    assert last.startswith("search: 25 trials in ")
    best = float(last.partition("trajectory.height_m=")[2].partition(",")[0])
    assert best == pytest.approx(1.2, abs=0.1)
    third = inside(*own, "peak", INTERVAL, "--trials", "25")
    assert third.stdout.splitlines()[-1] == last, "a finished search was taken up again"


def test_an_unknown_metric_is_named_after_the_first_trial(inside, own: list[str]) -> None:
    done = inside(*own, "peek", INTERVAL, "--trials", "1")
    assert done.returncode == 2
    assert "it has correlation, peak" in done.stderr.splitlines()[-1]


def test_overrides_define_the_search_space() -> None:
    searched: dict[str, Any]
    fixed, searched = space(["seed=3", "materials=vlm,void", "a.b=interval(1,2)", "c.d=tag(log,interval(0.1,10))", "e.f=range(1,4)"])
    assert fixed == ["seed=3"]
    assert searched["materials"].choices == ("vlm", "void")
    assert (searched["a.b"].low, searched["a.b"].high, searched["a.b"].log) == (1, 2, False)
    assert searched["c.d"].log
    assert searched["e.f"].choices == ("1", "2", "3")
    mistakes = {"tag(log,interval(0,10))": "above zero", "interval(2,1)": "a smaller and a larger", "interval(1": "cannot read"}
    for wrong, word in mistakes.items():
        with pytest.raises(ConfigError, match=word):
            space([f"c.d={wrong}"])
