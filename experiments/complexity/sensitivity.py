"""Measure how each simulator setting changes run time, simulated features, and the results of the fidelity tables.

The feature errors are relative to the finest setting; the measured recordings are the same for all settings. The steps along the track of a
drive are equally coarse in all settings, so the table underestimates the errors of drives. For comparison, the features of different
objects, distances and rooms differ by 1.4 standard deviations. docs/sweeps.md shows the same comparison as a parameter sweep.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from types import ModuleType
from typing import Any

import numpy as np

from experiments import statistics
from experiments.campaign import tally
from experiments.campaign.campaign import Campaign
from experiments.campaign.cases import Case
from experiments.campaign.frame import Frame, shared, stored
from experiments.drawing import PAGE_WIDTH_IN, PALETTE, Figure, figure, legend_above
from experiments.interface import Config, Progress, Result, Store, Table
from experiments.recognition import corner_reflector_calibration
from experiments.rover import rover_disentangle, rover_fidelity
from experiments.speed.machine import machine
from experiments.statistics import Estimate
from experiments.turntable import environment, linear_rail, turntable_material, turntable_shape, turntable_size
from experiments.verdicts import RowList
from radartwin.config.compose import compose
from radartwin.config.materials import default_materials
from radartwin.config.simulator import AutoSimulator, MitsubaSimulator
from radartwin.errors import ConfigError, InputError
from radartwin.features import families
from radartwin.store.digest import semantic

TABLE = Table(
    name="sensitivity",
    title="Effect and run time of each simulator setting",
    caption="Each setting is the default with one parameter changed; the finest setting has four times the rays and a fifth bounce. The "
    "feature error is the root mean square, over the features of a recording, of the difference from the finest twin, in units "
    "of the feature's standard deviation over the finest twin's recordings of that motion. A drive computes some quantities only at "
    "steps along its track, and these steps are equally coarse in the finest setting. Recording times exclude the set-up of the "
    "track; set-up times are given separately. The rows below give every main result of the fidelity tables and its change from "
    "the default.",
)

FIDELITY = (
    turntable_shape, turntable_material, turntable_size, linear_rail, environment, rover_fidelity, rover_disentangle,
    corner_reflector_calibration,
)  # fmt: skip
FEATURES = {"turntable": "rotation", "depth": "depth", "lateral": "lateral"}  # motion -> feature set
FINEST, DEFAULT = "finest", "default"
ERROR, COST, SETUP = "feature error", "core time per frame (ms)", "core time of a set-up (s)"
MIN_RECORDINGS = 3  # recordings per motion; fewer do not give a usable standard deviation of the features


@dataclass(frozen=True)
class Setting:
    """One simulator setting that is compared with the finest setting."""

    name: str
    simulator: dict[str, Any] = field(default_factory=dict)  # changed fields of the simulator's configuration
    materials: str = ""  # source of the materials of the simulated room, if not the default


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
    """The simulated recordings under one setting, and the results of the fidelity tables."""

    recordings: Frame  # a row per recording: motion, key, features (array), core seconds `frame_s` per frame, `setups` computed, `frames`
    figures: dict[tuple[str, str], tuple[float, list[str]]]  # {(table, metric): (value, keys of the recordings)} of the fidelity tables


def identity() -> dict[str, Any]:
    """Return additions to the run key: the configurations of the fidelity tables, and the machine."""
    return {"tables": {_name(module): semantic(_config_of(module)) for module in FIDELITY}, "machine": machine()}


def _name(module: ModuleType) -> str:
    return module.__name__.rpartition(".")[2]


def _config_of(module: ModuleType) -> Config:
    return compose([f"experiment={_name(module)}"])


def run(config: Config, store: Store, progress: Progress) -> Result:
    """Simulate the campaign with every setting. Raises ConfigError for the materials of a setting, or another simulator."""
    if config.materials.source in {setting.materials for setting in SETTINGS}:
        raise ConfigError(
            f"materials={config.materials.source} is one of the settings that experiment=sensitivity tries; leave materials out"
        )
    if not isinstance(config.simulator, MitsubaSimulator | AutoSimulator):
        raise ConfigError(f"experiment=sensitivity needs simulator=mitsuba, not {config.simulator.backend}; leave simulator out")
    twins = {}
    for setting in SETTINGS:
        progress.say(f"sensitivity: {setting.name}")
        changed = configured(config, setting)
        twins[setting.name] = read(Campaign(changed, store, progress), changed, progress)
    rows = table(config, twins)
    metrics = {f"feature_error_{r['motion']}_{r['setting'].replace(' ', '_')}": r["value"] for r in rows if r["metric"] == ERROR}
    keys = {
        key
        for twin in twins.values()
        for recording_keys in [twin.recordings.key, *(of for _, of in twin.figures.values())]
        for key in recording_keys
    }
    return Result(TABLE.name, rows, {"sensitivity": lambda: chart(rows)}, metrics, sorted(keys))


def configured(config: Config, setting: Setting) -> Config:
    """Return the configuration with the changes of one setting applied."""
    materials = default_materials(setting.materials) if setting.materials else config.materials
    return replace(config, simulator=replace(config.simulator, **setting.simulator), materials=materials)


def read(campaign: Campaign, config: Config, progress: Progress) -> Twin:
    """Return features and run times of the simulated recordings, and the results of the fidelity tables, under one setting."""
    import pandas as pd

    cases = {motion: of_motion for motion in FEATURES if len(of_motion := campaign.cases("twin", motion=motion)) >= MIN_RECORDINGS}
    campaign.prepare([("twin", case) for of_motion in cases.values() for case in of_motion])
    made = [_recording_columns(campaign, case) for motion, of_motion in cases.items() for case in progress.over(of_motion, motion)]
    columns = ("motion", "key", "features", "frame_s", "setups", "frames")
    return Twin(pd.DataFrame(made, columns=columns), dict(fidelity(campaign, config, progress)))


def fidelity(campaign: Campaign, config: Config, progress: Progress) -> Iterator[tuple[tuple[str, str], tuple[float, list[str]]]]:
    """Return ((table, metric), (value, keys of the recordings)) of each result of the fidelity tables."""
    fetch = partial(stored, progress=progress)
    for module in FIDELITY:
        same = {
            part: getattr(config, part) for part in ("simulator", "materials", "radar", "measured", "profile", "seed", "output", "jobs")
        }
        try:
            table_config = replace(_config_of(module), **same)
            if module is environment:
                frame = environment.read(table_config, environment.sources(campaign), fetch)
            else:
                frame = fetch(campaign, shared(campaign, module.MOTIONS))
            result = module.score(table_config, frame.assign(draw=0))  # all draws count as repetitions of one draw
        except InputError as error:  # the campaign lacks the motion, or has too few objects
            progress.say(f"sensitivity: leaves out the table {_name(module)}: {error}")
            continue
        for metric, value in result.metrics.items():
            yield (_name(module), metric), (value, result.keys)


def _recording_columns(campaign: Campaign, case: Case) -> tuple[str, str, np.ndarray, float, int, int]:
    """Return the columns of a simulated recording in `Twin.recordings`."""
    key, processed = campaign.processed("twin", case)
    made = campaign.clean("twin", case).read_json("meta")
    told = made["told"]
    values = families.vector(processed, campaign.log(case, "twin"), FEATURES[case.motion])[1]
    return case.motion, key, values, float(made["core_seconds"]) / told["frames"], int(told.get(tally.SETUPS, 0)), int(told["frames"])


def table(config: Config, twins: Mapping[str, Twin]) -> RowList:
    """Return feature error and run time of each setting and motion, and each fidelity result with its change from the default."""
    default = twins[DEFAULT]
    finest = dict(list(twins[FINEST].recordings.groupby("motion")))
    seeds = config.profile.resamples, config.seed
    rows = RowList(config)
    for name, twin in twins.items():
        for motion, of_motion in twin.recordings.groupby("motion", sort=False):
            case = {"setting": name, "table": "", "motion": motion, "change": None}
            error = feature_error(*(np.stack(list(recordings.features)) for recordings in (of_motion, finest[motion])))
            rows.add(case, ERROR, statistics.mean(error, *seeds), {*of_motion.key, *finest[motion].key})
            plain, others = of_motion[of_motion.setups == 0], of_motion[of_motion.setups > 0]
            if len(plain):
                rows.add(case, COST, statistics.mean(1e3 * plain.frame_s, *seeds), plain.key)
                if len(others):
                    whole = (others.frame_s - plain.frame_s.mean()) * others.frames / others.setups
                    rows.add(case, SETUP, statistics.mean(whole, *seeds), others.key)
        for (table_name, metric), (value, keys) in twin.figures.items():
            change = value - default.figures[table_name, metric][0] if (table_name, metric) in default.figures else None
            case = {"setting": name, "table": table_name, "motion": "", "change": change}
            rows.add(case, metric, Estimate(value, float("nan"), float("nan"), len(keys)), keys)
    return rows


def feature_error(values: np.ndarray, finest: np.ndarray) -> np.ndarray:
    """Return the feature error (recordings,) of (recordings, features): the rms over features of (value - value of the finest setting) /
    standard deviation over the recordings of the finest setting. Features that are constant there are left out.
    """
    spread = finest.std(axis=0)
    tells = spread > 1e-9 * np.abs(finest).max(axis=0, initial=0.0)
    return np.sqrt((((values - finest)[:, tells] / spread[tells]) ** 2).mean(axis=1))


def chart(rows: Sequence[dict[str, Any]]) -> Figure:
    """Draw run time against feature error, with a panel for each motion and a marker for each setting except the finest."""
    motions = list(dict.fromkeys(r["motion"] for r in rows if r["metric"] == ERROR))
    drawing, panels = figure(1, len(motions), width_in=PAGE_WIDTH_IN, height_in=3.2, sharey=True, squeeze=False)
    names = [setting.name for setting in SETTINGS if setting.name != FINEST]
    marks = "osD^v<>PX*"

    def value(name: str, motion: str, metric: str) -> float | None:
        return next((r["value"] for r in rows if (r["setting"], r["motion"], r["metric"]) == (name, motion, metric)), None)

    for axes, motion in zip(panels[0], motions, strict=True):
        for k, name in enumerate(names):
            cost = value(name, motion, COST)
            if cost is None:
                continue
            axes.plot(
                cost, max(value(name, motion, ERROR) or 0.0, 1e-3), marks[k % len(marks)], color=PALETTE[k % len(PALETTE)], label=name
            )
        axes.set(xscale="log", yscale="log", xlabel=COST, title=motion)
    panels[0][0].set_ylabel("feature error (standard deviations)")
    legend_above(drawing, panels[0][0], 4)
    return drawing
