"""Randomisation ablation: does it help recognition if copies of a simulated recording differ in more than their noise?

The encoder is trained on copies of simulated turntable revolutions (radartwin.recognize.randomise) in which all quantities that the user
does not know are random, only the noise is (as in the paper), or all but one are. Measured revolutions are classified without labels by the
nearest text, and with labels by the nearest class centroid of other recordings.
"""

from collections.abc import Iterator
from dataclasses import fields, replace

from experiments.campaign.campaign import Call
from experiments.campaign.frame import Frame
from experiments.cells import Cell
from experiments.framed import framed
from experiments.recognition import copies
from experiments.recognition.copies import Copied, with_copies
from experiments.recognition.plots import accuracy_bars
from experiments.recognition.protocol import compared_trainings
from experiments.recognition.readings import TURNTABLE, revolutions
from radartwin.config.config import Config
from radartwin.config.study import RandomiseConfig
from radartwin.runs.experiment import Table

TABLE = Table(
    name="randomisation_ablation",
    title="Effect of randomised copies",
    caption="An encoder is trained on copies of simulated revolutions in which the named quantities are drawn at random. Measured "
    "revolutions are classified by the nearest text (no labels), and by the nearest class centroid of other recordings. 'noise only' "
    "draws nothing but noise, as in the paper. The differences are against copies in which every quantity is drawn. "
    "The testbed draws some of these quantities too, from other ranges. Intervals are bootstraps over objects.",
)

ALL, NOISE_ONLY = "all drawn", "noise only"
QUANTITIES = tuple(field.name for field in fields(RandomiseConfig))


def calls(config: Config) -> list[Call]:
    """Return the simulations of the random targets of each kind of copies (experiments/shared_simulations.py)."""
    return [call for left_out in kinds(config).values() for call in copies.calls(copied_as(config, left_out))]


def kinds(config: Config) -> dict[str, tuple[str, ...]]:
    """Return the quantities that each kind of copies leaves out."""
    return {ALL: (), NOISE_ONLY: QUANTITIES} | {f"without {name}": (name,) for name in config.profile.left_out}


def copied_as(config: Config, left_out: tuple[str, ...]) -> Config:
    """Return the configuration whose copies keep the quantities `left_out` nominal."""
    strengths = replace(config.supervision.randomise, **dict.fromkeys(left_out, 0.0))
    return replace(config, supervision=replace(config.supervision, randomise=strengths))


def cells(config: Config, copied: Copied, frame: Frame) -> Iterator[Cell]:
    """Declare the cells of each kind of copies and probe."""
    trained = ((kind, revolutions(frame), copied(copied_as(config, names), frame)) for kind, names in kinds(config).items())
    return compared_trainings(config, frame, "copies", trained, {NOISE_ONLY: "drawing all quantities helps"})


run, recordings, score = framed(TABLE, TURNTABLE, cells, *accuracy_bars(TABLE.name, "copies", "probe"), source=with_copies)
