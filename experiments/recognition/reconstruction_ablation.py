"""Reconstruction ablation: how well are objects recognised if the simulation used for training contains less of the reconstructed room?

Random forests are trained on lateral drives in three simulations: with labelled materials, with one material on every surface, and without
the room. Paper (squash court), in this order: object accuracy 0.227 +- 0.015, 0.192 +- 0.015 and 0.138 +- 0.008; shape accuracy 0.65, 0.66
and 0.54; 23 recordings are right only with labelled materials, 6 only with one material; p 0.001.
"""

from collections.abc import Iterator, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from experiments.campaign.cases import TWIN
from experiments.campaign.frame import Frame
from experiments.cells import Cell
from experiments.draws import Part, Query
from experiments.framed import framed
from experiments.recognition import transfer
from experiments.recognition.plots import accuracy_bars
from experiments.recognition.protocol import FLOOR_ONLY, SHAPE, Scored, correct, sign_test, statistics_columns
from experiments.recognition.readings import by_side
from experiments.statistics import share
from experiments.verdicts import Claim
from radartwin.config.config import Config
from radartwin.config.materials import UniformMaterials, VoidMaterials
from radartwin.errors import ConfigError
from radartwin.recognize.score import majority_share, uniform_chance
from radartwin.runs.experiment import Table

TABLE = Table(
    name="reconstruction_ablation",
    title="Effect of the reconstructed room",
    caption="Label-free recognition of lateral drives in the squash court, from twins with labelled materials, with plasterboard on "
    "every surface, and without the room. An unequal answer is a recording that only one of two twins classifies correctly, "
    "by the majority over seeds; the columns first_only and second_only count them.",
)

ROOM, MOTION = "squash_court", "lateral"
LABELLED, UNIFORM, VOID = "labelled materials", "one material", "no room"
PAPER = {
    "object": {LABELLED: "0.227 +- 0.015", UNIFORM: "0.192 +- 0.015", VOID: "0.138 +- 0.008"},
    "shape": {LABELLED: "0.65", UNIFORM: "0.66", VOID: "0.54"},
}
BEATS = {
    (LABELLED, UNIFORM): "labelled materials beat one material", (UNIFORM, VOID): "a room of one material beats none",
    (LABELLED, VOID): "the reconstructed room beats none",
}  # fmt: skip


def query(config: Config) -> Query:
    """Return the recordings of the table, with each simulation as a side. Raises ConfigError for a uniform material or no room."""
    if config.materials.source in ("uniform", "void"):
        raise ConfigError(
            f"the ablation compares labelled materials with uniform and no materials; choose another source than {config.materials.source}"
        )
    others = {UNIFORM: UniformMaterials(), VOID: VoidMaterials()}
    more = [Part(TWIN, replace(config, materials=materials), {"side": name}) for name, materials in others.items()]
    return Query(config, (MOTION,), ROOM, several=True, side=LABELLED, more=more)


def cells(config: Config, frame: Frame) -> Iterator[Cell]:
    """Declare the cells of one draw."""
    for classes, names in (("object", None), ("shape", SHAPE)):
        splits = {method: transfer.ranked_split(drives, names) for method, drives in by_side(frame).items()}
        answers = {method: transfer.predict(config, split) for method, split in splits.items()}
        truth = splits[LABELLED].test.per_recording()
        hits = {method: correct(predictions, truth.label) for method, predictions in answers.items()}
        claims = {method: Claim("", paper) for method, paper in PAPER[classes].items()}  # rover_recognition judges the first
        pairs = {pair: Claim(text if names is None or pair[1] == VOID else "", untestable=FLOOR_ONLY) for pair, text in BEATS.items()}
        if names is None:
            panels = {method: (method, truth.label, predictions[0]) for method, predictions in answers.items()}
            yield from Scored(config, truth, frame, uniform_chance(truth)).compared(
                {"classes": classes}, hits, pairs, claims, panels=panels
            )
            yield from _paired(frame, hits, truth.object)
        else:
            yield from Scored(config, truth, frame, majority_share(truth)).compared(
                {"classes": classes}, hits, pairs, claims, answers=answers
            )


def _paired(frame: Frame, hits: Mapping[str, NDArray], objects: NDArray) -> Iterator[Cell]:
    """Declare paired comparisons of two simulations: the share of objects that one leads on, and the share of seeds in which it leads."""
    for better, worse, paper in ((LABELLED, UNIFORM, "23 against 6, p 0.001"), (LABELLED, VOID, "")):
        first_right, second_right = (hits[method].mean(axis=0) > 0.5 for method in (better, worse))
        columns = {
            "first_only": int(np.sum(first_right & ~second_right)),
            "second_only": int(np.sum(second_right & ~first_right)),
            **statistics_columns(first_right.size, 0.5),
        }
        case = {"classes": "object", "method": f"{better} or {worse}", **columns}
        _, item = np.unique(objects, return_inverse=True)
        leads = np.sign(np.bincount(item, first_right.astype(float) - second_right))
        estimate = sign_test(int(np.sum(leads > 0)), int(np.sum(leads < 0)))
        claim = Claim(f"more recordings are right with {better} alone", paper, bound=0.5, untestable=FLOOR_ONLY)
        yield Cell(case, "share of the unequal objects", frame, estimate, claim, first_right.size)
    leads = hits[LABELLED].mean(axis=1) > hits[UNIFORM].mean(axis=1)
    case = {"classes": "object", "method": f"{LABELLED} - {UNIFORM}", **statistics_columns(len(leads), 0.5)}
    yield Cell(case, "share of seeds in which it leads", frame, share(float(np.sum(leads)), len(leads)), Claim(paper="1.0"), len(leads))


run, recordings, score = framed(TABLE, query, cells, *accuracy_bars(TABLE.name, "classes", grey=VOID, confusion=True))
