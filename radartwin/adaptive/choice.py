"""The greedy choice of the cheapest sufficient model, and why.

From the finest model, each dimension in the order of what it saves is taken down to the cheapest value that is enough: every feature stays
within its limit of the finest model's. What is left out stays out. A first time round each may use half of the tolerance that is left, so
that no one thing uses up what several others need; a second time all of it. So the choice is deterministic (it never reads a clock), meets
the tolerance by construction, and costs a few short recordings.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Protocol

from numpy.typing import NDArray

from radartwin.adaptive.limits import Limits
from radartwin.adaptive.model import FINEST, LADDER, Model, cheaper
from radartwin.errors import InputError

HALF = 0.5  # of what is left of the tolerance, that one thing may use in the first round
WORDS = {
    "parts": "parts of the room", "coupling": "ways between thing and room", "max_bounces": "bounces", "diffuse": "diffuse cloud",
    "rays_per_wavelength2": "tubes per square wavelength", "elements": "elements",
}  # fmt: skip


class Probe(Protocol):
    """What tells the features under a model: radartwin.adaptive.probe, or one that keeps what it traced."""

    def features(self, model: Model) -> tuple[Sequence[str], NDArray]: ...


@dataclass(frozen=True)
class Step:
    """One model tried: what was changed to which value, by how many limits the worst feature moved, and whether that was within."""

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
    """A model, its worst feature's error in limits against the finest, and the steps that led there."""

    model: Model
    error: float
    feature: str
    steps: tuple[Step, ...]

    def lines(self) -> list[str]:
        """What was chosen, then why."""
        first = f"{self.model.told} ({self.feature} within {self.error:.2g} of its limit)"
        return [first, *dict.fromkeys(f"  {step.told}" for step in self.steps)]  # what is refused twice is told once

    def to_dict(self) -> dict[str, Any]:
        return asdict(self)

    @classmethod
    def from_dict(cls, stored: Mapping[str, Any]) -> Choice:
        steps = tuple(Step(**one) for one in stored["steps"])
        return cls(Model(**stored["model"]), stored["error"], stored["feature"], steps)


def choose(probes: Sequence[tuple[Probe, Limits]], tolerance: float = 1.0, pinned: Mapping[str, Any] | None = None) -> Choice:
    """The cheapest model that is enough for every probe.

    Args:
        probes: one for the choice of a scene; several for one setting that is to serve them all.
        tolerance: of the limit that a feature may move.
        pinned: {dimension: value} that are not to be chosen; the finest model has them too.
    Raises:
        InputError: a tolerance that is not above zero, an unknown dimension.
    """
    if not tolerance > 0:
        raise InputError(f"tolerance must be above zero, not {tolerance:g}")
    if unknown := set(pinned or {}) - set(LADDER):
        raise InputError(f"{min(unknown)} is no dimension of a model; choose {', '.join(LADDER)}")
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
