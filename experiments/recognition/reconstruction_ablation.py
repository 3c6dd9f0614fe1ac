"""Reconstruction ablation: how well are objects recognised if the simulation used for training contains less of the reconstructed room?

In the measured recordings, the radar drives past the object, at right angles to the line of sight ("lateral" drives). The training uses no
class labels of measured recordings. The same random forests are trained on three simulations: of the room with labelled materials, of the
room with one uniform material on every surface, and without the room. The table compares the predictions of the three forests on the same
recordings.

Paper (reconstruction ablation, squash court), for labelled materials, uniform material and no room in this order: object accuracy 0.227 +-
0.015, 0.192 +- 0.015 and 0.138 +- 0.008; shape accuracy 0.65, 0.66 and 0.54. Of the recordings, 23 are classified correctly only with
labelled materials, and 6 only with the uniform material; p 0.001.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments import draws
from experiments.campaign.campaign import Campaign, joined, make_together
from experiments.campaign.schedule import RecordingTask
from experiments.campaign.source import RecordingSource
from experiments.claims import Claim
from experiments.recognition import transfer
from experiments.recognition.figures import bars, confusions
from experiments.recognition.protocol import FLOOR_ONLY, SHAPE, RecognitionRows, correct, sign_test, statistics_columns
from experiments.statistics import share
from radartwin.config.config import Config
from radartwin.errors import ConfigError
from radartwin.io.progress import Progress
from radartwin.recognize.score import majority_share, uniform_chance
from radartwin.runs.experiment import Result, Table
from radartwin.store.products import Store

TABLE = Table(
    name="reconstruction_ablation",
    title="Effect of the reconstructed room",
    caption="Label-free recognition of lateral drives in the squash court, from twins with labelled materials, with plasterboard on "
    "every surface, and without the room. An unequal answer is a recording that only one of two twins classifies correctly, "
    "by the majority over seeds; the columns first_only and second_only count them.",
)

ROOM, MOTION = "squash_court", "lateral"
LABELLED, UNIFORM, VOID = "labelled materials", "one material", "no room"
METHODS = ((LABELLED, "twin", None), (UNIFORM, "twin", "uniform"), (VOID, "void", None))  # method, domain, materials
PAPER = {
    "object": {LABELLED: "0.227 +- 0.015", UNIFORM: "0.192 +- 0.015", VOID: "0.138 +- 0.008"},
    "shape": {LABELLED: "0.65", UNIFORM: "0.66", VOID: "0.54"},
}


def run(config: Config, store: Store, progress: Progress) -> Result:
    make_together(recordings(config, store, progress), config.jobs, progress)
    return draws.scored(config, store, progress, lambda campaign: score(config, campaign, progress), rover=True)


def recordings(config: Config, store: Store, progress: Progress) -> dict[str, RecordingTask]:
    check(config)
    campaign = Campaign(config, store, progress)
    return joined(transfer.missing(campaign, ROOM, MOTION, domain, materials) for _, domain, materials in METHODS)


def check(config: Config) -> None:
    """Raise ConfigError if the configured simulation already has a uniform material or no room."""
    if config.materials.source in ("uniform", "void"):
        raise ConfigError(
            f"the ablation compares labelled materials with uniform and no materials; choose another source than {config.materials.source}"
        )


def score(config: Config, source: RecordingSource, progress: Progress) -> Result:
    """Build rows of accuracy for each simulation and kind of classes, of accuracy gains between simulations, and of paired tests."""
    check(config)
    read: dict[str, transfer.Frames] = {}
    for method, domain, materials in METHODS:
        progress.say(f"{MOTION} drives in {ROOM}: {method}")
        read[method] = transfer.read(source, ROOM, MOTION, domain, materials)
    keys = sorted({key for frames in read.values() for key in frames.keys})
    recordings = read[LABELLED].measured.per_recording()
    rows = RecognitionRows(config)
    shown: dict[str, dict[str, dict[str, Any]]] = {}
    panels: dict[str, tuple[NDArray, NDArray]] = {}
    hits: dict[tuple[str, str], NDArray] = {}
    for classes, names in (("object", None), ("shape", SHAPE)):
        truth = recordings if names is None else recordings.relabelled(names)
        chance = uniform_chance(truth) if names is None else majority_share(truth)
        for method, frames in read.items():
            predictions = transfer.predict(config, transfer.ranked_split(frames, names))
            hits[classes, method] = correct(predictions, truth.label)
            answers = None if names is None else predictions
            text = "with the room in the simulation, object accuracy is above chance" if (classes, method) == ("object", LABELLED) else ""
            case, claim = {"classes": classes, "method": method}, Claim(text, PAPER[classes][method])
            row = rows.share(case, hits[classes, method], truth, frames.keys, chance, claim, answers=answers)
            shown.setdefault(classes, {})[method] = row
            if names is None:
                panels[method] = (truth.label, predictions[0])
        for better, worse, text in (
            (LABELLED, UNIFORM, "labelled materials beat one material"),
            (UNIFORM, VOID, "a room of one material beats none"),
            (LABELLED, VOID, "the reconstructed room beats none"),
        ):
            claim = Claim(text if classes == "object" or worse == VOID else "", untestable=FLOOR_ONLY)
            case = {"classes": classes, "method": f"{better} - {worse}"}
            rows.gain(case, hits[classes, better], hits[classes, worse], truth, keys, claim)
    _add_paired(rows, hits, recordings.object, keys)
    figures = {
        "reconstruction_ablation": lambda: bars(shown, "accuracy", grey=VOID),
        "reconstruction_ablation_confusion": lambda: confusions(panels, recordings.classes),
    }
    metrics = {f"{classes}_{method.replace(' ', '_')}": float(found.mean()) for (classes, method), found in hits.items()}
    return Result("reconstruction_ablation", rows, figures, metrics, keys)


def _add_paired(rows: RecognitionRows, hits: Mapping[tuple[str, str], NDArray], objects: NDArray, keys: list[str]) -> None:
    """Add the share of objects of which more recordings are right after training on the first of two simulations than on the second, the
    numbers of such recordings, and the share of random seeds for which labelled materials give the higher accuracy.
    """
    for better, worse, paper in ((LABELLED, UNIFORM, "23 against 6, p 0.001"), (LABELLED, VOID, "")):
        one, two = (hits["object", method].mean(axis=0) > 0.5 for method in (better, worse))
        first, second = int(np.sum(one & ~two)), int(np.sum(two & ~one))
        columns = {"first_only": first, "second_only": second, **statistics_columns(one.size, 0.5)}
        case = {"classes": "object", "method": f"{better} or {worse}", **columns}
        _, item = np.unique(objects, return_inverse=True)
        leads = np.sign(np.bincount(item, one.astype(float) - two))
        found = sign_test(int(np.sum(leads > 0)), int(np.sum(leads < 0)))
        claim = Claim(f"more recordings are right with {better} alone", paper, bound=0.5, untestable=FLOOR_ONLY)
        rows.add(case, "share of the unequal objects", found, keys, claim, one.size)
    leads = hits["object", LABELLED].mean(axis=1) > hits["object", UNIFORM].mean(axis=1)
    case = {"classes": "object", "method": f"{LABELLED} - {UNIFORM}", **statistics_columns(len(leads), 0.5)}
    rows.add(case, "share of seeds in which it leads", share(float(np.sum(leads)), len(leads)), keys, Claim(paper="1.0"), len(leads))
