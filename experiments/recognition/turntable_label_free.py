"""Turntable without measured labels: does training on simulation alone recognise the attributes of an object, or the object itself?

The encoder (a neural network) is trained on noisy copies of the simulated features. The predicted object is the object whose text
embedding is nearest to the encoder's output. Paper (recognition, label-free): the accuracy for geometry is 0.72, and the largest geometry
class has a share of 0.58. In the paper, the accuracy for material is 0.72, and the largest material class has a share of 0.67. In the
paper, the object itself is not recognised.
"""

from __future__ import annotations

from dataclasses import replace

from experiments import draws
from experiments.campaign.schedule import RecordingTask
from experiments.campaign.source import RecordingSource
from experiments.claims import Claim
from experiments.recognition.copies import measured_and_copies
from experiments.recognition.figures import bars, confusions
from experiments.recognition.protocol import (
    GEOMETRY,
    MATERIAL,
    SAME_MODELS,
    RecognitionRows,
    anchors,
    at_chance,
    correct,
    encoders,
    settings,
)  # fmt: skip
from experiments.recognition.readings import MOTION, paired
from experiments.recognition.transfer import ranked
from radartwin.config.config import Config
from radartwin.io.progress import Progress
from radartwin.recognize.encoder import nearest_text
from radartwin.recognize.probes import transferred_probe
from radartwin.recognize.score import majority_share, uniform_chance
from radartwin.recognize.split import label_free
from radartwin.runs.experiment import Result, Table
from radartwin.store.products import Store

TABLE = Table(
    name="turntable_label_free",
    title="Recognition on the turntable without labels",
    caption="Rotation features are rank-normalised within each domain and distance. An encoder and a linear classifier (probe) on "
    "its embeddings are trained on the simulated features and applied to the measured ones. Chance for geometry and "
    "material is the share of the largest class. Rows with an entry in the column 'twin' belong to a simulation that knows only the "
    "surface of vessels, and those with an entry in the column 'truth' to a testbed whose objects equal the catalogue (paper profile).",
)

ENCODER, RANKS = "encoder on ranks", "ranks alone"
PAPER = {"geometry": "0.72", "material": "0.72"}


def recordings(config: Config, store: Store, progress: Progress) -> dict[str, RecordingTask]:
    own = [config, *draws.unknown_contents(config), *draws.exact_objects(config)]
    return draws.recordings(own, lambda campaign: paired(campaign, MOTION), store, progress)


def run(config: Config, store: Store, progress: Progress) -> Result:
    def scored(own: Config) -> Result:
        return draws.scored(own, store, progress, lambda campaign: score(own, campaign, store, progress))

    return draws.beside_exact_objects(config, lambda own: draws.beside_unknown(own, scored) if own is config else scored(own))


def score(config: Config, source: RecordingSource, store: Store, progress: Progress) -> Result:
    """Build the table rows for each attribute (geometry, material) and method, and for the object itself."""
    measured, copies = measured_and_copies(config, source, store, progress)
    keys = tuple(sorted((*measured.keys, *copies.keys)))
    split = label_free(ranked(copies.samples), ranked(measured.samples))
    trained = encoders(config, split)
    rows = RecognitionRows(config)
    shown: dict[str, dict[str, dict]] = {}
    for attribute, classes in (("geometry", GEOMETRY), ("material", MATERIAL)):
        embedded = [[encoder.embedded(one.relabelled(classes)) for one in (split.train, split.test)] for encoder in trained]
        plain = label_free(split.train.relabelled(classes), split.test.relabelled(classes))
        truth = plain.test
        claim = Claim(f"{attribute} transfers: above the majority", PAPER[attribute])
        for method, splits, claimed in ((RANKS, [plain], Claim()), (ENCODER, [label_free(*pair) for pair in embedded], claim)):
            answers = [transferred_probe(one) for one in splits]
            hits = correct(answers, truth.label)
            case = {"supervision": "label_free", "attribute": attribute, "method": method}
            shown.setdefault(attribute, {})[method] = rows.share(case, hits, truth, keys, majority_share(truth), claimed, answers=answers)
    texts, temperature = anchors(split.test.classes), settings(config).temperature
    names = [nearest_text(encoder, split.unlabelled, texts, temperature) for encoder in trained]
    chance = uniform_chance(split.test)
    case = {"supervision": "label_free", "attribute": "identity", "method": ENCODER}
    claim = replace(at_chance("identity stays at chance", "does not transfer", chance), untestable=SAME_MODELS)
    shown["identity"] = {ENCODER: rows.share(case, correct(names, split.test.label), split.test, keys, chance, claim)}
    figures = {
        "turntable_label_free": lambda: bars(shown, "accuracy", grey=RANKS),
        "turntable_label_free_confusion": lambda: confusions({"nearest description": (split.test.label, names[0])}, split.test.classes),
    }
    metrics = {f"accuracy_{name}": group[ENCODER]["value"] for name, group in shown.items()}
    return Result("turntable_label_free", rows, figures, metrics, sorted(keys))
