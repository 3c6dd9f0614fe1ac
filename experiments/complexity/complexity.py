"""How much model a scene needs: the cheapest model whose features stay within their repeatability, by scene, object and feature set.

This is the choice of simulator=auto (radartwin/adaptive), case by case. It starts from the finest model and leaves out one part after
another that the features do not need. The fixed default is one setting for all cases: the cheaper of the shipped default and the choice
for all cases at once, as far as both are sufficient. The error is that of the worst feature against the finest model, in units of its
repeatability limit. It is reported on the frames of the choice, and judged on an equal number of frames between them. Run times are of
whole recordings (`timing`). Rooms are the procedural ones without scan errors, and a scan if the configuration has one.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments.campaign.cases import Case, Log, log, stand_top
from experiments.claims import NONE, Claim, row
from experiments.complexity import figure, timing
from experiments.speed.machine import machine
from experiments.statistics import Estimate
from radartwin.adaptive import limits as limits_module
from radartwin.adaptive.choice import Choice, choose
from radartwin.adaptive.limits import Limits
from radartwin.adaptive.model import DEFAULT, FINEST, LADDER, Model
from radartwin.adaptive.probe import Probe, thinned
from radartwin.build.auto import MOTION_FAMILIES, families_of
from radartwin.build.radar import build_radar
from radartwin.build.setup import build_setup
from radartwin.config.config import Config
from radartwin.config.study import CampaignConfig
from radartwin.features.families import SETS
from radartwin.features.processed import Processed
from radartwin.io.progress import Progress
from radartwin.runs import workers
from radartwin.runs.experiment import Result, Table
from radartwin.scene import rooms
from radartwin.scene.objects.catalogue import catalogue
from radartwin.scene.scene import Scene
from radartwin.store import array_cache
from radartwin.store.digest import path_digest
from radartwin.store.products import Store

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TABLE = Table(
    name="complexity",
    title="How much model a scene needs",
    caption="simulator=auto chooses the cheapest model whose features stay within their repeatability limit of the finest model's "
    "features, on a few frames of a recording. The finest model traces the whole room with five bounces and four tubes per "
    "square wavelength. The repeatability limit is the difference that 95 % of repeated set-ups of the same object at 1 m stay "
    "below, in the testbed. The error is that of the worst feature, in units of its limit, and is judged on an equal number of "
    "held-out frames. The fixed default is the cheapest setting known to work for all cases. A value is its processor time per "
    "frame divided by that of auto, as the median and the range over n rounds. The time of the choice is a column of its own, "
    "with the number of frames after which the choice has saved that time. The median over cases uses the feature set of each "
    "case; its interval is a bootstrap over cases. The quick profile has one case.",
)

PROBED = ("radartwin.adaptive.probe",)  # modules that decide the content of a probe's recording
CHEAPER = 3.0  # required ratio of run times, fixed default to auto, in the median
ROUNDS = 2  # of timing; the quick profile has one
# Feature sets of each motion: those of claims, the motion's own set, and all of its features.
SHAPE, MULTIPATH, EVERYTHING = "shape", "multipath share", "everything"
_DRIVEN = {"track": ("track",), "depth": SETS["depth"], EVERYTHING: MOTION_FAMILIES["depth"]}
ASKED: dict[str, dict[str, tuple[str, ...]]] = {
    "turntable": {
        SHAPE: ("harmonics", "envelope"), "rotation": SETS["rotation"], MULTIPATH: ("multipath",), EVERYTHING: MOTION_FAMILIES["turntable"],
    },
    "lateral": {"envelope": ("harmonics", "envelope"), "lateral": SETS["lateral"], EVERYTHING: MOTION_FAMILIES["lateral"]},
    **dict.fromkeys(("depth", "radial", "diagonal"), _DRIVEN),
}  # fmt: skip
OWN = tuple(name for name in SETS if name != "raw")  # feature sets named after motions; the median takes one per case
REFLECTOR = Case("corner_reflector", "lab", "turntable", 2.0)
CASES = {
    "quick": (REFLECTOR,),
    "paper": (
        REFLECTOR, Case("mustard", "lab", "turntable", 2.0), replace(REFLECTOR, distance_m=1.0),
        Case("drink_can_355", "squash_court", "depth", 1.0), Case("mug", "squash_court", "lateral", 1.0),
        Case("mustard", "atrium", "depth", 1.0),
    ),
}  # fmt: skip
AUTO, FIXED, SHIPPED = "auto", "fixed", "shipped"
SAVED = "cost of the fixed default over auto's"
NEEDED = "parts of the room that are needed (0 none, 1 large, 2 whole)"


@dataclass(frozen=True, eq=False)
class Kept:
    """A probe with recordings in the store; `cost` holds the core seconds of each."""

    probe: Probe
    store: Store
    cost: dict[Model, float] = field(default_factory=dict)

    def features(self, model: Model) -> tuple[list[str], np.ndarray]:
        if model not in self.probe.traced:
            spec = {**self.probe.described(), "families": None, "model": model}

            def build(folder: Path) -> None:
                self.probe.record(model).save(folder)

            product = self.store.fetch("probe", spec, PROBED, build)
            self.probe.traced[model] = Processed.load(product.path)
            self.cost[model] = float(product.read_json("meta")["core_seconds"])
        return self.probe.features(model)

    def asked(self, families: tuple[str, ...]) -> Kept:
        return replace(self, probe=replace(self.probe, families=families))


ProbeOf = Callable[[int | None, bool], Probe]  # (number of frames or None for a probe's, whether between the probe's frames)


@dataclass(frozen=True, eq=False)
class Asked:
    """A feature set of a case: the probe of the choice, the probe of the frames between, and the limits."""

    name: str
    words: str
    kept: Kept
    between: Kept
    limits: Limits
    probe_of: ProbeOf

    def error(self, model: Model, between: bool = False, finest: Model = FINEST) -> tuple[float, str]:
        """(error, name) of the feature with the largest difference from the finest model, in limits."""
        kept = self.between if between else self.kept
        names, values = kept.features(model)
        return self.limits.moved(names, values, kept.features(finest)[1])


@dataclass(frozen=True)
class Found:
    """The result for one scene, object and feature set.

    Attributes:
        name, asked: names of the case and of the feature set.
        choice: of auto.
        models: by AUTO, FIXED and SHIPPED.
        errors: (limits, feature) of each model on the frames of the choice.
        between: (limits, feature) of each model on the frames between.
        layers: error of the shipped default without layers.
        seconds: core seconds per frame of each model, round by round.
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
        """Run time of the fixed default relative to auto."""
        return timing.ratio(self.seconds[FIXED], self.seconds[AUTO])


