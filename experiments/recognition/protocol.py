"""Functions that all recognition tables use: text embeddings, encoder settings, random seeds, and rows with intervals and verdicts."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments.claims import LEVEL, NONE, Claim, Row, RowList
from experiments.statistics import SHARE, SIGNED, Estimate, clustered
from radartwin.config.config import Config
from radartwin.recognize.encoder import Encoder, Settings, nearest_text
from radartwin.recognize.probes import leave_one_out_centroid, repeatability, standardised
from radartwin.recognize.samples import Samples
from radartwin.recognize.score import binomial_p, exact_interval
from radartwin.recognize.split import Split, label_free
from radartwin.recognize.text import embed
from radartwin.recognize.training import fit
from radartwin.scene.objects.catalogue import catalogue

LEAST_GAIN = 0.02  # smallest gain in accuracy that counts as an effect: one recording in fifty
FEWEST_UNEQUAL = 6  # objects for which two methods have different accuracies; with fewer, the bootstrap interval of a gain is too narrow
CHANCE_MARGIN = 0.1  # an accuracy that differs from chance by at most one recording in ten counts as chance
TEXT, CENTROID = "nearest text", "other recordings"  # names of probes
GEOMETRY = {name: "symmetric" if entry.symmetric else "asymmetric" for name, entry in catalogue().items()}
SHAPE: dict[str, str] = {name: entry.shape for name, entry in catalogue().items()}
MATERIAL: dict[str, str] = {name: entry.material_class for name, entry in catalogue().items()}


def anchors(objects: Iterable[str], text: str = "description") -> dict[str, NDArray]:
    """Return {object: embedding vector of the object's text}. `text` is "description" (its looks) or "radar_description" (its echo)."""
    known, names = catalogue(), sorted(objects)
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
    if all(np.unique(measured.source[measured.label == label]).size > 1 for label in measured.classes):
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
        balanced: bool = False,
    ) -> Row:  # fmt: skip
        """Append the accuracy (share of correct predictions).

        A claim without a condition holds if the confidence interval of the accuracy lies above chance. For a plain accuracy, the exact
        binomial p value must also be below 0.05. The trials of this test are the objects.

        Args:
            hits: boolean (seeds, N), whether each prediction is correct.
            balanced: if true, the accuracy is the balanced accuracy (mean of the accuracies of all classes).
        """
        classes, metric = (recordings.label, "balanced accuracy") if balanced else (None, "accuracy")
        found = self._clustered(hits, recordings, SHARE, classes)
        if found.low == found.high:  # all resamples are equal, for example if all predictions are correct
            found = interval(found.value, found.n)
        if not balanced:
            p, least = (binomial_p(count, found.n, chance) for count in (math.floor(found.value * found.n + 1e-9), found.n))
            found = replace(found, p=p, least_p=least)
        elif any(np.unique(recordings.object[recordings.label == one]).size < 2 for one in np.unique(recordings.label)):
            claim = replace(claim, untestable="a class has a single object")
        if not claim.bounded:
            claim = replace(claim, above=chance, p_below=None if balanced else LEVEL)
        columns = statistics_columns(len(recordings), chance, np.nanmean(np.atleast_2d(hits), axis=1))
        return self.add({**case, **columns}, metric, found, keys, claim, count_sources(recordings))

    def gain(
        self, case: Mapping[str, Any], first: NDArray, second: NDArray, recordings: Samples, keys: Sequence[str], claim: Claim = NONE
    ) -> Row:
        """Append the accuracy of `first` minus that of `second` on the same recordings.

        The claim holds if the confidence interval of this difference lies above LEAST_GAIN. The claim cannot be tested if both methods
        classify every recording correctly. It also cannot be tested if their accuracies differ for fewer than FEWEST_UNEQUAL objects.
        """
        ours, theirs = (np.atleast_2d(hits).mean(axis=0) for hits in (first, second))
        found = self._clustered(ours - theirs, recordings, SIGNED)
        unequal = np.unique(recordings.object[ours != theirs]).size
        few = f"the answers of the methods differ for {unequal} objects ({FEWEST_UNEQUAL} needed)" if unequal < FEWEST_UNEQUAL else ""
        ceiling = "both classify every recording correctly" if ours.min() == theirs.min() == 1 else ""
        claim = replace(claim, above=LEAST_GAIN, untestable=ceiling or few)
        case = {**case, **statistics_columns(len(recordings), 0.0)}
        return self.add(case, "gain in accuracy", found, keys, claim, count_sources(recordings))

    def control(
        self, case: Mapping[str, Any], shares: NDArray, scored: Samples, keys: Sequence[str], chance: float, metric: str = "accuracy"
    ) -> Row:
        """Append the mean of the accuracies `shares` (shuffles,) with shuffled labels. The claim is that this mean is at chance level.

        Only the shuffles are independent of each other. The recordings of one shuffle are not independent, because the same few labels
        classify all of them.
        """
        spread = "all shuffles have the same accuracy" if np.ptp(shares) == 0 else ""
        claim = Claim("at chance", contains=chance, margin=CHANCE_MARGIN, untestable=spread)
        case = {**case, **statistics_columns(len(scored), chance, shares)}
        return self.add(case, metric, over_shuffles(shares), keys, claim, count_sources(scored))

    def _clustered(self, values: NDArray, recordings: Samples, limits: tuple[float, float], classes: NDArray | None = None) -> Estimate:
        return clustered(values, recordings.object, self.config.profile.resamples, self.config.seed, classes, limits)


def interval(value: float, n: int) -> Estimate:
    """Return the estimate of a share of successes in n independent trials, with its exact binomial interval."""
    low, value, high = exact_interval(value, n)
    return Estimate(value, low, high, n, limits=SHARE)


def over_shuffles(shares: NDArray) -> Estimate:
    """Return the mean of the accuracies (N,) of independent shuffles with its 95 % interval by Student's t distribution.

    >>> found = over_shuffles(np.array([0.0, 0.1, 0.2]))
    >>> round(found.low, 3), round(found.value, 3), round(found.high, 3)
    (-0.148, 0.1, 0.348)
    """
    from scipy.stats import t

    mean, count = float(np.mean(shares)), len(shares)
    half = float(t.ppf(0.975, count - 1) * np.std(shares, ddof=1) / np.sqrt(count)) if count > 1 else 0.0
    return Estimate(mean, mean - half, mean + half, count, limits=SHARE)


def sign_test(found: Estimate, differences: NDArray, groups: NDArray) -> Estimate:
    """Return `found` with the one-sided exact p value of a sign test that the mean differences (N,) of most groups (N,) are positive.

    Groups whose mean difference is zero are left out. If no group remains, p is 1.
    """
    _, group = np.unique(groups, return_inverse=True)
    signs = np.sign(np.round(np.bincount(group, differences), 12))
    wins, losses = int(np.sum(signs > 0)), int(np.sum(signs < 0))
    p, least = (binomial_p(count, wins + losses, 0.5) if wins + losses else 1.0 for count in (wins, wins + losses))
    return replace(found, p=p, least_p=least)
