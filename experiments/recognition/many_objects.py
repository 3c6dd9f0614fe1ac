"""Many objects: what does training on simulation gain, if there are enough objects to decide it?

The objects of the assortment (radartwin.scene.objects.assortment) turn without a room, which does not change the features of a turntable.
Raw features, and embeddings of encoders trained on simulation alone, classify every measured revolution by the nearest centroid of its
class: without labels that of the simulated copies, with k labels that of k measured revolutions, and then only recordings of other
distances are classified. The primary endpoint is the mean gain over 1, 2 and 4 labels. All trainings use the measured noise of the first
draw, so that all draws share them. The objects are a sample of everyday objects, so tests exchange the methods, or the classes, of whole
objects.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from experiments import statistics
from experiments.campaign.campaign import Call
from experiments.campaign.cases import MEASURED
from experiments.campaign.frame import Frame, by_revolution, features
from experiments.campaign.schedule import RecordingTask
from experiments.cells import Cell, Estimator, first_draw, keys, mean, per, table_rows
from experiments.interface import Config, Progress, Result, Store, Table
from experiments.recognition import labelled_probe, protocol
from experiments.recognition.copies import with_copies
from experiments.recognition.encoder_comparison import few_shot_hits
from experiments.recognition.labelled_probe import PRETRAINED, RAW, RIVAL
from experiments.recognition.plots import grouped, label_curve
from experiments.recognition.protocol import GEOMETRY, LEAST_GAIN, MATERIAL, SAME_MODELS, scaled
from experiments.recognition.readings import by_side, recording_name
from experiments.recognition.transfer import ranked
from experiments.statistics import SHARE, SIGNED, Estimate
from experiments.verdicts import NONE, Claim
from radartwin.config.materials import VoidMaterials
from radartwin.errors import ConfigError
from radartwin.recognize.encoder import Encoder
from radartwin.recognize.probes import nearest_centroid, transferred_probe
from radartwin.recognize.samples import Samples
from radartwin.recognize.score import majority_share
from radartwin.recognize.split import label_free
from radartwin.scene.objects.assortment import assortment

TABLE = Table(
    name="many_objects",
    title="Many objects",
    caption="Objects of the assortment on a turntable without a room. Measured revolutions are classified by the nearest class centroid "
    "of k labelled measured revolutions, and without labels by that of simulated revolutions, in the space of the raw features and of "
    "encoders trained on simulation alone. RF-Genesis is the corrected re-implementation. 'Model of another object' trains on the model "
    "of another object of the same kind. Saved labels are the labels that raw features need in addition for the same accuracy, at most 4 "
    "in all. n counts measured recordings. Tests exchange the methods or classes of whole objects, pooled over draws.",
)

OTHER = "model of another object of its kind"
SHOTS = (0, 1, 2, 4)
PAIRS = {  # (method, method that it is compared with): claim about the mean gain over 1, 2 and 4 labels
    (PRETRAINED, RAW): Claim("training on simulation beats the raw features", "+5.6 points", bound=LEAST_GAIN, null=0.0),
    (PRETRAINED, RIVAL): Claim("training on our simulation is more accurate than on RF-Genesis", "+5.2 points", bound=LEAST_GAIN, null=0.0),
    (OTHER, RAW): Claim("training on the model of another object beats the raw features", bound=LEAST_GAIN, null=0.0),
    (PRETRAINED, OTHER): NONE,
}
ATTRIBUTES = {"geometry": (GEOMETRY, "0.72"), "material": (MATERIAL, "0.72")}
Copies = Mapping[str, Samples]  # scaled features of simulated copies by method


def run(config: Config, store: Store, progress: Progress) -> Result:
    table_config = of_assortment(config)
    frame, copied = with_copies(labelled_probe.query(table_config), store, progress)
    return score(table_config, frame, {method: scaled(copied(table_config, side)) for method, side in by_side(first_draw(frame)).items()})


def recordings(config: Config, store: Store, progress: Progress) -> dict[str, RecordingTask]:
    return labelled_probe.recordings(of_assortment(config), store, progress)


def calls(config: Config) -> list[Call]:
    return labelled_probe.calls(of_assortment(config))


def of_assortment(config: Config) -> Config:
    """Return the configuration in which the assortment turns without room, equipment or person. Raises ConfigError for real recordings."""
    if config.measured.provider != "testbed":
        raise ConfigError("many_objects has its own set of objects, which a recording set lacks; use measured=testbed")
    profile = config.profile
    objects = [entry.name for kind in assortment().values() for entry in kind[: profile.objects_campaign.per_kind]]
    gap = replace(config.measured.gap, person=0.0, clutter=0.0)
    campaign = replace(profile.objects_campaign, turntable_objects=objects)
    profile = replace(profile, campaign=campaign, unknown_contents=False, layout_turns=0)
    return replace(config, materials=VoidMaterials(), measured=replace(config.measured, gap=gap), profile=profile)


def score(config: Config, frame: Frame, copies: Copies) -> Result:
    """Build the table from the frame of readings and the copies by the methods PRETRAINED and RIVAL."""
    measured = by_revolution(frame[frame.domain == MEASURED])
    copies = {**copies, OTHER: copies[PRETRAINED].relabelled(another_of_its_kind(copies[PRETRAINED].classes))}
    of_first_draw = samples(measured[measured.draw == measured.draw.iloc[0]])
    trained = {method: protocol.encoders(config, label_free(rows, of_first_draw)) for method, rows in copies.items()}
    on_ranks = protocol.encoders(config, label_free(ranked(copies[PRETRAINED]), ranked(of_first_draw)))
    answers = pd.concat([_answered(config, rows, copies, trained, on_ranks) for _, rows in measured.groupby("draw")], ignore_index=True)
    rows = table_rows(config, answers, partial(cells, config))
    accuracies = [row for row in rows if row["metric"] == "accuracy" and not row.get("attribute")]
    curve = grouped(accuracies, "method", "labels per class")
    metrics = {
        f"gain_over_{row['method'].partition(' - ')[2].partition(' (')[0].replace(' ', '_')}": row["value"]
        for row in rows
        if row["labels per class"] == "1, 2 and 4" and row["method"].startswith(PRETRAINED)
    }
    return Result(TABLE.name, rows, {TABLE.name: lambda: label_curve(curve, 1 / len(of_first_draw.classes))}, metrics, keys(frame))


def another_of_its_kind(objects: Sequence[str]) -> dict[str, str]:
    """Return for each object the next of these objects of its kind; the last has the first."""
    kinds = [[entry.name for entry in kind if entry.name in objects] for kind in assortment().values()]
    return {name: kind[(place + 1) % len(kind)] for kind in kinds for place, name in enumerate(kind)}


def samples(revolutions: Frame) -> Samples:
    """Return the rows of measured revolutions as samples with the object as label."""
    names, source, name = features(revolutions), revolutions.key.to_numpy(str), revolutions.object.to_numpy(str)
    revolution = revolutions.groupby("key").cumcount().to_numpy()
    recordings = (recording_name(MEASURED, row) for row in revolutions.itertuples())
    recording = np.array([f"{prefix} turn {number:02d}" for prefix, number in zip(recordings, revolution, strict=True)])
    stratum, domain = np.array([f"{distance:g} m" for distance in revolutions.distance_m]), np.full(len(source), MEASURED)
    return Samples(tuple(names), revolutions[names].to_numpy(float), recording, stratum, domain, source, name, name)


def _answered(
    config: Config, revolutions: Frame, copies: Copies, trained: Mapping[str, Sequence[Encoder]], on_ranks: Sequence[Encoder]
) -> Frame:
    """Return the revolutions of one draw with columns `METHOD, k` (share of the trainings that recognise the object; NaN if not classified)
    and a column for each attribute (the class that each training predicts).
    """
    plain = samples(revolutions)
    truth, draw, columns = scaled(plain), int(revolutions.draw.iloc[0]), {}
    spaces = {RAW: [(copies[PRETRAINED], truth)]}
    spaces |= {
        method: [(encoder.embedded(copies[method]), encoder.embedded(truth)) for encoder in of_seeds]
        for method, of_seeds in trained.items()
    }
    hits = {f"{method}, 0": np.array([nearest_centroid(*pair) == truth.label for pair in pairs], float) for method, pairs in spaces.items()}
    for shots in SHOTS[1:]:
        few_shot = few_shot_hits(config, {method: [rows for _, rows in pairs] for method, pairs in spaces.items()}, truth, shots, draw)
        hits |= {f"{method}, {shots}": method_hits for method, method_hits in few_shot.items()}
    for name, method_hits in hits.items():
        count = (~np.isnan(method_hits)).sum(axis=0)
        columns[name] = np.nansum(method_hits, axis=0) / np.where(count > 0, count, np.nan)
    for attribute, (classes, _) in ATTRIBUTES.items():
        pairs = [[encoder.embedded(ranked(rows).relabelled(classes)) for rows in (copies[PRETRAINED], plain)] for encoder in on_ranks]
        columns[attribute] = list(np.stack([transferred_probe(label_free(*pair)) for pair in pairs], axis=1))
    return revolutions.assign(**columns)


def cells(config: Config, frame: Frame) -> Iterator[Cell]:
    """Declare the accuracy of each method, its gains and the saved labels, and the accuracy of the attributes without labels."""
    chance = 1 / frame.object.nunique()
    stays = protocol.at_chance("identity stays at chance", "does not transfer", chance)
    identity = {PRETRAINED: replace(stays, untestable=SAME_MODELS), OTHER: stays}
    for shots in SHOTS:
        at = {"labels per class": shots, "chance": chance}
        for method in (RAW, PRETRAINED, RIVAL, OTHER):
            claim = identity.get(method, NONE) if not shots else NONE
            yield Cell({**at, "method": method}, "accuracy", frame, mean(per(f"{method}, {shots}"), SHARE), claim)
    for (first, second), claim in PAIRS.items():
        for label, counts in (*((shots, (shots,)) for shots in SHOTS), ("1, 2 and 4", SHOTS[1:])):
            case = {"labels per class": label, "method": f"{first} - {second}"}
            yield Cell(case, "gain in accuracy", frame, _gain(first, second, counts), claim if len(counts) > 1 else NONE)
    for shots in SHOTS[:2]:
        yield Cell({"labels per class": shots, "method": PRETRAINED}, "saved labels per class", frame, _saved(shots))
    measured = samples(frame[[column for column in frame if not str(column).startswith((RAW, PRETRAINED, RIVAL, OTHER))]])
    for attribute, (classes, paper) in ATTRIBUTES.items():
        truth = measured.relabelled(classes)
        estimate = protocol.permuted_accuracy(list(np.stack(list(frame[attribute])).T), truth, config.seed)
        majority = majority_share(truth)
        claim = Claim(f"{attribute} transfers: above the majority", paper, bound=majority, null=float(np.mean(estimate.shuffled)))  # type: ignore[arg-type]
        yield Cell(
            {"labels per class": 0, "attribute": attribute, "method": PRETRAINED, "chance": majority}, "accuracy", frame, estimate, claim
        )


def _gain(first: str, second: str, shots: Sequence[int]) -> Estimator:
    """Estimate the accuracy of a method less that of another, averaged over numbers of labels, with the test that swaps the methods."""

    def gains(rows: Frame) -> NDArray[np.float64]:
        of_first, of_second = (per([f"{method}, {k}" for k in shots])(rows).to_numpy().mean(axis=1) for method in (first, second))
        return of_first - of_second

    return lambda rows, resamples, seed: statistics.sign_flipped(gains(rows), seed, SIGNED)


def _saved(shots: int) -> Estimator:
    """Estimate how many labels more the raw features need for the accuracy of the trained encoder with `shots` labels."""
    limits = (float(-shots), float(SHOTS[-1] - shots))

    def saved(accuracies: NDArray) -> float:
        return float(np.interp(accuracies[0], np.maximum.accumulate(accuracies[1:]), SHOTS)) - shots

    def estimate(rows: Frame, resamples: int, seed: int) -> Estimate:
        values = per([f"{PRETRAINED}, {shots}", *(f"{RAW}, {k}" for k in SHOTS)])(rows).to_numpy()
        index = np.random.default_rng(seed).integers(len(values), size=(resamples, len(values)))
        return statistics.resampled(saved(values.mean(axis=0)), [saved(values[drawn].mean(axis=0)) for drawn in index], len(values), limits)

    return estimate
