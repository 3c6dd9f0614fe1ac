"""What the recognition experiments share: classes, trainings over seeds, and rows with their intervals and verdicts."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments.claims import told
from radartwin.config.config import Config
from radartwin.recognize.encoder import Encoder, Settings
from radartwin.recognize.samples import Samples
from radartwin.recognize.score import exact_interval, seed_mean, share
from radartwin.recognize.split import Split
from radartwin.recognize.text import embed
from radartwin.recognize.training import fit
from radartwin.scene.objects.catalogue import catalogue

CALIBRATION_OBJECT = "corner_reflector"
GEOMETRY = {name: "symmetric" if entry.symmetric else "asymmetric" for name, entry in catalogue().items()}
SHAPE: dict[str, str] = {name: entry.shape for name, entry in catalogue().items()}
MATERIAL: dict[str, str] = {name: entry.material_class for name, entry in catalogue().items()}


def anchors(objects: Iterable[str]) -> dict[str, NDArray]:
    """Text vector of each object's description."""
    known, names = catalogue(), sorted(objects)
    return dict(zip(names, embed([known[name].description for name in names]), strict=True))


def settings(config: Config, level: str = "label_free") -> Settings:
    """Of the encoder; the paired term is for who has labels."""
    chosen = Settings(**asdict(config.supervision.encoder))
    return chosen if level == "few_shot" else replace(chosen, paired=0.0)


def seeds(config: Config) -> list[int]:
    """Of the trainings that are averaged."""
    return [config.seed + number for number in range(config.supervision.seeds)]


def encoders(config: Config, split: Split) -> list[Encoder]:
    """One training per seed."""
    texts = anchors(split.train.classes)
    return [fit(split, texts, settings(config, split.level), seed).encoder for seed in seeds(config)]


def cells(recordings: Samples) -> NDArray[np.str_]:
    """Which recordings share a simulation: the same object at the same distance."""
    return np.array([f"{label} {stratum}" for label, stratum in zip(recordings.label, recordings.stratum, strict=True)])


@dataclass(frozen=True)
class Rows:
    """Collects rows of one table; `domain` is what they are scored against."""

    config: Config
    rows: list[dict[str, Any]]

    @property
    def domain(self) -> str:
        return self.config.measured.provider

    def add(
        self, case: Mapping[str, Any], metric: str, interval: tuple[float, float, float], n: int, keys: Sequence[str], *,
        paper: str = "", claim: str = "", holds: bool | None = None,
    ) -> dict[str, Any]:  # fmt: skip
        """One row. `holds` is None where there is no claim, or fewer than two recordings to judge it by."""
        low, value, high = interval
        verdict = "untestable" if holds is None or n < 2 else "holds" if holds else "fails"
        row = {
            **case, "claim": claim, "metric": metric, "run_keys": told(keys), "paper": paper, "value": value, "low": low, "high": high,
            "n": n, "domain": self.domain, "verdict": verdict,
        }  # fmt: skip
        self.rows.append(row)
        return row

    def share(
        self, case: Mapping[str, Any], right: NDArray, recordings: Samples, keys: Sequence[str], chance: float, *,
        paper: str = "", claim: str = "", balanced: bool = False,
    ) -> dict[str, Any]:  # fmt: skip
        """A share of right answers over seeds, (seeds, N), against its chance; the claim is that the whole interval lies above it.

        Args:
            balanced: the mean of the classes' shares instead.
        """
        classes, metric = (recordings.label, "balanced accuracy") if balanced else (None, "accuracy")
        interval = seed_mean(right, cells(recordings), self.config.profile.resamples, self.config.seed, classes)
        if interval[0] == interval[2]:  # no draw differs, as where all are right: what so many cells tell
            interval = exact_interval(interval[1], np.unique(cells(recordings)).size)
        holds = interval[0] > chance if claim else None
        n = np.unique(recordings.source).size
        p = None if balanced else binomial_p(interval[1], n, chance)
        told_of = {
            **case,
            "answers": len(recordings),
            "chance": chance,
            "p": p,
            "seed_sd": seed_sd(np.nanmean(np.atleast_2d(right), axis=1)),
        }
        return self.add(told_of, metric, interval, n, keys, paper=paper, claim=claim, holds=holds)

    def gain(
        self, case: Mapping[str, Any], first: NDArray, second: NDArray, recordings: Samples, keys: Sequence[str], *,
        paper: str = "", claim: str = "", metric: str = "gain in accuracy",
    ) -> dict[str, Any]:  # fmt: skip
        """By how much the first is right more often than the second on the same recordings; the claim is that the interval is above 0."""
        difference = np.atleast_2d(first).mean(axis=0) - np.atleast_2d(second).mean(axis=0)
        interval = seed_mean(difference, cells(recordings), self.config.profile.resamples, self.config.seed)
        told_of = {**case, "answers": len(recordings), "chance": 0.0, "p": None, "seed_sd": None}
        n = np.unique(recordings.source).size
        return self.add(told_of, metric, interval, n, keys, paper=paper, claim=claim, holds=interval[0] > 0 if claim else None)

    def control(
        self,
        case: Mapping[str, Any],
        shares: NDArray,
        draws: int,
        scored: Samples,
        keys: Sequence[str],
        chance: float,
        *,
        metric: str = "accuracy",
    ) -> dict[str, Any]:
        """Shares after labels were dealt anew, (seeds,); the claim is that they are at chance.

        Args:
            draws: what was dealt independently of one another in each seed, such as simulated recordings.
        """
        low, value, high = exact_interval(float(np.mean(shares)), draws * len(shares))
        told_of = {**case, "answers": len(scored), "chance": chance, "p": None, "seed_sd": seed_sd(shares)}
        n = np.unique(scored.source).size
        return self.add(told_of, metric, (low, value, high), n, keys, claim="at chance", holds=low <= chance <= high)


def seed_sd(shares: NDArray) -> float | None:
    """Standard deviation over seeds, as the paper gives it after +-; None of one seed."""
    return float(np.std(shares, ddof=1)) if len(shares) > 1 else None


def binomial_p(value: float, n: int, chance: float) -> float:
    """Exact p of as many right answers or more at chance, one answer per stored recording: the mean over seeds and its pieces."""
    return share(np.arange(n) < round(value * n), chance).p


def right(answers: Sequence[NDArray], truth: NDArray) -> NDArray[np.bool_]:
    """(seeds, N): which answers are right."""
    return np.stack([answer == truth for answer in answers])
