"""Tests of the table of the paper's main claims: verdicts over strengths, scaled gaps, and rows that exist in every table."""

from __future__ import annotations

import dataclasses

import pytest
from fake_campaign import config
from scipy.stats import t

from experiments.gaps import headline
from experiments.gaps.headline import HEADLINES
from radartwin.config.config import Config
from radartwin.runs.experiment import Result, check_rows

COLUMNS = {"claim": "c", "paper": "0.5", "n": 3, "items": 3, "domain": "testbed", "run_keys": "", "reason": "", "draws": 3, "p": None,
           "bound": 0.5, "direction": "above", "null": 0.5, "margin": None, "level": 0.95, "family": "", "test": "Student's t",
           "unit": "draws", "freedom": 9.0, "interval_scale": "", "lowest": None, "highest": None}  # fmt: skip


@pytest.fixture(autouse=True)
def _cheap_run_keys(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the text of a configuration stand for its run key, which reads the source of every package."""
    monkeypatch.setattr(headline, "run_key", repr)


def made(settings: Config) -> Result:
    """Return a table with a row for each headline claim of the table; the verdict of all rows depends on the strength of the gaps."""
    rows = []
    for claim in HEADLINES:
        if claim.table == settings.experiment.name:
            holds = settings.measured.gap.person < 2.0 if settings.measured.provider == "testbed" else True  # type: ignore[attr-defined]
            value = 0.9 if holds else 0.3
            score = {"value": value, "low": value - 0.1, "high": value + 0.1, "verdict": "supported" if holds else "contradicted"}
            rows.append({**claim.where, "metric": claim.metric, **COLUMNS, **score})
    return Result(str(settings.experiment.name), rows, keys=[str(settings.experiment.name)])


def test_a_verdict_that_changes_depends_on_strength() -> None:
    assert {row["over all strengths"] for row in headline.score(config("headline"), made).rows} == {headline.NOT_COMPARED}
    result = headline.score(config("headline", "profile.strengths=[0.5,1,2]"), made)
    assert len(result.rows) == len(HEADLINES) - 2  # the table has the probe on other recordings, so that it leaves out the other probe
    check_rows("headline", list(result.rows))
    for row in result.rows:
        assert row["verdict"] == "supported"
        assert row["over all strengths"] == headline.DEPENDS
        assert row["strength 0.5"].endswith("supported (3 draws)")
        assert row["strength 1"].endswith("supported (3 draws)")
        assert row["strength 2"] == "0.3 [0.2, 0.4], contradicted (3 draws)"
    assert set(result.keys) == set(headline.SOURCES)


def test_a_claim_without_a_row_at_a_strength_is_not_compared() -> None:
    def lacking(settings: Config) -> Result:
        result = made(settings)
        rows = [row for row in result.rows if settings.measured.gap.person < 2.0 or row.get("attribute") != "identity"]  # type: ignore[attr-defined]
        return dataclasses.replace(result, rows=rows)

    rows = headline.score(config("headline", "profile.strengths=[0.5,1,2]"), lacking).rows
    by_claim = {row["claim of the paper"]: row for row in rows}
    lacks = by_claim["identity does not transfer without labels"]
    assert (lacks["strength 2"], lacks["over all strengths"]) == ("no such row", headline.NOT_COMPARED)
    assert by_claim["geometry transfers without labels"]["over all strengths"] == headline.DEPENDS


def test_a_verdict_that_more_draws_change_does_not_depend_on_strength() -> None:
    settings = config("headline", "profile.strengths=[0.5,1]", "profile.campaign.draws=10", "profile.strength_campaign.draws=3")

    def wide(of_table: Config) -> Result:
        result = made(of_table)
        return dataclasses.replace(
            result, rows=[{**row, "verdict": "supported" if of_table.profile.campaign.draws == 10 else "undecided"} for row in result.rows]
        )

    for row in headline.score(settings, wide).rows:
        assert (row["verdict"], row["over all strengths"]) == ("supported", headline.AGREES)
        assert "undecided" in row["strength 1"]


def test_a_strength_multiplies_all_gaps_and_nothing_else() -> None:
    settings = config("headline", "measured.gap.person=0.5", "seed=3")
    half = headline.at_strength(settings, "turntable_shape", 0.5)
    gaps = dataclasses.asdict(half.measured.gap)  # type: ignore[attr-defined]
    assert gaps.pop("person") == 0.25
    assert gaps.pop("unscanned_echoes") == 0.0  # off by default
    assert set(gaps.values()) == {0.5}
    assert (half.seed, half.profile, half.experiment.name) == (3, settings.profile, "turntable_shape")


def test_the_run_of_strength_one_is_that_of_the_table_itself() -> None:
    from radartwin.runs.run import run_key

    settings = config("headline")
    for name in headline.SOURCES:
        assert run_key(headline.at_strength(settings, name, 1.0)) == run_key(config(name, f"output={settings.output}"))


@pytest.mark.parametrize(("first", "more"), [(0, True), (100, False)])
def test_draws_that_only_the_headline_reads_have_no_recordings_that_no_claim_reads(first: int, more: bool) -> None:
    tables = headline.tables(config("headline", "profile=paper", f"profile.campaign.first_draw={first}"))
    profile = tables[headline.WHOLE, "labelled_probe"].profile
    others = profile.unknown_contents, profile.exact_objects, profile.operating_points, profile.layout_turns > 0
    assert others == (more,) * 4
    assert profile.campaign.rover_rooms == ["atrium"] * more + ["squash_court"]
    assert tables[0.5, "labelled_probe"].profile.campaign.first_draw == 0


def test_each_claim_has_the_level_of_its_rank() -> None:
    """Three claims with p = 0.001, 0.02 and 0.04 have the levels 1 - 0.05/3, 1 - 0.05/2 and 0.95; 0.03 does not suffice first."""

    def row(p: float) -> dict:
        half = 0.5 / t.isf(p / 2, 9) * t.isf(0.025, 9)  # of the 95 % interval around 0.5, so that p is the p value of the null 0
        return {**COLUMNS, "bound": 0.0, "null": 0.0, "p": p, "value": 0.5, "low": 0.5 - half, "high": 0.5 + half, "verdict": "supported"}

    rows = [row(0.02), row(0.001), row(0.04), row(0.5) | {"verdict": "not testable here", "reason": "no such room"}]
    headline.at_levels(rows)
    assert [claim["level"] for claim in rows] == pytest.approx([1 - 0.05 / 2, 1 - 0.05 / 3, 0.95, 0.95])
    assert [claim["verdict"] for claim in rows] == ["supported"] * 3 + ["not testable here"]
    assert [claim["family"] for claim in rows] == ["primary"] * 3 + [""]
    rows = [row(0.02), row(0.02) | {"p": None, "low": None, "high": None, "verdict": "undecided"}]
    headline.at_levels(rows)
    assert [claim["level"] for claim in rows] == [1 - 0.05 / 2, 0.95]  # a claim without a p value stays in the family
    rows = [row(0.03), row(0.031), row(0.032)]
    headline.at_levels(rows)
    assert [claim["verdict"] for claim in rows] == ["undecided", "undecided", "supported"]
    assert (rows[0]["low"] > 0) == (0.03 < 0.05 / 3)


def test_the_labelled_probe_is_judged_on_other_recordings_if_the_table_has_them() -> None:
    def told(probes: set[str]) -> list[str]:
        def table(settings: Config) -> Result:
            result = made(settings)
            return dataclasses.replace(result, rows=[row for row in result.rows if row.get("probe", "") in {"", *probes}])

        rows = headline.score(config("headline"), table).rows
        return [row["claim of the paper"] for row in rows if row["table"] == "labelled_probe"]

    claims = ("training on simulation beats raw features", "training on our simulation is more accurate than on RF-Genesis")
    assert told({"other recordings", "other revolutions"}) == [f"{claim} (other recordings)" for claim in claims]
    assert told({"other revolutions"}) == [f"{claim} (other revolutions)" for claim in claims]


def test_a_claim_that_fits_two_rows_is_a_defect() -> None:
    def doubled(settings: Config) -> Result:
        result = made(settings)
        return dataclasses.replace(result, rows=[*result.rows, {**result.rows[-1], "claim": ""}, *result.rows[:1]])

    with pytest.raises(ValueError, match=r"2 rows of the table \w+ fit"):
        headline.score(config("headline"), doubled)
