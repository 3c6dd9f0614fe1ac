"""Labelled probe: how much does an encoder trained on simulation alone help if the classes of some measured recordings are known?

A probe classifies each measured turntable revolution by the nearest class centroid of other measured revolutions, in the space of the
encoder's embeddings. For comparison, the same probe also classifies the features without the encoder. The difference shows how much the
training of the encoder helps. Turntable revolutions of the same recording are nearly equal. The "other recordings" probe therefore leaves
out all revolutions of the recording that is classified, so the remaining revolutions of the same object are at other distances. Paper
(recognition with simulation-trained representations): 95.3 +- 1.5 % with encoder, 89.7 % with raw features and 90.1 % with an adapted
RF-Genesis; at equal distance 95.3 % with encoder and 90.3 % with raw features. This table adds controls with shuffled class labels and
shuffled domains, which the paper does not have. The table encoder_comparison has other learners and the accuracy with few labels.

In the paper, about four objects stand at each distance and a recording has about twelve revolutions (chance at equal distance 24.8 %). The
rows with the layout "as in the paper" use recordings with these numbers, from one draw of the testbed (profile.layout_turns). In all other
rows, every object is recorded at every distance.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from experiments import draws
from experiments.campaign.campaign import Call, Campaign, joined
from experiments.campaign.cases import MEASURED, TWIN, Case
from experiments.campaign.schedule import RecordingTask
from experiments.campaign.source import RecordingSource
from experiments.claims import Claim
from experiments.recognition import copies
from experiments.recognition.figures import bars, confusions
from experiments.recognition.protocol import (
    RecognitionRows,
    anchors,
    correct,
    count_sources,
    encoders,
    has_other_recordings,
    scaled,
    seeds,
    settings,
    statistics_columns,
)  # fmt: skip
from experiments.recognition.readings import FEATURES, MOTION, paired, shared_cases, vectors
from experiments.statistics import share
from radartwin.config.config import Config
from radartwin.config.simulator import RFGenesisSimulator
from radartwin.io.progress import Progress
from radartwin.recognize.encoder import Encoder, nearest_text
from radartwin.recognize.probes import leave_one_out_centroid, logistic_regression
from radartwin.recognize.samples import Samples, join
from radartwin.recognize.score import uniform_chance
from radartwin.recognize.split import as_domains, label_free, shuffled
from radartwin.recognize.training import fit
from radartwin.runs.experiment import Result, Table
from radartwin.store.products import Store

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TABLE = Table(
    name="labelled_probe",
    title="Gain by training on simulation",
    caption="An encoder is trained on randomised copies of simulated revolutions and frozen. Measured revolutions are classified by the "
    "nearest class centroid of other revolutions. For 'other recordings', the other revolutions are at other distances, so that no "
    "part of a recording classifies another part of it. RF-Genesis is the corrected re-implementation. The testbed uses the same "
    "physics as our tracer, so the comparison favours our tracer. n counts recordings; the column answers counts revolutions. "
    "Intervals are bootstraps over objects. Rows with an entry in the column 'twin' belong to a simulation that "
    "knows only the surface of vessels (paper profile). Rows with the layout 'as in the paper' have four objects at each distance and "
    "twelve revolutions in a recording, of one draw (paper profile).",
)

RIVAL = "RF-Genesis (corrected)"
PRETRAINED, RAW = "trained on simulation", "raw features"
REVOLUTIONS, RECORDINGS, MATCHED = "other revolutions", "other recordings", "other revolutions, same distance"
PROBES = {  # per probe: the paper's accuracy by method, and the paper's gain
    REVOLUTIONS: ({PRETRAINED: "95.3 %", RAW: "89.7 %", RIVAL: "90.1 %"}, "+5.6 points"),
    MATCHED: ({PRETRAINED: "95.3 %", RAW: "90.3 %"}, "+5.0 points"),
    RECORDINGS: ({}, ""),
}
CASE = {"supervision": "few_shot", "setting": "turntable, 12 objects"}


@dataclass(frozen=True, eq=False)
class Data:
    """Features of measured revolutions, and of copies of simulated revolutions by method.

    `keys` holds the store keys of the recordings by method. Measured rows and the rows of each method are standardised separately by their
    own mean and standard deviation.
    """

    measured: Samples
    copies: Mapping[str, Samples]
    keys: Mapping[str, tuple[str, ...]]

    def keys_of(self, method: str) -> tuple[str, ...]:
        """Return the store keys of the measured recordings and of the simulated recordings on which the method was trained, if there are
        any.
        """
        return (*self.keys["measured"], *self.keys.get(method, ()))


def run(config: Config, store: Store, progress: Progress) -> Result:
    """Compute the table for the configured campaign, and for the same campaign simulated by RF-Genesis as a comparison."""

    def scored(own: Config) -> Result:
        rivals = {RIVAL: Campaign(rf_genesis(own), store, progress)} if own is config else {}
        first, layout = draws.numbers(own)[0], _layout_campaign(own, store, progress)

        def of_draw(campaign: Campaign) -> Result:
            return score(own, campaign, store, progress, rivals, layout if campaign.draw == first else None)

        return draws.scored(own, store, progress, of_draw)

    return draws.beside_unknown(config, scored)


def recordings(config: Config, store: Store, progress: Progress) -> dict[str, RecordingTask]:
    own = [config, *draws.unknown_contents(config)]
    found = [draws.recordings(own, lambda campaign: paired(campaign, MOTION), store, progress)]
    found.append(draws.recordings([rf_genesis(config)], simulated, store, progress))
    if layout := _layout_campaign(config, store, progress):
        found.append(layout.missing([(MEASURED, case) for case in as_in_paper(layout.cases(MEASURED, motion=MOTION))]))
    return joined(found)


def simulated(campaign: Campaign) -> list[tuple[str, Case]]:
    """Return the simulated recordings that the copies need, as (domain, case) pairs."""
    return [(TWIN, case) for case in shared_cases(campaign, MOTION)[1]]


def calls(config: Config) -> list[Call]:
    """Return the simulations of the random targets for every compared simulation (experiments/together.py)."""
    return [call for one in (config, *draws.unknown_contents(config), rf_genesis(config)) for call in copies.calls(one)]


def rf_genesis(config: Config) -> Config:
    """Return the configuration in which RF-Genesis (corrected) simulates the twin."""
    simulator = RFGenesisSimulator(variant=config.simulator.variant, elements=config.simulator.elements, version="corrected")
    return replace(config, simulator=simulator)


def _layout_campaign(config: Config, store: Store, progress: Progress) -> Campaign | None:
    """Return the campaign with as many revolutions in a recording as in the paper, or None if the table has no rows of this layout.

    There are no such rows if the profile has no `layout_turns`, or if the measurements come from a recording set.
    """
    turns = config.profile.layout_turns
    if not turns or config.measured.provider != "testbed":
        return None
    profile = replace(config.profile, campaign=replace(config.profile.campaign, turns=turns))
    return Campaign(replace(config, profile=profile), store, progress, draws.numbers(config)[0])


def score(
    config: Config, source: RecordingSource, store: Store, progress: Progress, rivals: Mapping[str, RecordingSource] | None = None,
    layout: RecordingSource | None = None,
) -> Result:  # fmt: skip
    """Build the rows of every probe and of the controls.

    Args:
        rivals: the campaigns that other simulators simulated, by name.
        layout: the campaign from which the recordings in the layout of the paper are taken; None leaves out the rows of this layout.
    """
    data = gather_data(config, source, store, progress, rivals or {})
    measured = data.measured
    rows = RecognitionRows(config)
    chance = uniform_chance(measured)
    trained = {method: encoders(config, label_free(simulated, measured)) for method, simulated in data.copies.items()}
    embedded = {RAW: [measured]} | {method: [encoder.embedded(measured) for encoder in some] for method, some in trained.items()}
    probes = _usable_probes(measured, progress)
    predictions = {(method, probe): [_predict(samples, probe) for samples in some] for probe in probes for method, some in embedded.items()}
    hits = {key: correct(found, measured.label) for key, found in predictions.items()}
    shown = {}
    for probe in probes:
        shown[probe.replace(", ", ",\n")] = _add_probe(rows, data, probe, {method: hits[method, probe] for method in embedded}, chance)
    last = list(probes)[-1]
    panels = {method: (measured.label, predictions[method, last][0]) for method in (RAW, PRETRAINED)}
    figures: dict[str, Callable[[], Figure]] = {
        "labelled_probe": lambda: bars(shown, "accuracy", grey=RAW),
        "labelled_probe_confusion": lambda: confusions(panels, measured.classes),
    }
    _add_controls(rows, data, chance)
    used = {key for found in data.keys.values() for key in found}
    if layout is not None:
        used |= set(_add_layout(rows, data, trained, layout, progress))
    metrics = {
        f"accuracy_{name}_{probe.replace(', ', '_').replace(' ', '_')}": float(hits[method, probe].mean())
        for name, method in (("pretrained", PRETRAINED), ("raw", RAW)) for probe in probes
    } | {"chance": chance}  # fmt: skip
    return Result("labelled_probe", rows, figures, metrics, sorted(used))


def _add_probe(
    rows: RecognitionRows, data: Data, probe: str, hits: Mapping[str, NDArray], chance: float, layout: Mapping[str, str] | None = None
) -> dict[str, Mapping[str, Any]]:
    """Add the accuracy of every method, and the accuracy gain from training on simulation. Returns a dictionary {method: table row
    with the accuracy}. `layout` holds further columns of the rows.
    """
    figures, gain = PROBES[probe]
    case, shown = CASE | {"probe": probe, **(layout or {})}, {}
    for method, found in hits.items():
        claim = Claim("measured revolutions are recognised" if method == PRETRAINED else "", figures.get(method, ""))
        shown[method] = rows.share(case | {"method": method}, found, data.measured, data.keys_of(method), chance, claim)
    claims = {RAW: Claim("training on simulation beats the raw features", gain)}
    claims |= {
        method: Claim("training on our simulation is more accurate than on RF-Genesis", "+5.2 points" if probe == REVOLUTIONS else "")
        for method in data.copies if method != PRETRAINED
    }  # fmt: skip
    for method, claim in claims.items():
        keys = sorted({*data.keys_of(PRETRAINED), *data.keys_of(method)})
        rows.gain(case | {"method": f"{PRETRAINED} - {method}"}, hits[PRETRAINED], hits[method], data.measured, keys, claim)
    return shown


def _add_layout(
    rows: RecognitionRows, data: Data, trained: Mapping[str, Sequence[Encoder]], source: RecordingSource, progress: Progress
) -> tuple[str, ...]:
    """Add the probes on recordings in the layout of the paper, with the encoders `trained` of each method. Returns the store keys of these
    recordings.
    """
    cases = as_in_paper(source.cases("measured", motion=MOTION))
    progress.say(f"{len(cases)} measured {MOTION} recordings in the layout of the paper")
    found = vectors(source, "measured", cases, FEATURES)
    measured = scaled(found.samples)
    own = replace(data, measured=measured, keys={**data.keys, "measured": found.keys})
    embedded = {RAW: [measured]} | {method: [encoder.embedded(measured) for encoder in some] for method, some in trained.items()}
    for probe, chance in ((REVOLUTIONS, 1 / len(measured.classes)), (MATCHED, uniform_chance(measured))):
        hits = {method: correct([_predict(one, probe) for one in some], measured.label) for method, some in embedded.items()}
        _add_probe(rows, own, probe, hits, chance, {"layout": "as in the paper"})
    return found.keys


def as_in_paper(cases: Sequence[Case]) -> list[Case]:
    """Choose cases so that each object stands at one distance, and some objects also at a second distance.

    The number of objects with a second distance equals the number of distances. Twelve objects and four distances give four objects at each
    distance.
    """
    objects, distances = sorted({case.object for case in cases}), sorted({case.distance_m for case in cases})
    count = len(distances)
    places = {(name, distances[k % count]) for k, name in enumerate(objects)}
    places |= {(name, distances[(k + count // 2) % count]) for k, name in enumerate(objects[:count])}
    return [case for case in cases if (case.object, case.distance_m) in places and case.repetition == 0]


def _usable_probes(measured: Samples, progress: Progress) -> list[str]:
    """Return the names of all probes, but without the probe RECORDINGS if an object has only one recording."""
    if has_other_recordings(measured):
        return list(PROBES)
    progress.say("some objects have a single recording, so the probe on other recordings is left out")
    return [probe for probe in PROBES if probe != RECORDINGS]


def _predict(samples: Samples, probe: str) -> NDArray[np.str_]:
    return leave_one_out_centroid(samples, samples.source if probe == RECORDINGS else None, stratified=probe == MATCHED)


def gather_data(config: Config, source: RecordingSource, store: Store, progress: Progress, rivals: Mapping[str, RecordingSource]) -> Data:
    """Return the measured revolutions, and copies of simulated recordings: those of RadarTwin and those of each other simulator in
    `rivals`.
    """
    cases, twins = shared_cases(source, MOTION)
    progress.say(f"{len(cases)} measured {MOTION} recordings")
    measured = vectors(source, "measured", cases, FEATURES)
    rows = {}
    for method, simulated in {PRETRAINED: source, **rivals}.items():
        progress.say(f"{len(twins)} simulated revolutions, {config.supervision.copies} copies of each: {method}")
        rows[method] = copies.rows_of_copies(config, store, simulated, twins, cases, measured_source=source)["features"]
    keys = {"measured": measured.keys, **{method: readings.keys for method, readings in rows.items()}}
    return Data(scaled(measured.samples), {method: scaled(readings.samples) for method, readings in rows.items()}, keys)


def _add_controls(rows: RecognitionRows, data: Data, chance: float) -> None:
    """Add the controls: shuffled class labels and shuffled domains, both expected at chance, and a linear classifier of the true
    domains.
    """
    measured, simulated, keys = data.measured, data.copies[PRETRAINED], data.keys_of(PRETRAINED)
    both = as_domains(join(simulated.per_recording(), measured))
    texts, chosen = anchors(measured.classes), settings(rows.config)
    predictions, shuffled_domains, domains = [], [], []
    for seed in seeds(rows.config):
        encoder = fit(label_free(shuffled(simulated, seed), measured), texts, chosen, seed).encoder
        predictions.append(nearest_text(encoder, measured.unlabelled(), texts, chosen.temperature))
        shuffled_domains.append(_domain_accuracy(shuffled(both, seed), seed))
        domains.append(_domain_accuracy(both, seed))
    shares = correct(predictions, measured.label).mean(axis=1)
    case = CASE | {"probe": "control", "method": "simulated labels shuffled, nearest text"}
    rows.control(case, shares, measured, keys, chance)
    case = CASE | {"probe": "control", "method": "domains shuffled, linear probe"}
    rows.control(case, np.array(shuffled_domains), both, keys, 0.5, metric="balanced accuracy")
    case = CASE | {"probe": "linear probe", "method": "simulated or measured"} | statistics_columns(len(both), 0.5, np.array(domains))
    sources = count_sources(both)
    rows.add(case, "balanced accuracy", share(float(np.sum(domains)) / len(domains) * (sources // 2), sources // 2), keys, count=sources)


def _domain_accuracy(samples: Samples, seed: int) -> float:
    """Train a linear classifier that separates measured from simulated rows, on half of the recordings.

    Returns the balanced accuracy of the classifier on the recordings that were not used for training.
    """
    from sklearn.metrics import balanced_accuracy_score

    order = np.random.default_rng([seed, 0xD0]).permutation(np.unique(samples.source))
    learned = np.isin(samples.source, order[: len(order) // 2])
    train, test = samples.take(learned), samples.take(~learned)
    return balanced_accuracy_score(test.label, logistic_regression().fit(train.values, train.label).predict(test.values))
