"""Labelled probe: what a representation trained on simulation alone is worth to who has a few measured labels.

The encoder learns from noise-augmented copies of simulated revolutions and never sees a measured one; measured revolutions are embedded by
it, frozen, and each is recognised by the nearest class centroid of all the others. The same probe on the features themselves tells what
the training was worth; within strata of equal distance, that distance is no cue. Revolutions of one recording are nearly alike, so the
probe is also asked without the other revolutions of the same recording, which are then of other distances. Paper: recognition with
simulation-trained representations, 95.3 +- 1.5 % against 89.7 % raw, stratified 95.3 against 90.3 %, an adapted RF-Genesis 90.1 %. Beyond
the paper: accuracy against the number of labels, and controls on shuffled labels and domains.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments.recognition.figures import bars, confusions, label_curve
from experiments.recognition.protocol import Rows, anchors, encoders, right, seed_sd, seeds, settings
from experiments.recognition.readings import Campaign, Readings, noise_copies, shared_cases, vectors
from radartwin.config.config import Config
from radartwin.config.simulator import RFGenesisSimulator
from radartwin.io.progress import Progress
from radartwin.recognize.encoder import Encoder, nearest_text
from radartwin.recognize.probes import leave_one_out_centroid, nearest_centroid, standardised
from radartwin.recognize.samples import Samples, join
from radartwin.recognize.score import balanced_share, exact_interval, uniform_chance
from radartwin.recognize.split import Split, as_domains, draw_shots, label_free, most_shots, shuffled
from radartwin.recognize.training import fit
from radartwin.runs.experiment import Result, Table
from radartwin.store.products import Store

TABLE = Table(
    name="labelled_probe",
    title="What training on simulation is worth",
    caption="An encoder is trained on noisy copies of simulated revolutions and frozen. Measured revolutions are classified by the "
    "nearest class centroid of other recordings. These are at other distances, so that no part of a recording classifies "
    "another part of it. RF-Genesis is the corrected re-implementation. The testbed uses the same physics as our tracer, which "
    "favours our tracer. Labels per class are drawn from half of each object's recordings; the other half is scored. n counts "
    "recordings, answers counts revolutions. Intervals are bootstraps over objects and distances.",
)

MOTION, FEATURES = "turntable", "rotation"
SHOTS = (0, 1, 2, 4, 8, 14)
RIVAL = "RF-Genesis (corrected)"
PRETRAINED, RAW, SCRATCH = "trained on simulation", "raw features", "trained on the labels alone"
REVOLUTIONS, RECORDINGS, MATCHED = "other revolutions", "other recordings", "other revolutions, same distance"
PROBES = {  # by what the centroids are of: the paper's figures by method, and its gain
    REVOLUTIONS: ({PRETRAINED: "95.3 %", RAW: "89.7 %", RIVAL: "90.1 %"}, "+5.6 points"),
    MATCHED: ({PRETRAINED: "95.3 %", RAW: "90.3 %"}, "+5.0 points"),
    RECORDINGS: ({}, ""),
}
CASE = {"level": "few_shot", "setting": "turntable, 12 objects"}


@dataclass(frozen=True, eq=False)
class Data:
    """Measured recordings, and simulated copies by simulator, each domain standardised by its own unlabelled rows."""

    measured: Samples
    copies: Mapping[str, Samples]
    keys: Mapping[str, tuple[str, ...]]


def run(config: Config, store: Store, progress: Progress) -> Result:
    from experiments.campaign.campaign import Campaign as Recorded

    rival = RFGenesisSimulator(variant=config.simulator.variant, elements=config.simulator.elements, version="corrected")
    naive = replace(config, simulator=rival)
    return score(config, Recorded(config, store, progress), store, progress, {RIVAL: Recorded(naive, store, progress)})


def score(config: Config, campaign: Campaign, store: Store, progress: Progress, rivals: Mapping[str, Campaign] | None = None) -> Result:
    """The table from a campaign, and from rival simulators' campaigns under the same protocol."""
    data = gather_data(config, campaign, store, progress, rivals or {})
    table = Rows(config, [])
    measured, keys = data.measured, (*data.keys["measured"], *data.keys[PRETRAINED])
    chance = uniform_chance(measured.relabelled({label: label for label in measured.classes}))
    answers: dict[tuple[str, str], list[NDArray]] = {}
    trained: dict[str, list[Encoder]] = {}
    for name, simulated in data.copies.items():
        trained[name] = encoders(config, label_free(simulated, measured))
    probes = _probes(measured, progress)
    for probe in probes:
        answers[RAW, probe] = [_probed(measured, probe)]
        for name, found in trained.items():
            answers[name, probe] = [_probed(encoder.embedded(measured), probe) for encoder in found]
    scores = {case: right(found, measured.label) for case, found in answers.items()}

    groups: dict[str, dict[str, Mapping[str, Any]]] = {}
    for probe, (figures, gain) in probes.items():
        case = CASE | {"probe": probe}
        shown = groups.setdefault(probe.replace(", ", ",\n"), {})
        for method in (RAW, *data.copies):
            claim = "measured revolutions are recognised" if method == PRETRAINED else ""
            used = data.keys["measured"] if method == RAW else (*data.keys["measured"], *data.keys[method])
            shown[method] = table.share(
                case | {"method": method}, scores[method, probe], measured, used, chance, paper=figures.get(method, ""), claim=claim
            )
        for method, paper, claim in (
            (RAW, gain, "training on simulation beats the raw features"),
            *(
                (rival, "+5.2 points" if probe == REVOLUTIONS else "", "our simulation teaches more")
                for rival in data.copies
                if rival != PRETRAINED
            ),
        ):
            table.gain(
                case | {"method": f"{PRETRAINED} - {method}"}, scores[PRETRAINED, probe], scores[method, probe], measured,
                sorted({*keys, *data.keys.get(method, ())}), paper=paper, claim=claim,
            )  # fmt: skip
    curve = label_efficiency(config, table, data, trained[PRETRAINED], chance) if RECORDINGS in probes else {}
    controls(config, table, data, chance)
    figures_of = {
        "labelled_probe": lambda: bars(groups, "accuracy", grey=RAW),
        "labelled_probe_confusion": lambda: confusions(
            {method: (measured.label, answers[method, list(probes)[-1]][0]) for method in (RAW, PRETRAINED)}, measured.classes
        ),
    }
    if curve:
        figures_of["label_efficiency"] = lambda: label_curve(curve, chance)
    metrics = {
        f"accuracy_{name}_{probe.replace(', ', '_').replace(' ', '_')}": float(scores[method, probe].mean())
        for name, method in (("pretrained", PRETRAINED), ("raw", RAW)) for probe in probes
    } | {"chance": chance}  # fmt: skip
    all_keys = sorted({key for found in data.keys.values() for key in found})
    return Result(TABLE.name, table.rows, figures_of, metrics, all_keys)


