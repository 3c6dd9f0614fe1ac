"""Implement the verb `train`: simulate the user's objects, train a recogniser on the simulation, and write it with its model card.

The store keeps revolutions and recogniser, so that an interrupted command resumes. MLflow tracks the training like an experiment.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from radartwin.builders import revolutions
from radartwin.builders.revolutions import Revolution
from radartwin.builders.scene import materials_line
from radartwin.config.compose import compose, path_override, refuse_unread, with_output
from radartwin.config.config import Config
from radartwin.config.trajectory import TurntableTrajectory
from radartwin.errors import ConfigError
from radartwin.io.progress import Progress
from radartwin.recognize.encoder import Settings
from radartwin.recognize.own import stored
from radartwin.recognize.own.copied_rows import FEATURES, WITHOUT
from radartwin.recognize.own.fitting import HeldOut, Training
from radartwin.recognize.own.model_card import CARD, FREE_SPACE, TrainedOn
from radartwin.recognize.own.object_list import OwnObject, anchors, read_objects
from radartwin.recognize.samples import Samples, gather
from radartwin.runs import workers
from radartwin.runs.run import tracked
from radartwin.runs.tracking import Tracker
from radartwin.store import products
from radartwin.store.products import Product, Store

TABLE = "train"  # name of the MLflow experiment
LONGEST = 500  # characters of a parameter in MLflow
KIND, ROOTS = "recogniser", ["radartwin.recognize.own.stored"]
READ = ("radar", "trajectory", "supervision", "seed", "simulator", "scene", "materials", "contents", "tracking", "output", "jobs")
SET_BY = {"scene.target": "OBJECTS", "trajectory.distance_m": "--distances", "trajectory.frames": "--frames"}


def train(options: argparse.Namespace) -> int:
    config = configured(options)
    objects = read_objects(options.objects, config.contents)
    vectors = anchors(objects)
    stored.check_model_folder(options.out)
    progress = Progress()
    tracker = Tracker(config.tracking, Path(config.output))
    root = Path(config.output) / "cache"
    planned, room = revolutions.plan(config, objects, options.distances, options.frames, root)
    store = Store(root, progress.say)
    with products.counting() as counts:
        rows, keys = simulated(planned, config.jobs, store, progress)
    trained = trained_on(config, objects, planned, room)
    features = {"set": FEATURES, "without": list(WITHOUT), "period_s": trained.period_s, "frames_per_turn": trained.frames}
    settings = replace(Settings(**asdict(config.supervision.encoder)), paired=0.0)
    product = fitted(objects, Training(vectors, settings, config.seed, features), trained, rows, keys, store, tracker)
    stored.copy(product, options.out)
    tested = stored.read_held_out(product)
    made = counts.by_kind[f"{revolutions.REVOLUTION} built"]
    progress.say(f"simulated {made} recordings, reused {len(planned) - made}")
    accuracy = "no accuracy, because no distance was held out" if tested is None else f"{tested.accuracy:.1%} correct at held-out distances"
    print(f"{options.out}: {len(objects)} classes; {accuracy} (simulation, not reality); {options.out / CARD} has the details")
    return 0


def configured(options: argparse.Namespace) -> Config:
    """Compose the configuration of a training. Raise ConfigError for an override that a training does not read."""
    given = with_output(options.overrides, options.output)
    keys = refuse_unread("train", given, READ, SET_BY)
    target = "scene.target=corner_reflector"  # a placeholder, because the configuration cannot name the user's objects
    presets = ["features=rotation", f"features.without=[{','.join(WITHOUT)}]", target]
    if options.room:
        if "scene" in keys or "scene.path" in keys:
            raise ConfigError("--room and scene= both choose the room; give one of them")
        presets += ["scene=scan", path_override("scene.path", options.room)]
    elif "scene" not in keys:
        presets.append("scene=empty")
    config = compose([*presets, *given], options.config_dir)
    if config.supervision.mode != "label_free":
        raise ConfigError(f"supervision={config.supervision.mode} needs measured recordings, but train uses simulation only; leave it out")
    return config


def simulated(planned: Sequence[Revolution], jobs: int, store: Store, progress: Progress) -> tuple[Samples, dict[str, str]]:
    """Return the feature rows of all revolutions, and the store key of the copies of each revolution by its name.

    Workers compute the missing results.
    """
    missing = [(revolution,) for revolution in planned if not revolution.is_stored(store)]
    if missing:
        with progress.task("recordings simulated", len(missing)) as done:
            workers.each(revolutions.compute, missing, jobs, done)
    parts = [revolution.part(store) for revolution in planned]
    return gather(parts[0][1], [part for _, _, part in parts]), {part.recording: key for key, _, part in parts}


def trained_on(config: Config, objects: Sequence[OwnObject], planned: Sequence[Revolution], room: Mapping[str, Any]) -> TrainedOn:
    assert isinstance(config.trajectory, TurntableTrajectory)
    return TrainedOn(
        radar=Path(config.radar.file).name if config.radar.file else config.radar.name,
        radar_settings=planned[0].setup.radar.to_dict(),
        surroundings=surroundings(room),
        simulator=config.simulator.backend,
        distances_m=tuple(dict.fromkeys(revolution.distance_m for revolution in planned)),
        frames=planned[0].frames,
        period_s=config.trajectory.period_s,
        copies=config.supervision.copies,
        variants=config.supervision.variants,
        randomise=asdict(config.supervision.randomise),
        seed=config.seed,
        recordings=len(planned),
        described=any(own_object.description for own_object in objects),
    )


def fitted(
    objects: Sequence[OwnObject],
    training: Training,
    trained: TrainedOn,
    rows: Samples,
    keys: Mapping[str, str],
    store: Store,
    tracker: Tracker,
) -> Product:
    """Train the recogniser or read it from the store, track it in MLflow, and return its stored result."""
    described = [
        [own_object.name, own_object.origin, own_object.material, own_object.size_m, own_object.description] for own_object in objects
    ]
    spec = {"recordings": dict(keys), "trained": trained, "training": training, "objects": described}

    def build(folder: Path) -> None:
        stored.write(folder, rows, training, objects, trained, {**asdict(trained), "recordings": dict(keys)})

    shown = TABLE, f"{len(objects)} objects", params(trained, objects)
    with tracked(tracker, store, (KIND, spec, ROOTS), build, *shown) as (product, record):
        record.metrics = metrics(stored.read_held_out(product), len(objects))
        record.artifacts, record.inputs = sorted(product.path.iterdir()), {revolutions.COPIES: sorted(keys.values())}
    return product


def surroundings(room: Mapping[str, Any]) -> str:
    """Return the surroundings of the objects as text, from the description of the room (`describe_room`)."""
    scene = room["scene"]
    return f"room {scene.get('path', scene['name'])}; {line}" if (line := materials_line(dict(room))) else FREE_SPACE


def params(trained: TrainedOn, objects: Sequence[OwnObject]) -> dict[str, str]:
    """Return the values that MLflow shows as parameters of the run."""
    names = ", ".join(own_object.name for own_object in objects)
    distances = " ".join(f"{distance_m:g}" for distance_m in trained.distances_m)
    values = {name: value for name, value in asdict(trained).items() if name != "radar_settings"}
    return {name: str(value)[:LONGEST] for name, value in {**values, "distances_m": distances, "objects": names}.items()}


def metrics(tested: HeldOut | None, classes: int) -> dict[str, float]:
    """Return the numbers that MLflow shows. All numbers come from simulation."""
    if tested is None:
        return {"chance": 1 / classes}
    per_distance = {f"simulated_accuracy_{name.replace(' ', '')}": share for name, share in tested.by_distance.items()}
    return {"chance": 1 / classes, "simulated_accuracy": tested.accuracy, **(per_distance if len(per_distance) <= 20 else {})}
