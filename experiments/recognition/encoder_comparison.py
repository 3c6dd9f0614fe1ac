"""Encoder comparison: which learner is most accurate after training on simulation, without labels and with a few labelled measured
revolutions?

All learners are trained on the same copies of simulated turntable revolutions, and classify the same measured revolutions. The two-layer
network of the paper and gradient-boosted trees read the rotation features. The convolutional network reads pictures of a revolution. The
two-layer network is trained towards two kinds of texts: how an object's echo varies over a revolution (as in the paper), and its looks.

Without labelled measured revolutions, the class that a learner predicts is the result. With k labelled measured revolutions per class, the
predicted class is that whose labelled revolutions have the nearest centroid in the embedding of the learner. Two further networks use the
labels in their training: one network is trained on the labelled revolutions alone, and the other network on these revolutions and the
simulation. Labelled revolutions come from one half of each object's recordings, and the other half is scored. The largest k depends on the
number of revolutions of a recording (profile.campaign.turns). The probe "other recordings" uses the labels of all recordings except the one
that it classifies. The other recordings of the same object are at other distances.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from experiments import draws
from experiments.campaign.source import RecordingSource
from experiments.claims import Claim
from experiments.recognition.copies import rows_of_copies
from experiments.recognition.figures import bars, label_curve
from experiments.recognition.protocol import (
    ECHOES,
    LOOKS,
    RecognitionRows,
    anchors,
    correct,
    has_other_recordings,
    scaled,
    seeds,
    settings,
)  # fmt: skip
from experiments.recognition.readings import FEATURES, MOTION, pictures, shared_cases, vectors
from radartwin import plugins
from radartwin.config.config import Config
from radartwin.config.plugged import code_of
from radartwin.io.progress import Progress
from radartwin.recognize.learners import LEARNERS, Fitted, learner
from radartwin.recognize.learners.interface import Reads
from radartwin.recognize.probes import leave_one_out_centroid, nearest_centroid
from radartwin.recognize.samples import Samples, join
from radartwin.recognize.score import uniform_chance
from radartwin.recognize.split import Split, draw_shots, label_free, most_shots
from radartwin.runs.experiment import Result, Table
from radartwin.store.products import Store

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TABLE = Table(
    name="encoder_comparison",
    title="Learners side by side",
    caption="Each learner is trained on copies of simulated revolutions alone and classifies measured revolutions: without "
    "labels, by the nearest class centroid of k labelled measured revolutions, and by that of all other recordings. 'trained on the "
    "labels alone' and 'trained on simulation and labels' are two-layer networks whose "
    "training uses the labels. n counts recordings. Intervals are bootstraps over draws and "
    "objects.",
)

SHOTS = (0, 1, 2, 4, 8, 14, 20)
NETWORK, OF_LOOKS, CONVOLUTION, TREES = "two-layer network", "two-layer network, texts of looks", "convolutional network", "boosted trees"
METHODS = {  # method: (learner, kind of text)
    NETWORK: ("network", ECHOES), OF_LOOKS: ("network", LOOKS), CONVOLUTION: ("convolution", ECHOES), TREES: ("trees", ECHOES),
}  # fmt: skip
RAW, SCRATCH, JOINT = "raw features", "trained on the labels alone", "trained on simulation and labels"
LABELLED_SHARE = 0.2  # share of (repeated) labelled measured rows in the training of JOINT; recognition_choices.json has the reason
RECORDINGS = "other recordings"
LABEL_STEP = 1000  # each draw adds this step to the seeds of its label sets; it exceeds the number of trainings
Embedded = Mapping[str, Sequence[Samples]]  # by method: the embeddings of the measured rows for each seed


def methods() -> dict[str, tuple[str, str]]:
    """Return METHODS, and one method for each learner of other packages (entry points of the group `radartwin.encoders`)."""
    return METHODS | {name: (name, ECHOES) for name in plugins.names(plugins.ENCODERS)}


def identity() -> dict[str, Any]:
    """Return additions to the run key: the source code of the learners of other packages."""
    found = {name: plugins.find(plugins.ENCODERS, name, LEARNERS) for name in plugins.names(plugins.ENCODERS)}
    code = {name: code_of(plugin) for name, plugin in found.items() if plugin is not None}
    return {"encoders": code} if code else {}


def run(config: Config, store: Store, progress: Progress) -> Result:
    return draws.scored(config, store, progress, lambda campaign: score(config, campaign, store, progress))


def score(config: Config, source: RecordingSource, store: Store, progress: Progress) -> Result:
    """Build the rows of every learner."""
    rows = RecognitionRows(config)
    measured, copies, keys = gather_rows(config, source, store, progress)
    for of in (measured, copies):
        of["features"] = scaled(of["features"])  # pictures have levels from 0 to 1
    fitted: dict[str, list[Fitted]] = {}
    reads: dict[str, Reads] = {method: learner(kind).reads for method, (kind, _) in methods().items()}
    for method in progress.over(list(reads), "learners"):
        fitted[method] = fit_method(config, method, copies, measured)
    truth = measured["features"]
    chance = uniform_chance(truth)
    curve: dict[str, list[Mapping[str, Any]]] = {method: [] for method in (*reads, RAW, SCRATCH, JOINT)}
    for method, some in fitted.items():
        predicted = [one.predict(measured[reads[method]].unlabelled()) for one in some]
        claim = Claim("measured revolutions are recognised without labels") if method == NETWORK else Claim()
        case = {"supervision": "label_free", "labels per class": 0, "method": method}
        curve[method].append(rows.share(case, correct(predicted, truth.label), truth, keys, chance, claim) | {"shots": 0})
    embedded = {method: [one.embedded(measured[reads[method]]) for one in some] for method, some in fitted.items()} | {
        RAW: [truth] * len(seeds(config))
    }
    draw = source.cases("measured", motion=MOTION)[0].draw
    _add_shots(rows, embedded, copies["features"], truth, draw, keys, chance, curve)
    _add_other_recordings(rows, embedded, truth, keys, chance)
    figures: dict[str, Callable[[], Figure]] = {
        "encoder_comparison": lambda: bars({"no labels": {m: curve[m][0] for m in reads}}, "accuracy", grey=TREES),
        "label_efficiency": lambda: label_curve({method: some for method, some in curve.items() if some}, chance),
    }
    metrics = {f"accuracy_{method.replace(', ', '_').replace(' ', '_')}": float(curve[method][0]["value"]) for method in reads}
    return Result(TABLE.name, rows, figures, metrics | {"chance": chance}, keys)


def fit_method(config: Config, method: str, copies: Mapping[Reads, Samples], measured: Mapping[Reads, Samples]) -> list[Fitted]:
    """Train the learner of a method on scaled rows of copies, once for each seed. Boosted trees use no random numbers, so they are trained
    once.
    """
    kind, text = methods()[method]
    chosen = learner(kind)
    split, texts = label_free(copies[chosen.reads], measured[chosen.reads]), anchors(measured["features"].classes, text)
    return [chosen.fit(split, texts, settings(config), seed) for seed in (seeds(config)[:1] if kind == "trees" else seeds(config))]


def fit_with_labels(
    config: Config, simulated: Samples | None, known: Samples, rest: Samples, seed: int, share: float = LABELLED_SHARE
) -> Fitted:
    """Train the two-layer network on labelled measured rows, and on simulated rows if there are any.

    The labelled rows are repeated so that they are about `share` of the training rows.
    """
    train, shots = known, len(known) // len(known.classes)
    if simulated is not None:
        times = max(1, round(share / (1 - share) * len(simulated) / len(known)))
        train = join(simulated, known.take(np.repeat(np.arange(len(known)), times)))
    return LEARNERS["network"].fit(Split("few_shot", train, rest, shots), anchors(known.classes), settings(config), seed)


def gather_rows(
    config: Config, source: RecordingSource, store: Store, progress: Progress
) -> tuple[dict[Reads, Samples], dict[Reads, Samples], list[str]]:
    """Return (measured rows, rows of copies, store keys). Both dictionaries have an entry for each kind of rows that a learner reads. The
    rows are not scaled.
    """
    cases, twins = shared_cases(source, MOTION)
    progress.say(f"{len(twins)} simulated revolutions, {config.supervision.copies} copies of each")
    vector, picture = vectors(source, "measured", cases, FEATURES), pictures(source, "measured", cases)
    copies = rows_of_copies(config, store, source, twins, cases)
    keys = sorted({*vector.keys, *copies["features"].keys})
    return {"features": vector.samples, "pictures": picture.samples}, {kind: found.samples for kind, found in copies.items()}, keys


def _add_shots(
    rows: RecognitionRows,
    embedded: Embedded,
    simulated: Samples,
    truth: Samples,
    draw: int,
    keys: Sequence[str],
    chance: float,
    curve: Mapping[str, list],
) -> None:
    """Add the accuracy with k labelled measured revolutions per class, and the gain of JOINT over RAW and over SCRATCH.

    Each draw of the measurement has its own sets of labelled revolutions, so that the mean over draws does not depend on a few sets.
    """
    place = {name: row for row, name in enumerate(truth.recording)}
    most = most_shots(truth)
    for shots in (k for k in SHOTS if 0 < k <= most):
        hits = {method: np.full((len(seeds(rows.config)), len(truth)), np.nan) for method in (*embedded, SCRATCH, JOINT)}
        for number, seed in enumerate(seeds(rows.config)):
            known, rest = draw_shots(truth, shots, seed + LABEL_STEP * draw)
            chosen, scored = np.isin(truth.recording, known.recording), [place[name] for name in rest.recording]
            for method, some in embedded.items():
                own_rows = some[min(number, len(some) - 1)]  # a learner without random numbers has the same rows for all seeds
                hits[method][number, scored] = nearest_centroid(own_rows.take(chosen), own_rows.take(scored)) == rest.label
            for method, beside in ((SCRATCH, None), (JOINT, simulated)):
                own = fit_with_labels(rows.config, beside, known, rest, seed)
                hits[method][number, scored] = nearest_centroid(own.embedded(known), own.embedded(rest)) == rest.label
        counted = ~np.isnan(hits[RAW]).all(axis=0)
        for method, found in hits.items():
            case = {"supervision": "few_shot", "labels per class": shots, "method": method}
            row = rows.share(case, found[:, counted], truth.take(counted), keys, chance)
            curve[method].append(row | {"shots": shots})
        for other in (RAW, SCRATCH):
            ours, theirs = (np.nanmean(hits[method][:, counted], axis=0, keepdims=True) for method in (JOINT, other))
            case = {"supervision": "few_shot", "labels per class": shots, "method": f"{JOINT} - {other}"}
            rows.gain(case, ours, theirs, truth.take(counted), keys, Claim("simulation helps at equal labels"))


def _add_other_recordings(rows: RecognitionRows, embedded: Embedded, truth: Samples, keys: Sequence[str], chance: float) -> None:
    """Add the accuracy of the nearest class centroid of all other recordings, and the gain of each learner over raw features. The table
    labelled_probe has those of NETWORK and RAW.
    """
    if not has_other_recordings(truth):
        return
    hits = {method: correct([leave_one_out_centroid(one, one.source) for one in some], truth.label) for method, some in embedded.items()}
    for method in (one for one in hits if one not in (NETWORK, RAW)):
        case = {"supervision": "few_shot", "labels per class": RECORDINGS, "method": method}
        rows.share(case, hits[method], truth, keys, chance)
        rows.gain(case | {"method": f"{method} - {RAW}"}, hits[method], hits[RAW], truth, keys)
