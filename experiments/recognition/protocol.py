"""Functions that all recognition tables use: text embeddings, encoder settings, random seeds, and rows with intervals and verdicts."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments.claims import NONE, Claim, told
from radartwin.config.config import Config
from radartwin.recognize.encoder import Encoder, Settings
from radartwin.recognize.samples import Samples
from radartwin.recognize.score import binomial_p, exact_interval, seed_mean
from radartwin.recognize.split import Split
from radartwin.recognize.text import embed
from radartwin.recognize.training import fit
from radartwin.scene.objects.catalogue import catalogue

GEOMETRY = {name: "symmetric" if entry.symmetric else "asymmetric" for name, entry in catalogue().items()}
SHAPE: dict[str, str] = {name: entry.shape for name, entry in catalogue().items()}
MATERIAL: dict[str, str] = {name: entry.material_class for name, entry in catalogue().items()}


def anchors(objects: Iterable[str]) -> dict[str, NDArray]:
    """Return {object: embedding vector of the object's text description}."""
    known, names = catalogue(), sorted(objects)
    return dict(zip(names, embed([known[name].description for name in names]), strict=True))


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


def cells(recordings: Samples) -> NDArray[np.str_]:
    """Return the cell (object and distance) of each recording, (N,). Measured recordings of the same object and distance (cell) are
    compared with the same simulation.
    """
    return np.array([f"{label} {stratum}" for label, stratum in zip(recordings.label, recordings.stratum, strict=True)])


def count_sources(recordings: Samples) -> int:
    """Return the number of different stored recordings from which the rows were computed."""
    return np.unique(recordings.source).size


def statistics_columns(answers: int, chance: float | None = None, p: float | None = None, shares: NDArray | None = None) -> dict[str, Any]:
    """Build extra columns of a score: number of predictions, chance, p value, and the standard deviation of the accuracies `shares`
    (seeds,).
    """
    spread = float(np.std(shares, ddof=1)) if shares is not None and len(shares) > 1 else None
    return {"answers": answers, "chance": chance, "p": p, "seed_sd": spread}


def correct(predictions: Sequence[NDArray], truth: NDArray) -> NDArray[np.bool_]:
    """Return a boolean array (seeds, N) that is true where the prediction equals the true class."""
    return np.stack([prediction == truth for prediction in predictions])


class RecognitionRows(list[dict[str, Any]]):
    """The list of the rows of one recognition table, with methods that append a row."""

    def __init__(self, config: Config):
        super().__init__()
        self.config = config

    def add(
        self, case: Mapping[str, Any], metric: str, interval: tuple[float, float, float], n: int, keys: Sequence[str],
        claim: Claim = NONE, holds: bool | None = None,
    ) -> dict[str, Any]:  # fmt: skip
        """Append one row to the table and return this row.

        Args:
            interval: (lower bound, value, upper bound) of the score's confidence interval.
            n: number of recordings; with fewer than two recordings the verdict is "untestable".
            claim: the claim's text and the paper's value.
            holds: whether the claim holds; None for a row without a claim.
        """
        low, value, high = interval
        verdict = "untestable" if holds is None or n < 2 else "holds" if holds else "fails"
        row = {
            **case, "claim": claim.text, "metric": metric, "run_keys": told(keys), "paper": claim.paper, "value": value, "low": low,
            "high": high, "n": n, "domain": self.config.measured.provider, "verdict": verdict,
        }  # fmt: skip
        self.append(row)
        return row

    def share(
        self, case: Mapping[str, Any], hits: NDArray, recordings: Samples, keys: Sequence[str], chance: float, claim: Claim = NONE,
        balanced: bool = False,
    ) -> dict[str, Any]:  # fmt: skip
        """Append the accuracy (share of correct predictions). The claim holds if the whole confidence interval of the accuracy lies above
        chance.

        Args:
            hits: boolean (seeds, N), whether each prediction is correct.
            balanced: if true, the accuracy is the balanced accuracy (mean of the accuracies of all classes).
        """
        classes, metric = (recordings.label, "balanced accuracy") if balanced else (None, "accuracy")
        interval = seed_mean(hits, cells(recordings), self.config.profile.resamples, self.config.seed, classes)
        if interval[0] == interval[2]:  # all resamples are equal, for example if all predictions are correct
            interval = exact_interval(interval[1], np.unique(cells(recordings)).size)
        n = count_sources(recordings)
        p = None if balanced else binomial_p(round(interval[1] * n), n, chance)
        columns = statistics_columns(len(recordings), chance, p, np.nanmean(np.atleast_2d(hits), axis=1))
        return self.add({**case, **columns}, metric, interval, n, keys, claim, interval[0] > chance if claim.text else None)

    def gain(
        self, case: Mapping[str, Any], first: NDArray, second: NDArray, recordings: Samples, keys: Sequence[str], claim: Claim = NONE
    ) -> dict[str, Any]:
        """Append the accuracy of `first` minus that of `second` on the same recordings. The claim holds if the confidence interval of
        this difference lies above zero.
        """
        difference = np.atleast_2d(first).mean(axis=0) - np.atleast_2d(second).mean(axis=0)
        interval = seed_mean(difference, cells(recordings), self.config.profile.resamples, self.config.seed)
        case = {**case, **statistics_columns(len(recordings), 0.0)}
        holds = interval[0] > 0 if claim.text else None
        return self.add(case, "gain in accuracy", interval, count_sources(recordings), keys, claim, holds)

    def control(
        self, case: Mapping[str, Any], shares: NDArray, draws: int, scored: Samples, keys: Sequence[str], chance: float,
        metric: str = "accuracy",
    ) -> dict[str, Any]:  # fmt: skip
        """Append the mean of the accuracies `shares` (seeds,) with shuffled labels. The claim is that the mean accuracy is at chance level.

        Args:
            draws: number of class labels that were shuffled independently for each seed (the number of simulated recordings).
        """
        low, value, high = exact_interval(float(np.mean(shares)), draws * len(shares))
        case = {**case, **statistics_columns(len(scored), chance, None, shares)}
        return self.add(case, metric, (low, value, high), count_sources(scored), keys, Claim("at chance"), low <= chance <= high)
