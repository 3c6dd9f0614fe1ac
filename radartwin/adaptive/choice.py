"""Greedy choice of the cheapest sufficient model, with the reasons.

The search starts at the finest model. In the order of their savings, it lowers each dimension to the cheapest value for which every feature
stays within its limit of the finest model. In a first round each dimension may use half of the remaining tolerance, so that one dimension
does not use up the tolerance that several others need; in a second round it may use all of it. The choice never reads a clock, so it is
deterministic. It meets the tolerance by construction and costs a few short recordings.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Protocol

from numpy.typing import NDArray

from radartwin.adaptive.limits import Limits
from radartwin.adaptive.model import FINEST, LADDER, Model, cheaper
from radartwin.errors import InputError

HALF = 0.5  # share of the remaining tolerance that one dimension may use in the first round
WORDS = {
    "parts": "parts of the room", "coupling": "ways between thing and room", "max_bounces": "bounces", "diffuse": "diffuse cloud",
    "rays_per_wavelength2": "tubes per square wavelength", "elements": "elements",
}  # fmt: skip


class Probe(Protocol):
    """Source of the features under a model: radartwin.adaptive.probe, or a substitute in tests."""

    def features(self, model: Model) -> tuple[Sequence[str], NDArray]: ...


@dataclass(frozen=True)
class Step:
    """One tried model: the changed dimension and value, the change of the worst feature in limits, and whether the model was taken."""

    dimension: str
    value: Any
    error: float
    feature: str
    taken: bool

    @property
    def told(self) -> str:
        verdict = "enough" if self.taken else "too little"
        return f"{WORDS[self.dimension]} {self.value}: {self.feature} moves {self.error:.2g} of its limit, {verdict}"


@dataclass(frozen=True)
class Choice:
    """A model, the error of its worst feature against the finest model in limits, and the steps of the search."""

    model: Model
    error: float
    feature: str
    steps: tuple[Step, ...]

    def lines(self) -> list[str]:
        """The chosen model, then the steps."""
        first = f"{self.model.told} ({self.feature} within {self.error:.2g} of its limit)"
        return [first, *dict.fromkeys(f"  {step.told}" for step in self.steps)]  # a model that is refused twice has one line

    def to_dict(self) -> dict[str, Any]:
        return asdict(self)

    @classmethod
    def from_dict(cls, stored: Mapping[str, Any]) -> Choice:
        steps = tuple(Step(**one) for one in stored["steps"])
        return cls(Model(**stored["model"]), stored["error"], stored["feature"], steps)


def choose(probes: Sequence[tuple[Probe, Limits]], tolerance: float = 1.0, pinned: Mapping[str, Any] | None = None) -> Choice:
    """The cheapest model that is sufficient for every probe.

    Args:
        probes: one for the choice of a scene, or several for one setting that must serve them all.
        tolerance: permitted change of a feature, in limits.
        pinned: {dimension: value} that are fixed, also in the finest model.
    Raises:
        InputError: the tolerance is not above zero, or a dimension is unknown.
    """
    if not tolerance > 0:
        raise InputError(f"tolerance must be above zero, not {tolerance:g}")
    if unknown := set(pinned or {}) - set(LADDER):
        raise InputError(f"{min(unknown)} is not a dimension of a model; choose {', '.join(LADDER)}")
    finest = replace(FINEST, **(pinned or {}))

    def error(model: Model) -> tuple[float, str]:
        return max(_moved(probe, limits, model, finest) for probe, limits in probes)

    model, reached, steps = finest, (0.0, "nothing"), []
    for share in (HALF, 1.0):
        for dimension in (name for name in LADDER if name not in (pinned or {})):
            for candidate in cheaper(model, dimension):
                moved, feature = error(candidate)
                taken = moved <= reached[0] + share * (tolerance - reached[0])
                steps.append(Step(dimension, getattr(candidate, dimension), moved, feature, taken))
                if taken:
                    model, reached = candidate, (moved, feature)
                    break
    return Choice(model, *reached, tuple(steps))


def _moved(probe: Probe, limits: Limits, model: Model, finest: Model) -> tuple[float, str]:
    names, reference = probe.features(finest)
    return limits.moved(names, probe.features(model)[1], reference)
