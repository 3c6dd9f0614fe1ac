"""Contrastive alignment of simulated radar with descriptions: what a linear probe reads off the embeddings of measured recordings.

The encoder learns the simulated rotation vectors against MiniLM embeddings of the objects' descriptions; measured vectors are embedded by
it, and a linear probe tells geometry and material of each from the others: all other recordings (as the paper may be read), and all
recordings of other objects, where no object's own recordings can give it away. Classes are weighted alike, so chance is one over their
number. Paper: contrastive sim-real alignment, geometry 85 % (chance 50), material 40 % (chance 33). At `supervision=few_shot` the drawn
recordings are learned too, and `supervision.encoder.paired` adds the term between simulated and measured ones. A training on simulation
alone leaves the study as a model for `radartwin classify`; its features leave brightness out: nobody knows the gain of another's radar.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from experiments.recognition.figures import bars, embedding_map
from experiments.recognition.labelled_probe import FEATURES, MOTION
from experiments.recognition.protocol import GEOMETRY, MATERIAL, Rows, anchors, encoders, right, settings
from experiments.recognition.readings import Campaign, Readings, noise_copies, shared_cases, vectors
from radartwin.config.config import Config
from radartwin.config.trajectory import TurntableTrajectory
from radartwin.io.progress import Progress
from radartwin.recognize.model import Recogniser
from radartwin.recognize.probes import linear_probe, standardised
from radartwin.recognize.samples import Samples, join
from radartwin.recognize.split import Split, draw_shots, label_free
from radartwin.recognize.training import fit
from radartwin.runs.experiment import Result, Table
from radartwin.store.products import Store

TABLE = Table(
    name="contrastive",
    title="Simulated radar aligned with descriptions",
    caption="Balanced accuracy of linear probes on embeddings of measured revolutions. The probes are trained on other recordings, or "
    "on other objects only; the latter leaves out classes with a single object.",
)

EMBEDDED, RAW = "embeddings", "features"
PAPER = {"geometry": "0.85", "material": "0.40"}
EXPORT_WITHOUT = ("brightness",)


def run(config: Config, store: Store, progress: Progress) -> Result:
    from experiments.campaign.campaign import Campaign as Recorded

    return score(config, Recorded(config, store, progress), store, progress)


def score(config: Config, campaign: Campaign, store: Store, progress: Progress) -> Result:
    measured, copies = read(config, campaign, store, progress)
    keys = tuple(sorted((*measured.keys, *copies.keys)))
    split = _split(config, standardised(copies.samples), standardised(measured.samples))
    trained = encoders(config, split)
    table, shown = Rows(config, []), {}
    for attribute, classes in (("geometry", GEOMETRY), ("material", MATERIAL)):
        for left_out, groups in (("recording", split.test.source), ("object", split.test.label)):
            case = {"level": f"{split.level} encoder, labelled probe", "attribute": attribute, "left out": left_out}
            scored = _told_by_others(split.test, classes) if left_out == "object" else np.ones(len(split.test), bool)
            rows = split.test.take(scored).relabelled(classes)
            if len(rows.classes) < 2:
                continue
            chance = 1 / len(rows.classes)
            for method, values in ((RAW, [split.test]), (EMBEDDED, [encoder.embedded(split.test) for encoder in trained])):
                answers = [linear_probe(one.take(scored).relabelled(classes), groups[scored]) for one in values]
                claim = f"{attribute} is read off measured embeddings" if method == EMBEDDED else ""
                paper = PAPER[attribute] if claim and left_out == "recording" else ""
                hits = right(answers, rows.label)
                row = table.share(case | {"method": method}, hits, rows, keys, chance, paper=paper, claim=claim, balanced=True)
                shown.setdefault(f"{attribute},\nother {left_out}s", {})[method] = row
    both = join(trained[0].embedded(split.simulated.per_recording()), trained[0].embedded(split.test))
    figures = {
        "contrastive": lambda: bars(shown, "balanced accuracy", grey=RAW),
        "contrastive_map": lambda: embedding_map(both, GEOMETRY, "first seed"),
    }
    metrics = {f"{r['attribute']}_{r['left out']}": r["value"] for r in table.rows if r["method"] == EMBEDDED}
    models = {"recogniser": export(config, campaign, store)}
    return Result(TABLE.name, table.rows, figures, metrics, sorted(keys), models=models)


def read(config: Config, campaign: Campaign, store: Store, progress: Progress, without: tuple[str, ...] = ()) -> tuple[Readings, Readings]:
    """(measured recordings, noise copies of the simulated ones)."""
    cases, twins = shared_cases(campaign, MOTION)
    progress.say(f"{len(twins)} simulated revolutions, {config.supervision.copies} copies of each; {len(cases)} measured")
    made = noise_copies(campaign, store, twins, cases, FEATURES, config.supervision.copies, config.seed, without)
    return vectors(campaign, "measured", cases, FEATURES, without), made


def _split(config: Config, simulated: Samples, measured: Samples) -> Split:
    if config.supervision.mode != "few_shot":
        return label_free(simulated, measured)
    known, rest = draw_shots(measured, config.supervision.shots, config.seed)
    return Split("few_shot", join(simulated, known), rest, config.supervision.shots)


def _told_by_others(recordings: Samples, classes: dict[str, str]) -> NDArray[np.bool_]:
    """Recordings of classes that another object has too: with one object of a class nothing tells it without its own recordings."""
    objects = {kind: {label for label in recordings.classes if classes[label] == kind} for kind in set(classes.values())}
    return np.array([len(objects[classes[label]]) > 1 for label in recordings.label])


def export(config: Config, campaign: Campaign, store: Store) -> Recogniser:
    """The recogniser of the twelve objects, trained on simulation alone, features scaled by the simulated ones."""
    measured, copies = read(config, campaign, store, Progress(), EXPORT_WITHOUT)
    texts = anchors(copies.samples.classes)
    trained = fit(label_free(standardised(copies.samples), standardised(measured.samples)), texts, settings(config), config.seed)
    provenance = {
        "trained on": "simulation", "table": "contrastive", "seed": config.seed, "epochs": trained.epochs,
        "copies": config.supervision.copies, "recordings": sorted(copies.keys),
    }  # fmt: skip
    classes = tuple(sorted(texts))
    turntable = config.trajectory if isinstance(config.trajectory, TurntableTrajectory) else TurntableTrajectory
    features = {"set": FEATURES, "without": list(EXPORT_WITHOUT), "period_s": turntable.period_s}
    values = copies.samples.values
    return Recogniser(
        trained.encoder, classes, np.stack([texts[label] for label in classes]), settings(config).temperature, copies.samples.names,
        features, values.mean(axis=0), values.std(axis=0), provenance,
    )  # fmt: skip
