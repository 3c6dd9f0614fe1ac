"""Functions that all recognition tables use: text embeddings, encoder settings, random seeds, and rows with intervals and verdicts."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from experiments.claims import EQUAL, NONE, Claim, Row, RowList
from experiments.statistics import (
    BINOMIAL,
    SHARE,
    SIGNED,
    Estimate,
    clustered,
    orders,
    permuted,
    share,
    sign_flipped,
    students_t,
)  # fmt: skip
from radartwin.config.config import Config
from radartwin.recognize.encoder import Encoder, Settings, nearest_text
from radartwin.recognize.probes import leave_one_out_centroid, repeatability, standardised
from radartwin.recognize.samples import Samples
from radartwin.recognize.score import uniform_chance
from radartwin.recognize.split import Split, label_free
from radartwin.recognize.text import embed
from radartwin.recognize.training import fit
from radartwin.scene.objects.assortment import every_object

if TYPE_CHECKING:
    from experiments.recognition.readings import Readings

LEAST_GAIN = 0.02  # smallest gain in accuracy that counts as an effect: one recording in fifty
CHANCE_MARGIN = 0.1  # an accuracy that differs from chance by at most one recording in ten counts as chance
# Reasons why this testbed cannot decide a claim by construction
SAME_MODELS = "the simulation holds the model of each measured object, not of another object of its kind"
NO_SESSIONS = "the receiver has no gain and no start offset of its own in each session"
FLOOR_ONLY = "within 1 m of the target, the court has only the floor"
ONE_OBJECT = "a class has a single object"
ECHOES, LOOKS = "radar_description", "description"  # texts of an object: how its echo varies over a revolution, and what it looks like
TEXT, CENTROID = "nearest text", "other recordings"  # names of probes
GEOMETRY = {name: "symmetric" if entry.symmetric else "asymmetric" for name, entry in every_object().items()}
SHAPE: dict[str, str] = {name: entry.shape for name, entry in every_object().items()}
MATERIAL: dict[str, str] = {name: entry.material_class for name, entry in every_object().items()}


def anchors(objects: Iterable[str], text: str = ECHOES) -> dict[str, NDArray]:
    """Return {object: embedding vector of the object's text}. `text` is ECHOES, as in the paper, or LOOKS, also for objects without an
    echo's text.
    """
    known, names = every_object(), sorted(objects)
    text = text if all(getattr(known[name], text) for name in names) else LOOKS
    return dict(zip(names, embed([getattr(known[name], text) for name in names]), strict=True))


def scaled(samples: Samples) -> Samples:
    """Standardise the features of turntable revolutions, with the repeatability of each feature as its smallest spread."""
    return standardised(samples, repeatability(samples.names))


def settings(config: Config, level: str = "label_free") -> Settings:
    """Return the encoder settings of a supervision level. Only the supervision level few_shot includes the loss term of
    simulated-measured pairs.
    """
    chosen = Settings(**asdict(config.supervision.encoder))
    return chosen if level == "few_shot" else replace(chosen, paired=0.0)


def seeds(config: Config) -> list[int]:
    """Return the random seeds of the trainings; each table averages the results over these seeds."""
    return [config.seed + number for number in range(config.supervision.seeds)]


def encoders(config: Config, split: Split) -> list[Encoder]:
    texts = anchors(split.train.classes)
    return [fit(split, texts, settings(config, split.level), seed).encoder for seed in seeds(config)]


def count_sources(recordings: Samples) -> int:
    """Return the number of different stored recordings from which the rows were computed."""
    return np.unique(recordings.source).size


def has_other_recordings(samples: Samples) -> bool:
    """Return whether every class has two recordings or more, so that one can be left out."""
    return all(np.unique(samples.source[samples.label == label]).size > 1 for label in samples.classes)


def statistics_columns(answers: int, chance: float | None = None, shares: NDArray | None = None) -> dict[str, Any]:
    """Build extra columns of a score: number of predictions, chance, and the standard deviation of the accuracies `shares` (seeds,)."""
    spread = float(np.std(shares, ddof=1)) if shares is not None and len(shares) > 1 else None
    return {"answers": answers, "chance": chance, "seed_sd": spread}


def probe_hits(config: Config, measured: Samples, copies: Samples) -> dict[str, NDArray[np.bool_]]:
    """Train the encoder on scaled rows of simulated copies, and return for each probe whether each answer is correct, (seeds, N).

    The probe TEXT needs no labels. The probe CENTROID needs at least two recordings of each object, and is left out without them.
    """
    trained = encoders(config, label_free(copies, measured))
    texts, temperature = anchors(measured.classes), settings(config).temperature
    found = {TEXT: correct([nearest_text(one, measured.unlabelled(), texts, temperature) for one in trained], measured.label)}
    if has_other_recordings(measured):
        answers = [leave_one_out_centroid(one.embedded(measured), measured.source) for one in trained]
        found[CENTROID] = correct(answers, measured.label)
    return found


def correct(predictions: Sequence[NDArray], truth: NDArray) -> NDArray[np.bool_]:
    """Return a boolean array (seeds, N) that is true where the prediction equals the true class."""
    return np.stack([prediction == truth for prediction in predictions])


class RecognitionRows(RowList):
    """The list of the rows of one recognition table, with methods that append a row. Column n counts measured recordings."""

    def share(
        self, case: Mapping[str, Any], hits: NDArray, recordings: Samples, keys: Sequence[str], chance: float, claim: Claim = NONE,
        balanced: bool = False, answers: Sequence[NDArray] | None = None,
    ) -> Row:  # fmt: skip
        """Append the accuracy (share of correct predictions). A claim without a condition says that it is above chance.

        If `answers` is given, the test permutes the classes of the objects, and the accuracy without an effect is the mean accuracy of the
        permuted classes. This asks for several objects in each class. Otherwise the interval is a bootstrap over objects.

        Args:
            hits: boolean (seeds, N), whether each prediction is correct.
            balanced: if true, the accuracy is the balanced accuracy (mean of the accuracies of all classes).
            answers: (seeds) predicted classes (N,).
        """
        metric, null = "balanced accuracy" if balanced else "accuracy", None
        if answers is not None and np.unique(recordings.label).size > 1:
            found = permuted_accuracy(answers, recordings, self.config.seed, balanced)
            null = float(found.shuffled.mean())  # type: ignore[union-attr]
        else:
            found = self._clustered(hits, recordings, SHARE, recordings.label if balanced else None)
            if found.low == found.high:  # all resamples are equal, for example if all predictions are correct
                found = replace(share(found.value * found.n, found.n), closed=found.closed)
        if balanced and any(np.unique(recordings.object[recordings.label == one]).size < 2 for one in np.unique(recordings.label)):
            claim = replace(claim, untestable=ONE_OBJECT)
        if claim.bound is None and claim.null is None:
            claim = replace(claim, bound=chance, null=null)
        columns = statistics_columns(len(recordings), chance, np.nanmean(np.atleast_2d(hits), axis=1))
        return self.add({**case, **columns}, metric, found, keys, claim, count_sources(recordings))

    def gain(
        self, case: Mapping[str, Any], first: NDArray, second: NDArray, recordings: Samples, keys: Sequence[str], claim: Claim = NONE
    ) -> Row:
        """Append the accuracy of `first` minus that of `second` on the same recordings, with the test that swaps the methods of objects.
        The claim is that the gain is above LEAST_GAIN.
        """
        differences = np.atleast_2d(first).mean(axis=0) - np.atleast_2d(second).mean(axis=0)
        _, item = np.unique(recordings.object, return_inverse=True)
        found = sign_flipped(np.bincount(item, differences) / np.bincount(item), self.config.seed, SIGNED)
        case = {**case, **statistics_columns(len(recordings), 0.0)}
        claim = replace(claim, bound=LEAST_GAIN, null=0.0)
        found = replace(found, closed=is_closed(recordings))
        return self.add(case, "gain in accuracy", found, keys, claim, count_sources(recordings))

    def control(
        self, case: Mapping[str, Any], shares: NDArray, scored: Samples, keys: Sequence[str], chance: float, metric: str = "accuracy"
    ) -> Row:
        """Append the mean of the accuracies `shares` (shuffles,) with shuffled labels. The claim is that this mean is at chance level.

        Only the shuffles are independent of each other. The recordings of one shuffle are not independent, because the same few labels
        classify all of them.
        """
        case = {**case, **statistics_columns(len(scored), chance, shares)}
        return self.add(
            case, metric, students_t(shares, SHARE, "shuffles"), keys, at_chance("at chance", "", chance), count_sources(scored)
        )

    def _clustered(self, values: NDArray, recordings: Samples, limits: tuple[float, float], classes: NDArray | None = None) -> Estimate:
        found = clustered(values, recordings.object, self.config.profile.resamples, self.config.seed, classes, limits)
        return replace(found, closed=is_closed(recordings))


def compared_trainings(
    config: Config, column: str, trained: Iterable[tuple[str, Readings, Readings]], claims: Mapping[str, str]
) -> tuple[RecognitionRows, dict[str, dict[str, Row]], list[str]]:
    """Train an encoder for each name in `trained`. The rows are its accuracy with each probe, and the gain of the first over the others.

    Args:
        column: column of the name. trained: (name, features of measured revolutions, features of copies of simulated revolutions).
        claims: text of the claim about the gain over a name.
    Returns:
        The rows, those with the accuracy as {probe: {name: row}}, and the store keys of the recordings.
    """
    hits: dict[str, dict[str, NDArray[np.bool_]]] = {}
    known: set[str] = set()
    truth: Samples | None = None
    for name, measured, copies in trained:
        samples = scaled(measured.samples)
        truth = samples if truth is None else truth
        known |= {*measured.keys, *copies.keys}
        for probe, right in probe_hits(config, samples, scaled(copies.samples)).items():
            hits.setdefault(probe, {})[name] = right
    assert truth is not None
    rows, shown, keys, chance = RecognitionRows(config), {probe: {} for probe in hits}, sorted(known), uniform_chance(truth)
    for probe, of in hits.items():
        first = next(iter(of))
        for name, right in of.items():
            case = {"supervision": "label_free" if probe == TEXT else "few_shot", "probe": probe, column: name}
            shown[probe][name] = rows.share(case, right, truth, keys, chance)
            if name != first:
                rows.gain(case | {column: f"{first} - {name}"}, of[first], right, truth, keys, Claim(claims.get(name, "")))
    return rows, shown, keys


def at_chance(text: str, paper: str, chance: float) -> Claim:
    """Return the claim that an accuracy is that of chance."""
    return Claim(text, paper, direction=EQUAL, null=chance, margin=CHANCE_MARGIN)


def is_closed(recordings: Samples) -> bool:
    """Return whether every object is a class of its own, so that the objects are no sample of anything."""
    return np.unique(recordings.label).size == np.unique(recordings.object).size


def permuted_accuracy(answers: Sequence[NDArray], recordings: Samples, seed: int, balanced: bool = False) -> Estimate:
    """Return the accuracy, with the test that permutes the classes of the objects and keeps the answers on each object."""
    objects, item = np.unique(recordings.object, return_inverse=True)
    kinds, truth = np.unique(recordings.label, return_inverse=True)
    counts = np.array([[np.sum(np.stack(answers)[:, item == one] == kind) for kind in kinds] for one in range(len(objects))], float)
    total, order = np.bincount(item) * float(len(answers)), orders(len(objects), seed)
    classes = truth[[np.flatnonzero(item == one)[0] for one in range(len(objects))]][order]  # (permutations, objects)
    right = counts[np.arange(len(objects)), classes]
    if balanced:
        of_kind = [classes == kind for kind in range(len(kinds))]
        shuffled = np.mean([(right * one).sum(axis=1) / (total * one).sum(axis=1) for one in of_kind], axis=0)
    else:
        shuffled = right.sum(axis=1) / total.sum()
    return permuted(float(shuffled[0]), shuffled, len(objects), SHARE)


def sign_test(wins: int, losses: int) -> Estimate:
    """Return the share of wins with its exact binomial interval. Without wins and losses, the share is 0.5 and unknown."""
    return share(wins, wins + losses) if wins + losses else Estimate(0.5, 0.0, 1.0, 0, test=BINOMIAL)
