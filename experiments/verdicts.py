"""Build table rows with a claim, the figure of the paper and our result, and judge the claim by the interval of the result."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from numpy.typing import ArrayLike

from experiments import statistics
from experiments.statistics import Estimate
from radartwin.config.config import Config
from radartwin.runs.experiment import JUDGED, LIMITS, VERDICTS
from radartwin.store.digest import spec_digest

SHOWN_KEYS = 12  # largest number of store keys that a table cell lists; the run's result holds all keys
ABOVE, BELOW, EQUAL = "above", "below", "none"  # directions of a claim; EQUAL is a claim of no effect
PRIMARY = "primary"  # the family of the headline's claims; only to this family, Holm's correction applies
SUPPORTED, SHOWN, UNDECIDED, CONTRADICTED, NOT_HERE = VERDICTS
HOLDS, MISSES = LIMITS


def judge(
    value: float | None, low: float | None, high: float | None, bound: float | None, direction: str | None, null: float | None,
    margin: float | None, reason: str = "",
) -> str:  # fmt: skip
    """Return the verdict on a row with a claim, from the columns of the row alone; "" for a row without a claim.

    A verdict is the first that fits of: "not testable here" (a row with a reason); "supported" if the whole interval lies beyond the bound;
    "direction shown" if it lies wholly beyond the null, which stands for no effect; "contradicted" if it lies wholly on the other side of
    the bound; "undecided". A claim of no effect is supported by an interval within the margin around the null, and contradicted by one
    wholly beyond the margin. An end of the interval that is None is infinite, and a value that is None decides nothing.

    >>> [judge(0.3, low, high, 0.2, ABOVE, 0.0, None) for low, high in ((0.25, 0.4), (0.1, 0.4), (-0.1, 0.4), (0.05, 0.15), (-0.2, 0.1))]
    ['supported', 'direction shown', 'undecided', 'direction shown', 'contradicted']
    """
    if not direction:
        return ""
    if reason:
        return NOT_HERE
    if value is None or not math.isfinite(value):
        return UNDECIDED
    low, high = (-math.inf if low is None else low), (math.inf if high is None else high)
    if direction == EQUAL:
        first, last = (null or 0.0) - (margin or 0.0), (null or 0.0) + (margin or 0.0)
        return SUPPORTED if first <= low and high <= last else CONTRADICTED if high < first or low > last else UNDECIDED
    assert bound is not None
    if direction == BELOW:
        low, high, bound, null = -high, -low, -bound, None if null is None else -null
    if low > bound:
        return SUPPORTED
    if null is not None and low > null:
        return SHOWN
    return CONTRADICTED if high < bound else UNDECIDED


def limit_kept(kept: bool | None) -> str:
    """Return the verdict of an engineering table on one limit: "holds" or "misses", or "" for None."""
    return "" if kept is None else HOLDS if kept else MISSES


@dataclass(frozen=True)
class Claim:
    """A claim about one table row, by the paper or by this project, with the condition that our result must meet.

    Bounds are minimum effects. docs/findings.md says when they were written. A claim without text is not judged.
    """

    text: str = ""
    paper: str = ""  # the value in the paper
    bound: float | None = None  # the whole confidence interval must lie beyond it, on the side `direction`
    direction: str = ABOVE  # ABOVE, BELOW, or for a claim of no effect EQUAL: within `margin` around `null`
    null: float | None = None  # value that stands for no effect; None stands for the bound
    margin: float | None = None
    least: int = 2  # smallest number of items that have an interval; a figure that is no estimate has 1
    limit: bool = False  # whether the claim is a limit of an engineering table, which says "holds" or "misses"
    untestable: str = ""  # reason why this testbed cannot decide the claim by construction

    def columns(self, estimate: Estimate) -> dict[str, Any]:
        """Return the columns of a row from which the verdict follows, with the verdict; an estimate without an error has no interval."""
        if not self.text or (self.bound is None and self.null is None):
            return {**dict.fromkeys(JUDGED), "reason": "", "verdict": ""}
        bound, null = (self.null if self.bound is None else self.bound), (self.bound if self.null is None else self.null)
        assert bound is not None
        assert null is not None
        if estimate.n < self.least or (self.least > 1 and estimate.drawn is not None and estimate.low == estimate.high):
            estimate = replace(estimate, low=-math.inf, high=math.inf)
        judged = [*map(_finite, (estimate.value, estimate.low, estimate.high)), bound, self.direction, null, self.margin, self.untestable]
        word = judge(*judged)  # type: ignore[arg-type]
        wide = math.isfinite(estimate.low) or math.isfinite(estimate.high)
        return {
            "bound": bound, "direction": self.direction, "null": null, "margin": self.margin, "level": statistics.LEVEL,
            "family": "", "test": estimate.test, "unit": estimate.unit, "p": _finite(estimate.p(null)) if wide else None,
            "freedom": estimate.degrees,
            "interval_scale": estimate.scale,
            "lowest": _finite(estimate.limits[0]),
            "highest": _finite(estimate.limits[1]), "reason": self.untestable, "low": judged[1], "high": judged[2],
            "verdict": limit_kept(None if judged[0] is None else word == SUPPORTED) if self.limit else word,
        }  # fmt: skip


def within(text: str, low: float, high: float, **fields: Any) -> Claim:
    """Return the claim that a quantity lies from `low` to `high`, which is a claim of no effect around their mean."""
    return Claim(text, direction=EQUAL, null=(low + high) / 2, margin=(high - low) / 2, **fields)


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


NONE = Claim()


@dataclass(eq=False)
class Row(dict[str, Any]):
    """A table row as a dictionary {column: value}, with the estimate, the claim and the store keys that the columns show."""

    case: Mapping[str, Any]  # columns that say what the row is about
    metric: str
    estimate: Estimate
    recordings: frozenset[str]  # store keys
    claim: Claim
    config: Config = field(repr=False)
    count: int | None = None  # column n; None stands for the number of keys, or without keys of items
    domain: str | None = None  # data with which the value was compared; None stands for the configured measured recordings
    panel: Any = field(default=None, repr=False)  # what a figure shows beside the row

    def __post_init__(self) -> None:
        estimate = self.estimate
        assert not set(self.case) & set(JUDGED), f"a column of {self.metric} has the name of a column of its claim"
        value, low, high = map(_finite, (estimate.value, estimate.low, estimate.high))
        judged = self.claim.columns(estimate)
        n = self.count if self.count is not None else len(self.recordings) or estimate.n
        self.update(
            {
                **self.case, "claim": self.claim.text, **{name: judged[name] for name in (*JUDGED, "reason")}, "items": estimate.n,
                "seed": self.config.seed, "run_keys": told(self.recordings), "metric": self.metric, "paper": self.claim.paper,
                "value": value, "low": judged.get("low", low), "high": judged.get("high", high), "n": n,
                "domain": self.domain or self.config.measured.provider, "verdict": judged["verdict"],
            }
        )  # fmt: skip


def told(keys: Iterable[str]) -> str:
    """Format store keys as one table cell: the shortened keys, or for more than SHOWN_KEYS keys their number and hash."""
    unique = sorted(set(keys))
    if len(unique) <= SHOWN_KEYS:
        return " ".join(key[:8] for key in unique)
    return f"{len(unique)} recordings {spec_digest(unique)[:8]}"


def score_columns(metric: str, estimate: Estimate, domain: str, kept: bool | None = None, keys: Iterable[str] = ()) -> dict[str, Any]:
    """Return the last columns of a row of an engineering table, with the verdict on its limit: kept, not kept, or None for no limit.

    A value or end of an interval that is not finite becomes None, and then has no verdict.
    """
    value, low, high = map(_finite, (estimate.value, estimate.low, estimate.high))
    return {
        "run_keys": told(keys), "metric": metric, "paper": None, "value": value, "low": low, "high": high, "n": estimate.n,
        "domain": domain, "verdict": limit_kept(None if value is None else kept),
    }  # fmt: skip


class RowList(list[Row]):
    """The list of the rows of one results table, with methods that append a row."""

    def __init__(self, config: Config):
        super().__init__()
        self.config = config

    def add(
        self, case: Mapping[str, Any], metric: str, estimate: Estimate, keys: Iterable[str], claim: Claim = NONE, count: int | None = None
    ) -> Row:
        """Append one row to the table and return it. `count` is the value of column n."""
        self.append(Row(case, metric, estimate, frozenset(keys), claim, self.config, count))
        return self[-1]

    def add_mean(
        self, case: Mapping[str, Any], metric: str, samples: ArrayLike, keys: Iterable[str], claim: Claim = NONE,
        limits: tuple[float, float] = statistics.ANY, on: str = "",
    ) -> Row:  # fmt: skip
        """Append a row with the mean of samples of a quantity within `limits`, and its bootstrap interval on the scale `on` (SCALES)."""
        estimate = statistics.mean(samples, self.config.profile.resamples, self.config.seed, limits, on=on)
        return self.add(case, metric, estimate, keys, claim)
