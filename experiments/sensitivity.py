"""What each simulator setting costs and changes: the twin's features against the finest setting's, and every fidelity figure.

One setting at a time is changed from the default. The feature error of a recording is the root mean square, over the features of its
motion's set, of the difference from the finest twin's, each in units of that feature's standard deviation over the finest twin's recordings
of that motion: 1 is as much as objects, distances and rooms differ. The measured side is the same throughout. The same as a sweep:
docs/sweeps.md.
"""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments import statistics
from experiments.campaigns.campaign import Campaign
from experiments.campaigns.cases import Case
from experiments.claims import row
from experiments.statistics import Estimate
from radartwin.compose import compose
from radartwin.config import Config, MaterialsConfig
from radartwin.experiment import Result
from radartwin.features import sets
from radartwin.plotting import PAGE_WIDTH_IN, PALETTE, figure
from radartwin.progress import Progress
from radartwin.store import Store

if TYPE_CHECKING:
    from matplotlib.figure import Figure

FIDELITY = (
    "turntable_shape", "turntable_material", "turntable_size", "linear_rail", "environment", "rover_fidelity", "rover_disentangle",
    "corner_reflector_calibration",
)  # fmt: skip
FEATURES = {"turntable": "rotation", "depth": "depth", "lateral": "lateral"}  # by motion
FINEST, DEFAULT = "finest", "default"


@dataclass(frozen=True)
class Setting:
    """A name, what of the simulator it changes, and the twin's source of materials where that is another."""

    name: str
    simulator: dict[str, Any] = field(default_factory=dict)
    materials: str = ""


SETTINGS = (
    Setting(FINEST, {"rays_per_wavelength2": 4.0, "max_bounces": 5}),
    Setting(DEFAULT),
    Setting("a quarter of the rays", {"rays_per_wavelength2": 0.25}),
    Setting("3 bounces", {"max_bounces": 3}),
    Setting("2 bounces", {"max_bounces": 2}),
    Setting("1 bounce", {"max_bounces": 1}),
    Setting("no ways over the room", {"coupling": False}),
    Setting("no diffuse cloud", {"diffuse": False}),
    Setting("plane waves across the array", {"elements": "planar"}),
    Setting("plasterboard everywhere", materials="uniform"),
    Setting("no room", materials="void"),
)


@dataclass(frozen=True, eq=False)
class Twin:
    """The twin's recordings under one setting.

    Attributes:
        values: {motion: (recordings, features)}. keys: of all recordings. core_seconds: (recordings,) of one frame, by motion.
        figures: {(table, metric): value} of the fidelity tables.
    """

    values: dict[str, np.ndarray]
    keys: dict[str, list[str]]
    core_seconds: dict[str, np.ndarray]
    figures: dict[tuple[str, str], float]


def run(config: Config, store: Store, progress: Progress) -> Result:
    """Every setting on the twin's side of the campaign. Raises UserError for a campaign that cannot be made."""
    twins = {}
    for setting in SETTINGS:
        progress.say(f"sensitivity: {setting.name}")
        changed = _changed(config, setting)
        twins[setting.name] = read(Campaign(changed, store, progress), changed, store, progress)
    rows = table(config, twins)
    metrics = {f"feature_error_{r['motion']}_{r['setting'].replace(' ', '_')}": r["value"] for r in rows if r["metric"] == ERROR}
    keys = sorted({key for twin in twins.values() for some in twin.keys.values() for key in some})
    return Result("sensitivity", rows, {"sensitivity": lambda: chart(rows)}, metrics, keys)


def _changed(config: Config, setting: Setting) -> Config:
    materials = MaterialsConfig(source=setting.materials) if setting.materials else config.materials
    return replace(config, simulator=replace(config.simulator, **setting.simulator), materials=materials)


