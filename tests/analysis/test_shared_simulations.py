"""Before the tables are computed, the recordings of all tables are simulated together. Tables that measure run times are computed last."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from analysis import main
from experiments import shared_simulations
from experiments.campaign.campaign import Campaign, joined
from experiments.campaign.schedule import RecordingTask
from experiments.recognition import copies
from radartwin.config.compose import compose, path_override
from radartwin.config.config import Config
from radartwin.io.progress import Progress
from radartwin.runs import workers
from radartwin.runs.experiment import load
from radartwin.store.products import Store

FEW = ("profile.campaign.turntable_objects=[mug,mustard,corner_reflector]", "profile.campaign.rover_objects=[mug,mustard]")
TABLES = ("campaign", "environment", "linear_rail", "labelled_probe", "material_errors", "complexity")


def config_of(name: str, output: Path, *overrides: str) -> Config:
    return compose([f"experiment={name}", "profile=quick", *FEW, *overrides, path_override("output", output)])


def test_recordings_of_all_tables_are_simulated_together(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    given: dict[str, Any] = {}

    def keep(missing: Any, jobs: int, progress: Progress, calls: Any) -> None:
        given.update(missing=missing, calls=calls)

    monkeypatch.setattr(shared_simulations, "make_together", keep)
    shared_simulations.simulate([config_of(name, tmp_path) for name in TABLES], Progress(quiet=True))
    for name in ("turntable_shape", "linear_rail", "rover_fidelity", "labelled_probe", "material_errors"):
        campaign = Campaign(config_of(name, tmp_path), Store(tmp_path / "cache"), Progress(quiet=True))
        assert campaign.missing(campaign.plan()).keys() <= given["missing"].keys()
    assert {task.domain for task in given["missing"].values()} == {"measured", "twin", "void"}
    targets = [call for call in given["calls"] if call[0] is copies.simulate_targets]
    assert len(targets) == 2 * 3, "the drawn targets of three objects for both simulators"
    assert [case.room for function, case, *_ in given["calls"] if function is not copies.simulate_targets] == ["lab"], "of complexity"


def planned(name: str, output: Path, *overrides: str) -> dict[str, RecordingTask]:
    config = config_of(name, output, "profile.campaign.draws=2", *overrides)
    return load(config.experiment).recordings(config, Store(output / "cache"), Progress(quiet=True))


def test_recordings_beside_the_configured_ones_are_planned(tmp_path: Path) -> None:
    usual = planned("turntable_material", tmp_path)
    beside = planned("turntable_material", tmp_path, "profile.unknown_contents=true")
    assert {(task.domain, task.config.contents) for key, task in beside.items() if key not in usual} == {("twin", "unknown")}
    usual = planned("rover_recognition", tmp_path)
    exact = planned("rover_recognition", tmp_path, "profile.exact_objects=true")
    added = [task for key, task in exact.items() if key not in usual]
    assert {(task.domain, task.case.draw, task.case.object) for task in added} == {("measured", 0, "mug"), ("measured", 0, "mustard")}
    assert len(added) == len([task for task in usual.values() if task.domain == "measured"])
    layout = planned("labelled_probe", tmp_path, "profile.layout_turns=3").values()
    assert {task.case.draw for task in layout if task.config.profile.campaign.turns == 3} == {0}


def test_a_recording_that_two_tables_read_is_processed_if_one_of_them_reads_it_processed() -> None:
    task = RecordingTask(compose(["profile=quick"]), Path("cache"), "twin", object())  # type: ignore[arg-type]
    clean = RecordingTask(task.config, task.root, task.domain, task.case, clean=True)
    assert not joined([{"key": clean}, {"key": task}])["key"].clean
    assert not joined([{"key": task}, {"key": clean}])["key"].clean
    assert joined([{"key": clean}, {"key": clean}])["key"].clean


@pytest.mark.parametrize("count", [1, 2])
def test_recordings_come_first_and_run_times_last(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, count: int) -> None:
    done: list[str] = []

    def inline(function: Any, next_call: Any, on_result: Any, count: int) -> None:
        while (arguments := next_call(0)) is not None:
            on_result(function(*arguments))

    def made(config: Config, *_: Any) -> tuple[str, str | None]:
        name = config.experiment.name or ""
        done.append(name)
        return name, None if name == "labels" else name

    monkeypatch.setattr(workers, "worker_count", lambda jobs, items: count)
    monkeypatch.setattr(workers, "run", inline)
    monkeypatch.setattr(shared_simulations, "simulate", lambda configs, progress: done.append("simulated"))
    monkeypatch.setattr(main, "_made", made)
    succeeded, _ = main._run(["speed_accuracy", "labels", "complexity", "positioning"], "quick", tmp_path)
    assert done == ["simulated", "labels", "positioning", "speed_accuracy", "complexity"]
    assert succeeded == ["positioning", "speed_accuracy", "complexity"], "labels failed"