def identity() -> dict[str, Any]:
    """Additional parts of the run key: the machine, because it decides the timings, and the file of the limits."""
    return {"machine": machine(), "limits": path_digest(limits_module.SHIPPED)}


def run(config: Config, store: Store, progress: Progress) -> Result:
    """Choose a model for every case alone and for all cases together, then time the chosen models.

    Raises:
        ConfigError: a scan without an object under test, or with a motion of unknown repeatability.
    """
    cases = CASES.get(config.profile.name, CASES["paper"])
    if workers.worker_count(config.jobs, len(cases)) > 1:
        with progress.task("cases recorded", len(cases)) as done:
            workers.each(_recorded, [(case, config) for case in cases], config.jobs, done)
    asked = [one for case in cases for one in _of_case(case, config, store)]
    if config.scene.name == "scan":
        asked += _of_scan(config, store)
    alone = []
    for name in dict.fromkeys(one.name for one in asked):
        with tempfile.TemporaryDirectory() as folder, array_cache.in_folder(folder):  # the models of one case share cached rooms
            mine = [one for one in asked if one.name == name]
            alone += [choose([(one.kept, one.limits)]) for one in progress.over(mine, name)]
    fixed = choose([(one.kept, one.limits) for one in progress.over(asked, "one for all")])
    seconds: dict[str, dict[Model, list[float]]] = {}
    names = dict.fromkeys(one.name for one in asked)
    for name in progress.over(list(names), "costs"):
        mine = [(one, choice) for one, choice in zip(asked, alone, strict=True) if one.name == name]
        models = [fixed.model, DEFAULT, *(choice.model for _, choice in mine)]
        seconds[name] = timing.seconds(mine[0][0].probe_of, models, 1 if config.profile.name == "quick" else ROUNDS, store)
    sufficient = max(one.error(DEFAULT)[0] for one in asked) <= 1
    if sufficient and np.median([timing.ratio(of[DEFAULT], of[fixed.model]) for of in seconds.values()]) < 1:
        fixed = Choice(DEFAULT, *max(one.error(DEFAULT) for one in asked), ())
    pairs = list(zip(asked, alone, strict=True))
    found = [_found(one, choice, fixed.model, seconds[one.name]) for one, choice in progress.over(pairs, "errors")]
    rows = table(config, found, fixed)
    figures: dict[str, Callable[[], Figure]] = {"complexity": lambda: figure.chart(rows)}
    claimed = [r for r in rows if r["claim"] and r["value"] is not None]
    metrics = {_plain(f"{r['metric']} {r['case']} {r['features']}"): r["value"] for r in claimed}
    return Result(TABLE.name, rows, figures, metrics, [])


def _recorded(case: Case, config: Config) -> None:
    """Store the recordings that the choice for one case and its errors need."""
    with tempfile.TemporaryDirectory() as folder, array_cache.in_folder(folder):
        for one in _of_case(case, config, Store(Path(config.output) / "cache")):
            chosen = choose([(one.kept, one.limits)]).model
            for model in (chosen, DEFAULT):
                one.error(model, between=True)
            one.error(replace(DEFAULT, layered=False))


def _plain(name: str) -> str:
    """Remove characters that metric names must not have."""
    return re.sub(r"[^\w .:/-]", "", name)