def _probes(measured: Samples, progress: Progress) -> Mapping[str, tuple[Mapping[str, str], str]]:
    """Those that can be asked: with one recording of an object there is no other one to know it by, and none to spare for labels."""
    alone = [label for label in measured.classes if len(np.unique(measured.source[measured.label == label])) < 2]
    if not alone:
        return PROBES
    progress.say(f"one recording alone of {len(alone)} objects: neither told from other recordings nor by number of labels")
    return {probe: paper for probe, paper in PROBES.items() if probe != RECORDINGS}


def _probed(rows: Samples, probe: str) -> NDArray[np.str_]:
    """The leave-one-out answers of a probe."""
    return leave_one_out_centroid(rows, rows.source if probe == RECORDINGS else None, stratified=probe == MATCHED)


def gather_data(config: Config, campaign: Campaign, store: Store, progress: Progress, rivals: Mapping[str, Campaign]) -> Data:
    """Read everything; a rival replaces the twin's recordings, nothing else."""
    cases, _ = shared_cases(campaign, MOTION)
    progress.say(f"{len(cases)} measured {MOTION} recordings")
    measured = vectors(campaign, "measured", cases, FEATURES)
    read: dict[str, Readings] = {}
    for name, source in {PRETRAINED: campaign, **rivals}.items():
        twins = shared_cases(_measured_by(campaign, source), MOTION)[1]
        progress.say(f"{len(twins)} simulated revolutions, {config.supervision.copies} copies of each: {name}")
        read[name] = noise_copies(_measured_by(campaign, source), store, twins, cases, FEATURES, config.supervision.copies, config.seed)
    keys = {"measured": measured.keys, **{name: readings.keys for name, readings in read.items()}}
    return Data(standardised(measured.samples), {name: standardised(readings.samples) for name, readings in read.items()}, keys)


def _measured_by(campaign: Campaign, twins: Campaign) -> Campaign:
    """The measured recordings of one campaign with the simulated ones of another."""
    if campaign is twins:
        return campaign

    class Both:
        def cases(self, domain: Any, **chosen: Any) -> Sequence[Any]:
            return (campaign if domain == "measured" else twins).cases(domain, **chosen)

        def prepare(self, wanted: Any, materials: Any = None) -> None:
            wanted = list(wanted)
            campaign.prepare([one for one in wanted if one[0] == "measured"], materials)
            twins.prepare([one for one in wanted if one[0] != "measured"], materials)

        def processed(self, domain: Any, case: Any, materials: Any = None):
            return (campaign if domain == "measured" else twins).processed(domain, case, materials)

        def log(self, case: Any, domain: str = "measured"):
            return campaign.log(case, domain)

    return Both()


