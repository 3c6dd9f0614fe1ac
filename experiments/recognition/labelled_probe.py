"""Labelled probe: how much does an encoder trained on simulation alone help if the classes of some measured recordings are known?

A probe classifies each measured revolution by the nearest class centroid of other measured revolutions, among the encoder's embeddings and,
for comparison, among the features. Revolutions of one recording are nearly equal, so "other recordings" leaves out the whole recording.
Controls have shuffled classes and domains. Paper: 95.3 +- 1.5 % with encoder, 89.7 % with raw features, 90.1 % with an adapted RF-Genesis;
at equal distance 95.3 % and 90.3 %. Rows with the layout "as in the paper" have about four objects at each distance and twelve revolutions
a recording (profile.layout_turns).
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from experiments.campaign.campaign import Call
from experiments.campaign.cases import MEASURED, TWIN
from experiments.campaign.frame import Frame, RecordingSource, Wanted
from experiments.cells import Cell
from experiments.draws import Part, Query, numbers
from experiments.framed import Figures, framed
from experiments.recognition import copies, protocol
from experiments.recognition.copies import Copied, with_copies
from experiments.recognition.plots import bars, confusions, grouped, values
from experiments.recognition.protocol import RECORDINGS, Scored, correct, encoders, scaled
from experiments.recognition.readings import MOTION, by_side, revolutions
from experiments.statistics import share
from experiments.verdicts import Claim, Row
from radartwin.config.config import Config
from radartwin.config.simulator import RFGenesisSimulator
from radartwin.recognize.encoder import Encoder, nearest_text
from radartwin.recognize.probes import leave_one_out_centroid, logistic_regression
from radartwin.recognize.samples import Samples, join
from radartwin.recognize.score import uniform_chance
from radartwin.recognize.split import as_domains, label_free, shuffled
from radartwin.recognize.training import fit
from radartwin.runs.experiment import Table

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
LAYOUT = "as in the paper"
REVOLUTIONS, MATCHED = "other revolutions", "other revolutions, same distance"
PROBES = {  # per probe: the paper's accuracy by method, and the paper's gain
    REVOLUTIONS: ({PRETRAINED: "95.3 %", RAW: "89.7 %", RIVAL: "90.1 %"}, "+5.6 points"),
    MATCHED: ({PRETRAINED: "95.3 %", RAW: "90.3 %"}, "+5.0 points"),
    RECORDINGS: ({}, ""),
}
CASE = {"supervision": "few_shot", "setting": "turntable, 12 objects"}


def query(config: Config) -> Query:
    """Return the recordings of the table: also those of RF-Genesis, and those of the testbed in the layout of the paper."""
    more, turns, measured = [Part(TWIN, rf_genesis(config), {"side": RIVAL})], config.profile.layout_turns, config.measured
    if turns and measured.provider == "testbed":
        profile = replace(config.profile, campaign=replace(config.profile.campaign, turns=turns))
        first = replace(config, profile=profile, measured=replace(measured, draw=numbers(config)[0]))
        more.append(Part(MEASURED, first, {"side": LAYOUT}, as_in_paper))
    return Query(config, (MOTION,), several=True, side=PRETRAINED, unknown=True, more=more)


def calls(config: Config) -> list[Call]:
    """Return the simulations of the random targets for every compared simulation (experiments/shared_simulations.py)."""
    return [call for part in query(config).parts if part.domain == TWIN for call in copies.calls(part.config)]


def rf_genesis(config: Config) -> Config:
    """Return the configuration in which RF-Genesis (corrected) simulates the twin."""
    simulator = RFGenesisSimulator(variant=config.simulator.variant, elements=config.simulator.elements, version="corrected")
    return replace(config, simulator=simulator)


def cells(config: Config, copied: Copied, frame: Frame) -> Iterator[Cell]:
    """Declare the cells of every probe and of the controls in one draw."""
    usual = frame[frame.side != LAYOUT]
    measured, sides = scaled(revolutions(usual)), by_side(usual)
    simulated = {method: scaled(copied(config, side)) for method, side in sides.items()}
    trained = {method: encoders(config, label_free(rows, measured)) for method, rows in simulated.items()}
    probes = [probe for probe in PROBES if probe != RECORDINGS or protocol.has_other_recordings(measured)]
    yield from _probed(config, usual, measured, trained, dict.fromkeys(probes, uniform_chance(measured)))
    yield from _controls(config, sides[PRETRAINED], measured, simulated[PRETRAINED])
    layout = frame[(frame.side == LAYOUT) | (frame.domain != MEASURED)]
    if (layout.domain == MEASURED).any():
        truth = scaled(revolutions(layout))
        chances = {REVOLUTIONS: 1 / len(truth.classes), MATCHED: uniform_chance(truth)}
        yield from _probed(config, layout, truth, trained, chances, {"layout": LAYOUT})


def _probed(
    config: Config, of: Frame, truth: Samples, trained: Mapping[str, Sequence[Encoder]], chances: Mapping[str, float],
    layout: Mapping[str, str] | None = None,
) -> Iterator[Cell]:  # fmt: skip
    """Declare the accuracy of every method with each probe of `chances`, and the gain from training on simulation."""
    embedded = {RAW: [truth]} | {method: [encoder.embedded(truth) for encoder in of_seeds] for method, of_seeds in trained.items()}
    for probe, chance in chances.items():
        left_out = {"stratified": True} if probe == MATCHED else {}
        answers = {
            method: [leave_one_out_centroid(space, space.source if probe == RECORDINGS else None, **left_out) for space in spaces]
            for method, spaces in embedded.items()
        }
        hits = {method: correct(of_seeds, truth.label) for method, of_seeds in answers.items()}
        shown = (RAW, PRETRAINED) if probe == list(chances)[-1] and not layout else ()
        panels = {method: (method, truth.label, answers[method][0]) for method in shown}
        figures, gain = PROBES[probe]
        claims = {method: Claim("", paper) for method, paper in figures.items()}
        claims[PRETRAINED] = Claim("measured revolutions are recognised", figures.get(PRETRAINED, ""))
        over_rival = Claim("training on our simulation is more accurate than on RF-Genesis", "+5.2 points" if probe == REVOLUTIONS else "")
        pairs = {(PRETRAINED, RAW): Claim("training on simulation beats the raw features", gain)}
        pairs |= {(PRETRAINED, method): over_rival for method in trained if method != PRETRAINED}
        yield from Scored(config, truth, of, chance).compared(CASE | {"probe": probe, **(layout or {})}, hits, pairs, claims, panels=panels)


def as_in_paper(source: RecordingSource) -> Wanted:
    """Choose measured recordings so that each object stands at one distance, and as many objects as there are distances at a second one."""
    cases = source.cases(MEASURED, motion=MOTION)
    objects, distances = sorted({case.object for case in cases}), sorted({case.distance_m for case in cases})
    count = len(distances)
    places = {(name, distances[k % count]) for k, name in enumerate(objects)}
    places |= {(name, distances[(k + count // 2) % count]) for k, name in enumerate(objects[:count])}
    return [(MEASURED, case) for case in cases if (case.object, case.distance_m) in places and case.repetition == 0]


def _controls(config: Config, of: Frame, measured: Samples, simulated: Samples) -> Iterator[Cell]:
    """Declare the controls with shuffled classes and shuffled domains (both expected at chance), and a linear classifier of the domains."""
    both = as_domains(join(simulated.per_recording(), measured))
    texts, encoder_settings = protocol.anchors(measured.classes), protocol.settings(config)
    predictions, shuffled_domains, domains = [], [], []
    for seed in protocol.seeds(config):
        encoder = fit(label_free(shuffled(simulated, seed), measured), texts, encoder_settings, seed).encoder
        predictions.append(nearest_text(encoder, measured.unlabelled(), texts, encoder_settings.temperature))
        shuffled_domains.append(_domain_accuracy(shuffled(both, seed), seed))
        domains.append(_domain_accuracy(both, seed))
    shares = correct(predictions, measured.label).mean(axis=1)
    case = CASE | {"probe": "control", "method": "simulated labels shuffled, nearest text"}
    yield Scored(config, measured, of, uniform_chance(measured)).control(case, shares)
    case = CASE | {"probe": "control", "method": "domains shuffled, linear probe"}
    yield Scored(config, both, of, 0.5).control(case, np.array(shuffled_domains), "balanced accuracy")
    case = (
        CASE | {"probe": "linear probe", "method": "simulated or measured"} | protocol.statistics_columns(len(both), 0.5, np.array(domains))
    )
    sources = protocol.count_sources(both)
    estimate = share(float(np.sum(domains)) / len(domains) * (sources // 2), sources // 2)
    yield Cell(case, "balanced accuracy", of, estimate, count=sources)


def _domain_accuracy(samples: Samples, seed: int) -> float:
    """Return the balanced accuracy of a linear classifier of the domains, trained on half of the recordings, on the other half."""
    from sklearn.metrics import balanced_accuracy_score

    order = np.random.default_rng([seed, 0xD0]).permutation(np.unique(samples.source))
    learned = np.isin(samples.source, order[: len(order) // 2])
    train, test = samples.take(learned), samples.take(~learned)
    return balanced_accuracy_score(test.label, logistic_regression().fit(train.values, train.label).predict(test.values))


def _groups(rows: list[Row]) -> dict[str, dict[str, Any]]:
    return grouped([row for row in rows if row["probe"] in PROBES and not row.get("layout")], "probe")


def _figures(rows: list[Row], first: Frame) -> Figures:
    groups = {probe.replace(", ", ",\n"): of for probe, of in _groups(rows).items()}
    return {TABLE.name: lambda: bars(groups, "accuracy", grey=RAW), f"{TABLE.name}_confusion": lambda: confusions(rows)}


run, recordings, score = framed(TABLE, query, cells, _figures, lambda rows: values(_groups(rows)), source=with_copies)
