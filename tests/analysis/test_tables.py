"""A results table is written with the same rows in four file formats, and its rows are checked before any file is written."""

from __future__ import annotations

import csv
import io
from pathlib import Path
from typing import Any

import pytest

from analysis import main, registry, table_runs, tables
from experiments import verdicts
from radartwin.config.study import TrackingConfig
from radartwin.errors import ConfigError, InputError, MissingError
from radartwin.runs.experiment import Result, Table, check_rows
from radartwin.runs.tracking import Tracker

SCORE = ["metric", "paper", "value", "low", "high", "n", "domain", "verdict"]
TABLE = Table("environment", "The room & the signal", "Correlation at 50 % of_all.")


def row(**changes: Any) -> dict[str, Any]:
    given = {
        "metric": "r | z", "paper": "-0.24 to +0.42", "value": 1 / 3, "low": 0.25, "high": 0.5, "n": 3,
        "domain": "testbed", "verdict": "supported", "distance_m": 2.0, "run_keys": "abc def",
    }  # fmt: skip
    return {**given, **changes}


UNTESTABLE = row(value=None, low=None, high=None, n=0, verdict="undecided")


def test_csv_has_case_keys_and_score_in_full_precision() -> None:
    known, absent = csv.DictReader(io.StringIO(tables.to_csv([row(), UNTESTABLE])))
    assert list(known) == ["distance_m", "run_keys", *SCORE]
    assert float(known["value"]) == 1 / 3
    assert known["run_keys"] == "abc def"
    assert absent["value"] == ""


@pytest.mark.parametrize(("word", "changes", "expected"), [
    ("supported", {"direction": "above", "bound": 0.2, "null": 0.0}, "The whole interval is above 0.2."),
    ("direction shown", {"direction": "above", "bound": 0.3, "null": 0.0}, "The whole interval is above 0, but not above 0.3."),
    ("contradicted", {"direction": "above", "bound": 0.6, "null": 0.6}, "The whole interval is below 0.6."),
    ("contradicted", {"direction": "below", "bound": 0.1, "null": 0.1}, "The whole interval is above 0.1."),
    ("undecided", {"direction": "above", "bound": 0.4, "null": 0.4}, "The interval contains 0.4."),
    ("undecided", {"direction": "above", "bound": 0.4, "null": 0.3}, "The interval reaches from 0.3 or less to 0.4 or more."),
    ("undecided", {"direction": "below", "bound": 0.3, "null": 0.4}, "The interval reaches from 0.3 or less to 0.4 or more."),
    ("undecided", {"direction": "none", "null": 0.0, "margin": 0.3}, "Only a part of the interval is within −0.3 to 0.3."),
    ("supported", {"direction": "none", "null": 0.5, "margin": 0.3}, "The whole interval is within 0.2 to 0.8."),
    ("contradicted", {"direction": "none", "null": 0.0, "margin": 0.1}, "No part of the interval is within −0.1 to 0.1."),
    ("undecided", {"direction": "above", "bound": 0.0, "value": None}, "There is no value."),
    ("undecided", {"direction": "above", "bound": 0.0, "low": None, "high": None}, "There are too few samples for an interval."),
    ("not testable here", {"direction": "above", "bound": 0.0, "reason": "no clutter"}, "No clutter."),
    ("misses", {"direction": "below", "bound": 0.1}, "It is not wholly below the limit 0.1."),
    ("holds", {"limit": "<= 1"}, "The limit is <= 1."),
    ("misses", {}, "The claim states the limit."),
    ("", {}, ""),
])  # fmt: skip
def test_why_names_the_bound_that_decides(word: str, changes: dict[str, Any], expected: str) -> None:
    given = {"null": None, "margin": None, "bound": None, **changes}
    assert tables.why(row(verdict=word, **given)) == expected
    if given.get("direction") and word not in ("misses", "not testable here"):
        numbers = {name: row(**given)[name] for name in ("value", "low", "high", "bound", "direction", "null", "margin")}
        assert verdicts.judge(**numbers) == word, "the example has this verdict"