def label_efficiency(
    config: Config, table: Rows, data: Data, trained: Sequence[Encoder], chance: float
) -> dict[str, list[Mapping[str, Any]]]:
    """Accuracy with k labelled measured revolutions per class: nearest centroid of the k, or the nearest text where k is 0.

    Labels are drawn from one half of each object's recordings; the other half is scored.
    """
    measured = data.measured
    texts = anchors(measured.classes)
    found: dict[str, list[Mapping[str, Any]]] = {PRETRAINED: [], RAW: [], SCRATCH: []}
    place = {name: row for row, name in enumerate(measured.recording)}
    for shots in (k for k in SHOTS if k <= most_shots(measured)):
        hits = {method: np.full((len(trained), len(measured)), np.nan) for method in found}
        for number, (seed, encoder) in enumerate(zip(seeds(config), trained, strict=True)):
            known, rest = draw_shots(measured, shots, seed)
            answers = {PRETRAINED: nearest_text(encoder, rest.unlabelled(), texts, settings(config).temperature)}
            if shots:
                own = fit(Split("few_shot", known, rest, shots), texts, settings(config), seed).encoder
                answers = {
                    PRETRAINED: nearest_centroid(encoder.embedded(known), encoder.embedded(rest)),
                    RAW: nearest_centroid(known, rest),
                    SCRATCH: nearest_centroid(own.embedded(known), own.embedded(rest)),
                }
            for method, answer in answers.items():
                hits[method][number, [place[name] for name in rest.recording]] = answer == rest.label
        for method, scored in hits.items():
            rows = ~np.isnan(scored).all(axis=0)
            if rows.any():
                keys = data.keys["measured"] if method != PRETRAINED else (*data.keys["measured"], *data.keys[PRETRAINED])
                case = CASE | {"probe": f"{shots} labels per class", "method": method}
                found[method].append(table.share(case, scored[:, rows], measured.take(rows), keys, chance) | {"shots": shots})
    return {method: rows for method, rows in found.items() if rows}


def controls(config: Config, table: Rows, data: Data, chance: float) -> None:
    """What must come out at chance: labels dealt anew, domains dealt anew; and how well the true domains are told apart."""
    measured, simulated = data.measured, data.copies[PRETRAINED]
    keys = (*data.keys["measured"], *data.keys[PRETRAINED])
    answers, dealt_domains, domains = [], [], []
    both = as_domains(join(simulated.per_recording(), measured))
    texts = anchors(measured.classes)
    for seed in seeds(config):
        dealt = fit(label_free(shuffled(simulated, seed), measured), texts, settings(config), seed).encoder
        answers.append(nearest_text(dealt, measured.unlabelled(), texts, settings(config).temperature))
        for samples, kept in ((shuffled(both, seed), dealt_domains), (both, domains)):
            kept.append(_domains_told(samples, seed))
    draws = len(np.unique(simulated.recording))
    shares = right(answers, measured.label).mean(axis=1)
    table.control(CASE | {"probe": "control", "method": "simulated labels shuffled, nearest text"}, shares, draws, measured, keys, chance)
    case = CASE | {"probe": "control", "method": "domains shuffled, linear probe"}
    table.control(case, np.array(dealt_domains), len(np.unique(both.source)) // 2, both, keys, 0.5, metric="balanced accuracy")
    told = {"answers": len(both), "chance": 0.5, "p": None, "seed_sd": seed_sd(np.array(domains))}
    sources = len(np.unique(both.source))
    case = CASE | {"probe": "linear probe", "method": "simulated or measured", **told}
    table.add(case, "balanced accuracy", exact_interval(float(np.mean(domains)), sources // 2), sources, keys)


def _domains_told(samples: Samples, seed: int) -> float:
    """Balanced accuracy of a linear domain classifier on the half of the stored recordings that it was not trained on."""
    from sklearn.linear_model import LogisticRegression

    order = np.random.default_rng([seed, 0xD0]).permutation(np.unique(samples.source))
    learned = np.isin(samples.source, order[: len(order) // 2])
    train, test = samples.take(learned), samples.take(~learned)
    probe = LogisticRegression(max_iter=5000, class_weight="balanced").fit(train.values, train.label)
    return balanced_share(test.label, probe.predict(test.values))
