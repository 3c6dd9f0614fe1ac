"""Find the cheapest simulation model whose feature errors stay within the features' repeatability, for each scene, object and feature set.

simulator=auto (radartwin/adaptive) starts from the finest model and leaves out, one after another, the parts that the features do not need.
The "fixed default" is the model that the same search finds for all cases together. If the shipped default model is sufficient and cheaper,
it is the fixed default instead. The run times in this table are those of whole recordings (module `timing`). The recordings are simulated
in procedural rooms without scan errors, and also in a scanned room if the configuration names a scan.
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from experiments.campaign.cases import Case, Log, log, stand_top
from experiments.complexity import timing
from experiments.complexity.rows import AUTO, EVERYTHING, FIXED, MULTIPATH, REFLECTOR, SHAPE, SHIPPED, CaseResult, chart, table
from experiments.interface import Config, Progress, Result, Store, Table
from experiments.speed.machine import machine
from radartwin.adaptive import limits as limits_module
from radartwin.adaptive.choice import Choice, choose
from radartwin.adaptive.limits import Limits
from radartwin.adaptive.probe import Probe, thinned
from radartwin.adaptive.scene_settings import DEFAULT, FINEST, Model
from radartwin.builders.radar import build_radar
from radartwin.builders.recording import build_setup
from radartwin.builders.simulator import MOTION_FAMILIES, families_of
from radartwin.config.study import CampaignConfig
from radartwin.features.processed import Processed
from radartwin.features.sets import SETS
from radartwin.runs import workers
from radartwin.scene import rooms
from radartwin.scene.objects.catalogue import catalogue
from radartwin.scene.scene import Scene
from radartwin.store import array_cache
from radartwin.store.digest import path_digest

TABLE = Table(
    name="complexity",
    title="How detailed the simulation of a scene must be",
    caption="A model is one set of simulator settings. simulator=auto chooses the cheapest model whose features differ from those of the "
    "finest model by at most their repeatability limit, on a few frames of a recording. The finest model traces the whole room with "
    "five bounces and four tubes per square wavelength. "
    "The repeatability limit is the difference that 95 % of repeated set-ups of the same object at 1 m stay "
    "below, in the testbed. The error is that of the worst feature, in units of its repeatability limit, and is judged on an equal "
    "number of held-out frames. The fixed default is the cheapest single setting known to work for all cases. A value is the "
    "processor time per frame of the fixed default divided by that of the chosen model: the median and the range over n rounds. "
    "Two columns give the time of the choice, and the number of frames after which the choice has saved that time. The median over "
    "cases uses one feature set per case, that of its motion; its interval is a bootstrap over cases. The quick profile has one case, "
    "times fewer frames, and leaves out the set of all features.",
    timed=True,
)

PROBED = ("radartwin.adaptive.probe",)  # the cache keys of recordings depend on the code of these modules
# Number of rounds of timing, and of frames of the longer recording, None for all of a probe
QUICK, PAPER = (1, 16), (2, None)
# Feature sets of each motion: sets that a claim of a table needs, the set named after the motion, and all features of the motion.
_DRIVEN = {"track": ("track",), "depth": SETS["depth"], EVERYTHING: MOTION_FAMILIES["depth"]}
ASKED: dict[str, dict[str, tuple[str, ...]]] = {
    "turntable": {
        SHAPE: ("harmonics", "envelope"), "rotation": SETS["rotation"], MULTIPATH: ("multipath",), EVERYTHING: MOTION_FAMILIES["turntable"],
    },
    "lateral": {"envelope": ("harmonics", "envelope"), "lateral": SETS["lateral"], EVERYTHING: MOTION_FAMILIES["lateral"]},
    **dict.fromkeys(("depth", "radial", "diagonal"), _DRIVEN),
}  # fmt: skip
NEARER = replace(REFLECTOR, distance_m=1.0)
CASES = {
    "quick": (NEARER,),  # a recording takes two thirds of the time of one at 2 m
    "paper": (
        REFLECTOR, Case("mustard", "lab", "turntable", 2.0), NEARER,
        Case("drink_can_355", "squash_court", "depth", 1.0), Case("mug", "squash_court", "lateral", 1.0),
        Case("mustard", "atrium", "depth", 1.0),
    ),
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Kept:
    """A probe (frames on which models are compared) whose recordings are stored; `cost` holds the core-seconds of each."""

    probe: Probe
    store: Store
    cost: dict[Model, float] = field(default_factory=dict)

    def features(self, model: Model) -> tuple[list[str], np.ndarray]:
        """Return names and values of the features that a model gives; a recording that the store lacks is simulated first."""
        if model not in self.probe.traced:
            spec = {**self.probe.described(), "families": None, "model": model}

            def build(folder: Path) -> None:
                self.probe.record(model).save(folder)

            product = self.store.fetch("probe", spec, PROBED, build)
            self.probe.traced[model] = Processed.load(product.path)
            self.cost[model] = float(product.read_json("meta")["core_seconds"])
        return self.probe.features(model)

    def asked(self, families: tuple[str, ...]) -> Kept:
        """Return the same probe (frames for comparing models) with the feature families `families`."""
        return replace(self, probe=replace(self.probe, families=families))


ProbeOf = Callable[[int | None, bool], Probe]  # (number of frames or None for the default, whether to take held-out frames) -> probe


@dataclass(frozen=True, eq=False)
class Requirement:
    """A feature set of one case (scene, object and motion), for which a simulation model is chosen."""

    name: str  # name of the case
    words: str  # name of the feature set for which a model is chosen
    kept: Kept  # frames on which the model is chosen
    between: Kept  # held-out frames between the frames of `kept`
    limits: Limits  # repeatability limits of the features
    probe_of: ProbeOf

    def error(self, model: Model, between: bool = False) -> tuple[float, str]:
        """Return (error, name) of the feature with the largest error: its difference from the finest model over its repeatability limit
        (the difference that occurs between repeated measurements).
        """
        kept = self.between if between else self.kept
        names, values = kept.features(model)
        return self.limits.moved(names, values, kept.features(FINEST)[1])


def identity() -> dict[str, Any]:
    """Return additions to the run key: the machine, because run times depend on it, and the file of the repeatability limits."""
    return {"machine": machine(), "limits": path_digest(limits_module.SHIPPED)}


def run(config: Config, store: Store, progress: Progress) -> Result:
    """Choose a model for each case and for all, then measure run times. Raises ConfigError for a scan without target or limits."""
    cases = cases_of(config)
    if workers.worker_count(config.jobs, len(cases)) > 1:
        with progress.task("cases recorded", len(cases)) as done:
            workers.each(_recorded, [(case, config) for case in cases], config.jobs, done)
    requirements = [requirement for case in cases for requirement in _of_case(case, config, store)]
    if config.scene.name == "scan":
        requirements += _of_scan(config, store)
    alone = []
    for name in dict.fromkeys(requirement.name for requirement in requirements):
        with tempfile.TemporaryDirectory() as folder, array_cache.in_folder(folder):  # the models of one case share cached rooms
            mine = [requirement for requirement in requirements if requirement.name == name]
            alone += [choose([(requirement.kept, requirement.limits)]) for requirement in progress.over(mine, name)]
    fixed = choose([(requirement.kept, requirement.limits) for requirement in progress.over(requirements, "one model for all cases")])
    seconds: dict[str, dict[Model, list[float]]] = {}
    names = dict.fromkeys(requirement.name for requirement in requirements)
    for name in progress.over(list(names), "run times"):
        mine = [(requirement, choice) for requirement, choice in zip(requirements, alone, strict=True) if requirement.name == name]
        models = [fixed.model, DEFAULT, *(choice.model for _, choice in mine)]
        rounds, frames = QUICK if config.profile.name == "quick" else PAPER
        seconds[name] = timing.seconds(mine[0][0].probe_of, models, rounds, store, frames)
    sufficient = max(requirement.error(DEFAULT)[0] for requirement in requirements) <= 1
    if sufficient and np.median([timing.ratio(of[DEFAULT], of[fixed.model]) for of in seconds.values()]) < 1:
        fixed = Choice(DEFAULT, *max(requirement.error(DEFAULT) for requirement in requirements), ())
    pairs = list(zip(requirements, alone, strict=True))
    results = []
    for requirement, choice in progress.over(pairs, "errors"):
        models = {AUTO: choice.model, FIXED: fixed.model, SHIPPED: DEFAULT}
        errors, between = ({who: requirement.error(model, held) for who, model in models.items()} for held in (False, True))
        layers = requirement.error(replace(DEFAULT, layered=False))
        choosing_s = sum(requirement.kept.cost.get(model, 0.0) for model in {FINEST, *examined(choice)})
        by_model = {who: seconds[requirement.name][model] for who, model in models.items()}
        results.append(CaseResult(requirement.name, requirement.words, choice, models, errors, between, layers, by_model, choosing_s))
    rows = table(config, results, fixed)
    claimed = [r for r in rows if r["claim"] and r["value"] is not None]
    # a metric name may contain only the characters in this pattern
    metrics = {re.sub(r"[^\w .:/-]", "", f"{r['metric']} {r['case']} {r['features']}"): r["value"] for r in claimed}
    return Result(TABLE.name, rows, {TABLE.name: lambda: chart(rows)}, metrics)


def calls(config: Config) -> list[tuple[Any, ...]]:
    return [(_recorded, case, config) for case in cases_of(config)]


def cases_of(config: Config) -> tuple[Case, ...]:
    return CASES.get(config.profile.name, CASES["paper"])


def _recorded(case: Case, config: Config) -> None:
    """Simulate and store the recordings that are needed to choose a model for one case and to compute the model's errors."""
    with tempfile.TemporaryDirectory() as folder, array_cache.in_folder(folder):
        for requirement in _of_case(case, config, Store(Path(config.output) / "cache")):
            auto = choose([(requirement.kept, requirement.limits)]).model
            for model in (auto, DEFAULT):
                requirement.error(model, between=True)
            requirement.error(replace(DEFAULT, layered=False))


