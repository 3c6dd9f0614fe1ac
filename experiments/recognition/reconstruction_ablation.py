"""Reconstruction ablation: label-free recognition of lateral sweeps as the twin's room is taken away piece by piece.

The same forests learn the twin with labelled materials, with one uniform material on every surface of the room, and without the room.
Answers are paired by recording. Paper: reconstruction ablation, squash court, 0.227 +- 0.015, 0.192 +- 0.015, 0.138 +- 0.008; 23 recordings
that only the labelled twin gets right against 6, p 0.001; shape 0.65, 0.66, 0.54.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments.recognition import transfer
from experiments.recognition.figures import bars, confusions
from experiments.recognition.protocol import SHAPE, Rows, right
from experiments.recognition.readings import Campaign
from radartwin.config.config import Config
from radartwin.errors import ConfigError
from radartwin.io.progress import Progress
from radartwin.recognize.score import exact_interval, majority_share, paired, uniform_chance
from radartwin.runs.experiment import Result, Table
from radartwin.store.products import Store

TABLE = Table(
    name="reconstruction_ablation",
    title="What the reconstruction is worth",
    caption="Label-free recognition of lateral drives in the squash court, from twins with labelled materials, with plasterboard "
    "everywhere, and without the room. Unequal answers counts the recordings that only one of two twins classifies correctly, "
    "by the majority over seeds.",
)

ROOM, MOTION = "squash_court", "lateral"
LABELLED, UNIFORM, VOID = "labelled materials", "one material", "no room"
METHODS = ((LABELLED, "twin", None), (UNIFORM, "twin", "uniform"), (VOID, "void", None))  # with domain and materials
PAPER = {
    "object": {LABELLED: "0.227 +- 0.015", UNIFORM: "0.192 +- 0.015", VOID: "0.138 +- 0.008"},
    "shape": {LABELLED: "0.65", UNIFORM: "0.66", VOID: "0.54"},
}


def run(config: Config, store: Store, progress: Progress) -> Result:
    from experiments.campaign.campaign import Campaign as Recorded
    from experiments.campaign.campaign import make_together

    check(config)
    campaign = Recorded(config, store, progress)
    sides = [transfer.missing(campaign, ROOM, MOTION, domain, materials) for _, domain, materials in METHODS]
    make_together({key: one for some in sides for key, one in some.items()}, progress)
    return score(config, campaign, store, progress)


def check(config: Config) -> None:
    """Raises ConfigError for a twin that is one of the worse ones."""
    if config.materials.source in ("uniform", "void"):
        raise ConfigError(f"the ablation compares labelled materials with worse ones; choose another source than {config.materials.source}")


def score(config: Config, campaign: Campaign, store: Store, progress: Progress) -> Result:
    check(config)
    read: dict[str, transfer.Frames] = {}
    for method, domain, materials in METHODS:
        progress.say(f"{MOTION} sweeps in {ROOM}: {method}")
        read[method] = transfer.read(campaign, ROOM, MOTION, domain, materials)
    keys = sorted({key for frames in read.values() for key in frames.keys})
    recordings = read[LABELLED].measured.per_recording()
    table = Rows(config, [])
    shown: dict[str, dict[str, dict[str, Any]]] = {}
    panels: dict[str, tuple[NDArray, NDArray]] = {}
    hits: dict[tuple[str, str], NDArray] = {}
    for classes, names in (("object", None), ("shape", SHAPE)):
        truth = recordings if names is None else recordings.relabelled(names)
        chance = uniform_chance(truth) if names is None else majority_share(truth)
        for method, frames in read.items():
            found = transfer.answers(config, transfer.ranked_split(frames, names))
            hits[classes, method] = right(found, truth.label)
            claim = "the twin's room makes objects known: above chance" if (classes, method) == ("object", LABELLED) else ""
            row = table.share(
                {"classes": classes, "method": method}, hits[classes, method], truth, frames.keys, chance,
                paper=PAPER[classes][method], claim=claim,
            )  # fmt: skip
            shown.setdefault(classes, {})[method] = row
            if names is None:
                panels[method] = (truth.label, found[0])
        for better, worse, claim in (
            (LABELLED, UNIFORM, "labelled materials beat one material"),
            (UNIFORM, VOID, "a room of one material beats none"),
            (LABELLED, VOID, "the reconstructed room beats none"),
        ):
            case = {"classes": classes, "method": f"{better} - {worse}"}
            claim = claim if classes == "object" or worse == VOID else ""
            table.gain(case, hits[classes, better], hits[classes, worse], truth, keys, claim=claim)
    paired_rows(table, hits, keys)
    figures = {
        "reconstruction_ablation": lambda: bars(shown, "accuracy", grey=VOID),
        "reconstruction_ablation_confusion": lambda: confusions(panels, recordings.classes),
    }
    metrics = {f"{classes}_{method.replace(' ', '_')}": float(found.mean()) for (classes, method), found in hits.items()}
    return Result(TABLE.name, table.rows, figures, metrics, keys)


def paired_rows(table: Rows, hits: Mapping[tuple[str, str], NDArray], keys: list[str]) -> None:
    """Recordings that only one of two twins gets right, by the majority of the seeds, with the exact p; and seeds in which one leads."""
    for better, worse, paper in ((LABELLED, UNIFORM, "23 against 6, p 0.001"), (LABELLED, VOID, "")):
        one, two = (hits["object", method].mean(axis=0) > 0.5 for method in (better, worse))
        found = paired(one, two)
        decided = found.first_only + found.second_only
        case = {"classes": "object", "method": f"{better} or {worse}, {found.first_only} against {found.second_only}"}
        interval = exact_interval(found.first_only / decided, decided) if decided else (0.0, 0.5, 1.0)
        holds = found.p < 0.05 and found.first_only > found.second_only
        told = {**case, "answers": one.size, "chance": 0.5, "p": found.p, "seed_sd": None}
        claim = f"more recordings are right with {better} alone"
        table.add(told, "share of the unequal answers", interval, one.size, keys, paper=paper, claim=claim, holds=holds)
    leads = hits["object", LABELLED].mean(axis=1) > hits["object", UNIFORM].mean(axis=1)
    told = {"classes": "object", "method": f"{LABELLED} - {UNIFORM}", "answers": len(leads), "chance": 0.5, "p": None, "seed_sd": None}
    table.add(told, "share of seeds in which it leads", exact_interval(float(np.mean(leads)), len(leads)), len(leads), keys, paper="1.0")
