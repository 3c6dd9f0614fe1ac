"""Build table rows with a claim, the figure of the paper and our result, and decide whether the claim holds."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from numpy.typing import ArrayLike

from experiments import statistics
from experiments.statistics import Estimate
from radartwin.config.config import Config
from radartwin.store.digest import spec_digest

SHOWN_KEYS = 12  # largest number of store keys that a table cell lists; the run's result holds all keys
NO_WIDTH = "the interval has no width"
TOO_WIDE = "the interval is too wide to show no effect"
LEVEL = 0.05  # a claim holds only if its corrected p value is below this


def verdict(holds: bool | None) -> str:
    """Return "holds", "fails", or "untestable" for None."""
    return "untestable" if holds is None else "holds" if holds else "fails"


@dataclass(frozen=True)
class Claim:
    """A claim about one table row, by the paper or by this project, with the condition that our result must meet so that the claim holds.

    Bounds are minimum effects: a module states them before its table is computed (`gap_attribution` says where it did so later). A claim
    without text is not judged.
    """

    text: str = ""  # the claim in words
    paper: str = ""  # the value in the paper
    above: float = -math.inf  # our whole confidence interval must lie above this value
    below: float = math.inf  # our whole confidence interval must lie below this value
    contains: float | None = None  # value from which our whole interval may differ by at most `margin`; used for a claim of no effect
    reaches: float | None = None  # value that our interval must not exceed; used for a claim that the quantity is at most this value
    margin: float = 0.0  # largest deviation from `contains` or `reaches` that still counts as no effect
    p_below: float | None = None  # our p value must be smaller than this
    least: int = 2  # smallest number of items for a verdict; the default is 2, because a single item has no interval
    untestable: str = ""  # reason why these recordings cannot decide the claim

    @property
    def bounds_an_effect(self) -> bool:
        return (self.above, self.below) != (-math.inf, math.inf)

    @property
    def bounded(self) -> bool:
        """Whether the claim states a condition on our interval."""
        return self.bounds_an_effect or (self.contains, self.reaches) != (None, None)

    def judge(self, found: Estimate) -> tuple[str, str]:
        """Return the verdict "holds", "fails" or "untestable" on an estimate, and the reason for "untestable"."""
        if not self.text or self.untestable:
            return "untestable", self.untestable
        if not math.isfinite(found.value) or math.isnan(found.low) or math.isnan(found.high):
            return "untestable", "the value is not finite"
        if found.n < self.least:
            return "untestable", f"{found.n} of at least {self.least} items"
        if found.drawn is not None and found.low == found.high:
            return "untestable", NO_WIDTH
        if self.contains is not None or self.reaches is not None:
            return self._judge_no_effect(found)
        if self.p_below is not None and found.least_p >= self.p_below:
            return "untestable", f"p is {found.least_p:.2g} or more for so few items"
        true = (self.above == -math.inf or self.above < found.low) and (self.below == math.inf or found.high < self.below)
        true &= self.p_below is None or found.p < self.p_below
        return verdict(true), ""

    def _judge_no_effect(self, found: Estimate) -> tuple[str, str]:
        """Judge a claim of no effect. The claim holds if the whole interval is within the margin around the stated value, and fails if the
        interval excludes this value.
        """
        both_sides = self.contains is not None
        value = self.contains if self.contains is not None else self.reaches
        assert value is not None
        if found.high <= value + self.margin and (not both_sides or value - self.margin <= found.low):
            return "holds", ""
        if found.low > value or (both_sides and found.high < value):
            return "fails", ""
        return "untestable", TOO_WIDE

    def p_of(self, found: Estimate) -> float:
        """Return the p value of the claim: that of the claim's own test, or else the one that follows from the interval and the bounds.

        With two bounds, the p value is the larger one. A claim without its own test has the p value NaN if it states no minimum effect, or
        if the interval does not come from a bootstrap.
        """
        if self.p_below is not None:
            return found.p
        if found.drawn is None or not self.bounds_an_effect:
            return math.nan
        p = []
        for bound, beyond in ((self.above, found.value > self.above), (self.below, found.value < self.below)):
            if math.isfinite(bound):
                one = found.p_beyond(bound)
                p.append(one if beyond else 1 - one)
        return max(p)


NONE = Claim()


@dataclass(eq=False)
class Row(dict[str, Any]):
    """A table row as a dictionary {column: value}, with the estimate, the claim and the store keys that the columns show.

    Attributes:
        case: columns that say what the row is about.
        recordings: store keys of the recordings.
        count: number that column n shows; None stands for the number of keys, or without keys for the number of items.
        domain: data with which the value was compared; None stands for the configured measured recordings.
    """

    case: Mapping[str, Any]
    metric: str
    found: Estimate
    recordings: frozenset[str]
    claim: Claim
    config: Config = field(repr=False)
    count: int | None = None
    domain: str | None = None

    def __post_init__(self) -> None:
        found = self.found
        value, low, high = (one if math.isfinite(one) else None for one in (found.value, found.low, found.high))
        verdict, reason = self.claim.judge(found)
        n = self.count if self.count is not None else len(self.recordings) or found.n
        self.update(
            {
                **self.case, "claim": self.claim.text, "p": None if math.isnan(found.p) else found.p, "reason": reason, "items": found.n,
                "seed": self.config.seed, "run_keys": told(self.recordings), "metric": self.metric, "paper": self.claim.paper,
                "value": value, "low": low, "high": high, "n": n,
                "domain": self.domain or self.config.measured.provider, "verdict": verdict,
            }
        )  # fmt: skip


def row(config: Config, case: Mapping[str, Any], metric: str, found: Estimate, keys: Iterable[str], claim: Claim = NONE) -> Row:
    """Build one table row from the columns `case`, an estimate, the store keys of the recordings used, and the claim.

    Column n shows the number of recordings if the row has store keys, else the number of items; the verdict always uses the number of
    items. A value or bound that is not finite becomes None. A row whose value is None has the verdict "untestable".
    """
    return Row(case, metric, found, frozenset(keys), claim, config)


def told(keys: Iterable[str]) -> str:
    """Format store keys as one table cell: the shortened keys, or for more than SHOWN_KEYS keys their number and hash."""
    unique = sorted(set(keys))
    if len(unique) <= SHOWN_KEYS:
        return " ".join(key[:8] for key in unique)
    return f"{len(unique)} recordings {spec_digest(unique)[:8]}"


class RowList(list[Row]):
    """The list of the rows of one results table, with methods that append a row."""

    def __init__(self, config: Config):
        super().__init__()
        self.config = config

    def add(
        self, case: Mapping[str, Any], metric: str, found: Estimate, keys: Iterable[str], claim: Claim = NONE, count: int | None = None
    ) -> Row:
        """Append one row to the table and return it. The arguments are those of the function `row`; `count` is the value of column n."""
        self.append(Row(case, metric, found, frozenset(keys), claim, self.config, count))
        return self[-1]

    def add_mean(
        self, case: Mapping[str, Any], metric: str, samples: ArrayLike, keys: Iterable[str], claim: Claim = NONE,
        limits: tuple[float, float] = statistics.ANY,
    ) -> Row:  # fmt: skip
        """Append one row with the mean of the samples and its confidence interval from a bootstrap over the samples.

        Args:
            limits: smallest and largest value that the quantity can have.
        """
        return self.add(case, metric, statistics.mean(samples, self.config.profile.resamples, self.config.seed, limits), keys, claim)


def corrected(rows: Sequence[Row]) -> list[Row]:
    """Return the rows with verdicts from p values that are corrected for the number of tests.

    The rows whose claim has a p value (`Claim.p_of`) are one family of tests. A claim of the family holds only if its corrected p value is
    also below LEVEL. A claim whose smallest possible p value would not be below LEVEL after the correction is untestable. Column p_holm
    shows the p value after Holm's correction (S. Holm, Scandinavian Journal of Statistics 6 (1979) 65), and column p the p value of the
    single test.
    """
    single = {id(one): one.claim.p_of(one.found) for one in rows if one["verdict"] != "untestable"}
    single = {key: p for key, p in single.items() if not math.isnan(p)}
    adjusted = dict(zip(single, statistics.holm(list(single.values())), strict=True))
    out = []
    for one in rows:
        judged = one
        if (p := adjusted.get(id(one))) is not None:
            claim = replace(one.claim, p_below=one.claim.p_below or LEVEL)
            least = 0.0 if one.claim.p_below is None else one.found.least_p
            tests = sum(other >= least for other in single.values())  # Holm multiplies the smallest possible p value by this number
            judged = replace(one, found=replace(one.found, p=p, least_p=min(1.0, tests * least)), claim=claim)
        judged |= {"p": single.get(id(one), one["p"]), "p_holm": p}
        out.append(judged)
    return out
