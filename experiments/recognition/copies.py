"""Make randomised copies of simulated turntable revolutions, and read their feature rows.

Each copy has random values of the quantities that the user of a simulation cannot know (radartwin.recognize.randomise). For each recording,
`supervision.variants` random targets on random turntables are simulated alone in free space. The store keeps the echoes of the nominal and
the random targets, and the feature rows and pictures of the copies. The noise power of the copies follows from target energies and noise
floors of measured recordings, without their class labels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from experiments.campaign.campaign import Call, Campaign
from experiments.campaign.cases import TWIN, Case
from experiments.campaign.source import RecordingSource
from experiments.recognition.readings import FEATURES, MOTION, Readings, part, picture_row, recording_name, shared_cases, stratum, vectors
from radartwin.builders.radar import build_radar
from radartwin.builders.simulator import fixed_simulator, simulator_options
from radartwin.config.config import Config
from radartwin.features import envelope, sets
from radartwin.features.log import distances
from radartwin.features.processed import MAX_RANGE_M
from radartwin.io.progress import Progress
from radartwin.radar.processing import range_axis
from radartwin.recognize import randomise
from radartwin.recognize.augment import added_noise
from radartwin.recognize.learners.interface import Reads
from radartwin.recognize.samples import gather
from radartwin.scene.objects.assortment import every_object
from radartwin.store.products import Store, save_arrays

ROOTS = [
    "radartwin.features.sets", "radartwin.features.pictures", "radartwin.recognize.augment", "radartwin.recognize.randomise",
    "radartwin.builders.simulator", "experiments.recognition.copies",
]  # fmt: skip
NEAR_TARGET_M = 0.75  # largest distance of a stored echo from the nominal range of the target; farther echoes are below -60 dB


def strengths(config: Config) -> randomise.Randomisation:
    return randomise.Randomisation(**asdict(config.supervision.randomise))


def measured_and_copies(
    config: Config, source: RecordingSource, store: Store, progress: Progress, without: Sequence[str] = ()
) -> tuple[Readings, Readings]:
    """Return (features of measured turntable revolutions, features of copies of simulated turntable revolutions)."""
    cases, twins = shared_cases(source, MOTION)
    progress.say(f"{len(twins)} simulated revolutions, {config.supervision.copies} copies of each; {len(cases)} measured recordings")
    copied = rows_of_copies(config, store, source, twins, cases, without)
    return vectors(source, "measured", cases, FEATURES, without), copied["features"]


def rows_of_copies(
    config: Config, store: Store, source: RecordingSource, simulated: Sequence[Case], measured: Sequence[Case],
    without: Sequence[str] = (), measured_source: RecordingSource | None = None,
) -> dict[Reads, Readings]:  # fmt: skip
    """Compute feature vectors and pictures of `supervision.copies` copies per simulated recording.

    The noise level of a copy comes from the measured recordings at the same distance.

    Args:
        measured_source: source of the measured recordings; None stands for the same source as the simulated recordings (`source`).
    """
    measured_source = measured_source or source
    source.prepare([("twin", case) for case in simulated])
    measured_source.prepare([("measured", case) for case in measured])
    noise: dict[str, float] = {}
    for name in sorted({stratum(case) for case in simulated}):
        ours = np.array([_energy(source, "twin", case) for case in simulated if stratum(case) == name])
        theirs = np.array([_energy(measured_source, "measured", case) for case in measured if stratum(case) == name])
        noise[name] = added_noise(ours[:, 0], theirs[:, 0], float(np.median(theirs[:, 1]))) if len(theirs) else 0.0
    keys: list[str] = []
    kinds: tuple[Reads, ...] = ("features", "pictures")
    parts, names = {kind: [] for kind in kinds}, {kind: [] for kind in kinds}
    for case, own in _seeded(config, simulated):
        key, found = _rows(config, store, source, case, noise[stratum(case)], own, without)
        for kind in kinds:
            names[kind] = [str(name) for name in found[f"{kind}_names"]]
            parts[kind].append(part("twin", case, found[kind]))
        keys.append(key)
    return {kind: Readings(gather(names[kind], parts[kind]), tuple(sorted(keys))) for kind in kinds}


def _rows(
    config: Config, store: Store, source: RecordingSource, case: Case, noise_power: float, seed: list[int], without: Sequence[str]
) -> tuple[str, dict[str, NDArray]]:
    """Return the store key of a simulated recording, and the names and values of its copies' rows for each kind of row."""
    key, processed = source.processed("twin", case)
    log, chosen = source.log(case, "twin"), config.supervision
    drawn = strengths(config)

    def build(folder: Path) -> None:
        vectors_, pictures = [], []
        echoes: list[NDArray] = []
        if drawn.moves_target:
            assert isinstance(source, Campaign), "drawn targets need a campaign that simulates them"
            echoes = _alone(config, store, source, case, seed)
        for copy in randomise.copies(processed, echoes, noise_power, chosen.copies, drawn, seed):
            vectors_.append(sets.vector(copy, log, FEATURES, without))
            pictures.append(picture_row(copy, log))
        found: dict[str, NDArray] = {}
        for kind, made in (("features", vectors_), ("pictures", pictures)):
            found |= {f"{kind}_names": np.array(made[0][0]), kind: np.stack([values for _, values in made])}
        save_arrays(folder, found | {"pictures": found["pictures"].astype(np.float32)})

    spec = {
        "recording": key, "features": FEATURES, "without": list(without), "noise": noise_power, "count": chosen.copies, "seed": seed,
        "randomise": asdict(chosen.randomise), "variants": chosen.variants, "distance_m": log.distance_m, "angle_rad": log.angle_rad,
    }  # fmt: skip
    return key, store.fetch("copies", spec, ROOTS, build).arrays()


