"""Functions that all recognition tables use: text embeddings, encoder settings, random seeds, and cells with claims."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments import statistics
from experiments.campaign.cases import MEASURED
from experiments.campaign.frame import Frame
from experiments.cells import Cell
from experiments.verdicts import EQUAL, NONE, Claim
from radartwin.config.config import Config
from radartwin.recognize.encoder import Encoder, Settings, nearest_text
from radartwin.recognize.probes import leave_one_out_centroid, repeatability, standardised
from radartwin.recognize.samples import Samples
from radartwin.recognize.score import uniform_chance
from radartwin.recognize.split import Split, label_free
from radartwin.recognize.text import embed
from radartwin.recognize.training import fit
from radartwin.scene.objects.assortment import every_object

LEAST_GAIN = 0.02  # smallest gain in accuracy that counts as an effect: one recording in fifty
CHANCE_MARGIN = 0.1  # an accuracy that differs from chance by at most one recording in ten counts as chance
# Reasons why this testbed cannot decide a claim by construction
SAME_MODELS = "the simulation holds the model of each measured object, not of another object of its kind"
NO_SESSIONS = "the receiver has no gain and no start offset of its own in each session"
FLOOR_ONLY = "within 1 m of the target, the court has only the floor"
TRAININGS = 1_000  # distance between the seeds of the trainings of two draws
ONE_OBJECT = "a class has a single object"
ECHOES, LOOKS = "radar_description", "description"  # texts of an object: how its echo varies over a revolution, and what it looks like
TEXT, RECORDINGS = "nearest text", "other recordings"  # names of probes
GEOMETRY = {name: "symmetric" if entry.symmetric else "asymmetric" for name, entry in every_object().items()}
SHAPE: dict[str, str] = {name: entry.shape for name, entry in every_object().items()}
MATERIAL: dict[str, str] = {name: entry.material_class for name, entry in every_object().items()}


def anchors(objects: Iterable[str], text: str = ECHOES) -> dict[str, NDArray]:
    """Return {object: embedding of its text}: ECHOES, as in the paper, or LOOKS, also if an object has no text of its echo."""
    known, names = every_object(), sorted(objects)
    text = text if all(getattr(known[name], text) for name in names) else LOOKS
    return dict(zip(names, embed([getattr(known[name], text) for name in names]), strict=True))


def scaled(samples: Samples) -> Samples:
    """Standardise the features of turntable revolutions, with the repeatability of each feature as its smallest spread."""
    return standardised(samples, repeatability(samples.names))


def settings(config: Config, level: str = "label_free") -> Settings:
    """Return the encoder settings of a level; only few_shot includes the loss term of simulated-measured pairs."""
    configured = Settings(**asdict(config.supervision.encoder))
    return configured if level == "few_shot" else replace(configured, paired=0.0)


def seeds(config: Config) -> list[int]:
    """Return the random seeds of the trainings, over which each table averages. Each draw of the testbed has trainings of its own, because
    an interval over draws that share trainings would not contain their random error.
    """
    first = config.seed + TRAININGS * (config.measured.draw or 0)
    return [first + number for number in range(config.supervision.seeds)]


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
    """Train the encoder on scaled rows of copies, and return for TEXT, and RECORDINGS if possible, the correct answers (seeds, N)."""
    trained = encoders(config, label_free(copies, measured))
    texts, temperature = anchors(measured.classes), settings(config).temperature
    hits = {TEXT: correct([nearest_text(encoder, measured.unlabelled(), texts, temperature) for encoder in trained], measured.label)}
    if has_other_recordings(measured):
        answers = [leave_one_out_centroid(encoder.embedded(measured), measured.source) for encoder in trained]
        hits[RECORDINGS] = correct(answers, measured.label)
    return hits


def correct(predictions: Sequence[NDArray], truth: NDArray) -> NDArray[np.bool_]:
    """Return a boolean array (seeds, N) that is true where the prediction equals the true class."""
    return np.stack([prediction == truth for prediction in predictions])


@dataclass(frozen=True, eq=False)
class Scored:
    """Declare the cells about predictions on the measured recordings of one draw. Column n counts measured recordings."""

    config: Config
    truth: Samples  # the N classified rows, with their classes
    of: Frame  # the recordings of the cells; if they have several simulations (column `side`), `compared` takes those that a cell names
    chance: float  # accuracy of a random guess

    def accuracy(
        self, case: Mapping[str, Any], hits: NDArray, claim: Claim = NONE, balanced: bool = False,
        answers: Sequence[NDArray] | None = None, panel: Any = None,
    ) -> Cell:  # fmt: skip
        """Return the accuracy of `hits` (seeds, N), NaN for a row that a seed does not classify. A claim without a condition says that it
        is above chance. With `balanced`, the accuracy is the mean of the accuracies of all classes.

        With `answers`, (seeds) predicted classes (N,), the test permutes the classes of the objects, and the mean accuracy of the permuted
        classes is that without an effect; this asks for several objects in each class. Otherwise a bootstrap over objects is the test.
        """
        hits, truth = self._classified(hits)
        metric, null = "balanced accuracy" if balanced else "accuracy", None
        if answers is not None and len(truth.classes) > 1:
            estimate = permuted_accuracy(answers, truth, self.config.seed, balanced)
            null = float(estimate.shuffled.mean())  # type: ignore[union-attr]
        else:
            classes, seeds = truth.label if balanced else None, (self.config.profile.resamples, self.config.seed)
            estimate = replace(statistics.clustered(hits, truth.object, *seeds, classes, statistics.SHARE), closed=is_closed(truth))
            if estimate.low == estimate.high:  # all resamples are equal, for example if all predictions are correct
                estimate = replace(statistics.share(estimate.value * estimate.n, estimate.n), closed=estimate.closed)
        if balanced and any(np.unique(truth.object[truth.label == label]).size < 2 for label in truth.classes):
            claim = replace(claim, untestable=ONE_OBJECT)
        if claim.bound is None and claim.null is None:
            claim = replace(claim, bound=self.chance, null=null)
        columns = statistics_columns(len(truth), self.chance, np.nanmean(hits, axis=1))
        return Cell({**case, **columns}, metric, self.of, estimate, claim, count_sources(truth), panel)

    def gain(self, case: Mapping[str, Any], first: NDArray, second: NDArray, claim: Claim = NONE) -> Cell:
        """Return the accuracy of `first` minus that of `second`, claimed above LEAST_GAIN; the test swaps the methods of objects."""
        (first_hits, truth), (second_hits, _) = (self._classified(hits) for hits in (first, second))
        differences = np.nanmean(first_hits, axis=0) - np.nanmean(second_hits, axis=0)
        _, item = np.unique(truth.object, return_inverse=True)
        estimate = statistics.sign_flipped(np.bincount(item, differences) / np.bincount(item), self.config.seed, statistics.SIGNED)
        case = {**case, **statistics_columns(len(truth), 0.0)}
        claim = replace(claim, bound=LEAST_GAIN, null=0.0)
        return Cell(case, "gain in accuracy", self.of, replace(estimate, closed=is_closed(truth)), claim, count_sources(truth))

    def compared(
        self, case: Mapping[str, Any], hits: Mapping[str, NDArray], pairs: Mapping[tuple[str, str], Claim],
        claims: Mapping[str, Claim] | None = None, column: str = "method", answers: Mapping[str, Sequence[NDArray]] | None = None,
        panels: Mapping[str, Any] | None = None,
    ) -> Iterator[Cell]:  # fmt: skip
        """Yield the accuracy of each method (see `accuracy`), and the gain of a pair's first method; all arguments are by method."""
        for method, method_hits in hits.items():
            claim, panel = (claims or {}).get(method, NONE), (panels or {}).get(method)
            predictions = answers[method] if answers else None
            yield self.using(method).accuracy({**case, column: method}, method_hits, claim, answers=predictions, panel=panel)
        for (first, second), claim in pairs.items():
            yield self.using(first, second).gain({**case, column: f"{first} - {second}"}, hits[first], hits[second], claim)

    def using(self, *sides: str) -> Scored:
        """Return this with the measured recordings and those of some simulations. A single simulation without a name is kept."""
        if set(self.of.side[self.of.domain != MEASURED]) == {""}:
            return self
        return replace(self, of=self.of[(self.of.domain == MEASURED) | self.of.side.isin(sides)])

    def control(self, case: Mapping[str, Any], shares: NDArray, metric: str = "accuracy") -> Cell:
        """Return the mean of the accuracies (shuffles,) with shuffled labels. The claim is that it is at chance level. Only the shuffles
        are independent of each other: the same few labels classify all recordings of a shuffle.
        """
        case, claim = {**case, **statistics_columns(len(self.truth), self.chance, shares)}, at_chance("at chance", "", self.chance)
        return Cell(case, metric, self.of, statistics.students_t(shares, statistics.SHARE, "shuffles"), claim, count_sources(self.truth))

    def _classified(self, hits: NDArray) -> tuple[NDArray[np.float64], Samples]:
        """Return the columns of `hits` that a seed classifies, and their rows."""
        hits = np.atleast_2d(np.asarray(hits, float))
        mask = ~np.isnan(hits).all(axis=0)
        return hits[:, mask], self.truth.take(mask)


