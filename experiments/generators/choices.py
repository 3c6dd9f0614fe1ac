"""Choose the kind of copies and the learners for the turntable recognition, by their accuracy on recordings that no table reports.

    python -m experiments.generators.choices            writes experiments/recognition/recognition_choices.json in about half a core-hour

Each candidate is trained on copies of simulated revolutions, and classifies the measured revolutions of draw DRAW without labels, by the
nearest centroid of other recordings, and by that of a few labelled revolutions. The network's mean of the first two accuracies chooses the
kind of copies; each of them then chooses a learner. With 48 recordings, an accuracy of 0.4 has a standard error of 0.07, so the choice
between similar candidates is uncertain. The file also contains settings that were chosen otherwise.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from experiments.campaign.campaign import Campaign
from experiments.campaign.cases import MEASURED, Case
from experiments.campaign.frame import shared, stored
from experiments.campaign.truth import root_of
from experiments.interface import Config, Progress, Store
from experiments.recognition.copies import copies
from experiments.recognition.encoder_comparison import METHODS, NETWORK, RAW, TREES, fit_method, fit_with_labels
from experiments.recognition.protocol import scaled, seeds
from experiments.recognition.randomisation_ablation import ALL, NOISE_ONLY, QUANTITIES, copied_as
from experiments.recognition.readings import MOTION, revolutions
from radartwin.config.compose import compose
from radartwin.io import files
from radartwin.recognize.learners import LEARNERS
from radartwin.recognize.learners.interface import Reads
from radartwin.recognize.probes import leave_one_out_centroid, nearest_centroid
from radartwin.recognize.samples import Samples
from radartwin.recognize.split import draw_shots

DRAW = 500
SHOTS = (1, 2, 4)
SHARES = (0.2, 0.5, 0.8)
CHOSEN_BY = ("no labels", "other recordings")
OUTPUT = Path(__file__).parents[1] / "recognition" / "recognition_choices.json"
RECEIVER = ("level", "if_filter", "channels", "noise")
COPIES = {NOISE_ONLY: QUANTITIES, "receiver drawn": tuple(name for name in QUANTITIES if name not in RECEIVER), ALL: ()}


def configured() -> Config:
    """Return the configuration of the selection: every object of the catalogue at the paper's distances, with 24 frames per revolution."""
    return compose(["experiment=encoder_comparison", "profile.campaign.turntable_distances_m=[0.5,1.0,1.5,2.0]"])


class Selection(Campaign):
    """The campaign of the twin, with the measured recordings of the draw DRAW."""

    def cases(self, domain: str, **conditions: Any) -> list[Case]:
        cases = super().cases(domain, **conditions)
        return [replace(case, draw=DRAW) for case in cases] if domain == MEASURED else cases


def selection(config: Config, store: Store, progress: Progress) -> Selection:
    return Selection(config, store, progress, 0)


def recordings(config: Config) -> list[str]:
    """Return the names of the measured recordings of the selection, each with seed and board of its draw."""
    campaign = selection(config, Store(Path(config.output) / "cache"), Progress(quiet=True))
    return sorted(named(case, config) for case in campaign.cases(MEASURED, motion=MOTION))


def named(case: Case, config: Config) -> str:
    """Return the name of a measured recording with the seed and the board of its draw."""
    return f"seed {root_of(case, config)} board {case.draw}: {case.condition.name}"


def scores(config: Config, store: Store, progress: Progress) -> list[dict[str, Any]]:
    """Return the accuracies of every candidate."""
    source = selection(config, store, progress)
    frame = stored(source, shared(source, (MOTION,), several=True), progress)
    measured: dict[Reads, Samples] = {"features": scaled(revolutions(frame)), "pictures": revolutions(frame, "pictures")}
    features = measured["features"]
    rows = [{"copies": "", "method": RAW} | _probed([features] * len(seeds(config)), features)]
    for kind, left_out in progress.over(list(COPIES.items()), "copies"):
        features_, pictures = (copies(store, {"": source}, copied_as(config, left_out), frame, kind) for kind in ("features", "pictures"))
        simulated: dict[Reads, Samples] = {"features": scaled(features_), "pictures": pictures}
        for method in METHODS:
            if kind == ALL or method in (NETWORK, TREES):
                rows.append({"copies": kind, "method": method} | _scored(config, method, simulated, measured))
        if kind == ALL:
            rows += [{"copies": ALL, "labelled share": share} | _joint(config, share, simulated["features"], features) for share in SHARES]
    return rows


