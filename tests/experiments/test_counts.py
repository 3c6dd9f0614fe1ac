"""The tests count how many stored results are simulated, reused and scored after a configuration change."""

from __future__ import annotations

from pathlib import Path

import pytest

from radartwin.config.compose import compose
from radartwin.runs.run import run_experiment, run_key
from radartwin.store.products import Counts

TINY = [
    "experiment=environment", "materials=uniform", "jobs=1", "tracking=off",
    "measured.gap.solver=0", "measured.gap.clutter=0", "measured.gap.geometry=0",
    "experiment.distances_m=[1.0]", "profile.campaign.turntable_objects=[corner_reflector]", "profile.campaign.reflector_distances_m=[1.0]",
    "profile.campaign.frames_per_turn=4", "profile.campaign.turns=1", "profile.campaign.draws=1", "profile.campaign.reflector_repeats=1",
    "profile.campaign.rail_objects=[]", "profile.campaign.rover_rooms=[]",
]  # fmt: skip


@pytest.fixture(scope="module")
def counted(tmp_path_factory: pytest.TempPathFactory):
    """Return a function that runs an experiment with overrides in one output folder, and returns the run key and the counts of stored
    results.
    """
    folder = tmp_path_factory.mktemp("counts")

    def run(*more: str, into: Path = folder) -> tuple[str, Counts]:
        result, counts = run_experiment(compose([*TINY, f"output={into}", *more]))
        return result.run_key, counts

    first, counts = run()
    # the scan, and the noise-free and the processed recordings of measurement, simulated room, and simulation without a room
    assert counts.by_kind["clean built"] == 3
    assert counts.by_kind["processed built"] == 3
    assert (counts.reused, counts.scored) == (counts.by_kind["scan reused"], 1)
    run.first = first  # pyright: ignore[reportFunctionMemberAccess]
    return run


@pytest.mark.parametrize("more", [["jobs=2"], ["hydra/launcher=joblib"]])
def test_settings_without_influence_on_results_recompute_nothing(counted, more: list[str]) -> None:
    key, counts = counted(*more)
    assert key == counted.first
    assert (counts.simulated, counts.reused, counts.scored) == (0, 1, 0)


def test_another_output_folder_has_the_same_key(counted, tmp_path: Path) -> None:
    assert run_key(compose([*TINY, f"output={tmp_path}"])) == counted.first


def test_another_material_simulates_only_the_twins_room_again(counted) -> None:
    key, counts = counted("materials.material=concrete")
    assert key != counted.first
    assert (counts.by_kind["clean built"], counts.by_kind["clean reused"]) == (1, 2)
    assert (counts.by_kind["processed built"], counts.by_kind["processed reused"]) == (1, 2)
    assert counts.by_kind["scan built"] == 0
    assert counts.scored == 1


def test_stronger_hardware_processes_the_same_recordings_again(counted) -> None:
    _, counts = counted("measured.gap.hardware=2")
    assert counts.by_kind["clean built"] == 0
    assert (counts.by_kind["processed built"], counts.by_kind["processed reused"]) == (1, 2)


def test_another_bounce_simulates_the_twin_but_not_the_testbed(counted) -> None:
    _, counts = counted("simulator.max_bounces=2")
    assert (counts.by_kind["clean built"], counts.by_kind["clean reused"]) == (2, 1)


def test_more_resamples_score_stored_recordings(counted) -> None:
    _, counts = counted("profile.resamples=50")
    assert (counts.simulated, counts.scored) == (0, 1)
    assert counts.by_kind["processed reused"] == 3