def test_latex_escapes_its_special_characters_and_has_commands_for_symbols() -> None:
    text = tables.to_latex(TABLE, [row(metric="ρ ≥ 0.5 ± 3 µm² at λ/2, 45° → −1–2 × ε")])
    assert r"The room \& the signal" in text
    assert r"50 \% of\_all" in text
    assert text.count(r"\toprule") == text.count(r"\bottomrule") == 1
    assert text.count("{") == text.count("}")
    assert text.isascii()
    assert r"$\rho$ $\geq$ 0.5 $\pm$ 3 $\mu$m$^2$" in text


def test_every_experiment_module_declares_a_table_that_latex_can_typeset() -> None:
    for name in registry.NAMES:
        table = registry.table(name)
        assert table.name == name
        assert table.title
        assert tables.to_latex(table, [row()]).isascii()


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"verdict": "maybe"}, "maybe"),
        ({"low": 0.4}, "outside its interval"),
        ({"high": 0.3}, "outside its interval"),
        ({"n": 2.5}, "2.5"),
        ({"value": None}, "the value is missing; give a value"),
    ],
)
def test_invalid_row_is_refused_before_anything_is_written(changes: dict[str, Any], word: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=word):
        tables.write(TABLE, [row(), row(**changes)], tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_row_without_a_score_column_is_refused() -> None:
    with pytest.raises(InputError, match="verdict"):
        check_rows("t", [{k: v for k, v in row().items() if k != "verdict"}])


def test_caption_notes_a_testbed_score_and_the_draws_of_new_rows_and_of_rows_read_from_csv() -> None:
    assert "not a measurement of reality" in tables.full_caption(TABLE, [row()])
    assert tables.full_caption(TABLE, [row(domain="recordings")]) == tables.caption(TABLE, [row()]) == TABLE.caption
    for draws in (3, "3"):
        assert "means over 3 draws" in tables.caption(TABLE, [row(draws=draws), row(draws="")])


@pytest.mark.filterwarnings("ignore:The .*noload.* loader strategy")
def test_a_table_is_unchanged_until_profile_files_or_its_tracked_run_change(tmp_path: Path) -> None:
    result = Result("environment", [row()], {}, run_key="a" * 32)
    main.write(TABLE, result, "quick", tmp_path)
    assert not table_runs.unchanged(tmp_path, "environment", "quick"), "no tracking store holds the run"
    with Tracker(TrackingConfig(), tmp_path).run("environment", "a" * 32, "environment", {}):
        pass
    assert table_runs.unchanged(tmp_path, "environment", "quick")
    assert not table_runs.unchanged(tmp_path, "environment", "paper")
    (tmp_path / "tables" / "environment.csv").write_text("touched")
    assert not table_runs.unchanged(tmp_path, "environment", "quick")
    main.write(TABLE, result, "quick", tmp_path)
    table_runs.add_failure(tmp_path, "environment", "b" * 32, "quick", ValueError("no"))
    assert not table_runs.unchanged(tmp_path, "environment", "quick")
    main.write(TABLE, result, "quick", tmp_path)
    (tmp_path / "tables" / "environment.tex").unlink()
    assert not table_runs.unchanged(tmp_path, "environment", "quick")


ENTRY = '{{"environment": {{"run_key": "0", "profile": "quick", "figures": [{}]}}}}'
NO_FILE_NAMES = ("../secret", "/etc/passwd", ".hidden", "a\\\\b", "")


@pytest.mark.parametrize(
    "text",
    ["{", "[]", "5", '{"environment": 5}', '{"environment": {}}', ENTRY.format(1), *(ENTRY.format(f'"{name}"') for name in NO_FILE_NAMES)],
)
def test_damaged_index_is_named_before_any_work(text: str, tmp_path: Path) -> None:
    (tmp_path / "tables").mkdir()
    (tmp_path / "tables" / "index.json").write_text(text)
    for verb in (lambda: main.report_verb(tmp_path), lambda: main.tables("quick", None, tmp_path)):
        with pytest.raises(InputError, match=r"index\.json is damaged"):
            verb()


def test_missing_table_file_is_named(tmp_path: Path) -> None:
    (tmp_path / "tables").mkdir()
    (tmp_path / "tables" / "index.json").write_text(ENTRY.format(""))
    with pytest.raises(MissingError, match=r"environment\.csv is missing .*--only environment"):
        main.write_report(tmp_path, current=lambda name, profile, output: "0")


def test_unknown_table_and_empty_report_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="nonsense"):
        registry.check(["nonsense"])
    with pytest.raises(MissingError, match="radartwin tables"):
        main.write_report(tmp_path)