def selected(rows: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    """Return the kind of copies of the network with the best mean of both accuracies, and with these copies each best method."""
    network = {row["copies"]: float(np.mean([row[probe] for probe in CHOSEN_BY])) for row in rows if row.get("method") == NETWORK}
    kind = max(network, key=lambda name: network[name])
    trained = [row for row in rows if row["copies"] == kind and "method" in row]
    return {"copies": kind} | {probe: max(trained, key=lambda row: row[probe])["method"] for probe in CHOSEN_BY}


def chosen_share(rows: Sequence[Mapping[str, Any]]) -> float:
    """Return the smallest share of labelled training rows with the highest mean accuracy over all numbers of labels."""
    of_shares = [row for row in rows if "labelled share" in row]
    return max(of_shares, key=lambda row: round(float(np.mean([row[f"{shots} labels per class"] for shots in SHOTS])), 2))["labelled share"]


def _scored(config: Config, method: str, copies: Mapping[Reads, Samples], measured: Mapping[Reads, Samples]) -> dict[str, float]:
    rows, features = measured[LEARNERS[METHODS[method][0]].reads], measured["features"]
    fitted = fit_method(config, method, copies, measured)
    named_ = float(np.mean([model.predict(rows.unlabelled()) == features.label for model in fitted]))
    embedded = [model.embedded(rows) for model in fitted]
    return {"no labels": round(named_, 3)} | _probed([embedded[min(k, len(embedded) - 1)] for k in range(len(seeds(config)))], features)


def _joint(config: Config, share: float, simulated: Samples, truth: Samples) -> dict[str, float]:
    """Return the accuracies of the network that is trained on simulated rows and, as this share of all rows, on labelled measured rows."""
    accuracies = {}
    for shots in SHOTS:
        hits = []
        for seed in seeds(config):
            known, rest = draw_shots(truth, shots, seed)
            network = fit_with_labels(config, simulated, known, rest, seed, share)
            hits.append(float(np.mean(nearest_centroid(network.embedded(known), network.embedded(rest)) == rest.label)))
        accuracies[f"{shots} labels per class"] = round(float(np.mean(hits)), 3)
    return accuracies


def _probed(embedded: list[Samples], truth: Samples) -> dict[str, float]:
    accuracies = {"other recordings": float(np.mean([leave_one_out_centroid(space, space.source) == truth.label for space in embedded]))}
    for shots in SHOTS:
        hits = []
        for seed, space in enumerate(embedded):
            known, rest = (np.isin(truth.recording, drawn.recording) for drawn in draw_shots(truth, shots, seed))
            hits.append(float(np.mean(nearest_centroid(space.take(known), space.take(rest)) == truth.label[rest])))
        accuracies[f"{shots} labels per class"] = float(np.mean(hits))
    return {probe: round(value, 3) for probe, value in accuracies.items()}


def main() -> None:
    """Score the candidates, and write the scores and the recordings into the file of choices, beside the other choices in it."""
    config, progress = configured(), Progress()
    store = Store(Path(config.output) / "cache", progress.say)
    content = json.loads(OUTPUT.read_text(encoding="utf-8"))
    candidates = scores(config, store, progress)
    content["selection"] |= {
        "draw": DRAW,
        "chosen": selected(candidates) | {"labelled share": chosen_share(candidates)},
        "scores": candidates,
        "recordings": recordings(config),
    }
    files.write_atomically(OUTPUT, json.dumps(content, indent=1) + "\n")
    for row in content["selection"]["scores"]:
        print(row)


if __name__ == "__main__":
    main()
