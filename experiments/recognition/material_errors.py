"""Effect of wrong materials: how do recognition accuracy and level error change if more surfaces of the room have a wrong material?

The share of wrong material labels grows from none (true materials) to all (materials=random). The table also shows the configured material
source for comparison. Objects are recognised by the method of experiments/recognition/reconstruction_ablation.py.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from experiments.campaign.cases import MEASURED, TWIN
from experiments.campaign.frame import Frame
from experiments.cells import Cell, using
from experiments.drawing import PAGE_WIDTH_IN, PALETTE, Figure, error_bars, figure
from experiments.draws import Part, Query
from experiments.framed import framed
from experiments.recognition import transfer
from experiments.recognition.protocol import FLOOR_ONLY, Scored, correct, statistics_columns
from experiments.recognition.readings import by_side, profile_db
from experiments.recognition.reconstruction_ablation import MOTION, ROOM
from experiments.statistics import POSITIVE, clustered
from experiments.verdicts import NONE, Claim, Row
from radartwin.config.config import Config
from radartwin.config.materials import MaterialsConfig, RandomMaterials, TrueMaterials
from radartwin.recognize.score import uniform_chance
from radartwin.runs.experiment import Table

TABLE = Table(
    name="material_errors",
    title="Effect of wrong materials",
    caption="Label-free recognition of lateral drives in the squash court, with a share of the room's material labels replaced at "
    "random. The level error is the root mean square difference of the range profile in decibels, 0.3 to 5.5 m, from the "
    "twin with true materials.",
)

TRUE = "true materials"
WRONG = (0.25, 0.5, 1.0)  # shares of labels that are replaced
LEVEL_ERROR = "level error of the range profile (dB)"


def query(config: Config) -> Query:
    """Return the recordings of the table, with each material source as a side."""
    *others, (configured, _) = sources(config).items()
    more = [Part(TWIN, replace(config, materials=materials), {"side": name}) for name, (_, materials) in others]
    return Query(config, (MOTION,), ROOM, several=True, side=configured, more=more)


def sources(config: Config) -> dict[str, tuple[float | None, MaterialsConfig]]:
    """Return {name: (share of wrong labels, material source)}; the last one is configured, and its share is None."""
    by_name: dict[str, tuple[float | None, MaterialsConfig]] = {TRUE: (0.0, TrueMaterials())}
    for share in WRONG if config.profile.name != "quick" else WRONG[-1:]:
        by_name[f"{100 * share:g} % random"] = (share, RandomMaterials(p=share))
    return by_name | {f"as configured ({config.materials.source})": (None, config.materials)}


def cells(config: Config, frame: Frame) -> Iterator[Cell]:
    """Declare the cells of one draw."""
    sides, first, reference = by_side(frame), None, None  # correct predictions and profiles with true materials, which are the first source
    for name, (share, _) in sources(config).items():
        truth = (split := transfer.ranked_split(sides[name])).test.per_recording()
        hits = correct(transfer.predict(config, split), truth.label)
        case, scored = {"method": name, "wrong": share}, Scored(config, truth, sides[name], uniform_chance(truth))
        yield scored.accuracy(case, hits)
        twin = sides[name][sides[name].domain != MEASURED]
        levels = np.stack([profile_db(row.power.mean(axis=0, dtype=np.float64), row.range_m) for row in twin.itertuples()])
        if first is None or reference is None:
            first, reference = hits, levels
        else:
            claim = Claim("wrong labels cost recognition", untestable=FLOOR_ONLY) if share == 1 else NONE
            yield scored.gain(case | {"method": f"{TRUE} - {name}"}, first, hits, claim)
        difference = np.sqrt(np.mean((levels - reference) ** 2, axis=1))
        estimate = using(partial(clustered, limits=POSITIVE), difference, twin.object.to_numpy(str))
        yield Cell(case | statistics_columns(len(levels)), LEVEL_ERROR, twin, estimate)


def _figure(rows: Sequence[Mapping[str, Any]]) -> Figure:
    """Draw accuracy and level error against the share of wrong labels, and those of the configured material source as a band."""
    drawing, panels = figure(1, 2, width_in=PAGE_WIDTH_IN, height_in=2.6)
    for panel, metric, label in zip(panels, ("accuracy", LEVEL_ERROR), ("label-free accuracy", "level error (dB)"), strict=True):
        *known, configured = [row for row in rows if row["metric"] == metric]
        value, errors = error_bars(known)
        share = [100 * row["wrong"] for row in known]
        panel.errorbar(share, value, errors, marker="o", ms=4, capsize=2, color=PALETTE[0], label="random labels")
        panel.axhspan(configured["low"], configured["high"], color=PALETTE[1], alpha=0.2, lw=0)
        panel.axhline(configured["value"], color=PALETTE[1], lw=1, label=configured["method"])
        panel.set(xlabel="wrong labels of the room (%)", ylabel=label, ylim=(0, 1 if metric == "accuracy" else None))
    panels[0].axhline(rows[0]["chance"], color="black", ls="--", lw=0.8, label="chance")
    panels[0].legend(loc="best")
    return drawing


def _metrics(rows: list[Row]) -> dict[str, float]:
    return {f"accuracy_wrong_{r['wrong']:g}": r["value"] for r in rows if r["metric"] == "accuracy" and r["wrong"] is not None}


run, recordings, score = framed(TABLE, query, cells, lambda rows, first: {TABLE.name: lambda: _figure(rows)}, _metrics)
