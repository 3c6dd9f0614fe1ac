"""Turntable without labels: which attributes of an object, and whether the object itself, are told from simulation alone.

Both domains' rotation vectors are rank-normalised apart, within each distance; the encoder learns noise copies of the simulated ones, and
a linear probe on their embeddings tells geometry and material of the measured ones. Identity is the nearest description. Paper:
recognition, (ii) label-free: geometry 0.72 against a majority of 0.58, material 0.72 against 0.67, identity does not transfer.
"""

from __future__ import annotations

from experiments.recognition.figures import bars, confusions
from experiments.recognition.labelled_probe import FEATURES, MOTION
from experiments.recognition.protocol import GEOMETRY, MATERIAL, Rows, anchors, encoders, right, settings
from experiments.recognition.readings import Campaign, noise_copies, shared_cases, vectors
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
    caption="Rotation features are rank-normalised within each domain and distance. An encoder and a linear probe on its embeddings are "
    "trained on the simulated features and applied to the measured ones. Chance for geometry and material is the share of the "
    "largest class.",
)

ENCODER, RANKS = "encoder on ranks", "ranks alone"
PAPER = {"geometry": "0.72", "material": "0.72"}


def run(config: Config, store: Store, progress: Progress) -> Result:
    from experiments.campaign.campaign import Campaign as Recorded

    return score(config, Recorded(config, store, progress), store, progress)


def score(config: Config, campaign: Campaign, store: Store, progress: Progress) -> Result:
    cases, twins = shared_cases(campaign, MOTION)
    progress.say(f"{len(twins)} simulated revolutions, {config.supervision.copies} copies of each; {len(cases)} measured")
    read = vectors(campaign, "measured", cases, FEATURES)
    made = noise_copies(campaign, store, twins, cases, FEATURES, config.supervision.copies, config.seed)
    keys = tuple(sorted((*read.keys, *made.keys)))
    split = label_free(ranked(made.samples), ranked(read.samples))
    trained = encoders(config, split)
    table = Rows(config, [])
    shown: dict[str, dict[str, dict]] = {}
    for attribute, classes in (("geometry", GEOMETRY), ("material", MATERIAL)):
        truth = split.test.relabelled(classes)
        majority = majority_share(truth)
        found = []
        for encoder in trained:
            simulated, measured = (encoder.embedded(rows.relabelled(classes)) for rows in (split.train, split.test))
            found.append(transferred_probe(label_free(simulated, measured)))
        plain = [transferred_probe(label_free(split.train.relabelled(classes), truth))]
        shown[attribute] = {}
        for method, answers in ((RANKS, plain), (ENCODER, found)):
            claim, paper = (f"{attribute} transfers: above the majority", PAPER[attribute]) if method == ENCODER else ("", "")
            case = {"level": "label_free", "attribute": attribute, "method": method}
            shown[attribute][method] = table.share(case, right(answers, truth.label), truth, keys, majority, paper=paper, claim=claim)
    texts, temperature = anchors(split.test.classes), settings(config).temperature
    names = [nearest_text(encoder, split.unlabelled, texts, temperature) for encoder in trained]
    chance = uniform_chance(split.test)
    case = {"level": "label_free", "attribute": "identity", "method": ENCODER}
    row = table.share(
        case, right(names, split.test.label), split.test, keys, chance, paper="does not transfer", claim="identity stays at chance"
    )
    row["verdict"] = "holds" if row["low"] <= chance else "fails"
    shown["identity"] = {ENCODER: row}
    figures = {
        "turntable_label_free": lambda: bars(shown, "accuracy", grey=RANKS),
        "turntable_label_free_confusion": lambda: confusions({"nearest description": (split.test.label, names[0])}, split.test.classes),
    }
    metrics = {f"accuracy_{name}": group[ENCODER]["value"] for name, group in shown.items()}
    return Result(TABLE.name, table.rows, figures, metrics, sorted(keys))
