"""Test the table `reality`: the dihedrals against measured levels, captures and scan against their descriptions, and absent data."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from experiments.validation import reality
from experiments.validation.oracles.case import REFERENCE
from radartwin.config.compose import compose
from radartwin.runs.experiment import check_rows

CONFIG = compose(["experiment=reality"])


def rows(measurement: reality.Measurement) -> list[dict]:
    compare = dict(reality.COMPARISONS)[measurement]
    table = reality.rows_of(measurement, compare, CONFIG)
    check_rows("reality", table)
    return table


def test_simulated_dihedrals_match_the_measured_levels_like_physical_optics() -> None:
    by_method = {(row["method"], row["metric"].partition(":")[0]): row for row in rows(reality.DIHEDRALS)}
    for method in ("simulator", "physical optics"):
        for size in ("5 cm", "10 cm"):
            assert by_method[method, size]["value"] < 1.1, "the source gives 0.6 to 1.1 dB for physical optics"
        assert by_method[method, "both sizes, one offset"]["value"] == pytest.approx(2.1, abs=0.2)
        assert by_method[method, "both sizes, one offset"]["n"] == 68
    assert by_method["far field", "10 cm"]["value"] > 3.4, "the levels tell the near field from the far field"
    assert by_method["far field", "10 cm"]["verdict"] == ""


def test_shipped_levels_are_those_of_the_reference() -> None:
    reference = REFERENCE / "measured_dihedral_77ghz.csv"
    if not reference.is_file():
        pytest.skip("the folder shared/reference is not beside the checkout")
    assert reality.MEASURED.read_bytes() == reference.read_bytes()


def test_captures_agree_with_their_descriptions(shared_data: Path) -> None:
    for measurement in (reality.CAPTURE_WALK, reality.CAPTURE_ROOM):
        assert {row["verdict"] for row in rows(measurement)} == {"holds"}


@pytest.mark.slow
def test_reconstructed_chair_is_near_the_mesh_of_the_vendor(shared_data: Path) -> None:
    by_metric = {row["metric"]: row for row in rows(reality.SCAN)}
    assert by_metric["Chamfer distance, mean of both directions (mm)"]["value"] < 30
    assert by_metric["scale error (1)"]["verdict"] == "holds"
    assert by_metric["ours to vendor's: median (mm)"]["verdict"] == "holds"
    assert {row["n"] for row in by_metric.values()} == {24}


def test_absent_data_give_one_row_without_a_verdict_and_another_key(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = reality.identity()
    absent = tuple((replace(m, path=tmp_path / "radar" / m.path.name), compare) for m, compare in reality.COMPARISONS[1:])
    monkeypatch.setattr(reality, "COMPARISONS", (reality.COMPARISONS[0], *absent))
    for measurement, compare in absent:
        (row,) = reality.rows_of(measurement, compare, CONFIG)
        assert row["verdict"] == ""
        assert row["note"] == f"not available: radar/{measurement.path.name} is not in ../shared/data"
        assert row["value"] is None
    (tmp_path / "radar" / reality.ROOM.name).mkdir(parents=True)
    assert reality.identity() != before


def test_scale_between_meshes_is_found() -> None:
    box = trimesh.creation.box((1.0, 0.8, 0.6)).subdivide()
    larger = box.copy().apply_scale(1.02)
    assert reality.fitted_scale(box, larger) == pytest.approx(1.02, abs=1e-3)
    assert np.isclose(reality.fitted_scale(larger, box), 1 / 1.02, atol=1e-3)
