"""Choose copies and learner of the turntable recognition on recordings that no table reports.

    python -m experiments.generators.choices            writes experiments/recognition/recognition_choices.json in about half a core-hour

The testbed of the seed SEED draws other objects, rooms, radar boards and motions than those of the reported tables, whose seeds are 0 to
9000 (experiments/campaign/truth.py, root_of). Each candidate is trained on copies of simulated revolutions and scored on the measured
revolutions of this testbed: without labels, and by the nearest class centroid of other recordings and of a few labelled revolutions.
The candidate with the highest mean of the first two accuracies is chosen for the kind of copies. The learner is chosen for each of the two
accuracies. The output file lists the scores and the recordings on which they rest, beside the settings that were chosen without them.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from experiments.campaign.campaign import Campaign
from experiments.campaign.cases import MEASURED, Case
from experiments.campaign.truth import root_of
from experiments.recognition.copies import rows_of_copies
from experiments.recognition.encoder_comparison import METHODS, RAW
from experiments.recognition.protocol import anchors, scaled, seeds, settings
from experiments.recognition.randomisation_ablation import ALL, NOISE_ONLY, QUANTITIES, copied
from experiments.recognition.readings import FEATURES, MOTION, pictures, shared_cases, vectors
from radartwin.config.compose import compose
from radartwin.config.config import Config
from radartwin.io import files
from radartwin.io.progress import Progress
from radartwin.recognize.learners import LEARNERS
from radartwin.recognize.probes import leave_one_out_centroid, nearest_centroid
from radartwin.recognize.samples import Samples
from radartwin.recognize.split import draw_shots, label_free
from radartwin.store.products import Store

SEED = 500_000
SHOTS = (1, 2, 4)
OUTPUT = Path(__file__).parents[1] / "recognition" / "recognition_choices.json"
RECEIVER = ("level", "if_filter", "channels", "noise")
COPIES = {NOISE_ONLY: QUANTITIES, "receiver drawn": tuple(name for name in QUANTITIES if name not in RECEIVER), ALL: ()}


def configured() -> Config:
    """Return the configuration of the selection: every object of the catalogue at the paper's distances, with 24 frames per revolution."""
    return compose(["experiment=encoder_comparison", "profile.campaign.turntable_distances_m=[0.5,1.0,1.5,2.0]"])


def recordings(config: Config) -> list[str]:
    """Return the names of the measured recordings of the selection, each with the seed of its testbed."""
    campaign = Campaign(_truth(config), Store(Path(config.output) / "cache"), Progress(quiet=True), 0)
    return sorted(named(case, _truth(config)) for case in campaign.cases(MEASURED, motion=MOTION))


def named(case: Case, config: Config) -> str:
    """Return the name of a measured recording with the seed of its testbed."""
    return f"{root_of(case, config)} {case.name}"


def _truth(config: Config) -> Config:
    return replace(config, seed=SEED)


def scores(config: Config, store: Store, progress: Progress) -> list[dict[str, Any]]:
    """Return the accuracies of every candidate."""
    twin, truth = Campaign(config, store, progress, 0), Campaign(_truth(config), store, progress, 0)
    cases, twins = shared_cases(truth, MOTION)
    measured = {"features": scaled(vectors(truth, MEASURED, cases, FEATURES).samples), "pictures": pictures(truth, MEASURED, cases).samples}
    features = measured["features"]
    found = [{"copies": "", "method": RAW} | _probed([features] * len(seeds(config)), features)]
    for kind, left_out in progress.over(list(COPIES.items()), "copies"):
        drawn = rows_of_copies(copied(config, left_out), store, twin, twins, cases, measured_source=truth)
        copies = {"features": scaled(drawn["features"].samples), "pictures": drawn["pictures"].samples}
        for method, (learner, text) in METHODS.items():
            if kind == ALL or method in list(METHODS)[:1]:
                found.append({"copies": kind, "method": method} | _scored(config, learner, text, copies, measured))
    return found


def chosen(found: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    """Return the method with the highest accuracy of each probe, among the methods that are trained on copies with all quantities drawn."""
    trained = [row for row in found if row["copies"] == ALL]
    return {probe: max(trained, key=lambda row: row[probe])["method"] for probe in ("no labels", "other recordings")}


def _scored(config: Config, name: str, text: str, copies: Mapping[str, Samples], measured: Mapping[str, Samples]) -> dict[str, float]:
    learner, features = LEARNERS[name], measured["features"]
    rows, split = measured[learner.reads], label_free(copies[learner.reads], measured[learner.reads])
    fitted = [learner.fit(split, anchors(features.classes, text), settings(config), seed) for seed in seeds(config)]
    named_ = float(np.mean([one.predict(rows.unlabelled()) == features.label for one in fitted]))
    return {"no labels": round(named_, 3)} | _probed([one.embedded(rows) for one in fitted], features)


def _probed(embedded: list[Samples], truth: Samples) -> dict[str, float]:
    found = {"other recordings": float(np.mean([leave_one_out_centroid(one, one.source) == truth.label for one in embedded]))}
    for shots in SHOTS:
        hits = []
        for seed, one in enumerate(embedded):
            known, rest = (np.isin(truth.recording, some.recording) for some in draw_shots(truth, shots, seed))
            hits.append(float(np.mean(nearest_centroid(one.take(known), one.take(rest)) == truth.label[rest])))
        found[f"{shots} labels per class"] = float(np.mean(hits))
    return {probe: round(value, 3) for probe, value in found.items()}


def main() -> None:
    """Score the candidates, and write the scores and the recordings into the file of choices, beside the other choices in it."""
    config, progress = configured(), Progress()
    store = Store(Path(config.output) / "cache", progress.say)
    content = json.loads(OUTPUT.read_text(encoding="utf-8"))
    found = scores(config, store, progress)
    content["selection"] = {"seed": SEED, "chosen": chosen(found), "scores": found, "recordings": recordings(config)}
    files.write_atomically(OUTPUT, json.dumps(content, indent=1) + "\n")
    for row in content["selection"]["scores"]:
        print(row)


if __name__ == "__main__":
    main()
