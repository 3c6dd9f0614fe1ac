"""Make randomised copies of simulated turntable revolutions, and read their feature rows.

A copy has random values of the quantities that a user cannot know (radartwin.recognize.randomise): `supervision.variants` random targets on
random turntables are simulated alone in free space for each recording, and the noise power follows from target energies and noise floors of
measured recordings, without their labels. The store keeps the echoes, feature rows and pictures.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from experiments.campaign.campaign import Call, Campaign
from experiments.campaign.cases import MEASURED, TWIN, Case
from experiments.campaign.frame import CONDITIONS, Frame, RecordingSource, features, shared
from experiments.draws import Query
from experiments.recognition.readings import FEATURES, MOTION, cells, gathered, recording_name
from radartwin.builders.radar import build_radar
from radartwin.builders.simulator import fixed_simulator, simulator_options
from radartwin.config.config import Config
from radartwin.features import families
from radartwin.features.log import angles
from radartwin.features.processed import MAX_RANGE_M
from radartwin.features.range_time import picture
from radartwin.io.progress import Progress
from radartwin.radar.processing import range_axis
from radartwin.recognize import randomise
from radartwin.recognize.augment import added_noise
from radartwin.recognize.learners.interface import Reads
from radartwin.recognize.samples import Samples
from radartwin.scene.objects.assortment import every_object
from radartwin.store.products import Store, save_arrays

ROOTS = [
    "radartwin.features.families", "radartwin.features.range_time", "radartwin.recognize.augment", "radartwin.recognize.randomise",
    "radartwin.builders.simulator", "experiments.recognition.copies",
]  # fmt: skip
NEAR_TARGET_M = 0.75  # largest distance of a stored echo from the nominal range of the target; farther echoes are below -60 dB


def strengths(config: Config) -> randomise.Randomisation:
    return randomise.Randomisation(**asdict(config.supervision.randomise))


Copied = Callable[..., Samples]  # `copies` of a store and its sources: configuration, frame, kind of rows


def with_copies(query: Query, store: Store, progress: Progress) -> tuple[Frame, Copied]:
    """Return the frame of a turntable table, and the function that returns the copies of its simulated recordings."""
    return query.frame(store, progress), partial(copies, store, query.sources(store, progress))


def copies(store: Store, sources: Mapping[str, RecordingSource], config: Config, frame: Frame, kind: Reads = "features") -> Samples:
    """Return feature vectors or pictures of `supervision.copies` copies of each simulated recording of a frame with one simulation. The
    noise level of a copy comes from the measured recordings at the same distance. `sources` has the campaign of each simulation, by its
    name in the column `twin` or `side`.
    """
    simulated, measured = frame[frame.domain != MEASURED], frame[frame.domain == MEASURED]
    source, noise = sources[simulated.twin.iloc[0] or simulated.side.iloc[0]], {}
    for distance, here in simulated.groupby("distance_m"):
        simulated_levels, measured_levels = (
            np.stack(list(column)) for column in (here.energy_noise, measured.energy_noise[measured.distance_m == distance])
        )
        noise[distance] = added_noise(simulated_levels[:, 0], measured_levels[:, 0], float(np.median(measured_levels[:, 1])))
    cases = [Case(*row) for row in simulated[list(CONDITIONS)].itertuples(index=False)]
    seeds = dict(_seeded(config, cases))
    rows = [
        _rows(config, store, source, case, key, noise[case.distance_m], seeds[case])[kind]
        for case, key in zip(cases, simulated.key, strict=True)
    ]
    return gathered(simulated, features(simulated) if kind == "features" else cells(rows[0].shape[1]), rows)


def _rows(
    config: Config, store: Store, source: RecordingSource, case: Case, key: str, noise_power: float, seed: list[int]
) -> dict[str, NDArray]:
    """Return the rows of the copies of a simulated recording with this store key, for each kind of row."""
    log, supervision, drawn = source.log(case, TWIN), config.supervision, strengths(config)

    def build(folder: Path) -> None:
        processed, target_m = source.processed(TWIN, case)[1], float(np.mean(log.distance_m))
        echoes: list[NDArray] = []
        if drawn.moves_target:
            assert isinstance(source, Campaign), "drawn targets need a campaign that simulates them"
            echoes = _alone(config, store, source, case, seed)
        rows: dict[str, list[NDArray]] = {"features": [], "pictures": []}
        for copy in randomise.copies(processed, echoes, noise_power, supervision.copies, drawn, seed):
            rows["features"].append(families.vector(copy, log, FEATURES)[1])
            rows["pictures"].append(picture(copy, angles(log, copy.num_frames), target_m).ravel())
        save_arrays(folder, {kind: np.stack(kind_rows) for kind, kind_rows in rows.items()})

    spec = {
        "recording": key, "features": FEATURES, "noise": noise_power, "count": supervision.copies, "seed": seed,
        "randomise": asdict(supervision.randomise), "variants": supervision.variants,
        "distance_m": log.distance_m, "angle_rad": log.angle_rad,
    }  # fmt: skip
    return store.fetch("copies", spec, ROOTS, build).arrays()


def calls(config: Config) -> list[Call]:
    """Return the simulations of all random targets of a configuration, as shared_simulations.py runs them in several workers."""
    if not strengths(config).moves_target:
        return []
    twins = [case for domain, case in shared(_campaign(config), (MOTION,), several=True) if domain == TWIN]
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
    nominal, log = campaign.config, campaign.log(case, TWIN)
    radar = replace(build_radar(nominal.radar), frame_rate_hz=log.frame_rate_hz)
    surfaces = every_object()[case.object].surfaces(contents=nominal.contents)
    turned = np.repeat(log.target_poses, log.frames // len(log.target_poses), axis=0)
    simulator = fixed_simulator(nominal.simulator)
    count = min(config.supervision.variants, config.supervision.copies)
    range_m = range_axis(radar, radar.num_samples)
    near = np.abs(range_m[range_m <= MAX_RANGE_M] - float(np.mean(log.distance_m))) < NEAR_TARGET_M

    def build(folder: Path) -> None:
        options = simulator_options(simulator)
        made = randomise.echoes_alone(surfaces, radar, log.sensor_poses, turned, physical, count, seed, **options)
        save_arrays(folder, {"channels": made[..., near]})

    spec = {
        "object": case.object, "contents": nominal.contents, "radar": radar.to_dict(), "poses": [log.sensor_poses, turned], "near": near,
        "simulator": simulator, "randomise": asdict(physical), "count": count, "seed": seed,
    }  # fmt: skip
    stored = store.fetch("targets_alone", spec, ROOTS, build).arrays()["channels"]
    whole = np.zeros((*stored.shape[:-1], len(near)), np.complex64)
    whole[..., near] = stored
    return [whole[number] for number in range(len(whole))]
