"""Repeatability limit of each radar feature: the largest change that a simulation setting may cause.

If the same object is set up and recorded twice, a feature of the two recordings differs by less than its repeatability limit with a
probability of 95 %. The repeatability limit of a feature is sqrt(2) t s, with s the standard deviation of the feature between repeated
recordings and t Student's quantile for the degrees of freedom of s (ISO 5725-6:1994, 4.1.4; the limit tends to 2.8 s for many recordings).
The repeatability limit of a whole range profile is the 95 % quantile of the root mean square difference in decibels between the profiles of
two recordings. Each object has its own limits, but no limit is below MIN_SHARE times the limit pooled over all objects. Without the lower
bound MIN_SHARE, a feature that hardly varies would get a limit that is too small, for example the multipath power fraction of an object
much brighter than its room. The shipped limits come from simulated recordings of the testbed, the virtual measurement campaign;
experiments/generators/repeatability.py writes them.
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
MIN_SHARE = 0.1  # smallest limit of an object, relative to the limit pooled over objects
SPAN_DB = 40.0  # range bins weaker than the strongest bin by more than this are ignored
PROFILE = "range_profile_db"  # feature name of the root mean square difference over the bins of a range profile
SHIPPED = Path(__file__).parent / "repeatability.json"
_BIN = "profile_"


@dataclass(frozen=True)
class Limits:
    """Hold the repeatability limits of the features of one object under one motion (such as "turntable").

    Attributes:
        of: {feature name: repeatability limit, in the unit of the feature}.
        source: text that names the recordings from which the limits were computed.
    """

    of: Mapping[str, float]
    source: str

    @classmethod
    def shipped(cls, motion: str, thing: str | None = None) -> Limits:
        """Read the shipped repeatability limits, which were computed from simulated recordings of the testbed.

        Args:
            motion: "turntable", "radial" (along a rail), "diagonal", "depth" (drive towards the object and back) or "lateral" (drive past
                the object, at right angles to the line of sight).
            thing: name of the object under test. For None, and for an object without repeated recordings, the function returns the limits
                pooled over all objects.
        Raises:
            InputError: RadarTwin ships no repeatability limits for this motion.
        """
        stored = json.loads(SHIPPED.read_text(encoding="utf-8"))
        if motion not in stored["motions"]:
            raise InputError(f"no repeatability limits are known for motion {motion!r}; choose {', '.join(stored['motions'])}")
        known = stored["motions"][motion]
        limits = known["objects"].get(thing, known["pooled"])
        return cls({name: max(limit, MIN_SHARE * known["pooled"][name]) for name, limit in limits.items()}, stored["source"])

    def moved(self, names: Sequence[str], values: np.ndarray, reference: np.ndarray) -> tuple[float, str]:
        """Return the largest change of a feature, as a multiple of the feature's repeatability limit, and the name of this feature.

        Args:
            names: feature names. values, reference: feature values, shape (features,), under the tested model and under the finest model.
        Raises:
            InputError: a feature has no repeatability limit.
        """
        apart = distances(names, values, reference)
        if missing := [name for name in apart if not self.of.get(name, 0.0) > 0]:
            raise InputError(f"no repeatability limit is known for feature {missing[0]} ({self.source}); leave its feature family out")
        worst = max(apart, key=lambda name: apart[name] / self.of[name])
        return apart[worst] / self.of[worst], worst


def distances(names: Sequence[str], values: np.ndarray, reference: np.ndarray) -> dict[str, float]:
    """Return {feature: absolute difference from the reference}. The strong bins of a range profile count as a single feature, which is
    named PROFILE.
    """
    apart = np.abs(np.asarray(values) - reference)
    bins = np.array([name.startswith(_BIN) for name in names])
    by_feature = {name: float(d) for name, d, is_bin in zip(names, apart, bins, strict=True) if not is_bin}
    if bins.any():
        strong = bins & (np.maximum(values, reference) >= np.max(reference, where=bins, initial=-np.inf) - SPAN_DB)
        by_feature[PROFILE] = float(np.sqrt(np.mean(apart[strong] ** 2)))
    return by_feature


def measured(groups: Sequence[tuple[Sequence[str], np.ndarray]]) -> dict[str, float]:
    """Return {feature: repeatability limit} from repeated recordings, pooled over the groups (ISO 5725-2:1994, 7.4).

    Args:
        groups: one entry per object: the feature names and the feature values, shape (recordings, features), of at least two recordings.
    """
    freedom = sum(len(values) - 1 for _, values in groups)
    factor = np.sqrt(2) * stats.t.ppf(0.5 + CONFIDENCE / 2, freedom)
    squares: dict[str, float] = {}
    between: list[float] = []
    for names, values in groups:
        for name, s2 in zip(names, values.var(axis=0, ddof=1) * (len(values) - 1), strict=True):
            if not name.startswith(_BIN):
                squares[name] = squares.get(name, 0.0) + float(s2)
        between += [
            distance[PROFILE] for first, second in combinations(values, 2) if PROFILE in (distance := distances(names, first, second))
        ]
    limits = {name: float(factor * np.sqrt(s2 / freedom)) for name, s2 in squares.items()}
    return limits | ({PROFILE: float(np.quantile(between, CONFIDENCE))} if between else {})
