"""Gap attribution: which part of the distance between twin and testbed comes from which gap, for fidelity and for recognition?

Three losses (experiments/gaps/coalitions.py) are computed with any set of gaps on. Alone: the loss that a gap causes with all others off.
Left out: the loss that disappears if the gap goes off with all others on. Share: the gap's Shapley value, exact over groups of gaps; the
shares sum to the total loss (experiments/gaps/shapley.py). The three are equal for gaps that do not interact; a gap with a large loss
alone and none when left out is hidden by others. Losses are per recording; intervals are bootstraps over recordings. Each gap is one draw
of the seed. Claims were written before the first run: walls and their materials decide the room's profile; lines and filter take 8 dB of
the target's brightness; ranks do not depend on levels; a liquid affects its bottle only.

Cost of the quick profile: 86 core seconds on a busy machine, of which 28 set up the scanned laboratory (four objects, no clutter, no finer
solver, true labels). The paper profile has every gap.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from experiments import statistics
from experiments.claims import NONE, Claim, RowList
from experiments.drawing import error_bars, legend_above
from experiments.gaps import case_set, shapley
from experiments.gaps.coalitions import ERROR, LABELS, PROFILE, RECOGNITION, SCORES, Losses, Sides, cases, losses
from experiments.gaps.shapley import Coalition
from radartwin.config.config import Config
from radartwin.errors import ConfigError
from radartwin.io.progress import Progress
from radartwin.plotting.style import PAGE_WIDTH_IN, PALETTE, figure
from radartwin.runs.experiment import Result, Table
from radartwin.scene.objects.catalogue import catalogue
from radartwin.store.products import Store

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TABLE = Table(
    name="gap_attribution",
    title="Which gap costs what",
    caption="The loss that each gap between testbed and twin causes: alone (all others off), left out (all others on), and as its "
    "Shapley share of the total. Shapley values are exact over the groups, so that the shares sum to the total. Losses are per "
    "recording of a turntable at 1 m in the laboratory: the distance between features in standard deviations over objects, the "
    "decorrelation of range profiles in decibels, and the share of objects that forests trained on the twin get wrong. The "
    "quick profile has four objects and leaves clutter, the finer solver and wrong labels off; the paper profile has all gaps. "
    "The materials group includes roughness, the course group includes trajectory and placement, and in the paper profile the "
    "clutter group includes the solver. Intervals are bootstraps over objects. Each gap is one random draw.",
)

ALONE, LEFT_OUT, SHARE = "alone", "left out", "share"
ALL, FILLED = "all objects", "filled bottles"
ROOM = "geometry and materials"


@dataclass(frozen=True)
class Plan:
    """Groups of gaps and the recorded objects. Gaps in no group stay off.

    Attributes:
        singly: whether each gap of a group is also switched by itself.
    """

    groups: Mapping[str, tuple[str, ...]]
    objects: tuple[str, ...]
    singly: bool = True

    @property
    def everything(self) -> Coalition:
        return frozenset(gap for gaps in self.groups.values() for gap in gaps)

    def on(self, players: Coalition) -> Coalition:
        """The gaps of a coalition of groups."""
        return frozenset(gap for player in players for gap in self.groups[player])

    def switched(self) -> dict[str, Coalition]:
        """The sets that are switched alone and left out, by name: each group, and with `singly` each gap of a larger group."""
        single = {gap: frozenset((gap,)) for gaps in self.groups.values() if self.singly and len(gaps) > 1 for gap in gaps}
        return {name: frozenset(gaps) for name, gaps in self.groups.items()} | {f"{gap} only": one for gap, one in single.items()}

    def needed(self) -> list[Coalition]:
        """Every set of gaps that must be scored."""
        sets = [self.on(some) for some in shapley.coalitions(tuple(self.groups))]
        sets += [part for one in self.switched().values() for part in (one, self.everything - one)]
        return list(dict.fromkeys(sets))


PLANS = {
    # the set-up of clutter or of a finer solver would cost more than all of these gaps
    "quick": Plan(
        {
            "geometry": ("geometry",), "materials": ("materials", "roughness"), "contents": ("contents",), "hardware": ("hardware",),
            "course": ("trajectory", "placement"),
        },
        ("corner_reflector", "drink_can_355", "mustard", "mouthwash"),
        singly=False,
    ),
    "paper": Plan(
        {
            "geometry": ("geometry",), "materials": (LABELS, "materials", "roughness"), "contents": ("contents",),
            "clutter": ("clutter", "solver"), "hardware": ("hardware",), "course": ("trajectory", "placement"),
        },
        ("corner_reflector", "drink_can_355", "mug", "mustard", "mouthwash"),
    ),
}  # fmt: skip

CLAIMS: dict[tuple[str, str, str, str], Claim] = {  # by score, gap, objects, measure
    (PROFILE, ROOM, ALL, "part of the total"): Claim("the room's walls and materials bring most of what its profile loses", above=0.5),
    (PROFILE, "geometry", ALL, ALONE): Claim("a scan's walls return another profile", above=0.0),
    (PROFILE, "contents", ALL, SHARE): Claim("what is in a bottle is not in the room's profile", above=-0.05, below=0.05),
    (ERROR, "hardware", ALL, SHARE): Claim("lines and filter move every brightness", above=0.0),
    (ERROR, "contents", FILLED, ALONE): Claim("a bottle that is not full is another", above=0.0),
    (ERROR, "geometry", ALL, SHARE): Claim("the target's echo knows little of walls", above=-0.1, below=0.1),
    (RECOGNITION, "hardware", ALL, SHARE): Claim("ranks do not know a level", contains=0.0),
    (RECOGNITION, "geometry", ALL, SHARE): Claim("the target's echo knows little of walls", contains=0.0),
}


def run(config: Config, store: Store, progress: Progress) -> Result:
    """The table of the configured testbed and twin. Raises ConfigError for settings that the table sets itself."""
    check(config)
    plan = PLANS["quick" if config.profile.name == "quick" else "paper"]
    sides = Sides(config, store, progress, cases(plan.objects))
    found = losses(config, sides, plan.needed())
    filled = np.array([catalogue()[case.object].contents is not None for case in sides.cases])
    rows = table(config, plan, found, filled, sides.keys)
    metrics = {f"share_{r['score']}_{r['gap']}".replace(" ", "_"): r["value"] for r in rows if (r["metric"], r["objects"]) == (SHARE, ALL)}
    figures: dict[str, Callable[[], Figure]] = {"gap_attribution": lambda: chart(rows, tuple(plan.groups))}
    return Result(TABLE.name, rows, figures, metrics, sides.keys)


def check(config: Config) -> None:
    """Refuse settings that the table would override.

    Raises:
        ConfigError: measured recordings, gaps or materials that the table sets itself.
    """
    case_set.check_untouched(config)
    if config.materials.source in ("true", "void"):
        raise ConfigError(
            f"experiment=gap_attribution switches between true and labelled materials itself; leave materials={config.materials.source} out"
        )


def table(config: Config, plan: Plan, found: Losses, filled: NDArray[np.bool_], keys: Sequence[str]) -> RowList:
    """Rows per score: the loss without and with all gaps, then each gap alone, left out, and its share; also over filled bottles.

    Args:
        filled: (recordings,) mask of the filled bottles.
    """
    rows = RowList(config)
    for score in SCORES:
        for objects, chosen in ((ALL, np.ones_like(filled)), (FILLED, filled)):
            if chosen.any() and not (objects == FILLED and score == RECOGNITION):
                value = {on: loss[chosen] for on, loss in found[score].items()}
                _add_rows(rows, plan, score, objects, value, keys)
    return rows


def _add_rows(
    rows: RowList, plan: Plan, score: str, objects: str, value: Mapping[Coalition, NDArray[np.float64]], keys: Sequence[str]
) -> None:
    """Rows of one score; `value` holds its losses (recordings,) by set of gaps."""

    def add(gap: str, metric: str, samples: NDArray[np.float64]) -> None:
        case = {"score": score, "gap": gap, "objects": objects}
        rows.add_mean(case, metric, samples, keys, CLAIMS.get((score, gap, objects, metric), NONE))

    add("none", "loss", value[frozenset()])
    add("all", "loss", value[plan.everything])
    for gap, one in plan.switched().items():
        add(gap, ALONE, shapley.alone(value, one))
        add(gap, LEFT_OUT, shapley.left_out(value, one, plan.everything))
    groups = tuple(plan.groups)
    shared = shapley.shares(groups, {some: value[plan.on(some)] for some in shapley.coalitions(groups)})
    for gap, samples in shared.items():
        add(gap, SHARE, samples)
    if objects == ALL:
        case = {"score": score, "gap": ROOM, "objects": ALL}
        estimate = _part(rows.config, shared)
        rows.add(case, "part of the total", estimate, keys, CLAIMS.get((score, ROOM, ALL, "part of the total"), NONE))


def _part(config: Config, shared: Mapping[str, NDArray[np.float64]]) -> statistics.Estimate:
    """Part of geometry and materials in the total loss, with a bootstrap over recordings; NaN if all gaps together cause no loss."""
    room, total = shared["geometry"] + shared["materials"], np.sum(list(shared.values()), axis=0)
    drawn = np.random.default_rng(config.seed).integers(len(total), size=(config.profile.resamples, len(total)))
    sums = total[drawn].mean(axis=1)
    if total.mean() <= 0 or (sums <= 0).any():
        return statistics.exact(float("nan"), len(total))
    return statistics.resampled(float(room.mean() / total.mean()), room[drawn].mean(axis=1) / sums, len(total))


def chart(rows: Sequence[Mapping[str, Any]], groups: Sequence[str]) -> Figure:
    """Bars of alone, share and left out of each group with intervals, one panel per score."""
    drawing, panels = figure(1, len(SCORES), width_in=PAGE_WIDTH_IN, height_in=3.4, sharey=True)
    place = np.arange(len(groups))[::-1]
    for panel, score in zip(panels, SCORES, strict=True):
        known = {(r["gap"], r["metric"]): r for r in rows if (r["score"], r["objects"]) == (score, ALL)}
        for shift, metric, colour in ((0.27, ALONE, PALETTE[5]), (0.0, SHARE, PALETTE[0]), (-0.27, LEFT_OUT, PALETTE[4])):
            value, errors = error_bars(known[gap, metric] for gap in groups)
            panel.barh(place + shift, value, 0.25, color=colour, label=metric, xerr=errors, error_kw={"lw": 0.8, "ecolor": "0.3"})
        none, everything = (known[gap, "loss"]["value"] for gap in ("none", "all"))
        panel.set_title(score)
        panel.set_xlabel(f"{none:.2f} without gaps, {everything:.2f} with all")
        panel.axvline(0, color="0.4", lw=0.6)
        panel.grid(axis="x", color="0.9", lw=0.5)
        panel.set_axisbelow(True)
    panels[0].set_yticks(place, groups)
    legend_above(drawing, panels[0], 3)
    return drawing
