"""The learner `network`: the contrastive encoder of two layers on feature vectors (encoder.py, training.py)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from numpy.typing import NDArray

from radartwin.recognize.encoder import Settings
from radartwin.recognize.learners.interface import Reads, TextClassifier, text_classifier
from radartwin.recognize.split import Split
from radartwin.recognize.training import fit


@dataclass(frozen=True)
class Network:
    reads: Reads = "features"

    def fit(self, split: Split, anchors: Mapping[str, NDArray], settings: Settings, seed: int) -> TextClassifier:
        trained = fit(split, anchors, settings, seed)
        return text_classifier(trained.encoder, split, anchors, trained.epochs, settings)
