"""Greedy search for the cheapest sufficient model of a scene; the result lists every tried model and why it was accepted or refused.

The search starts at the finest model and lowers one setting of the model (a dimension, such as the number of bounces) after another,
beginning with the setting that saves most time. For each dimension, the search takes the cheapest value at which every feature stays close
to the feature under the finest model. The permitted difference (the tolerance) is by default the feature's repeatability limit. In the
first round each dimension may use half of the remaining tolerance, so that one dimension does not use up the tolerance that several others
need. In the second round each dimension may use all of the remaining tolerance. The search never reads a clock, so the result is
deterministic. Every model that the search accepts meets the tolerance, so the chosen model meets it too. The search simulates only a few
short recordings.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, Protocol

from numpy.typing import NDArray

from radartwin.adaptive.limits import Limits
from radartwin.adaptive.scene_settings import FINEST, LADDER, Model, cheaper
from radartwin.errors import InputError

HALF = 0.5  # fraction of the remaining tolerance that one dimension may use in the first round
WORDS = {
    "parts": "parts of the room", "coupling": "paths between object and room", "max_bounces": "bounces", "diffuse": "diffuse scatter",
    "rays_per_wavelength2": "ray tubes per square wavelength", "elements": "antenna elements",
}  # fmt: skip


class Probe(Protocol):
    """Compute the features of a few radar frames under a model. `radartwin.adaptive.probe.Probe` implements this interface, and so do
    substitutes in tests.
    """

    def features(self, model: Model) -> tuple[Sequence[str], NDArray]: ...


@dataclass(frozen=True)
class Step:
    """Describe one set of simulation settings (model) that the search tried.

    Attributes:
        dimension, value: name of the changed setting, such as "max_bounces", and its new value.
        error, feature: largest change of any feature from its value under the finest model, divided by its repeatability limit; and the
            name of this feature.
        taken: whether the search accepted the model.
    """

    dimension: str
    value: Any
    error: float
    feature: str
    taken: bool

    @property
    def told(self) -> str:
        verdict = "accepted" if self.taken else "rejected"
        return f"{WORDS[self.dimension]} {self.value}: {self.feature} changes by {self.error:.2g} times its repeatability limit, {verdict}"


@dataclass(frozen=True)
class Choice:
    """Hold the chosen model and all models that the search tried, in their order.

    Attributes:
        error, feature: largest change of any feature between the chosen and the finest model, as a multiple of the feature's repeatability
            limit, and the name of this feature.
    """

    model: Model
    error: float
    feature: str
    steps: tuple[Step, ...]

    def lines(self) -> list[str]:
        """Return one line of text for the chosen model, then one line for each tried model."""
        first = f"{self.model.told} ({self.feature} changes by {self.error:.2g} times its repeatability limit)"
        return [first, *dict.fromkeys(f"  {step.told}" for step in self.steps)]  # a model that both rounds refuse is listed once

    def to_dict(self) -> dict[str, Any]:
        return asdict(self)

    @classmethod
    def from_dict(cls, stored: Mapping[str, Any]) -> Choice:
        steps = tuple(Step(**step) for step in stored["steps"])
        return cls(Model(**stored["model"]), stored["error"], stored["feature"], steps)


def choose(probes: Sequence[tuple[Probe, Limits]], tolerance: float = 1.0, pinned: Mapping[str, Any] | None = None) -> Choice:
    """Return the cheapest model (set of simulation settings) that changes no feature of any probe by more than the tolerance.

    Args:
        probes: pairs of a probe (a few radar frames) and its repeatability limits. With several probes, the same model must suffice for all
            probes.
        tolerance: permitted change of a feature, as a multiple of its repeatability limit.
        pinned: {setting: value} of the settings that the search must not change; the finest model has the same fixed values.
    Raises:
        InputError: the tolerance is not above zero, or `pinned` names an unknown setting.
    """
    if not tolerance > 0:
        raise InputError(f"tolerance must be above zero, not {tolerance:g}")
    if unknown := set(pinned or {}) - set(LADDER):
        raise InputError(f"{min(unknown)} is not a setting that the search changes; choose {', '.join(LADDER)}")
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
