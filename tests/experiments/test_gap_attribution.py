"""The loss that each difference between simulation and measurement causes, on synthetic and on simulated recordings."""

from __future__ import annotations

from dataclasses import asdict, fields, replace
from itertools import permutations
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from fake_campaign import FakeCampaign

from experiments.campaign.cases import Case
from experiments.gaps import coalitions
from experiments.gaps.coalitions import ERROR, LABELS, PROFILE, RECOGNITION, SCORES, Sides, configured, losses, recognised_shares, side
from experiments.gaps.gap_attribution import ALL, ALONE, CLAIMS, FILLED, LEFT_OUT, PLANS, SHARE, Plan, chart, table
from experiments.gaps.shapley import Coalition, shares
from experiments.gaps.shapley import coalitions as subsets
from experiments.recognition import transfer
from experiments.recognition.protocol import correct
from experiments.recognition.readings import frames
from radartwin.config.compose import compose
from radartwin.config.study import GapConfig
from radartwin.features.processed import Processed
from radartwin.io.progress import Progress
from radartwin.runs.experiment import check_rows
from radartwin.store import products
from radartwin.store.products import Store

CONFIG = compose(["experiment=gap_attribution", "profile.resamples=200", "supervision.trees=20", "supervision.seeds=2"])
OBJECTS = ("corner_reflector", "mug", "mustard", "mouthwash")
FILLED_ONES = OBJECTS[2:]
PLAN = Plan({"geometry": ("geometry",), "materials": (LABELS, "materials"), "object": ("contents",), "hardware": ("hardware",)}, OBJECTS)
QUIET = Progress(quiet=True)


class FakeSides(Sides):
    """This class computes synthetic echoes of measurement and simulation from formulas, without a simulator. The difference `hardware`
    attenuates the measured echo by 6 dB, `contents` modulates the echo of a measured bottle twice per revolution, `geometry` mirrors the
    simulated room, and `materials` and `labels` each raise the amplitude of the measurement or of the simulation by 20 %.
    """

    def processed(self, domain: str, on: frozenset[str], case: Case) -> tuple[str, Processed]:
        materials = "uniform" if "geometry" in on else "true"
        key, made = FakeCampaign(distances=(1.0,), frames=16, materials=materials).processed("twin", case)
        lobes = 0.4 if domain == "measured" and "contents" in on and case.object in FILLED_ONES else 0.0
        gain = 1.2 if on & {"materials", LABELS} else 1.0
        gain *= 0.5 if domain == "measured" and "hardware" in on else 1.0
        wave = gain * (1 + lobes * np.cos(2 * 2 * np.pi * np.arange(16) / 16))
        power = (made.power * wave[:, None] ** 2).astype(np.float32)
        channels = (made.channels * wave[:, None, None]).astype(np.complex64)
        return f"{domain}{sorted(on)}{key}", replace(made, power=power, channels=channels)

    def missing(self, coalitions) -> dict:
        return {}

    def log(self, domain: str, case: Case):
        return FakeCampaign(distances=(1.0,), frames=16).log(case, "twin")


@pytest.fixture(scope="module")
def scored(tmp_path_factory: pytest.TempPathFactory):
    sides = FakeSides(CONFIG, Store(tmp_path_factory.mktemp("store")), QUIET, coalitions.cases(OBJECTS))
    found = losses(CONFIG, sides, PLAN.needed())
    filled = np.array([case.object in FILLED_ONES for case in sides.cases])
    return sides, found, filled, table(CONFIG, PLAN, found, filled, sides.keys)


def cell(rows: list[dict], score: str, gap: str, metric: str, objects: str = ALL) -> dict:
    (row,) = [r for r in rows if (r["score"], r["gap"], r["metric"], r["objects"]) == (score, gap, metric, objects)]
    return row


def test_the_paper_profile_switches_every_default_gap_alone_and_in_one_group() -> None:
    plan = PLANS["paper"]
    assert sorted(gap for gaps in plan.groups.values() for gap in gaps) == sorted(
        (LABELS, *(f.name for f in fields(GapConfig) if f.default))
    )
    assert {frozenset((gap,)) for gap in plan.everything} <= set(plan.switched().values())
    for profile in PLANS.values():
        needed = set(profile.needed())
        assert {frozenset(), profile.everything} <= needed
        assert all({part, profile.everything - part} <= needed for part in profile.switched().values())
        assert len(needed) == len(profile.needed())
    assert PLANS["quick"].everything < plan.everything


def test_a_set_of_gaps_is_on_and_all_others_off() -> None:
    made = configured(CONFIG, {"geometry", "clutter", LABELS})
    assert {name for name, strength in asdict(made.measured.gap).items() if strength} == {"geometry", "clutter"}
    assert made.materials == CONFIG.materials
    assert configured(CONFIG, {"geometry"}).materials.source == "true"
    on = frozenset(("geometry", LABELS, "clutter", "hardware"))
    assert side("twin", on) == {"geometry", LABELS, "hardware"}
    assert side("measured", on) == {"clutter", "hardware"}


