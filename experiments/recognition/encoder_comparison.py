"""Encoder comparison: which learner is most accurate after training on simulation, without and with a few labelled measured revolutions?

All learners are trained on the same copies of simulated revolutions. Without labels, the class that a learner predicts counts; with k
labels per class, the class with the nearest centroid of labelled revolutions in the embedding. Two further networks learn from the labels
alone, and from these and the simulation. Labelled revolutions come from one half of each object's recordings, and the other half is scored.
"other recordings" uses the labels of all recordings except the one that it classifies.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments.campaign.cases import MEASURED
from experiments.campaign.frame import Frame
from experiments.cells import Cell
from experiments.framed import Figures, framed
from experiments.recognition import protocol
from experiments.recognition.copies import Copied, with_copies
from experiments.recognition.plots import bars, grouped, label_curve, values
from experiments.recognition.protocol import ECHOES, LOOKS, RECORDINGS, correct, seeds
from experiments.recognition.readings import TURNTABLE, revolutions
from experiments.verdicts import NONE, Claim, Row
from radartwin import plugins
from radartwin.config.config import Config
from radartwin.config.plugged import code_of
from radartwin.recognize.learners import LEARNERS, Fitted, learner
from radartwin.recognize.learners.interface import Reads
from radartwin.recognize.probes import leave_one_out_centroid, nearest_centroid
from radartwin.recognize.samples import Samples, join
from radartwin.recognize.score import uniform_chance
from radartwin.recognize.split import Split, draw_shots, label_free, most_shots
from radartwin.runs.experiment import Table

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
LABEL_STEP = 1000  # each draw adds this step to the seeds of its label sets; it exceeds the number of trainings
Embedded = Mapping[str, Sequence[Samples]]  # by method: the embeddings of the measured rows for each seed


def methods() -> dict[str, tuple[str, str]]:
    """Return METHODS, and one method for each learner of other packages (entry points of the group `radartwin.encoders`)."""
    return METHODS | {name: (name, ECHOES) for name in plugins.names(plugins.ENCODERS)}


def identity() -> dict[str, Any]:
    """Return additions to the run key: the source code of the learners of other packages."""
    loaded = {name: plugins.find(plugins.ENCODERS, name, LEARNERS) for name in plugins.names(plugins.ENCODERS)}
    code = {name: code_of(plugin) for name, plugin in loaded.items() if plugin is not None}
    return {"encoders": code} if code else {}


def cells(config: Config, copied: Copied, frame: Frame) -> Iterator[Cell]:
    """Declare the cells of one draw."""
    measured: dict[Reads, Samples] = {"features": protocol.scaled(revolutions(frame)), "pictures": revolutions(frame, "pictures")}
    copies: dict[Reads, Samples] = {"features": protocol.scaled(copied(config, frame)), "pictures": copied(config, frame, "pictures")}
    truth = measured["features"]
    scored = protocol.Scored(config, truth, frame, uniform_chance(truth))
    embedded = {}
    for method, (kind, _) in methods().items():
        fitted, rows = fit_method(config, method, copies, measured), measured[learner(kind).reads]
        claim = Claim("measured revolutions are recognised without labels") if method == NETWORK else NONE
        hits = correct([model.predict(rows.unlabelled()) for model in fitted], truth.label)
        yield scored.accuracy({"supervision": "label_free", "labels per class": 0, "method": method}, hits, claim)
        embedded[method] = [model.embedded(rows) for model in fitted]
    embedded[RAW] = [truth] * len(seeds(config))
    for shots in (k for k in SHOTS if 0 < k <= most_shots(truth)):
        case = {"supervision": "few_shot", "labels per class": shots}
        hits = few_shot_hits(config, embedded, truth, shots, int(frame.draw[frame.domain == MEASURED].iloc[0]), copies["features"])
        yield from scored.compared(case, hits, dict.fromkeys([(JOINT, RAW), (JOINT, SCRATCH)], Claim("simulation helps at equal labels")))
    if protocol.has_other_recordings(truth):  # the table labelled_probe has the accuracies of NETWORK and RAW, and their difference
        hits = {
            method: correct([leave_one_out_centroid(space, space.source) for space in spaces], truth.label)
            for method, spaces in embedded.items()
        }
        case, others = {"supervision": "few_shot", "labels per class": RECORDINGS}, [name for name in hits if name not in (NETWORK, RAW)]
        for method in others:
            yield scored.accuracy({**case, "method": method}, hits[method])
            yield scored.gain({**case, "method": f"{method} - {RAW}"}, hits[method], hits[RAW])


def fit_method(config: Config, method: str, copies: Mapping[Reads, Samples], measured: Mapping[Reads, Samples]) -> list[Fitted]:
    """Train the learner of a method on scaled rows of copies, once for each seed; boosted trees use no random numbers."""
    kind, text = methods()[method]
    fitted, texts = learner(kind), protocol.anchors(measured["features"].classes, text)
    split, numbers = label_free(copies[fitted.reads], measured[fitted.reads]), seeds(config)
    return [fitted.fit(split, texts, protocol.settings(config), seed) for seed in (numbers[:1] if kind == "trees" else numbers)]


def fit_with_labels(
    config: Config, simulated: Samples | None, known: Samples, rest: Samples, seed: int, share: float = LABELLED_SHARE
) -> Fitted:
    """Train the network on labelled measured rows, repeated to about `share` of the training rows, and on simulated rows if any."""
    train, shots = known, len(known) // len(known.classes)
    if simulated is not None:
        times = max(1, round(share / (1 - share) * len(simulated) / len(known)))
        train = join(simulated, known.take(np.repeat(np.arange(len(known)), times)))
    return LEARNERS["network"].fit(Split("few_shot", train, rest, shots), protocol.anchors(known.classes), protocol.settings(config), seed)


def few_shot_hits(
    config: Config, embedded: Embedded, truth: Samples, shots: int, draw: int, simulated: Samples | None = None
) -> dict[str, NDArray]:
    """Return for each method whether each row is recognised with `shots` labelled rows per class, (seeds, N), NaN if it is not scored.

    Each draw of the measurement has its own sets of labelled revolutions, so that the mean over draws does not depend on a few sets. With
    simulated rows, SCRATCH and JOINT are further methods.
    """
    learned = {} if simulated is None else {SCRATCH: None, JOINT: simulated}
    hits = {method: np.full((len(seeds(config)), len(truth)), np.nan) for method in (*embedded, *learned)}
    for number, seed in enumerate(seeds(config)):
        labelled, rest = draw_shots(truth, shots, seed + LABEL_STEP * draw)
        known, scored = (np.isin(truth.recording, drawn.recording) for drawn in (labelled, rest))
        # a learner without random numbers has the same rows for all seeds
        spaces = {method: of_seeds[min(number, len(of_seeds) - 1)] for method, of_seeds in embedded.items()}
        spaces |= {method: fit_with_labels(config, beside, labelled, rest, seed).embedded(truth) for method, beside in learned.items()}
        for method, rows in spaces.items():
            hits[method][number, scored] = nearest_centroid(rows.take(known), rows.take(scored)) == truth.label[scored]
    return hits


def _curves(rows: Sequence[Row]) -> dict[str, dict[Any, Any]]:
    return grouped([row for row in rows if row["labels per class"] != RECORDINGS], "method", "labels per class")


def _unlabelled(rows: Sequence[Row]) -> dict[str, dict[str, Any]]:
    return {"no labels": {method: of[0] for method, of in _curves(rows).items() if 0 in of}}


def _figures(rows: list[Row], first: Frame) -> Figures:
    return {
        "encoder_comparison": lambda: bars(_unlabelled(rows), "accuracy", grey=TREES),
        "label_efficiency": lambda: label_curve(_curves(rows), rows[0]["chance"]),
    }


run, recordings, score = framed(TABLE, TURNTABLE, cells, _figures, lambda rows: values(_unlabelled(rows)), source=with_copies)
