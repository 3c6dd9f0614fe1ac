"""Rows and figure of the table `complexity`: the model chosen for each case, the run time that it saves, and claims about all cases."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from experiments.campaign.cases import Case
from experiments.complexity import timing
from experiments.drawing import PAGE_WIDTH_IN, PALETTE, Figure, figure
from experiments.statistics import Estimate, bootstrap, exact
from experiments.verdicts import BELOW, NONE, Claim, Row
from radartwin.adaptive.choice import Choice
from radartwin.adaptive.scene_settings import LADDER, Model
from radartwin.config.config import Config
from radartwin.features.sets import SETS

CHEAPER = 3.0  # claimed median of the ratio (run time of the fixed default) / (run time of auto)
SHAPE, MULTIPATH, EVERYTHING = "shape", "multipath share", "everything"
OWN = tuple(name for name in SETS if name != "raw")  # feature sets named after motions; the median over cases uses these
REFLECTOR = Case("corner_reflector", "lab", "turntable", 2.0)
AUTO, FIXED, SHIPPED = "auto", "fixed", "shipped"
SAVED = "cost of the fixed default over auto's"
NEEDED = "parts of the room that are needed (0 none, 1 large, 2 whole)"
HEADS = {
    "parts": "room", "max_bounces": "bounces", "rays_per_wavelength2": "tubes\nper λ²", "coupling": "paths\nover the\nroom",
    "elements": "elements", "diffuse": "diffuse\nscatter",
}  # fmt: skip
TICKS = [factor * 10.0**power for power in range(-3, 3) for factor in (1, 3)]
WORDS = {True: "yes", False: "no"}


@dataclass(frozen=True)
class CaseResult:
    """The chosen models, errors and run times for one scene, object and feature set."""

    name: str  # of the case
    asked: str  # name of the feature set
    choice: Choice  # the choice of simulator=auto
    models: dict[str, Model]  # models by the names AUTO, FIXED and SHIPPED
    errors: dict[str, tuple[float, str]]  # (error in repeatability limits, worst feature) of each model, on the frames of the choice
    between: dict[str, tuple[float, str]]  # (error in repeatability limits, worst feature) of each model, on the held-out frames
    layers: tuple[float, str]  # error of the shipped default without layered materials, on the frames of the choice
    seconds: dict[str, list[float]]  # core seconds per frame of each model, one value per round
    choosing_s: float  # core seconds of all recordings that the choice needed

    @property
    def saved(self) -> float:
        """Return the run time of the fixed default model divided by the run time of the model chosen by simulator=auto."""
        return timing.ratio(self.seconds[FIXED], self.seconds[AUTO])


def table(config: Config, results: Sequence[CaseResult], fixed: Choice) -> list[dict[str, Any]]:
    """Return rows with the chosen model, saved run time and held-out feature error of each case, then the claims about all cases."""
    rows = []
    for result in results:
        case = {"case": result.name, "features": result.asked} | columns_of(result)
        ratios = np.array(result.seconds[FIXED]) / np.array(result.seconds[AUTO])
        rows.append(_row(config, case, SAVED, Estimate(result.saved, float(ratios.min()), float(ratios.max()), len(ratios))))
        rows.append(_row(config, case, "error between the frames of the choice (limits)", exact(result.between[AUTO][0], 1), SUFFICIENT))
        if REFLECTOR.object in result.name and "lab" in result.name and result.asked in ROOM_CLAIMS:
            parts = float(LADDER["parts"].index(result.choice.model.parts))
            rows.append(_row(config, case, NEEDED, exact(parts, 1), ROOM_CLAIMS[result.asked]))
    every = {"case": "all", "features": "own sets"} | dict.fromkeys(columns_of(results[0]))
    motion_results = [result for result in results if result.asked in OWN]
    claim = Claim(f"auto is at least {CHEAPER:g} times cheaper in the median", bound=CHEAPER, limit=True)
    rows.append(_row(config, every, f"{SAVED}, median", _median([result.saved for result in motion_results], config), claim))
    every["features"] = "all sets"
    for who, name in ((SHIPPED, "shipped"), (FIXED, "fixed")):
        worst = max(results, key=lambda result, who=who: result.between[who][0])
        case = every | {"model": worst.models[who].told, "worst feature": worst.between[who][1], "why": _why(fixed) if who == FIXED else ""}
        metric = f"error of the {name} default between the frames of the choice, worst of all (limits)"
        rows.append(_row(config, case, metric, exact(worst.between[who][0], len(results)), SUFFICIENT))
    dearer = [timing.ratio(result.seconds[SHIPPED], result.seconds[FIXED]) for result in motion_results]
    text = "no setting known to be sufficient for all cases is more than 10 % cheaper than the shipped default"
    claim = Claim(text, bound=1.1, direction=BELOW, limit=True)
    case = every | {"model": fixed.model.told}
    rows.append(_row(config, case, "cost of the shipped default over the fixed one's, median", _median(dearer, config), claim))
    return rows


SUFFICIENT = Claim("every feature within its repeatability", bound=1.0, direction=BELOW, least=1, limit=True)
ROOM_CLAIMS = {
    SHAPE: Claim("the shape features of the reflector need no room", bound=0.5, direction=BELOW, least=1, limit=True),
    MULTIPATH: Claim("the multipath share of the reflector needs a room", bound=0.5, least=1, limit=True),
}


def columns_of(result: CaseResult) -> dict[str, Any]:
    """Return the table columns that describe a case: its models, feature errors, run times, and the reasons for the choice."""
    model = result.choice.model
    auto_s, fixed_s, shipped_s = (float(np.median(result.seconds[who])) for who in (AUTO, FIXED, SHIPPED))
    return {
        "model": model.told, **{name: getattr(model, name) for name in LADDER},
        "error (limits)": result.errors[AUTO][0], "worst feature": result.errors[AUTO][1], "between": result.between[AUTO][0],
        "without layers": result.layers[0], "fixed default": result.models[FIXED].told, "fixed, between": result.between[FIXED][0],
        "shipped, between": result.between[SHIPPED][0], "auto (s/frame)": auto_s, "fixed (s/frame)": fixed_s,
        "shipped (s/frame)": shipped_s, "choosing (s)": result.choosing_s,
        "pays after (frames)": result.choosing_s / (fixed_s - auto_s) if fixed_s > auto_s else None,
        "why": _why(result.choice),
    }  # fmt: skip


def _why(choice: Choice) -> str:
    """Return as text the rejected simplifications, which show the parts of the simulation model that the features need."""
    refused = {(step.dimension, step.value): step.told for step in choice.steps if not step.taken}
    taken = {(step.dimension, step.value) for step in choice.steps if step.taken}
    return "; ".join(told for what, told in refused.items() if what not in taken)


def _median(values: Sequence[float], config: Config) -> Estimate:
    """Return the median over cases with its 95 % confidence interval from a bootstrap over cases."""
    return bootstrap(partial(np.median, axis=-1), config.profile.resamples, config.seed, np.array(values))


def _row(config: Config, case: Mapping[str, Any], metric: str, estimate: Estimate, claim: Claim = NONE) -> Row:
    return Row(case, metric, estimate, frozenset(), claim, config, domain="this tracer, finest")


def chart(rows: Sequence[Mapping[str, Any]]) -> Figure:
    """Draw a map of the settings of each case (dark: expensive), and the run times of auto and shipped over the fixed default."""
    cases = [row for row in rows if row["metric"] == SAVED]
    # position of a setting on its scale, from cheapest to most expensive; paths over no room count as cheapest
    level = np.array([[LADDER[name].index(case[name]) / (len(LADDER[name]) - 1) for name in HEADS] for case in cases])
    level[[case["parts"] == "none" for case in cases], list(HEADS).index("coupling")] = 0.0
    drawing, (table, bars) = figure(
        1, 2, width_in=PAGE_WIDTH_IN, height_in=1.2 + 0.24 * len(cases), sharey=True, gridspec_kw={"width_ratios": (2, 1)}
    )
    table.imshow(level, cmap="Blues", vmin=0, vmax=1.6, aspect="auto")
    for y, case in enumerate(cases):
        for x, name in enumerate(HEADS):
            value = case[name]
            words = WORDS[value] if isinstance(value, bool) else f"{value:g}" if isinstance(value, (int, float)) else str(value)
            if name == "coupling" and case["parts"] == "none":
                words = "–"
            table.text(x, y, words, ha="center", va="center")
    table.set_xticks(range(len(HEADS)), HEADS.values())
    table.xaxis.tick_top()
    names = [re.sub(r"(?<=\d)m$", " m", case["case"].replace("-", ", ").replace("_", " ")) for case in cases]
    table.set_yticks(range(len(cases)), [f"{name}: {case['features']}" for name, case in zip(names, cases, strict=True)])
    table.tick_params(length=0)
    auto, shipped = ([case[f"{who} (s/frame)"] / case["fixed (s/frame)"] for case in cases] for who in ("auto", "shipped"))
    bars.barh(range(len(cases)), auto, color=PALETTE[0], height=0.6, label="auto")
    bars.plot(shipped, range(len(cases)), "k|", ms=7, label="shipped default")
    bars.axvline(1.0, color="0.5", lw=0.8)
    bars.set(xscale="log", xlabel="run time over that\nof the fixed default")
    low, high = min(*auto, *shipped) / 1.5, max(*auto, *shipped) * 1.5
    ticks = [tick for tick in TICKS if low <= tick <= high]
    bars.set_xlim(low, high)
    bars.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    bars.minorticks_off()
    bars.legend(loc="lower right", bbox_to_anchor=(1, 1), ncols=2)
    return drawing
