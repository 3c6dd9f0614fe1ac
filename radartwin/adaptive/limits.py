"""How far a feature may move before it matters: the repeatability limit of the measurement.

Two recordings of the same thing, each set up anew, differ in a feature by less than its limit with a probability of 95 %: sqrt(2) t s, s
the standard deviation between such recordings and t Student's of its degrees of freedom (ISO 5725-6:1994, 4.1.4, which has 2.8 s of very
many); of a whole range profile, the 95 % quantile of the root mean square difference of two. Of one object, but no less than LEAST of what
is pooled over all: a feature that saturates, as the multipath share of what outshines its room, is no better known than that. The shipped
figures are the testbed's (experiments/generators/repeatability.py writes them).
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
LEAST = 0.1
HEARD_DB = 40.0  # below the strongest bin of a profile, under which bins do not count
PROFILE = "range_profile_db"  # all bins of one, as their root mean square
SHIPPED = Path(__file__).parent / "repeatability.json"
_BIN = "profile_"


@dataclass(frozen=True)
class Limits:
    """Attributes:
    of: {feature: limit}, of one motion and thing. source: in words.
    """

    of: Mapping[str, float]
    source: str

    @classmethod
    def shipped(cls, motion: str, thing: str | None = None) -> Limits:
        """Of the testbed's recordings.

        Args:
            motion: turntable, radial, diagonal, depth or lateral.
            thing: under test; one that the testbed has not repeated has what all have in the mean.
        Raises:
            InputError: another motion.
        """
        stored = json.loads(SHIPPED.read_text(encoding="utf-8"))
        if motion not in stored["motions"]:
            raise InputError(f"there is no repeatability of {motion or 'such'} recordings; there is of {', '.join(stored['motions'])}")
        known = stored["motions"][motion]
        own = known["objects"].get(thing, known["pooled"])
        return cls({name: max(limit, LEAST * known["pooled"][name]) for name, limit in own.items()}, stored["source"])

    def moved(self, names: Sequence[str], values: np.ndarray, reference: np.ndarray) -> tuple[float, str]:
        """By how many limits the worst feature moves, and which one that is.

        Args:
            names, values, reference: (features,) of a model and of the finest one.
        Raises:
            InputError: a feature without a limit.
        """
        apart = distances(names, values, reference)
        if missing := [name for name in apart if not self.of.get(name, 0.0) > 0]:
            raise InputError(f"there is no repeatability of {missing[0]} ({self.source}); leave its family out")
        worst = max(apart, key=lambda name: apart[name] / self.of[name])
        return apart[worst] / self.of[worst], worst


def distances(names: Sequence[str], values: np.ndarray, reference: np.ndarray) -> dict[str, float]:
    """{feature: how far it is from the reference}; the bins of a range profile as one, of those that either hears."""
    apart = np.abs(np.asarray(values) - reference)
    bins = np.array([name.startswith(_BIN) for name in names])
    found = {name: float(d) for name, d, is_bin in zip(names, apart, bins, strict=True) if not is_bin}
    if bins.any():
        heard = bins & (np.maximum(values, reference) >= np.max(reference, where=bins, initial=-np.inf) - HEARD_DB)
        found[PROFILE] = float(np.sqrt(np.mean(apart[heard] ** 2)))
    return found


def measured(groups: Sequence[tuple[Sequence[str], np.ndarray]]) -> dict[str, float]:
    """{feature: limit} of repeated recordings, pooled over groups (ISO 5725-2:1994, 7.4).

    Args:
        groups: names and values (recordings, features) of the recordings of one thing, two or more.
    """
    freedom = sum(len(values) - 1 for _, values in groups)
    factor = np.sqrt(2) * stats.t.ppf(0.5 + CONFIDENCE / 2, freedom)
    squares: dict[str, float] = {}
    between: list[float] = []
    for names, values in groups:
        for name, s2 in zip(names, values.var(axis=0, ddof=1) * (len(values) - 1), strict=True):
            if not name.startswith(_BIN):
                squares[name] = squares.get(name, 0.0) + float(s2)
        between += [told[PROFILE] for one, other in combinations(values, 2) if PROFILE in (told := distances(names, one, other))]
    found = {name: float(factor * np.sqrt(s2 / freedom)) for name, s2 in squares.items()}
    return found | ({PROFILE: float(np.quantile(between, CONFIDENCE))} if between else {})
