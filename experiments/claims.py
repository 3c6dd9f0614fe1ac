"""Build table rows that compare a claim of the paper with our result, and decide whether the claim holds."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from numpy.typing import ArrayLike

from experiments import statistics
from experiments.statistics import Estimate
from radartwin.config.config import Config
from radartwin.store.digest import spec_digest

SHOWN_KEYS = 12  # store keys that a table cell shows; the run's result holds all keys


@dataclass(frozen=True)
class Claim:
    """A claim of the paper about one table row, with the condition that our result must meet so that the claim holds."""

    text: str = ""  # the claim in words
    paper: str = ""  # the value in the paper
    above: float = -math.inf  # lower bound of our whole confidence interval
    below: float = math.inf  # upper bound of our whole confidence interval
    contains: float | None = None  # value that our interval must contain; used for a claim of no effect
    p_below: float | None = None  # our p value must be smaller than this
    least: int = 2  # smallest number of items for a verdict; the default is 2, because a single item has no interval

    def verdict(self, low: float, high: float, n: int, p: float = math.nan) -> str:
        """Return whether the claim "holds", "fails" or is "untestable" for a confidence interval (low, high) over n items."""
        if not self.text or n < self.least or math.isnan(low) or math.isnan(high):
            return "untestable"
        true = (self.above == -math.inf or self.above < low) and (self.below == math.inf or high < self.below)
        true &= self.contains is None or low <= self.contains <= high
        true &= self.p_below is None or p < self.p_below
        return "holds" if true else "fails"


NONE = Claim()


def row(config: Config, case: Mapping[str, Any], metric: str, found: Estimate, keys: Iterable[str], claim: Claim = NONE) -> dict[str, Any]:
    """Build one table row from the columns `case`, an estimate, the store keys of the recordings used, and the claim.

    Column n shows the number of recordings if the row has store keys, else the number of items; the verdict always uses the number of
    items. A value or bound that is not finite becomes None. A row whose value is None has the verdict "untestable".
    """
    keys = set(keys)
    value, low, high = (one if math.isfinite(one) else None for one in (found.value, found.low, found.high))
    verdict = "untestable" if value is None else claim.verdict(found.low, found.high, found.n, found.p)
    return {
        **case, "claim": claim.text, "p": None if math.isnan(found.p) else found.p, "items": found.n, "seed": config.seed,
        "run_keys": told(keys), "metric": metric, "paper": claim.paper, "value": value, "low": low, "high": high, "n": len(keys) or found.n,
        "domain": config.measured.provider, "verdict": verdict,
    }  # fmt: skip


def told(keys: Iterable[str]) -> str:
    """Format store keys as one table cell: the shortened keys, or for more than SHOWN_KEYS keys their number and hash."""
    unique = sorted(set(keys))
    if len(unique) <= SHOWN_KEYS:
        return " ".join(key[:8] for key in unique)
    return f"{len(unique)} recordings {spec_digest(unique)[:8]}"


class RowList(list[dict[str, Any]]):
    """The list of the rows of one results table, with methods that append a row."""

    def __init__(self, config: Config):
        super().__init__()
        self.config = config

    def add(self, case: Mapping[str, Any], metric: str, found: Estimate, keys: Iterable[str], claim: Claim = NONE) -> None:
        """Append one row to the table; the arguments are those of the function `row`."""
        self.append(row(self.config, case, metric, found, keys, claim))

    def add_mean(self, case: Mapping[str, Any], metric: str, samples: ArrayLike, keys: Iterable[str], claim: Claim = NONE) -> None:
        """Append one row with the mean of the samples and its confidence interval from a bootstrap over the samples."""
        self.add(case, metric, statistics.mean(samples, self.config.profile.resamples, self.config.seed), keys, claim)
