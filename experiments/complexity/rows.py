"""Rows of the complexity table: the chosen model of each case, the run time it saves, and the claims about all cases."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from experiments.campaign.cases import Case
from experiments.claims import NONE, Claim, row
from experiments.complexity import timing
from experiments.statistics import Estimate
from radartwin.adaptive.choice import Choice
from radartwin.adaptive.model import LADDER, Model
from radartwin.config.config import Config
from radartwin.features.families import SETS

CHEAPER = 3.0  # claimed median of the run time of the fixed default over that of auto
SHAPE, MULTIPATH, EVERYTHING = "shape", "multipath share", "everything"
OWN = tuple(name for name in SETS if name != "raw")  # feature sets named after motions; the median over cases uses these
REFLECTOR = Case("corner_reflector", "lab", "turntable", 2.0)
AUTO, FIXED, SHIPPED = "auto", "fixed", "shipped"
SAVED = "cost of the fixed default over auto's"
NEEDED = "parts of the room that are needed (0 none, 1 large, 2 whole)"


@dataclass(frozen=True)
class Found:
    """The result for one scene, object and feature set.

    Attributes:
        name, asked: names of the case and of the feature set.
        choice: the choice of simulator=auto.
        models: models by the names AUTO, FIXED and SHIPPED.
        errors: (error in repeatability limits, worst feature) of each model, on the frames of the choice.
        between: the same on the held-out frames.
        layers: error of the shipped default without layered materials, on the frames of the choice.
        seconds: core seconds per frame of each model, one value per round.
        choosing_s: core seconds of all recordings that the choice needed.
    """

    name: str
    asked: str
    choice: Choice
    models: dict[str, Model]
    errors: dict[str, tuple[float, str]]
    between: dict[str, tuple[float, str]]
    layers: tuple[float, str]
    seconds: dict[str, list[float]]
    choosing_s: float

    @property
    def saved(self) -> float:
        """Return the run time of the fixed default divided by that of auto."""
        return timing.ratio(self.seconds[FIXED], self.seconds[AUTO])


def table(config: Config, found: Sequence[Found], fixed: Choice) -> list[dict[str, Any]]:
    """Return rows with the chosen model, saved run time and held-out error of each case, then the claims about all cases."""
    rows = []
    for one in found:
        case = {"case": one.name, "features": one.asked} | columns_of(one)
        ratios = np.array(one.seconds[FIXED]) / np.array(one.seconds[AUTO])
        rows.append(_row(config, case, SAVED, (one.saved, ratios.min(), ratios.max()), len(ratios)))
        error = one.between[AUTO][0]
        rows.append(_row(config, case, "error between the frames of the choice (limits)", _alone(error), 1, SUFFICIENT))
        if REFLECTOR.object in one.name and "lab" in one.name and one.asked in ROOM_CLAIMS:
            parts = float(LADDER["parts"].index(one.choice.model.parts))
            rows.append(_row(config, case, NEEDED, _alone(parts), 1, ROOM_CLAIMS[one.asked]))
    every = {"case": "all", "features": "own sets"} | dict.fromkeys(columns_of(found[0]))
    own = [one for one in found if one.asked in OWN]
    claim = Claim(f"auto is at least {CHEAPER:g} times cheaper in the median", above=CHEAPER)
    rows.append(_row(config, every, f"{SAVED}, median", _median([one.saved for one in own], config), len(own), claim))
    every["features"] = "all sets"
    for who, name in ((SHIPPED, "shipped"), (FIXED, "fixed")):
        worst = max(found, key=lambda one, who=who: one.between[who][0])
        case = every | {"model": worst.models[who].told, "worst feature": worst.between[who][1], "why": _why(fixed) if who == FIXED else ""}
        metric = f"error of the {name} default between the frames of the choice, worst of all (limits)"
        rows.append(_row(config, case, metric, _alone(worst.between[who][0]), len(found), SUFFICIENT))
    dearer = [timing.ratio(one.seconds[SHIPPED], one.seconds[FIXED]) for one in own]
    claim = Claim("no setting that is known to do for all is more than 10 % cheaper than the shipped default", below=1.1)
    case = every | {"model": fixed.model.told}
    rows.append(_row(config, case, "cost of the shipped default over the fixed one's, median", _median(dearer, config), len(dearer), claim))
    return rows


SUFFICIENT = Claim("every feature within its repeatability", below=1.0, least=1)
ROOM_CLAIMS = {
    SHAPE: Claim("its shape needs no room", below=0.5, least=1),
    MULTIPATH: Claim("its multipath share needs a room", above=0.5, least=1),
}


def columns_of(one: Found) -> dict[str, Any]:
    """Return the columns that describe a case: its models, errors, run times and reasons."""
    model = one.choice.model
    auto_s, fixed_s, shipped_s = (float(np.median(one.seconds[who])) for who in (AUTO, FIXED, SHIPPED))
    return {
        "model": model.told, **{name: getattr(model, name) for name in LADDER},
        "error (limits)": one.errors[AUTO][0], "worst feature": one.errors[AUTO][1], "between": one.between[AUTO][0],
        "without layers": one.layers[0], "fixed default": one.models[FIXED].told, "fixed, between": one.between[FIXED][0],
        "shipped, between": one.between[SHIPPED][0], "auto (s/frame)": auto_s, "fixed (s/frame)": fixed_s, "shipped (s/frame)": shipped_s,
        "choosing (s)": one.choosing_s, "pays after (frames)": one.choosing_s / (fixed_s - auto_s) if fixed_s > auto_s else None,
        "why": _why(one.choice),
    }  # fmt: skip


def _why(choice: Choice) -> str:
    """Return the simplifications that the choice rejected, as text; they show which parts of the model the features need."""
    refused = {(step.dimension, step.value): step.told for step in choice.steps if not step.taken}
    taken = {(step.dimension, step.value) for step in choice.steps if step.taken}
    return "; ".join(told for what, told in refused.items() if what not in taken)


def _alone(value: float) -> tuple[float, float, float]:
    return value, value, value


def _median(values: Sequence[float], config: Config) -> tuple[float, float, float]:
    """Return the median over cases with its 95 % interval from a bootstrap over cases."""
    drawn = np.median(np.random.default_rng(config.seed).choice(values, (config.profile.resamples, len(values))), axis=1)
    low, high = np.quantile(drawn, [0.025, 0.975])
    return float(np.median(values)), float(low), float(high)


def _row(
    config: Config, case: Mapping[str, Any], metric: str, value: tuple[float, float, float], n: int, claim: Claim = NONE
) -> dict[str, Any]:
    """Return a row of the table.

    Args:
        value: (value, low, high).
    """
    return row(config, case, metric, Estimate(float(value[0]), float(value[1]), float(value[2]), n), [], claim) | {
        "domain": "this tracer, finest"
    }
