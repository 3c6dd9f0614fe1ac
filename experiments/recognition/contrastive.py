"""Contrastive alignment of simulated radar features with text, tested by linear classifiers (probes) on embeddings of measured recordings.

The encoder aligns simulated rotation features with MiniLM embeddings of the objects' descriptions. Probes predict geometry and material of
each measured recording, trained on all other recordings (an interpretation of the paper) or on other objects only. Classes have equal
weight. Paper: geometry 85 % (chance 50), material 40 % (chance 33). An encoder trained on simulation alone is exported for `radartwin
classify`, without brightness, because the gain of a user's radar is unknown.
"""

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from experiments.campaign.cases import MEASURED
from experiments.campaign.frame import Frame
from experiments.cells import Cell, first_draw, keys
from experiments.draws import Query
from experiments.framed import Figures, framed
from experiments.interface import Config, Progress, Result, Store, Table
from experiments.recognition.copies import Copied, with_copies
from experiments.recognition.plots import bars, embedding_map, grouped, values
from experiments.recognition.protocol import GEOMETRY, MATERIAL, Scored, anchors, correct, encoders, scaled, settings
from experiments.recognition.readings import FEATURES, TURNTABLE, revolutions, without
from experiments.verdicts import NONE, Claim, Row
from radartwin.config.trajectory import TurntableTrajectory
from radartwin.features.families import BRIGHTNESS
from radartwin.recognize.model import Recogniser
from radartwin.recognize.probes import linear_probe, repeatability
from radartwin.recognize.samples import join
from radartwin.recognize.split import Split, draw_shots, label_free
from radartwin.recognize.training import fit

TABLE = Table(
    name="contrastive",
    title="Simulated radar aligned with descriptions",
    caption="Balanced accuracy of linear classifiers (probes) on embeddings of measured revolutions. The probes are trained on all "
    "other recordings, or on recordings of other objects only. The second case leaves out classes with a single object.",
)

EMBEDDED, RAW = "embeddings", "features"
PAPER = {"geometry": "0.85", "material": "0.40"}
EXPORT_WITHOUT = ("brightness",)


def cells(config: Config, copied: Copied, frame: Frame) -> Iterator[Cell]:
    """Declare the cells of one draw. The panel of a row has the recordings in the space of the first encoder."""
    simulated, measured = scaled(copied(config, frame)), scaled(revolutions(frame))
    split = label_free(simulated, measured)
    if (supervision := config.supervision).mode == "few_shot":
        known, rest = draw_shots(measured, supervision.shots, config.seed)
        split = Split("few_shot", join(simulated, known), rest, supervision.shots)
    trained = encoders(config, split)
    panel = join(trained[0].embedded(split.simulated.per_recording()), trained[0].embedded(split.test))
    for attribute, classes in (("geometry", GEOMETRY), ("material", MATERIAL)):
        for left_out, groups in (("recording", split.test.source), ("object", split.test.label)):
            objects = Counter(classes[label] for label in split.test.classes)  # an object is left out if its class has another one
            scored = np.array([left_out == "recording" or objects[classes[label]] > 1 for label in split.test.label])
            truth = split.test.take(scored).relabelled(classes)
            if len(truth.classes) < 2:
                continue
            for method, spaces in ((RAW, [split.test]), (EMBEDDED, [encoder.embedded(split.test) for encoder in trained])):
                predictions = [linear_probe(space.take(scored).relabelled(classes), groups[scored]) for space in spaces]
                paper = PAPER[attribute] if left_out == "recording" else ""
                claim = Claim(f"a classifier finds {attribute} from measured embeddings", paper) if method == EMBEDDED else NONE
                case = {
                    "supervision": f"{split.level} encoder, labelled probe",
                    "attribute": attribute,
                    "left out": left_out,
                    "method": method,
                }
                chance, hits = 1 / len(truth.classes), correct(predictions, truth.label)
                yield Scored(config, truth, frame, chance).accuracy(case, hits, claim, True, predictions, panel)


def export(config: Config, frame: Frame, copied: Copied) -> Recogniser:
    """Train a classifier on the simulation alone. Its features are scaled by their mean and spread over the simulated recordings."""
    measured, copies = (without(rows, BRIGHTNESS) for rows in (revolutions(frame), copied(config, frame)))
    texts = anchors(copies.classes)
    trained = fit(label_free(scaled(copies), scaled(measured)), texts, settings(config), config.seed)
    provenance = {
        "trained on": "simulation", "table": "contrastive", "seed": config.seed, "epochs": trained.epochs,
        "copies": config.supervision.copies, "recordings": keys(frame[frame.domain != MEASURED]),
    }  # fmt: skip
    classes = tuple(sorted(texts))
    turntable = config.trajectory if isinstance(config.trajectory, TurntableTrajectory) else TurntableTrajectory
    features = {"set": FEATURES, "without": list(EXPORT_WITHOUT), "period_s": turntable.period_s}
    return Recogniser(
        trained.encoder, classes, np.stack([texts[label] for label in classes]), settings(config).temperature, copies.names, features,
        copies.values.mean(axis=0), np.maximum(copies.values.std(axis=0), repeatability(copies.names)), provenance,
    )  # fmt: skip


def _groups(rows: list[Row]) -> dict[str, dict[str, Any]]:
    return grouped(rows, lambda row: f"{row['attribute']},\nother {row['left out']}s", metric="balanced accuracy")


def _figures(rows: list[Row], first: Frame) -> Figures:
    return {
        "contrastive": lambda: bars(_groups(rows), "balanced accuracy", grey=RAW),
        "contrastive_map": lambda: embedding_map(rows[0].panel, GEOMETRY, "first seed"),
    }


_, recordings, score = framed(TABLE, TURNTABLE, cells, _figures, lambda rows: values(_groups(rows)), source=with_copies)


def run(config: Config, store: Store, progress: Progress) -> Result:
    """Compute the table, and train the classifier that the run exports."""
    frame, copied = with_copies(Query(config, **TURNTABLE), store, progress)
    return replace(score(config, frame, copied), models={"recogniser": export(config, first_draw(frame), copied)})
