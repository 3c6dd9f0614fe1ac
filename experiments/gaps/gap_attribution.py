"""Gap attribution: how much of the difference between simulation and virtual measurement does each gap cause?

Three losses (`coalitions`) are computed for sets of gaps. "Alone" is the loss of a group of gaps if all others are off, "left out" the
decrease if only this group is switched off, and "share" its exact Shapley value; the shares sum to the total. If a gap is large alone but
zero left out, other gaps hide its effect. The claims were written before the first run, the constants LEAST and AT_MOST after it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments import statistics
from experiments.campaign.schedule import RecordingTask
from experiments.drawing import PAGE_WIDTH_IN, PALETTE, Figure, error_bars, figure, legend_above
from experiments.gaps import case_set, shapley
from experiments.gaps.coalitions import ERROR, LABELS, PROFILE, RECOGNITION, SCORES, Losses, Sides, cases, losses, sides_of
from experiments.gaps.shapley import Coalition
from experiments.interface import Config, Progress, Result, Store, Table
from experiments.verdicts import NONE, Claim, Row, RowList, within
from radartwin.errors import ConfigError
from radartwin.scene.objects.catalogue import catalogue

TABLE = Table(
    name="gap_attribution",
    title="The loss that each gap causes",
    caption="A gap is one kind of difference between testbed and twin. The rows give the loss that each gap causes: alone (all "
    "others off), left out (the decrease if only this gap is switched off), and as its Shapley share of the total loss. "
    "Shapley values are exact over the groups, so the shares sum to the total. Losses are computed for turntable recordings "
    "at 1 m in the laboratory: the difference of features in standard deviations over objects, one minus the correlation of "
    "range profiles in decibels, and the share of objects that forests trained on the twin classify wrongly. The quick "
    "profile has three objects and leaves clutter, a person, the antennas, the finer solver and wrong labels off; the paper profile has "
    "all gaps. "
    "The materials group includes roughness, the object group has shape, walls and contents of the target, the course group "
    "includes trajectory and placement, and in the paper profile the clutter group includes a person and the solver, and the hardware "
    "group the antennas. "
    "Intervals are bootstraps over objects. Each gap is one random draw.",
)

ALONE, LEFT_OUT, SHARE = "alone", "left out", "share"
ALL, FILLED = "all objects", "filled bottles"
ROOM = "geometry and materials"


@dataclass(frozen=True)
class Plan:
    """The groups of gaps and the objects that one attribution uses. A gap that is in none of the groups stays off."""

    groups: Mapping[str, tuple[str, ...]]
    objects: tuple[str, ...]
    singly: bool = True  # whether the gaps of a larger group are also switched one by one

    @property
    def everything(self) -> Coalition:
        return frozenset(gap for gaps in self.groups.values() for gap in gaps)

    def on(self, players: Coalition) -> Coalition:
        """Return all gaps that belong to a set of groups."""
        return frozenset(gap for player in players for gap in self.groups[player])

    def switched(self) -> dict[str, Coalition]:
        """Return {name: gaps} that "alone" and "left out" switch together: the groups and, with `singly`, each gap of a larger group."""
        single = {f"{gap} only": frozenset((gap,)) for gaps in self.groups.values() if self.singly and len(gaps) > 1 for gap in gaps}
        return {name: frozenset(gaps) for name, gaps in self.groups.items()} | single

    def needed(self) -> list[Coalition]:
        """Return every set of gaps for which the attribution needs the losses."""
        sets = [self.on(names) for names in shapley.coalitions(tuple(self.groups))]
        sets += [part for coalition in self.switched().values() for part in (coalition, self.everything - coalition)]
        return list(dict.fromkeys(sets))


OBJECT = ("contents", "object_shape", "object_material")
PLANS = {
    # without clutter and solver, because their set-up takes longer than all other gaps together; also without LABELS, person and antenna
    "quick": Plan(
        {
            "geometry": ("geometry",), "materials": ("materials", "roughness"), "object": OBJECT, "hardware": ("hardware",),
            "course": ("trajectory", "placement"),
        },
        ("corner_reflector", "mustard", "mouthwash"),
        singly=False,
    ),
    "paper": Plan(
        {
            "geometry": ("geometry",), "materials": (LABELS, "materials", "roughness"), "object": OBJECT,
            "clutter": ("clutter", "person", "solver"), "hardware": ("hardware", "antenna"), "course": ("trajectory", "placement"),
        },
        ("corner_reflector", "drink_can_355", "mug", "mustard", "mouthwash"),
    ),
}  # fmt: skip

# Without gaps, a loss is near its minimum. Any change therefore increases the loss, and a claim "above 0" could not fail. The smallest loss
# that counts as an effect is therefore 0.05 of a correlation, or a tenth of a standard deviation. The claims of no effect allow shares up
# to the same values.
LEAST = {PROFILE: 0.05, ERROR: 0.1}
AT_MOST = 0.05  # a Shapley share of RECOGNITION is a share of wrongly classified objects: 0.05 is one object in twenty
CLAIMS: dict[tuple[str, str, str, str], Claim] = {  # key: score, gap, objects, measure
    (PROFILE, ROOM, ALL, "part of the total"): Claim("geometry and materials cause most of the profile loss", bound=0.5),
    (PROFILE, "geometry", ALL, ALONE): Claim("walls from a scan change the range profile", bound=LEAST[PROFILE], null=0.0),
    (PROFILE, "object", ALL, SHARE): within("the object gaps hardly change the range profile", -LEAST[PROFILE], LEAST[PROFILE]),
    (ERROR, "hardware", ALL, SHARE): Claim("line loss and IF filter change the brightness of every object", bound=LEAST[ERROR], null=0.0),
    (ERROR, "object", FILLED, ALONE): Claim("a manufactured, partly filled bottle has another echo", bound=LEAST[ERROR], null=0.0),
    (ERROR, "geometry", ALL, SHARE): within("walls hardly change the echo of the target", -LEAST[ERROR], LEAST[ERROR]),
    (RECOGNITION, "hardware", ALL, SHARE): within("rank features do not depend on the level", -AT_MOST, AT_MOST),
    (RECOGNITION, "geometry", ALL, SHARE): within("walls hardly change the echo of the target", -AT_MOST, AT_MOST),
}


def run(config: Config, store: Store, progress: Progress) -> Result:
    """Compute the attribution table. Raises ConfigError for a setting that the table sets itself."""
    check(config)
    plan = plan_of(config)
    sides = Sides(config, store, progress, cases(plan.objects))
    by_score = losses(config, sides, plan.needed())
    filled = np.array([catalogue()[case.object].contents is not None for case in sides.cases])
    rows = table(config, plan, by_score, filled, sides.keys)
    metrics = {f"share_{r['score']}_{r['gap']}".replace(" ", "_"): r["value"] for r in rows if (r["metric"], r["objects"]) == (SHARE, ALL)}
    return Result(TABLE.name, rows, {TABLE.name: lambda: chart(rows, tuple(plan.groups))}, metrics, sides.keys)


def recordings(config: Config, store: Store, progress: Progress) -> dict[str, RecordingTask]:
    check(config)
    plan = plan_of(config)
    return Sides(config, store, progress, cases(plan.objects)).missing(sides_of(plan.needed()))


def plan_of(config: Config) -> Plan:
    return PLANS["quick" if config.profile.name == "quick" else "paper"]


def check(config: Config) -> None:
    """Raise ConfigError if the configuration sets measured recordings, gaps or materials, because the table sets these itself."""
    case_set.check_untouched(config)
    if config.materials.source in ("true", "void"):
        raise ConfigError(
            f"experiment=gap_attribution switches between true and labelled materials itself; leave materials={config.materials.source} out"
        )


def table(config: Config, plan: Plan, by_score: Losses, filled: NDArray[np.bool_], keys: Sequence[str]) -> list[Row]:
    """Build the rows of each loss, for all objects and for the bottles `filled`: without and with all gaps, and three for each gap."""
    rows = RowList(config)
    for score in SCORES:
        for objects, mask in ((ALL, np.ones_like(filled)), (FILLED, filled)):
            if mask.any() and not (objects == FILLED and score == RECOGNITION):
                value = {on: loss[mask] for on, loss in by_score[score].items()}
                _add_rows(rows, plan, score, objects, value, keys)
    return rows


def _add_rows(
    rows: RowList, plan: Plan, score: str, objects: str, value: Mapping[Coalition, NDArray[np.float64]], keys: Sequence[str]
) -> None:
    """Add the table rows of one loss. `value` maps each set of gaps that are on to the losses (recordings,)."""

    def add(gap: str, metric: str, samples: NDArray[np.float64]) -> None:
        case = {"score": score, "gap": gap, "objects": objects}
        rows.add_mean(case, metric, samples, keys, CLAIMS.get((score, gap, objects, metric), NONE))

    add("none", "loss", value[frozenset()])
    add("all", "loss", value[plan.everything])
    for gap, coalition in plan.switched().items():
        add(gap, ALONE, shapley.alone(value, coalition))
        add(gap, LEFT_OUT, shapley.left_out(value, coalition, plan.everything))
    groups = tuple(plan.groups)
    shared = shapley.shares(groups, {names: value[plan.on(names)] for names in shapley.coalitions(groups)})
    for gap, samples in shared.items():
        add(gap, SHARE, samples)
    if objects == ALL:
        case = {"score": score, "gap": ROOM, "objects": ALL}
        estimate = _part(rows.config, shared)
        rows.add(case, "part of the total", estimate, keys, CLAIMS.get((score, ROOM, ALL, "part of the total"), NONE))


def _part(config: Config, shared: Mapping[str, NDArray[np.float64]]) -> statistics.Estimate:
    """Estimate the fraction of the total loss that geometry and material gaps cause; NaN if all gaps together cause no loss."""
    room, total = shared["geometry"] + shared["materials"], np.sum(list(shared.values()), axis=0)
    drawn = np.random.default_rng(config.seed).integers(len(total), size=(config.profile.resamples, len(total)))
    sums = total[drawn].mean(axis=1)
    if total.mean() <= 0 or (sums <= 0).any():
        return statistics.exact(float("nan"), len(total))
    value = float(room.mean() / total.mean())
    return statistics.resampled(value, statistics.widened(room[drawn].mean(axis=1) / sums, value, len(total)), len(total))


def chart(rows: Sequence[Mapping[str, Any]], groups: Sequence[str]) -> Figure:
    """Draw bars of "alone", "share" and "left out" for each group of gaps, with confidence intervals, in one panel per loss."""
    drawing, panels = figure(1, len(SCORES), width_in=PAGE_WIDTH_IN, height_in=3.4, sharey=True)
    place = np.arange(len(groups))[::-1]
    for panel, score in zip(panels, SCORES, strict=True):
        known = {(r["gap"], r["metric"]): r for r in rows if (r["score"], r["objects"]) == (score, ALL)}
        for shift, metric, colour in ((0.27, ALONE, PALETTE[5]), (0.0, SHARE, PALETTE[0]), (-0.27, LEFT_OUT, PALETTE[4])):
            value, errors = error_bars(known[gap, metric] for gap in groups)
            panel.barh(place + shift, value, 0.25, color=colour, label=metric, xerr=errors, error_kw={"lw": 0.8, "ecolor": "0.3"})
        none, everything = (known[gap, "loss"]["value"] for gap in ("none", "all"))
        panel.set(title=score, xlabel=f"part of the loss ({none:.2f} without gaps, {everything:.2f} with all)")
        if score == RECOGNITION:
            panel.set_xlim(-1, 1)  # a share of objects
        panel.axvline(0, color="0.4", lw=0.6)
        panel.grid(axis="x", color="0.9", lw=0.5)
        panel.set_axisbelow(True)
    panels[0].set_yticks(place, groups)
    legend_above(drawing, panels[0], 3)
    return drawing
