"""Tests of the verdicts and of their tests: the order of the five words, the level of each test, and its agreement with the interval."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from fake_campaign import config

from experiments import statistics
from experiments.recognition.protocol import permuted_accuracy
from experiments.statistics import Estimate
from experiments.verdicts import ABOVE, BELOW, EQUAL, NONE, Claim, RowList, judge, within
from radartwin.recognize.samples import MEASURED, Part, gather
from radartwin.runs.experiment import check_rows


@pytest.mark.parametrize(
    ("low", "high", "word"),
    [(0.3, 0.5, "supported"), (0.1, 0.5, "direction shown"), (0.05, 0.15, "direction shown"), (-0.1, 0.5, "undecided"),
     (-0.1, 0.1, "contradicted"), (-0.5, -0.3, "contradicted"), (None, 0.5, "undecided"), (0.3, None, "supported")],
)  # fmt: skip
def test_an_effect_is_judged_in_the_stated_order(low: float | None, high: float | None, word: str) -> None:
    """The bound is 0.2 and the null 0. The mirrored interval and claim have the same verdict."""
    assert judge(0.1, low, high, 0.2, ABOVE, 0.0, None) == word
    low, high = (None if end is None else -end for end in (high, low))
    assert judge(-0.1, low, high, -0.2, BELOW, 0.0, None) == word
    assert judge(-0.1, low, high, -0.2, BELOW, 0.0, None, "no such room") == "not testable here"
    assert judge(-0.1, low, high, -0.2, None, 0.0, None, "made again in 1.1") == ""


@pytest.mark.parametrize(
    ("low", "high", "word"),
    [(0.4, 0.6, "supported"), (0.55, 0.6, "supported"), (0.3, 0.6, "undecided"), (0.55, 0.7, "undecided"), (0.61, 0.7, "contradicted"),
     (0.1, 0.39, "contradicted"), (None, None, "undecided")],
)  # fmt: skip
def test_no_effect_has_a_margin(low: float | None, high: float | None, word: str) -> None:
    assert judge(0.5, low, high, 0.5, EQUAL, 0.5, 0.1) == word


def test_rows_carry_what_their_verdict_follows_from() -> None:
    rows = RowList(config("turntable_shape"))
    above = Claim("c", bound=0.2, null=0.0)
    judged = rows.add({}, "m", Estimate(0.3, 0.1, 0.5, 9), (), above)
    assert judged["verdict"] == "direction shown"
    assert [judged[name] for name in ("bound", "direction", "null", "margin", "level", "family", "test", "unit")] == [
        0.2, "above", 0.0, None, 0.95, "", statistics.STUDENT, "recordings",
    ]  # fmt: skip
    nowhere = rows.add({}, "m", Estimate(np.nan, 0.2, np.inf, 5), ["a", "b"], above)
    assert (nowhere["value"], nowhere["high"], nowhere["verdict"], nowhere["n"]) == (None, None, "undecided", 2)
    unbounded = rows.add({}, "m", Estimate(3.0, 0.2, np.inf, 5), (), Claim("c", bound=0.0))
    assert (unbounded["high"], unbounded["verdict"]) == (None, "supported")
    single = rows.add({}, "m", Estimate(3.0, 3.0, 3.0, 1), (), above)
    assert (single["low"], single["high"], single["p"], single["verdict"]) == (None, None, None, "undecided")
    assert rows.add({}, "m", Estimate(3.0, 3.0, 3.0, 1), (), Claim("c", bound=0.2, least=1))["verdict"] == "supported"
    equal = statistics.resampled(0.2, np.full(9, 0.2), 3)
    assert rows.add({}, "m", equal, (), above)["verdict"] == "undecided", "a bootstrap whose samples are all equal"
    plain = rows.add({}, "m", Estimate(0.3, 0.1, 0.5, 9), (), NONE)
    assert (plain["verdict"], plain["bound"], plain["low"]) == ("", None, 0.1)
    limits = [rows.add({}, "m", Estimate(at, at, at, 2), (), Claim("c", bound=1.0, direction=BELOW, limit=True)) for at in (0.9, 1.1)]
    assert [judgement["verdict"] for judgement in limits] == ["holds", "misses"]
    check_rows("t", [judged, nowhere, unbounded, single, plain, *limits])
    assert within("c", -1.0, 3.0) == Claim("c", direction=EQUAL, null=1.0, margin=2.0)


@pytest.fixture(autouse=True)
def _few_permutations(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(statistics, "PERMUTATIONS", 399)


KINDS = ("order", "gain", "closed", "contrast", "accuracy")
CLASSES = np.array(["a", "b"] * 6)
FRAME = gather(("a",), [Part(f"r{n:02}", kind, MEASURED, np.zeros(1)) for n, kind in enumerate(CLASSES)])
FRAME = replace(FRAME, object=FRAME.recording)


def joined(kind: str, rng: np.random.Generator, draws: int, effect: float = 0.0, spread: float = 1.0) -> Estimate:
    """Return an estimate over draws of twelve objects, whose errors have the deviation `spread`; those of a draw have 1."""
    base, mind = rng.standard_normal(12), spread * rng.standard_normal(12)
    by_draw = []
    for noise in rng.standard_normal((draws, 12)):
        if kind == "order":
            by_draw.append(statistics.spearman(base, effect * base + mind + noise, 0))
        elif kind == "gain":
            by_draw.append(statistics.sign_flipped(effect + mind + noise, 0))
        elif kind == "closed":
            at = effect + float(noise[0])
            by_draw.append(Estimate(at, at, at, 12, limits=(-9.0, 9.0), closed=True))
        elif kind == "contrast":
            by_draw.append(statistics.mean(effect + mind + noise, 200, 0))
        else:
            leaning = mind + effect * np.where(CLASSES == "a", -1.0, 1.0) + rng.standard_normal((6, 12))
            by_draw.append(permuted_accuracy(list(np.where(leaning > 0, "b", "a")), FRAME, 0))
    return statistics.over_draws(by_draw, 200, 0)


def null_of(estimate: Estimate) -> float:
    return 0.0 if estimate.shuffled is None else float(estimate.shuffled.mean())


@pytest.mark.parametrize(
    ("kind", "draws"), [("closed", 3), *((kind, draws) for kind in ("order", "gain", "accuracy") for draws in (1, 3))]
)  # the p value of a contrast follows from its interval, whose coverage test_statistics.py tests
def test_without_an_effect_one_test_in_twenty_finds_one(kind: str, draws: int) -> None:
    rng = np.random.default_rng(1)
    estimates = [joined(kind, rng, draws) for _ in range(1000)]
    share = np.mean([estimate.p(null_of(estimate)) < 0.05 for estimate in estimates])
    print(f"{kind}, {draws} draws: {share:.1%}")
    assert 0.03 <= share <= 0.07


@pytest.mark.parametrize("kind", KINDS)
def test_more_draws_with_the_same_effect_lower_p(kind: str) -> None:
    """The median p over forty sets of objects falls with the number of draws."""
    effect = 0.8 if kind == "closed" else 0.4
    median = []
    for draws in (2, 4, 10):
        estimates = [joined(kind, np.random.default_rng(k), draws, effect, 0.3) for k in range(40)]
        median.append(np.median([estimate.p(null_of(estimate)) for estimate in estimates]))
    print(kind, median)
    assert all(later < earlier for earlier, later in itertools.pairwise(median))
    assert median[-1] < 0.05


@pytest.mark.parametrize("level", [0.9, 0.95, 0.99, 0.997])
def test_the_interval_excludes_a_value_exactly_if_its_p_is_below_the_level(level: float) -> None:
    rng = np.random.default_rng(4)
    tried = 0
    for effect in np.linspace(0, 1.5, 12):
        for kind in KINDS:
            estimate = joined(kind, rng, 3, effect)
            for null in (null_of(estimate), estimate.low - 1e-6, estimate.low + 1e-6, estimate.value - 0.1):
                low, high = statistics.at_level(estimate.value, estimate.low, estimate.high, level, estimate.degrees, estimate.scale)
                if min(abs(null - low), abs(null - high)) > 1e-9 and null > estimate.limits[0]:
                    assert (estimate.p(null) < 1 - level) == (not low <= null <= high), (estimate, null)
                    tried += 1
    assert tried > 200
