"""Simulation parts: what do near field, absolute level and room contribute to an encoder that is trained on simulation alone?

The table has the protocol of the table `labelled_probe`. The encoder is trained on copies of simulated revolutions, without one part of the
simulation at a time:
- "plane waves" assumes plane waves across the antenna array, so that the channels contain no near-field effect.
- "no level" leaves the brightness out of the features, in both domains.
- "no room" simulates target and stand without the room.
- RF-Genesis (corrected) is our re-implementation of another simulator (radartwin/simulation/backends/rfgenesis.py). It does not simulate
  mirror reflections, and gives each surface patch a single phase.
"""

from collections.abc import Iterator
from dataclasses import replace

from experiments.campaign.campaign import Call
from experiments.campaign.cases import TWIN
from experiments.campaign.frame import Frame
from experiments.cells import Cell
from experiments.draws import Part, Query
from experiments.framed import framed
from experiments.recognition import copies
from experiments.recognition.copies import Copied, with_copies
from experiments.recognition.labelled_probe import RIVAL, rf_genesis
from experiments.recognition.plots import accuracy_bars
from experiments.recognition.protocol import TEXT, compared_trainings
from experiments.recognition.readings import MOTION, by_side, revolutions, without
from experiments.verdicts import Row
from radartwin.config.config import Config
from radartwin.config.materials import VoidMaterials
from radartwin.features.families import BRIGHTNESS
from radartwin.runs.experiment import Table

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


def query(config: Config) -> Query:
    """Return the recordings of the table, with each simulation as a side. NO_LEVEL reads the recordings of EVERYTHING."""
    others = {
        PLANE: replace(config, simulator=replace(config.simulator, elements="planar")),
        NO_ROOM: replace(config, materials=VoidMaterials()),
        RIVAL: rf_genesis(config),
    }
    more = [Part(TWIN, side_config, {"side": name}) for name, side_config in others.items()]
    return Query(config, (MOTION,), several=True, side=EVERYTHING, more=more)


def calls(config: Config) -> list[Call]:
    """Return the simulations of the random targets (experiments/shared_simulations.py). Those of NO_ROOM are those of EVERYTHING."""
    parts = [part for part in query(config).parts if part.domain == TWIN and part.versions["side"] != NO_ROOM]
    return [call for part in parts for call in copies.calls(part.config)]


def cells(config: Config, copied: Copied, frame: Frame) -> Iterator[Cell]:
    """Declare the cells of one draw."""
    measured, sides = revolutions(frame), by_side(frame)
    rows = {name: (name, measured, copied(config, sides[name])) for name in sides}
    rows[NO_LEVEL] = (NO_LEVEL, without(measured, BRIGHTNESS), without(rows[EVERYTHING][2], BRIGHTNESS))
    of = frame.assign(side="")  # each row names the recordings of all simulations
    return compared_trainings(config, of, "simulation", [rows[name] for name in (EVERYTHING, *HELPS)], HELPS)


def _listed(row: Row) -> bool:
    """Leave out the rows of other tables: encoder_comparison and labelled_probe have the whole simulation, the latter also the rival."""
    return row["simulation"] != EVERYTHING and (row["probe"] == TEXT or RIVAL not in row["simulation"])


PLOTS = accuracy_bars(TABLE.name, "probe", "simulation", RIVAL)
run, recordings, score = framed(TABLE, query, cells, *PLOTS, source=with_copies, listed=_listed)
