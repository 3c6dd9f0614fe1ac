"""Build the sensitivity table from constructed simulations: feature errors in standard deviations, and run times without set-up times."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import pandas as pd
import pytest
from fake_campaign import FakeCampaign

from experiments.campaign import frame
from experiments.complexity import sensitivity
from experiments.complexity.sensitivity import COST, DEFAULT, ERROR, FINEST, SETUP, Twin, feature_error, table
from radartwin.config.compose import compose
from radartwin.io.progress import Progress
from radartwin.runs.experiment import check_rows

CONFIG = compose(["experiment=sensitivity", "profile.resamples=50"])
RNG = np.random.default_rng(0)
VALUES = RNG.standard_normal((6, 4)) * [1.0, 10.0, 0.1, 0.0]  # the last feature is constant, so that it carries no information


def twin(shift: float, frame_s: float, figure: float | None) -> Twin:
    setups = np.array([1, 0, 0, 0, 0, 0])
    seconds = np.full(6, frame_s) + setups * 30.0 / 36
    moved = VALUES + shift * VALUES.std(axis=0)
    figures = {} if figure is None else {("linear_rail", "error_m"): (figure, ["rail0", "rail1"])}
    columns = {"motion": "turntable", "key": [f"k{n}" for n in range(6)], "features": list(moved), "frame_s": seconds}
    return Twin(pd.DataFrame(columns | {"setups": setups, "frames": 36}), figures)


def cell(rows: Iterable[Mapping[str, Any]], setting: str, metric: str) -> Mapping[str, Any]:
    (row,) = [row for row in rows if (row["setting"], row["metric"]) == (setting, metric)]
    return row


def test_error_is_in_standard_deviations_and_run_time_excludes_set_ups() -> None:
    rows = table(CONFIG, {FINEST: twin(0.0, 0.8, 0.01), DEFAULT: twin(0.5, 0.2, 0.02), "no room": twin(1.0, 0.1, 0.05)})
    check_rows("sensitivity", rows)
    assert cell(rows, FINEST, ERROR)["value"] == 0.0
    assert cell(rows, DEFAULT, ERROR)["value"] == pytest.approx(0.5)
    assert cell(rows, "no room", ERROR)["value"] == pytest.approx(1.0)
    assert cell(rows, DEFAULT, COST)["value"] == pytest.approx(200.0)
    assert cell(rows, DEFAULT, SETUP)["value"] == pytest.approx(30.0)
    assert cell(rows, DEFAULT, SETUP)["n"] == 1
    rail = cell(rows, "no room", "error_m")
    assert (rail["value"], rail["change"], rail["n"], rail["run_keys"]) == (0.05, pytest.approx(0.03), 2, "rail0 rail1")


def test_random_recordings_differ_by_the_root_of_two() -> None:
    recordings = RNG.standard_normal((2000, 5))
    assert np.sqrt((feature_error(recordings[RNG.permutation(2000)], recordings) ** 2).mean()) == pytest.approx(np.sqrt(2), abs=0.06)


def test_fidelity_tables_are_read_from_frames_and_those_without_recordings_are_left_out(monkeypatch) -> None:
    monkeypatch.setattr(sensitivity, "stored", frame.read)
    campaign: Any = FakeCampaign(distances=(0.5, 1.0, 1.5, 2.0), repetitions=1, frames=16)
    results = dict(sensitivity.fidelity(campaign, CONFIG, Progress(quiet=True)))
    assert {table for table, _ in results} == {
        "turntable_shape", "turntable_material", "turntable_size", "environment", "corner_reflector_calibration",
    }  # fmt: skip
    assert all(np.isfinite(value) and keys for value, keys in results.values())