def compared_trainings(
    config: Config, frame: Frame, column: str, trained: Iterable[tuple[str, Samples, Samples]], claims: Mapping[str, str]
) -> Iterator[Cell]:
    """Train an encoder for each (name, features of measured revolutions, features of copies of simulated revolutions), and declare its
    accuracy with each probe, and the gain of the first over the others; `claims` has the text of the claim about the gain over a name.
    """
    hits: dict[str, dict[str, NDArray[np.bool_]]] = {}
    for name, measured, simulated in trained:
        truth = scaled(measured)
        for probe, right in probe_hits(config, truth, scaled(simulated)).items():
            hits.setdefault(probe, {})[name] = right
    scored = Scored(config, truth, frame, uniform_chance(truth))
    for probe, of in hits.items():
        case, (first, *others) = {"supervision": "label_free" if probe == TEXT else "few_shot", "probe": probe}, of
        yield from scored.compared(case, of, {(first, name): Claim(claims.get(name, "")) for name in others}, column=column)


def at_chance(text: str, paper: str, chance: float) -> Claim:
    """Return the claim that an accuracy is that of chance."""
    return Claim(text, paper, direction=EQUAL, null=chance, margin=CHANCE_MARGIN)


def is_closed(recordings: Samples) -> bool:
    """Return whether every object is a class of its own, so that the objects are no sample of anything."""
    return np.unique(recordings.label).size == np.unique(recordings.object).size