def _of_case(case: Case, config: Config, store: Store) -> list[Asked]:
    return _asked(case.name.removesuffix("-0"), staged_case(case, config), case.motion, case.object, store)


def _of_scan(config: Config, store: Store) -> list[Asked]:
    setup, features, variant = build_setup(config), config.features, config.simulator.variant
    families_of(features, motion := setup.measured_motion)
    name = f"scan-{motion}-{config.scene.target}"
    return _asked(name, lambda count, between: setup.probe(features, variant, count, between), motion, config.scene.target, store)


def _asked(name: str, probe_of: ProbeOf, motion: str, thing: str, store: Store) -> list[Asked]:
    kept, between, limits = Kept(probe_of(None, False), store), Kept(probe_of(None, True), store), Limits.shipped(motion, thing)
    return [Asked(name, words, kept.asked(f), between.asked(f), limits, probe_of) for words, f in ASKED[motion].items()]


def staged_case(case: Case, config: Config) -> ProbeOf:
    """A case of the campaign in the room without scan errors: a function that returns a probe of some or all frames."""
    frames = timing.FRAMES[case.motion != "turntable"]
    nominal: Log = log(case, CampaignConfig(frames_per_turn=frames, rover_every=1), measured=False)
    motion = {case.object: np.repeat(nominal.target_poses, nominal.frames // len(nominal.target_poses), axis=0)}
    kept = rooms.support(stand_top(nominal)) + Scene(catalogue()[case.object].surfaces())
    radar = replace(build_radar(config.radar), frame_rate_hz=nominal.frame_rate_hz)
    room = rooms.room(case.room)

    def some(count: int | None, between: bool) -> Probe:
        return thinned(room, kept, radar, nominal.sensor_poses, motion, nominal, (), config.simulator.variant, count, between)

    return some


def _found(one: Asked, choice: Choice, fixed: Model, seconds: Mapping[Model, list[float]]) -> Found:
    models = {AUTO: choice.model, FIXED: fixed, SHIPPED: DEFAULT}
    errors, between = ({who: one.error(model, held) for who, model in models.items()} for held in (False, True))
    layers = one.error(replace(DEFAULT, layered=False))
    choosing_s = sum(one.kept.cost.get(model, 0.0) for model in {FINEST, *examined(choice)})
    return Found(one.name, one.words, choice, models, errors, between, layers, {who: seconds[m] for who, m in models.items()}, choosing_s)


def examined(choice: Choice) -> Iterable[Model]:
    """Every model that a choice examined."""
    model = FINEST
    for step in choice.steps:
        candidate = replace(model, **{step.dimension: step.value})
        yield candidate
        model = candidate if step.taken else model


def table(config: Config, found: Sequence[Found], fixed: Choice) -> list[dict[str, Any]]:
    """The need of each case, its savings and its error between the frames of the choice; then the claims about all cases."""
    rows = []
    for one in found:
        case = {"case": one.name, "features": one.asked} | _told(one)
        ratios = np.array(one.seconds[FIXED]) / np.array(one.seconds[AUTO])
        rows.append(_row(config, case, SAVED, (one.saved, ratios.min(), ratios.max()), len(ratios)))
        error = one.between[AUTO][0]
        rows.append(_row(config, case, "error between the frames of the choice (limits)", _alone(error), 1, SUFFICIENT))
        if REFLECTOR.object in one.name and "lab" in one.name and one.asked in ROOM_CLAIMS:
            parts = float(LADDER["parts"].index(one.choice.model.parts))
            rows.append(_row(config, case, NEEDED, _alone(parts), 1, ROOM_CLAIMS[one.asked]))
    every = {"case": "all", "features": "own sets"} | dict.fromkeys(_told(found[0]))
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


def _told(one: Found) -> dict[str, Any]:
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
    """The reductions that were refused, which show what a scene needs."""
    refused = {(step.dimension, step.value): step.told for step in choice.steps if not step.taken}
    taken = {(step.dimension, step.value) for step in choice.steps if step.taken}
    return "; ".join(told for what, told in refused.items() if what not in taken)


def _alone(value: float) -> tuple[float, float, float]:
    return value, value, value


def _median(values: Sequence[float], config: Config) -> tuple[float, float, float]:
    """Median with its interval, a bootstrap over cases."""
    drawn = np.median(np.random.default_rng(config.seed).choice(values, (config.profile.resamples, len(values))), axis=1)
    low, high = np.quantile(drawn, [0.025, 0.975])
    return float(np.median(values)), float(low), float(high)


def _row(
    config: Config, case: Mapping[str, Any], metric: str, value: tuple[float, float, float], n: int, claim: Claim = NONE
) -> dict[str, Any]:
    """A row; value with least and greatest."""
    return row(config, case, metric, Estimate(float(value[0]), float(value[1]), float(value[2]), n), [], claim) | {
        "domain": "this tracer, finest"
    }
