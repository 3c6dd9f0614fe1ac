"""A registration states the claims as the tables state them; a changed file, and a claim without a test, are refused in one line."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from fake_campaign import FakeCampaign, config, frame_of

from analysis.pages.template import RESULTS
from analysis.tables import to_csv
from experiments import cells
from experiments.campaign.frame import Frame
from experiments.gaps import headline, registration
from experiments.rover import rover_fidelity
from experiments.turntable import turntable_material, turntable_shape
from radartwin.config.compose import compose
from radartwin.config.config import Config
from radartwin.errors import InputError
from radartwin.runs.experiment import Result
from radartwin.runs.run import run_key

REGISTERED = {one[registration.TEXT]: one for one in registration.claims()}


def drawn(frame: Frame) -> Frame:
    """Return the frame with the measured repetitions as draws."""
    return frame.assign(draw=frame.repetition, repetition=0)


def table(path: Path, **changed: str) -> Path:
    """Write a headline table that states the registered claims, with other cells in its first row."""
    rows = [
        {**{name: "" if claim[name] is None else str(claim[name]) for name in (registration.TEXT, *registration.FIXED)},
         "evidence": "draws 100 to 109, registered", "verdict": "undecided"}
        for claim in REGISTERED.values()
    ]  # fmt: skip
    rows[0] |= changed
    with path.open("w", newline="") as stream:
        writer = csv.DictWriter(stream, list(rows[0]))
        writer.writeheader()
        writer.writerows([*rows, {**rows[0], registration.TEXT: "beyond the testbed", "verdict": "not testable here"}])
    return path


@pytest.fixture
def written(tmp_path: Path) -> Path:
    path = tmp_path / "r.json"
    assert registration.main(["write", str(path)]) == 0
    return path


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({}, "states the claims of"),
        ({"direction": "below"}, "direction 'below', registered 'above'"),
        ({"bound": "0.1"}, "bound '0.1', registered 0.0"),
        ({"evidence": "draws 0 to 9, exploratory"}, "draws 0 to 9, exploratory, registered draws 100 to 109"),
        ({registration.TEXT: "more"}, "'more' is not registered"),
    ],
)
def test_a_table_is_compared_with_the_registered_claims(
    changed: dict[str, str], told: str, written: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert registration.main(["check", str(written), str(table(tmp_path / "h.csv", **changed))]) == (1 if changed else 0)
    assert told in capsys.readouterr().out


def test_the_committed_registration_states_the_present_claims() -> None:
    """The hash is that of 2026-11-29, before the draws 100 to 109 were simulated."""
    path = RESULTS.parent / "registration.json"
    assert registration.read(path) == list(REGISTERED.values())
    assert json.loads(path.read_text())["sha256"] == "1f1cc3f86090cb982417a6c806485edb78dc267c25cb1df1e4d66f63f4ad70f3"


@pytest.mark.parametrize(
    ("change", "told"),
    [(lambda c: c["claims"][0].update(bound="0.1"), "the hash does not match"), (lambda c: c.pop("sha256"), "is no registration")],
)
def test_a_changed_file_is_refused_in_one_line(
    change, told: str, written: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    content = json.loads(written.read_text())
    change(content)
    written.write_text(json.dumps(content))
    assert registration.main(["check", str(written), str(table(tmp_path / "h.csv"))]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert told in lines[0]


@pytest.mark.parametrize("name", ["test", "direction", "bound", "unit"])
def test_a_claim_without_a_test_is_refused(name: str) -> None:
    claim = {**next(iter(REGISTERED.values())), name: ""}
    with pytest.raises(InputError, match=f"has no {name}; state it in"):
        registration.registration([claim], "2026-11-28")


@pytest.mark.parametrize(
    ("overrides", "told"),
    [
        ([], "draws 0 to 9, exploratory"),
        (["profile.campaign.first_draw=100"], "draws 100 to 109, registered"),
        (["profile.campaign.first_draw=100", "output=elsewhere", "jobs=1", "simulator.variant=llvm"], "draws 100 to 109, registered"),
        (["profile.campaign.first_draw=100", "profile.campaign.draws=11"], "draws 100 to 110, exploratory"),
        (["profile.campaign.first_draw=100", "seed=7"], "draws 100 to 109, exploratory"),
        (["profile.campaign.first_draw=100", "measured.gap.person=0"], "draws 100 to 109, exploratory"),
        (["profile=quick", "profile.campaign.first_draw=100", "profile.campaign.draws=10"], "draws 100 to 109, exploratory"),
    ],
)
def test_other_draws_and_settings_than_the_registered_ones_are_exploratory(overrides: list[str], told: str) -> None:
    assert headline.evidence(compose(["experiment=headline", "profile=paper", *overrides]), False) == told


def test_a_row_that_some_registered_draws_lack_is_exploratory() -> None:
    settings = compose(["experiment=headline", "profile=paper", "profile.campaign.first_draw=100"])
    assert headline.evidence(settings, False, 10) == "draws 100 to 109, registered"
    assert headline.evidence(settings, False, 9) == "draws 100 to 109, exploratory"


@pytest.mark.parametrize(
    ("folders", "overrides"), [(["registered"], headline.REGISTERED_PROFILE), ([".", "draws_0_to_9"], ["profile=paper"])]
)
def test_the_committed_headlines_follow_from_their_tables(folders: list[str], overrides: Sequence[str]) -> None:
    settings = compose(["experiment=headline", *overrides])
    names = {run_key(one): name for (strength, name), one in headline.tables(settings).items() if strength == headline.WHOLE}

    def committed(of: Config) -> Result:
        if (key := run_key(of)) not in names:  # other strengths of the testbed, which version 1.1 has not compared
            return Result(str(of.experiment.name), [])
        *_, file = (file for folder in folders if (file := RESULTS / folder / f"{names[key]}.csv").is_file())
        rows = pd.read_csv(file).astype(object)
        return Result(names[key], rows.where(rows.notna(), None).to_dict("records"))

    written = pd.read_csv(io.StringIO(to_csv(headline.score(settings, committed).rows)))
    pd.testing.assert_frame_equal(written, pd.read_csv(RESULTS / folders[0] / "headline.csv"), check_dtype=False, rtol=1e-9)


def test_the_registered_headline_states_the_claims(capsys: pytest.CaptureFixture[str]) -> None:
    assert registration.main(["check", str(RESULTS.parent / "registration.json"), str(RESULTS / "registered" / "headline.csv")]) == 0
    assert "states the claims" in capsys.readouterr().out


def test_a_registration_is_never_replaced(written: Path, capsys: pytest.CaptureFixture[str]) -> None:
    before = written.read_bytes()
    assert registration.main(["write", str(written)]) == 2
    assert "never replaced" in capsys.readouterr().err
    assert written.read_bytes() == before


def test_the_tables_state_the_claims_as_they_are_registered() -> None:
    """Tables of two draws have the registered bounds and tests."""
    objects = ("can_211_300", "can_211_400", "corner_reflector", "mug", "mustard", "olive_oil")
    few: dict[str, Any] = {"repetitions": 2, "frames": 24, "objects": objects}
    turntable, drives = FakeCampaign(**few), FakeCampaign(("depth",), ("squash_court",), **few)
    declared = ((turntable_shape, turntable), (turntable_material, turntable), (rover_fidelity, drives))
    compared = 0
    for module, source in declared:
        options = config(module.TABLE.name)
        rows = cells.table_rows(options, drawn(frame_of(source, *module.MOTIONS[:1])), partial(module.cells, options))
        for claim in (claim for claim in headline.HEADLINES if claim.table == module.TABLE.name):
            _same_rule(headline._row(rows, claim), REGISTERED[claim.text])
            compared += 1
    assert compared == 6


def _same_rule(row: Mapping[str, Any] | None, registered: Mapping[str, Any]) -> None:
    assert row is not None
    stated = {name: row[name] for name in ("bound", "direction", "null", "margin", "test", "unit")}
    assert stated == {name: registered[name] for name in stated}
