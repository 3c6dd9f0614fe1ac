"""Simulation parts: what do near field, absolute level and room contribute to an encoder that is trained on simulation alone?

The table has the protocol of the table `labelled_probe`. The encoder is trained on copies of simulated revolutions, without one part of the
simulation at a time:
- "plane waves" assumes plane waves across the antenna array, so that the channels contain no near-field effect.
- "no level" leaves the brightness out of the features, in both domains.
- "no room" simulates target and stand without the room.
- RF-Genesis (corrected) is our re-implementation of another simulator (radartwin/simulation/backends/rfgenesis.py). It does not simulate
  mirror reflections, and gives each surface patch a single phase.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace

from experiments import draws
from experiments.campaign.campaign import Call, Campaign
from experiments.campaign.schedule import RecordingTask
from experiments.campaign.source import RecordingSource
from experiments.recognition import copies
from experiments.recognition.figures import bars
from experiments.recognition.labelled_probe import RIVAL, rf_genesis, simulated
from experiments.recognition.protocol import TEXT, compared_trainings
from experiments.recognition.readings import FEATURES, MOTION, Readings, paired, shared_cases, vectors
from radartwin.config.config import Config
from radartwin.config.materials import VoidMaterials
from radartwin.io.progress import Progress
from radartwin.runs.experiment import Result, Table
from radartwin.store.products import Store

TABLE = Table(
    name="simulation_parts",
    title="Effect of each part of the simulation",
    caption="An encoder is trained on copies of simulated revolutions with one part of the simulation switched off. Measured revolutions "
    "are classified by the nearest text (no labels), and by the nearest class centroid of other recordings. Differences are 'everything' "
    "minus the named simulation. The testbed uses the same physics as our tracer. "
    "Intervals are bootstraps over objects.",
)

EVERYTHING, PLANE, NO_LEVEL, NO_ROOM = "everything", "plane waves", "no level", "no room"
HELPS = {
    PLANE: "the near field helps", NO_LEVEL: "the level helps", NO_ROOM: "the room helps",
    RIVAL: "training on our simulation is more accurate than on RF-Genesis",
}  # fmt: skip
WITHOUT = {NO_LEVEL: ("brightness",)}  # feature families that are left out with this simulation


def configured(config: Config) -> dict[str, Config]:
    """Return the configuration of each simulation."""
    return {
        EVERYTHING: config,
        PLANE: replace(config, simulator=replace(config.simulator, elements="planar")),
        NO_LEVEL: config,
        NO_ROOM: replace(config, materials=VoidMaterials()),
        RIVAL: rf_genesis(config),
    }


def recordings(config: Config, store: Store, progress: Progress) -> dict[str, RecordingTask]:
    both = draws.recordings([config], lambda campaign: paired(campaign, MOTION), store, progress)
    return both | draws.recordings(configured(config).values(), simulated, store, progress)


def calls(config: Config) -> list[Call]:
    """Return the simulations of the random targets (experiments/together.py)."""
    return [call for name, own in configured(config).items() if name not in (NO_LEVEL, NO_ROOM) for call in copies.calls(own)]


def run(config: Config, store: Store, progress: Progress) -> Result:
    def scored(campaign: Campaign) -> Result:
        twins = {name: Campaign(own, store, progress) for name, own in configured(config).items()}
        return score(config, campaign, twins, store, progress)

    return draws.scored(config, store, progress, scored)


def score(config: Config, source: RecordingSource, twins: Mapping[str, RecordingSource], store: Store, progress: Progress) -> Result:
    """Build the rows of each simulation and probe.

    Args:
        source: source of the measured recordings.
        twins: source of the simulated recordings of each simulation.
    """
    cases, simulated = shared_cases(source, MOTION)

    def trained() -> Iterator[tuple[str, Readings, Readings]]:
        for name, twin in progress.over(list(twins.items()), "simulations"):
            without = WITHOUT.get(name, ())
            drawn = copies.rows_of_copies(config, store, twin, simulated, cases, without, measured_source=source)
            yield name, vectors(source, "measured", cases, FEATURES, without), drawn["features"]

    rows, shown, keys = compared_trainings(config, "simulation", trained(), HELPS)
    # encoder_comparison and labelled_probe have the rows of the whole simulation, and labelled_probe those of the rival with labels
    rows[:] = [row for row in rows if row["simulation"] != EVERYTHING and (row["probe"] == TEXT or RIVAL not in row["simulation"])]
    metrics = {f"accuracy_{probe}_{name}".replace(" ", "_").replace("(", "").replace(")", ""): float(row["value"])
               for probe, of in shown.items() for name, row in of.items()}  # fmt: skip
    return Result(TABLE.name, rows, {TABLE.name: lambda: bars(shown, "accuracy", grey=RIVAL)}, metrics, keys)