def calls(config: Config) -> list[Call]:
    """Return the simulations of all random targets of a configuration, as together.py runs them in several workers."""
    if not strengths(config).moves_target:
        return []
    _, twins = shared_cases(_campaign(config), MOTION)
    return [(simulate_targets, config, case, seed) for case, seed in _seeded(config, twins)]


def simulate_targets(config: Config, case: Case, seed: list[int]) -> None:
    """Simulate the random targets of a recording, unless the store holds them. Worker processes call this function."""
    campaign = _campaign(config)
    _alone(config, campaign.store, campaign, case, seed)


def _campaign(config: Config) -> Campaign:
    return Campaign(config, Store(Path(config.output) / "cache"), Progress(quiet=True))


def _seeded(config: Config, simulated: Sequence[Case]) -> list[tuple[Case, list[int]]]:
    """Return each simulated recording with the seed of its copies."""
    ordered = sorted(simulated, key=lambda case: recording_name("twin", case))
    return [(case, [config.seed, number]) for number, case in enumerate(ordered)]


def _alone(config: Config, store: Store, campaign: Campaign, case: Case, seed: list[int]) -> list[NDArray[np.complex64]]:
    """Return the channels (F, A, B) of the nominal target alone in free space, and of each random target on its random turntable."""
    # The receiver does not change the target, so copies that differ only in the receiver share the echoes.
    physical = replace(strengths(config), level=0.0, if_filter=0.0, channels=0.0, noise=0.0)
    own, log = campaign.config, campaign.log(case, TWIN)
    radar = replace(build_radar(own.radar), frame_rate_hz=log.frame_rate_hz)
    surfaces = every_object()[case.object].surfaces(contents=own.contents)
    turned = np.repeat(log.target_poses, log.frames // len(log.target_poses), axis=0)
    simulator = fixed_simulator(own.simulator)
    count = min(config.supervision.variants, config.supervision.copies)
    range_m = range_axis(radar, radar.num_samples)
    near = np.abs(range_m[range_m <= MAX_RANGE_M] - float(np.mean(log.distance_m))) < NEAR_TARGET_M

    def build(folder: Path) -> None:
        options = simulator_options(simulator)
        made = randomise.echoes_alone(surfaces, radar, log.sensor_poses, turned, physical, count, seed, **options)
        save_arrays(folder, {"channels": made[..., near]})

    spec = {
        "object": case.object, "contents": own.contents, "radar": radar.to_dict(), "poses": [log.sensor_poses, turned], "near": near,
        "simulator": simulator, "randomise": asdict(physical), "count": count, "seed": seed,
    }  # fmt: skip
    stored = store.fetch("targets_alone", spec, ROOTS, build).arrays()["channels"]
    whole = np.zeros((*stored.shape[:-1], len(near)), np.complex64)
    whole[..., near] = stored
    return [whole[number] for number in range(len(whole))]


def _energy(source: RecordingSource, domain: str, case: Case) -> tuple[float, float]:
    """Return (mean energy in the target gate, noise power per range bin) of a turntable recording."""
    _, processed = source.processed(domain, case)
    log = source.log(case, domain)
    return float(envelope.target_energy(processed, distances(log, processed.num_frames)).mean()), float(processed.noise_floor.mean())