def read(campaign: Campaign, config: Config, store: Store, progress: Progress) -> Twin:
    """Features and cost of the twin's recordings, and the fidelity figures, under one setting."""
    cases = {motion: campaign.cases("twin", motion=motion) for motion in FEATURES}
    campaign.prepare([("twin", case) for some in cases.values() for case in some])
    values, keys, cost = {}, {}, {}
    for motion, some in cases.items():
        if some:
            read = [_one(campaign, case) for case in progress.over(some, motion)]
            values[motion] = np.stack([one[0] for one in read])
            keys[motion], cost[motion] = [one[1] for one in read], np.array([one[2] for one in read])
    figures = {}
    for name in FIDELITY:
        own = compose([f"experiment={name}"])
        same = {
            part: getattr(config, part) for part in ("simulator", "materials", "radar", "measured", "profile", "seed", "output", "jobs")
        }
        module = importlib.import_module(f"experiments.{name}")
        quick = {"ripple": False} if name == "turntable_shape" else {}
        result = module.score(replace(own, **same), campaign, progress, **quick)
        figures |= {(name, metric): value for metric, value in result.metrics.items()}
    return Twin(values, keys, cost, figures)


def _one(campaign: Campaign, case: Case) -> tuple[np.ndarray, str, float]:
    """(features, key, core seconds a frame) of a twin's recording; what its track shares is in the first that used it."""
    key, processed = campaign.processed("twin", case)
    clean = campaign.clean("twin", case).read_json("meta")
    values = sets.vector(processed, campaign.log(case, "twin"), FEATURES[case.motion])[1]
    return values, key, float(clean["core_seconds"]) / clean["told"]["frames"]


ERROR, COST = "feature error", "core time per frame (ms)"


def table(config: Config, twins: dict[str, Twin]) -> list[dict[str, Any]]:
    """Per setting: error and cost by motion, and each fidelity figure beside the default's."""
    finest, default = twins[FINEST], twins[DEFAULT]
    spread = {motion: np.where((s := values.std(axis=0)) > 0, s, 1.0) for motion, values in finest.values.items()}
    rows = []
    for name, twin in twins.items():
        for motion, values in twin.values.items():
            case = {"setting": name, "table": "", "motion": motion}
            error = np.sqrt((((values - finest.values[motion]) / spread[motion]) ** 2).mean(axis=1))
            seeds = config.profile.resamples, config.seed
            rows.append(row(config, case, ERROR, statistics.mean(error, *seeds), twin.keys[motion]))
            rows.append(row(config, case, COST, statistics.mean(1e3 * twin.core_seconds[motion], *seeds), twin.keys[motion]))
        for (table_name, metric), value in twin.figures.items():
            case = {"setting": name, "table": table_name, "motion": ""}
            every = [key for some in twin.keys.values() for key in some]
            nothing = float("nan")
            rows.append(row(config, case, metric, Estimate(value, nothing, nothing, len(every)), every))
            rows[-1]["change"] = value - default.figures[table_name, metric]
    return [
        {"setting": one["setting"], "table": one["table"], "motion": one["motion"], "change": one.pop("change", None), **one}
        for one in rows
    ]


def chart(rows: Sequence[dict[str, Any]]) -> Figure:
    """Cost against feature error, a panel per motion, a mark per setting; the finest has no error to show."""
    motions = list(dict.fromkeys(r["motion"] for r in rows if r["metric"] == ERROR))
    drawing, panels = figure(1, len(motions), width_in=PAGE_WIDTH_IN, height_in=3.2, sharey=True, squeeze=False)
    names = [one.name for one in SETTINGS if one.name != FINEST]
    marks = "osD^v<>PX*"

    def value(name: str, motion: str, metric: str) -> float:
        return next(r["value"] for r in rows if (r["setting"], r["motion"], r["metric"]) == (name, motion, metric))

    for axes, motion in zip(panels[0], motions, strict=True):
        for k, name in enumerate(names):
            point = value(name, motion, COST), max(value(name, motion, ERROR), 1e-3)
            axes.plot(*point, marks[k % len(marks)], color=PALETTE[k % len(PALETTE)], label=name)
        axes.set(xscale="log", yscale="log", xlabel=COST, title=motion)
    panels[0][0].set_ylabel("feature error (spreads)")
    handles, labels = panels[0][0].get_legend_handles_labels()
    drawing.legend(handles, labels, loc="outside upper center", ncols=4)
    return drawing
