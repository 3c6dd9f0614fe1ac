"""Tests of the estimates over several draws of the campaign, and of the seeds of a draw."""

from __future__ import annotations

import dataclasses

import numpy as np
import pandas as pd
import pytest
from fake_campaign import config

from experiments import cells, draws, framed, statistics
from experiments.campaign import truth
from experiments.campaign.campaign import Campaign
from experiments.campaign.cases import Case, planned
from experiments.recognition import labelled_probe, protocol
from experiments.verdicts import Claim, RowList
from radartwin.errors import ConfigError
from radartwin.io.progress import Progress
from radartwin.store.products import Store

QUIET = Progress(quiet=True)


def test_rows_of_draws_join_by_their_conditions() -> None:
    settings, by_draw = config("turntable_shape"), []
    for number, (value, limit) in enumerate(((1.0, 0.2), (3.0, 0.4))):
        rows = RowList(settings)
        rows.add({"case": "a", "answers": 4, "chance": 0.25}, "level", statistics.mean([value, value + 0.1], 100, 0), [f"k{number}"],
                 Claim("above", bound=limit))  # fmt: skip
        if number == 0:
            rows.add({"case": "b"}, "level", statistics.exact(5.0, 3), ["k9"])
        by_draw.append(rows)
    first, second = cells.joined_rows(by_draw)
    assert (first["value"], first["draws"], first["n"], first["answers"], first["chance"]) == (pytest.approx(2.05), 2, 2, 8, 0.25)
    assert first.claim.bound == pytest.approx(0.3)
    assert (second["value"], second["draws"], second["verdict"]) == (5.0, 1, "")


def test_draws_share_no_training() -> None:
    """Otherwise the spread over draws would lack the random error of the trainings."""
    settings, used = config("labelled_probe", "profile.campaign.draws=3"), []
    frame = pd.DataFrame({"domain": ["twin", "measured", "measured", "measured"], "draw": [0, 0, 1, 2], "twin": "", "truth": ""})
    score = framed.framed(
        labelled_probe.TABLE, {}, lambda at, _: used.append(protocol.seeds(at)) or (), lambda *_: {}, lambda _: {}, named=True
    )[2]
    score(settings, frame)
    assert used[0] == protocol.seeds(settings) == list(range(settings.supervision.seeds))
    assert len(set(np.ravel(used))) == 3 * settings.supervision.seeds


def test_each_draw_has_seeds_of_its_own_and_the_first_has_the_configured_seed(tmp_path) -> None:
    settings = config("turntable_shape", "seed=7", "profile.campaign.draws=3")
    case = Case("mug", "lab", "turntable", 1.0)
    roots = [truth.root_of(dataclasses.replace(case, draw=k), settings) for k in range(3)]
    assert roots[0] == 7
    assert len(set(roots)) == 3
    other = config("turntable_shape", f"seed={7 + truth.DRAW_STEP}")  # the first draw of this seed has another board than the second of 7
    assert truth.specification(case, other) != truth.specification(dataclasses.replace(case, draw=1), settings)
    assert truth.specification(case, settings) != truth.specification(dataclasses.replace(case, draw=1), settings)
    campaign = settings.profile.campaign
    assert {recording.draw for recording in planned(campaign, measured=True) if recording.motion == "turntable"} == set(
        range(campaign.draws)
    )
    assert {recording.draw for recording in planned(campaign, measured=False)} == {0}
    assert {recording.draw for recording in Campaign(settings, Store(tmp_path), QUIET, draw=1).cases("measured")} == {1}
    assert draws.numbers(config("turntable_shape", "profile.campaign.draws=3", "measured.draw=2")) == [2]
    with pytest.raises(ConfigError, match=r"measured\.draw=2: the draws of drives are 0 to 0 in profile=quick"):
        draws.numbers(config("rover_fidelity", "profile.campaign.draws=3", "measured.draw=2"), rover=True)
    registered = config("headline", "profile=paper", "profile.campaign.first_draw=100")
    assert (draws.numbers(registered), draws.numbers(registered, rover=True)) == (list(range(100, 110)), [100, 101, 102])
    assert {recording.draw for recording in planned(registered.profile.campaign, measured=True) if recording.motion == "turntable"} == set(
        range(100, 110)
    )


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
        draws.Query(config("rover_fidelity", "profile.campaign.draws=3", "measured.draw=2"), ("lateral",)).wanted(Store(tmp_path), QUIET)