def permuted_accuracy(answers: Sequence[NDArray], recordings: Samples, seed: int, balanced: bool = False) -> statistics.Estimate:
    """Return the accuracy, with the test that permutes the classes of the objects and keeps the answers on each object."""
    objects, item = np.unique(recordings.object, return_inverse=True)
    kinds, truth = np.unique(recordings.label, return_inverse=True)
    counts = np.array([[np.sum(np.stack(answers)[:, item == number] == kind) for kind in kinds] for number in range(len(objects))], float)
    total, order = np.bincount(item) * float(len(answers)), statistics.orders(len(objects), seed)
    classes = truth[[np.flatnonzero(item == number)[0] for number in range(len(objects))]][order]  # (permutations, objects)
    right = counts[np.arange(len(objects)), classes]
    if balanced:
        of_kind = [classes == kind for kind in range(len(kinds))]
        shuffled = np.mean([(right * mask).sum(axis=1) / (total * mask).sum(axis=1) for mask in of_kind], axis=0)
    else:
        shuffled = right.sum(axis=1) / total.sum()
    return statistics.permuted(float(shuffled[0]), shuffled, len(objects), statistics.SHARE)


def sign_test(wins: int, losses: int) -> statistics.Estimate:
    """Return the share of wins with its exact binomial interval. Without wins and losses, the share is 0.5 and unknown."""
    return statistics.share(wins, wins + losses) if wins + losses else statistics.Estimate(0.5, 0.0, 1.0, 0, test=statistics.BINOMIAL)