def _of_case(case: Case, config: Config, store: Store) -> list[Requirement]:
    requirements = _requirements(case.name.removesuffix("-0"), staged_case(case, config), case.motion, case.object, store)
    return [requirement for requirement in requirements if config.profile.name != "quick" or requirement.words != EVERYTHING]


def _of_scan(config: Config, store: Store) -> list[Requirement]:
    setup = build_setup(config)
    features, variant = config.features, config.simulator.variant
    families_of(features, motion := setup.measured_motion)
    name = f"scan-{motion}-{config.scene.target}"
    return _requirements(name, lambda count, between: setup.probe(features, variant, count, between), motion, config.scene.target, store)


def _requirements(name: str, probe_of: ProbeOf, motion: str, thing: str, store: Store) -> list[Requirement]:
    kept, between, limits = Kept(probe_of(None, False), store), Kept(probe_of(None, True), store), Limits.shipped(motion, thing)
    return [Requirement(name, words, kept.asked(f), between.asked(f), limits, probe_of) for words, f in ASKED[motion].items()]


def staged_case(case: Case, config: Config) -> ProbeOf:
    """Return the function that builds the probe (frames on which models are compared) of a case, in the room without scan errors."""
    frames = timing.FRAMES[case.motion != "turntable"]
    nominal: Log = log(case, CampaignConfig(frames_per_turn=frames, rover_every=1), measured=False)
    motion = {case.object: np.repeat(nominal.target_poses, nominal.frames // len(nominal.target_poses), axis=0)}
    kept = rooms.support(stand_top(nominal)) + Scene(catalogue()[case.object].surfaces())
    radar = replace(build_radar(config.radar), frame_rate_hz=nominal.frame_rate_hz)
    room = rooms.room(case.room)

    def probe_of(count: int | None, between: bool) -> Probe:
        return thinned(room, kept, radar, nominal.sensor_poses, motion, nominal, (), config.simulator.variant, count, between)

    return probe_of


def examined(choice: Choice) -> Iterable[Model]:
    """Yield every simulation model that was examined before a choice was made."""
    model = FINEST
    for step in choice.steps:
        candidate = replace(model, **{step.dimension: step.value})
        yield candidate
        model = candidate if step.taken else model