def test_no_gaps_cause_no_loss_and_shares_sum_to_the_total(scored) -> None:
    *_, rows = scored
    check_rows("gap_attribution", rows)
    for score in SCORES:
        assert cell(rows, score, "none", "loss")["value"] == pytest.approx(0.0, abs=1e-6)
        total = cell(rows, score, "all", "loss")["value"] - cell(rows, score, "none", "loss")["value"]
        assert sum(cell(rows, score, gap, SHARE)["value"] for gap in PLAN.groups) == pytest.approx(total, abs=1e-9)


def test_each_gap_causes_loss_only_in_the_scores_and_objects_it_affects(scored) -> None:
    _, found, filled, rows = scored
    change = found[ERROR][frozenset(("contents",))] - found[ERROR][frozenset()]
    assert (change[filled] > 0.1).all()
    np.testing.assert_array_equal(change[~filled], 0.0)
    assert cell(rows, PROFILE, "geometry", ALONE)["value"] > 0.01
    assert cell(rows, PROFILE, "geometry", LEFT_OUT)["value"] > 0.01
    # a change of level does not change the correlation of range profiles
    assert cell(rows, PROFILE, "hardware", SHARE)["value"] == pytest.approx(0.0, abs=1e-5)
    assert cell(rows, RECOGNITION, "hardware", SHARE)["value"] == 0.0  # a change of level does not change the ranks of features
    assert cell(rows, ERROR, "hardware", ALONE)["low"] > 0.0
    assert cell(rows, ERROR, "object", ALONE, FILLED)["value"] > 0.0
    assert cell(rows, ERROR, "labels only", ALONE)["low"] > 0.0
    # `materials` changes measurement and simulation equally, so that it causes no error alone
    assert cell(rows, ERROR, "materials", ALONE)["value"] == pytest.approx(0.0, abs=1e-6)


def test_sets_are_classified_together_as_separately(scored) -> None:
    sides, _, _, _ = scored
    twin = sides.read("twin", frozenset())
    coalitions: list[Coalition] = [frozenset(), frozenset(("contents",)), frozenset(("hardware", "contents"))]
    measured = {on: sides.read("measured", on) for on in coalitions}
    together = recognised_shares(CONFIG, frames(twin), {on: frames(rows) for on, rows in measured.items()})
    for on, rows in measured.items():
        split = transfer.ranked_split(pd.concat([twin, rows]))
        hits = correct(transfer.predict(CONFIG, split), split.test.per_recording().label)
        np.testing.assert_array_equal(together[on], hits.mean(axis=0))


def test_every_claim_has_a_row_in_the_paper_profile() -> None:
    plan = PLANS["paper"]
    count = len(plan.objects)
    rng = np.random.default_rng(0)
    drawn = {score: {on: rng.uniform(1, 2, count) + len(on) for on in plan.needed()} for score in SCORES}
    rows = table(CONFIG, plan, drawn, np.arange(count) > 2, ["key"])
    check_rows("gap_attribution", rows)
    claimed = {(r["score"], r["gap"], r["objects"], r["metric"]) for r in rows if r["claim"]}
    assert claimed == set(CLAIMS)
    assert chart(rows, tuple(plan.groups)).axes


PLAYERS = ("a", "b", "c", "d")


def test_shares_are_the_mean_over_all_orders_and_sum_to_the_total() -> None:
    """The game has three players with random values per recording, and a player without influence, whose share must be zero."""
    rng = np.random.default_rng(0)
    drawn = {players: rng.standard_normal(5) for players in subsets(PLAYERS[:3])}
    played = {players: drawn[players - {"d"}] for players in subsets(PLAYERS)}
    found = shares(PLAYERS, played)
    for player in PLAYERS:
        before = [frozenset(order[: order.index(player)]) for order in permutations(PLAYERS)]
        counted = np.mean([played[players | {player}] - played[players] for players in before], axis=0)
        np.testing.assert_allclose(found[player], counted, atol=1e-12)
    np.testing.assert_allclose(sum(found.values()), played[frozenset(PLAYERS)] - played[frozenset()], atol=1e-12)
    np.testing.assert_allclose(found["d"], 0, atol=1e-12)


@pytest.mark.slow
def test_simulated_recordings_of_a_can_and_a_bottle_lose_to_contents_and_placement(tmp_path: Path) -> None:
    """Filling the bottle (`contents`) changes only the bottle's echo, a position error (`placement`) both echoes."""
    plan = Plan({"contents": ("contents",), "placement": ("placement",)}, ("drink_can_355", "mustard"))
    config = replace(CONFIG, output=str(tmp_path))
    sides = Sides(config, Store(tmp_path / "cache"), QUIET, coalitions.cases(plan.objects))
    found = losses(config, sides, plan.needed())
    can, bottle = 0, 1
    assert [case.object for case in sides.cases] == ["drink_can_355", "mustard"]
    none, contents, placement = frozenset(), frozenset(("contents",)), frozenset(("placement",))
    assert (found[ERROR][none] < 1e-3).all()
    assert (found[PROFILE][none] < 1e-4).all()
    assert (found[RECOGNITION][none] == 0).all()
    assert found[ERROR][contents][can] == found[ERROR][none][can]
    assert found[ERROR][contents][bottle] > 0.01
    assert (found[ERROR][placement] > 0.01).all()
    again = Sides(config, Store(tmp_path / "cache"), QUIET, sides.cases)
    with products.counting() as counts:
        again.prepare(plan.needed())
    assert counts.simulated == 0
    assert again.keys == sides.keys
