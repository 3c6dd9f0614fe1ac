"""Tests of the estimates over several draws of the campaign, and of the seeds of a draw."""

from __future__ import annotations

import dataclasses
from dataclasses import replace

import numpy as np
import pytest
from fake_campaign import config

from experiments import cells, draws, statistics
from experiments.campaign import truth
from experiments.campaign.campaign import Campaign
from experiments.campaign.cases import Case, planned
from experiments.claims import Claim, RowList
from experiments.statistics import Estimate
from radartwin.cli import main
from radartwin.errors import ConfigError
from radartwin.io.progress import Progress
from radartwin.store.products import Store

QUIET = Progress(quiet=True)


@pytest.mark.parametrize(("between", "within"), [(1.0, 0.0), (0.0, 1.0), (1.0, 1.0), (0.3, 1.0)])
def test_the_interval_covers_draws_and_items(between: float, within: float) -> None:
    """The value of item i in draw d is a_d + b_i. Both effects are normal with zero mean, so 95 % of the intervals should contain zero."""
    rng = np.random.default_rng(0)
    inside = 0
    for trial in range(300):
        values = between * rng.standard_normal((10, 1)) + within * rng.standard_normal(12)
        found = statistics.over_draws([statistics.mean(one, 300, trial) for one in values], 300, trial)
        inside += found.low <= 0 <= found.high
    assert 0.86 < inside / 300 < 0.98  # a percentile bootstrap of 10 or 12 values covers 90 to 93 %


def test_one_draw_is_returned_as_it_is() -> None:
    one = statistics.mean([1.0, 2.0, 4.0], 100, 0)
    assert statistics.over_draws([one], 100, 0) is one


def test_draws_that_agree_have_the_interval_of_one_draw() -> None:
    one = statistics.mean(np.random.default_rng(1).normal(size=12), 500, 0)
    three = statistics.over_draws([one] * 3, 500, 0)
    assert (three.value, three.low, three.high) == pytest.approx((one.value, one.low, one.high))


@pytest.mark.parametrize("count", [3, 10])
def test_draws_of_equal_estimates_without_resamples_have_the_interval_of_one_draw(count: int) -> None:
    """The figure belongs to the same items in every draw, so more draws do not make it more certain."""
    one = Estimate(0.5, 0.4, 0.6, 9)
    joined = statistics.over_draws([one] * count, 500, 0)
    assert (joined.low, joined.high) == (0.4, 0.6)
    shifted = [replace(one, value=0.5 + at, low=0.4 + at, high=0.6 + at) for at in np.linspace(-1e-9, 1e-9, count)]
    joined = statistics.over_draws(shifted, 20_000, 0)
    assert (joined.low, joined.high) == pytest.approx((0.4, 0.6), abs=0.005)


@pytest.mark.parametrize("count", [2, 3, 5])
def test_few_draws_of_a_single_item_have_wide_intervals(count: int) -> None:
    rng = np.random.default_rng(count)
    inside = 0
    for trial in range(400):
        found = statistics.over_draws([Estimate(one, one, one, 1) for one in rng.standard_normal(count)], 300, trial)
        inside += found.low <= 0 <= found.high
    assert inside / 400 > 0.9


def test_an_interval_over_draws_stays_within_the_limits_of_the_quantity() -> None:
    some = [replace(statistics.mean([at, at + 0.1], 100, 0), limits=statistics.SIGNED) for at in (0.1, 0.5, 0.9)]
    joined = statistics.over_draws(some, 500, 0)
    assert joined.high == 1.0
    assert joined.limits == statistics.SIGNED


def test_draws_without_items_are_left_out() -> None:
    nothing = Estimate(0.5, 0.0, 1.0, 0)
    assert statistics.over_draws([nothing] * 3, 50, 0) == nothing
    one = statistics.mean([1.0, 2.0, 4.0], 100, 0)
    assert statistics.over_draws([nothing, one], 50, 0) is one


def test_a_bound_is_infinite_if_many_resamples_are() -> None:
    assert statistics.resampled(4.0, [2.0, 3.0, 4.0, np.inf], 4).high == np.inf
    assert statistics.resampled(4.0, [2.0, 3.0, 4.0, np.nan], 4).high == pytest.approx(4.0)


def test_a_single_recording_of_each_draw_counts_the_draws() -> None:
    some = [statistics.mean([value], 50, 0) for value in (1.0, 2.0, 3.0)]
    found = statistics.over_draws(some, 2000, 0)
    assert (found.value, found.n) == (2.0, 3)
    assert found.low < 1.3 < 2.7 < found.high


