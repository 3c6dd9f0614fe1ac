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
    """Return a function that runs an experiment with overrides in one output folder: run key and counts of stored results."""
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


def test_settings_without_influence_on_results_recompute_nothing(counted, tmp_path: Path) -> None:
    key, counts = counted("jobs=2")
    assert (counts.simulated, counts.reused, counts.scored) == (0, 1, 0)
    others = [run_key(compose([*TINY, f"output={tmp_path}", override])) for override in ("jobs=1", "hydra/launcher=joblib")]
    assert [key, *others] == [counted.first] * 3


@pytest.mark.parametrize(
    ("override", "expected"),
    [
        (
            "materials.material=concrete",
            {"scan built": 0, "clean built": 1, "clean reused": 2, "processed built": 1, "processed reused": 2},
        ),
        ("measured.gap.hardware=2", {"clean built": 0, "processed built": 1, "processed reused": 2}),
        ("simulator.max_bounces=2", {"clean built": 2, "clean reused": 1}),
        ("profile.resamples=50", {"clean built": 0, "processed built": 0, "processed reused": 3}),
    ],
)
def test_a_setting_simulates_and_processes_only_what_it_changes(counted, override: str, expected: dict[str, int]) -> None:
    """Another material changes the twin's room, hardware the processing of the measurement, and bounces both simulations."""
    key, counts = counted(override)
    assert key != counted.first
    assert {kind: counts.by_kind[kind] for kind in expected} == expected
    assert counts.scored == 1
