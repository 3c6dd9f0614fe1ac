"""Claims of the paper with the conditions under which they hold, and the table row that shows claim and result."""

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

SHOWN_KEYS = 12  # in a cell; the run's result holds all keys


@dataclass(frozen=True)
class Claim:
    """A claim of the paper about a row, the paper's value, and the condition on our interval.

    Attributes:
        above, below: bounds between which the whole interval must lie.
        contains: a value inside the interval, for a claim of no effect.
        p_below: the level that p must not reach.
        least: required number of items; a single item has no interval.
    """

    text: str = ""
    paper: str = ""
    above: float = -math.inf
    below: float = math.inf
    contains: float | None = None
    p_below: float | None = None
    least: int = 2

    def verdict(self, low: float, high: float, n: int, p: float = math.nan) -> str:
        """holds, fails or untestable."""
        if not self.text or n < self.least or math.isnan(low) or math.isnan(high):
            return "untestable"
        true = (self.above == -math.inf or self.above < low) and (self.below == math.inf or high < self.below)
        true &= self.contains is None or low <= self.contains <= high
        true &= self.p_below is None or p < self.p_below
        return "holds" if true else "fails"


NONE = Claim()


def row(config: Config, case: Mapping[str, Any], metric: str, found: Estimate, keys: Iterable[str], claim: Claim = NONE) -> dict[str, Any]:
    """One row: the columns of `case`, then claim, p, number of items, seed, keys of the recordings, and the score columns.

    n counts recordings if there are any; the verdict uses the number of items. A value that is not finite becomes None and untestable; a
    bound that is not finite becomes None.
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
    """The keys of a row's recordings as one cell, or their number and digest if there are more than SHOWN_KEYS."""
    unique = sorted(set(keys))
    if len(unique) <= SHOWN_KEYS:
        return " ".join(key[:8] for key in unique)
    return f"{len(unique)} recordings {spec_digest(unique)[:8]}"


class RowList(list[dict[str, Any]]):
    """The rows of one table."""

    def __init__(self, config: Config):
        super().__init__()
        self.config = config

    def add(self, case: Mapping[str, Any], metric: str, found: Estimate, keys: Iterable[str], claim: Claim = NONE) -> None:
        """Append one row; arguments as `row`."""
        self.append(row(self.config, case, metric, found, keys, claim))

    def add_mean(self, case: Mapping[str, Any], metric: str, samples: ArrayLike, keys: Iterable[str], claim: Claim = NONE) -> None:
        """Append the mean of the samples with its bootstrap interval."""
        self.add(case, metric, statistics.mean(samples, self.config.profile.resamples, self.config.seed), keys, claim)