def test_rows_of_draws_join_by_their_conditions() -> None:
    own, found = config("turntable_shape"), []
    for number, (value, limit) in enumerate(((1.0, 0.2), (3.0, 0.4))):
        rows = RowList(own)
        rows.add({"case": "a", "answers": 4, "chance": 0.25}, "level", statistics.mean([value, value + 0.1], 100, 0), [f"k{number}"],
                 Claim("above", bound=limit))  # fmt: skip
        if number == 0:
            rows.add({"case": "b"}, "level", statistics.exact(5.0, 3), ["k9"])
        found.append(rows)
    first, second = cells.joined_rows(found)
    assert (first["value"], first["draws"], first["n"], first["answers"], first["chance"]) == (pytest.approx(2.05), 2, 2, 8, 0.25)
    assert first.claim.bound == pytest.approx(0.3)
    assert (second["value"], second["draws"], second["verdict"]) == (5.0, 1, "")


@pytest.mark.parametrize("n", [2, 3, 4, 6, 12])
def test_mean_of_few_items_has_its_coverage(n) -> None:
    rng = np.random.default_rng(3)
    found = [statistics.mean(rng.standard_normal(n), 999, 1) for _ in range(400)]
    assert 0.89 <= np.mean([one.low <= 0 <= one.high for one in found]) <= 0.99


def test_each_draw_has_seeds_of_its_own_and_the_first_has_the_configured_seed(tmp_path) -> None:
    chosen = config("turntable_shape", "seed=7")
    case = Case("mug", "lab", "turntable", 1.0)
    roots = [truth.root_of(dataclasses.replace(case, draw=k), chosen) for k in range(3)]
    assert roots[0] == 7
    assert len(set(roots)) == 3
    other = config("turntable_shape", f"seed={7 + truth.DRAW_STEP}")  # the first draw of this seed has another board than the second of 7
    assert truth.specification(case, other) != truth.specification(dataclasses.replace(case, draw=1), chosen)
    assert truth.specification(case, chosen) != truth.specification(dataclasses.replace(case, draw=1), chosen)
    campaign = chosen.profile.campaign
    assert {one.draw for one in planned(campaign, measured=True) if one.motion == "turntable"} == set(range(campaign.draws))
    assert {one.draw for one in planned(campaign, measured=False)} == {0}
    assert {one.draw for one in Campaign(chosen, Store(tmp_path), QUIET, draw=1).cases("measured")} == {1}
    assert draws.numbers(config("turntable_shape", "measured.draw=2")) == [2]
    with pytest.raises(ConfigError, match=r"measured\.draw=2: the draws of drives are 0 to 0 in profile=quick"):
        draws.numbers(config("rover_fidelity", "measured.draw=2"), rover=True)
    registered = config("headline", "profile=paper", "profile.campaign.first_draw=100")
    assert (draws.numbers(registered), draws.numbers(registered, rover=True)) == (list(range(100, 110)), [100, 101, 102])
    assert {one.draw for one in planned(registered.profile.campaign, measured=True) if one.motion == "turntable"} == set(range(100, 110))


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ("measured.draw=3", "measured.draw=3 does not exist: the draws of profile=quick are 0 to 2"),
        ("measured.draw=-1", "measured.draw=-1 must be zero or above"),
        ("measured.gap.object_shape=-0.5", "object_shape"),
        ("measured.gap.antennas=1", "antennas"),
    ],
)
def test_a_wrong_draw_or_gap_is_one_line(given: str, told: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(ConfigError, match=r"draw|gap"):
        config("turntable_shape", given)
    assert main(["run", "experiment=turntable_shape", given]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert told in lines[0]


def test_further_parts_follow_the_profile_and_switch_off_the_gaps_of_the_target(tmp_path) -> None:
    def parts(*given: str) -> list[draws.Part]:
        return draws.Query(config("turntable_label_free", *given), ("turntable",), side="ours", unknown=True, exact=True).parts

    usual = [("measured", {}), ("twin", {"side": "ours"})]
    assert [(part.domain, part.versions) for part in parts()] == usual
    *_, unknown = parts("profile.unknown_contents=true")
    assert (unknown.domain, unknown.versions, unknown.config.contents) == ("twin", {"side": "ours", "twin": draws.UNKNOWN}, "unknown")
    assert len(parts("profile.unknown_contents=true", "contents=unknown")) == 2
    *_, exact = parts("profile.exact_objects=true")
    assert (exact.domain, exact.versions, exact.config.measured.draw) == ("measured", {"truth": draws.EXACT}, 0)
    off = {name for name, strength in dataclasses.asdict(exact.config.measured.gap).items() if strength == 0}
    assert off == {*draws.OBJECT_GAPS, "unscanned_echoes"}
    with pytest.raises(ConfigError, match=r"measured\.draw=2: the draws of drives are 0 to 0"):
        draws.Query(config("rover_fidelity", "measured.draw=2"), ("lateral",)).wanted(Store(tmp_path), QUIET)
