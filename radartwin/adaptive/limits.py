"""Tolerated change of each feature: the repeatability limit of the measurement.

Two recordings of the same object, each with a new set-up, differ in a feature by less than its limit with a probability of 95 %. The limit
is sqrt(2) t s, with s the standard deviation between such recordings and t Student's quantile for its degrees of freedom (ISO 5725-6:1994,
4.1.4, which gives 2.8 s for very many). The limit of a whole range profile is the 95 % quantile of the root mean square difference of two
recordings. Limits are per object, but at least MIN_SHARE of the limit pooled over all objects, because a saturated feature, such as the
multipath share of an object much brighter than its room, seems too repeatable. The shipped limits are the testbed's
(experiments/generators/repeatability.py writes them).
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path

import numpy as np
from scipy import stats

from radartwin.errors import InputError

CONFIDENCE = 0.95
MIN_SHARE = 0.1  # of the pooled limit
SPAN_DB = 40.0  # bins further below the strongest bin of a profile do not count
PROFILE = "range_profile_db"  # root mean square over the bins of a range profile
SHIPPED = Path(__file__).parent / "repeatability.json"
_BIN = "profile_"


@dataclass(frozen=True)
class Limits:
    """Limits of the features of one motion and object.

    Attributes:
        of: {feature: limit}. source: of the limits, as text.
    """

    of: Mapping[str, float]
    source: str

    @classmethod
    def shipped(cls, motion: str, thing: str | None = None) -> Limits:
        """The limits of the testbed's recordings.

        Args:
            motion: turntable, radial, diagonal, depth or lateral.
            thing: object under test; an object without repeated recordings has the pooled limits.
        Raises:
            InputError: another motion.
        """
        stored = json.loads(SHIPPED.read_text(encoding="utf-8"))
        if motion not in stored["motions"]:
            raise InputError(f"there is no repeatability of {motion or 'such'} recordings; there is of {', '.join(stored['motions'])}")
        known = stored["motions"][motion]
        own = known["objects"].get(thing, known["pooled"])
        return cls({name: max(limit, MIN_SHARE * known["pooled"][name]) for name, limit in own.items()}, stored["source"])

    def moved(self, names: Sequence[str], values: np.ndarray, reference: np.ndarray) -> tuple[float, str]:
        """(change of the worst feature in limits, its name).

        Args:
            names, values, reference: (features,) of a model and of the finest model.
        Raises:
            InputError: a feature has no limit.
        """
        apart = distances(names, values, reference)
        if missing := [name for name in apart if not self.of.get(name, 0.0) > 0]:
            raise InputError(f"there is no repeatability of {missing[0]} ({self.source}); leave its family out")
        worst = max(apart, key=lambda name: apart[name] / self.of[name])
        return apart[worst] / self.of[worst], worst


def distances(names: Sequence[str], values: np.ndarray, reference: np.ndarray) -> dict[str, float]:
    """{feature: distance from the reference}; the bins of a range profile count as one feature, weak bins not at all."""
    apart = np.abs(np.asarray(values) - reference)
    bins = np.array([name.startswith(_BIN) for name in names])
    found = {name: float(d) for name, d, is_bin in zip(names, apart, bins, strict=True) if not is_bin}
    if bins.any():
        strong = bins & (np.maximum(values, reference) >= np.max(reference, where=bins, initial=-np.inf) - SPAN_DB)
        found[PROFILE] = float(np.sqrt(np.mean(apart[strong] ** 2)))
    return found


def measured(groups: Sequence[tuple[Sequence[str], np.ndarray]]) -> dict[str, float]:
    """{feature: limit} of repeated recordings, pooled over groups (ISO 5725-2:1994, 7.4).

    Args:
        groups: names and values (recordings, features) of two or more recordings of one object each.
    """
    freedom = sum(len(values) - 1 for _, values in groups)
    factor = np.sqrt(2) * stats.t.ppf(0.5 + CONFIDENCE / 2, freedom)
    squares: dict[str, float] = {}
    between: list[float] = []
    for names, values in groups:
        for name, s2 in zip(names, values.var(axis=0, ddof=1) * (len(values) - 1), strict=True):
            if not name.startswith(_BIN):
                squares[name] = squares.get(name, 0.0) + float(s2)
        between += [distance[PROFILE] for one, other in combinations(values, 2) if PROFILE in (distance := distances(names, one, other))]
    found = {name: float(factor * np.sqrt(s2 / freedom)) for name, s2 in squares.items()}
    return found | ({PROFILE: float(np.quantile(between, CONFIDENCE))} if between else {})
