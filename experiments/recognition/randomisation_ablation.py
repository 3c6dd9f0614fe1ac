"""Randomisation ablation: does it help recognition if copies of a simulated recording differ in more than their noise?

The encoder is trained on copies of simulated turntable revolutions. The user of a simulation does not know some quantities, such as the
wobble of the turntable, so the copies have random values of these quantities (radartwin.recognize.randomise). For the table, the encoder is
trained on copies in which all quantities are random, only the noise is random (as in the paper), or all but one are random. Measured
revolutions are classified without labels by the nearest text, and with labels by the nearest class centroid of other recordings.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import fields, replace
from typing import Any

from experiments import draws
from experiments.campaign.campaign import Call
from experiments.campaign.source import RecordingSource
from experiments.recognition import copies
from experiments.recognition.figures import bars
from experiments.recognition.protocol import compared_trainings
from experiments.recognition.readings import Readings
from radartwin.config.config import Config
from radartwin.config.study import RandomiseConfig
from radartwin.io.progress import Progress
from radartwin.runs.experiment import Result, Table
from radartwin.store.products import Store

TABLE = Table(
    name="randomisation_ablation",
    title="Effect of randomised copies",
    caption="An encoder is trained on copies of simulated revolutions in which the named quantities are drawn at random. Measured "
    "revolutions are classified by the nearest text (no labels), and by the nearest class centroid of other recordings. 'noise only' "
    "draws nothing but noise, as in the paper. The differences are against copies in which every quantity is drawn. "
    "The testbed draws some of these quantities too, from other ranges. Intervals are bootstraps over objects.",
)

ALL, NOISE_ONLY = "all drawn", "noise only"
QUANTITIES = tuple(one.name for one in fields(RandomiseConfig))


def run(config: Config, store: Store, progress: Progress) -> Result:
    return draws.scored(config, store, progress, lambda campaign: score(config, campaign, store, progress))


def calls(config: Config) -> list[Call]:
    """Return the simulations of the random targets of each kind of copies (experiments/together.py)."""
    return [call for left_out in kinds(config).values() for call in copies.calls(copied(config, left_out))]


def kinds(config: Config) -> dict[str, tuple[str, ...]]:
    """Return the quantities that each kind of copies leaves out."""
    return {ALL: (), NOISE_ONLY: QUANTITIES} | {f"without {name}": (name,) for name in config.profile.left_out}


def copied(config: Config, left_out: tuple[str, ...]) -> Config:
    """Return the configuration whose copies keep the quantities `left_out` nominal."""
    chosen = replace(config.supervision.randomise, **dict.fromkeys(left_out, 0.0))
    return replace(config, supervision=replace(config.supervision, randomise=chosen))


def score(config: Config, source: RecordingSource, store: Store, progress: Progress) -> Result:
    """Build the rows of each kind of copies and probe."""

    def trained() -> Iterator[tuple[str, Readings, Readings]]:
        for kind, left_out in progress.over(list(kinds(config).items()), "copies"):
            yield kind, *copies.measured_and_copies(copied(config, left_out), source, store, progress)

    rows, shown, used = compared_trainings(config, "copies", trained(), {NOISE_ONLY: "drawing all quantities helps"})
    by_kind = {kind: {probe: of[kind] for probe, of in shown.items()} for kind in kinds(config)}
    figures: dict[str, Any] = {"randomisation_ablation": lambda: bars(by_kind, "accuracy")}
    metrics = {f"accuracy_{probe.replace(' ', '_')}_{kind.replace(' ', '_')}": float(row["value"]) for probe, of in shown.items()
               for kind, row in of.items() if kind in (ALL, NOISE_ONLY)}  # fmt: skip
    return Result(TABLE.name, rows, figures, metrics, used)
