"""Continued training with unlabelled measured rows on Gaussian domains: its effect, its determinism, and that it uses no labels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from class_rows import text_vectors

from radartwin.recognize.continued_training import Alignment, align, copy_noise
from radartwin.recognize.encoder import Encoder, Settings, nearest_text, text_scores
from radartwin.recognize.probes import standardised
from radartwin.recognize.samples import MEASURED, SIMULATED, Part, Samples, gather
from radartwin.recognize.split import Split, label_free
from radartwin.recognize.training import fit

CLASSES, FEATURES = 8, 8
SETTINGS = Settings(hidden=32, epochs=40, batch=128)
ANCHORS = text_vectors([f"k{kind}" for kind in range(CLASSES)])
SHORT = replace(SETTINGS, epochs=3)


def split(seed: int, shift: float = 0.0, copies: int = 10) -> Split:
    """Return rows of both domains. The measured ones share a random shift of `shift`, and their class means differ by 0.3."""
    rng = np.random.default_rng(seed)
    centres, apart = rng.normal(size=(CLASSES, FEATURES)), 0.3 * rng.normal(size=(CLASSES, FEATURES))
    names = [f"f{number}" for number in range(FEATURES)]

    def rows(domain: str, means: np.ndarray, each: int, copies: int) -> Samples:
        parts = [
            Part(f"{domain} {kind} {number}", f"k{kind}", domain, means[kind] + 0.3 * rng.normal(size=(copies, FEATURES)))
            for kind in range(CLASSES)
            for number in range(each)
        ]
        return standardised(gather(names, parts))

    simulated, measured = rows(SIMULATED, centres, 4, copies), rows(MEASURED, centres + apart, 8, 1)
    return label_free(simulated, measured.with_values(measured.values + shift * rng.normal(size=FEATURES)))


def accuracy(encoder: Encoder, data: Split) -> float:
    return float((nearest_text(encoder, data.unlabelled, ANCHORS, SETTINGS.temperature) == data.test.per_recording().label).mean())


def test_views_remove_a_shift_that_all_classes_have_in_common() -> None:
    gains = []
    for seed in range(4):
        data = split(seed, shift=0.7)
        start = fit(data, ANCHORS, SETTINGS, seed).encoder
        alone, with_views = (
            accuracy(align(start, data, ANCHORS, SETTINGS, seed, Alignment("views", weight)), data) for weight in (0.0, 0.1)
        )
        gains.append(with_views - alone)
    assert np.mean(gains) > 0.05


def test_prototypes_pull_measured_rows_to_their_nearest_text_and_keep_the_accuracy() -> None:
    texts = np.stack([ANCHORS[label] for label in sorted(ANCHORS)])
    for seed in range(3):
        data = split(seed)
        start = fit(data, ANCHORS, SETTINGS, seed).encoder
        alone, pulled = (align(start, data, ANCHORS, SETTINGS, seed, Alignment(weight=weight)) for weight in (0.0, 1.0))
        sure = [text_scores(encoder.embed(data.test.values), texts, SETTINGS.temperature).max(axis=1).mean() for encoder in (alone, pulled)]
        assert sure[1] > sure[0]
        assert accuracy(pulled, data) >= accuracy(alone, data) - 0.05


@pytest.mark.parametrize("term", ["prototypes", "views"])
def test_the_same_seed_gives_the_same_bytes_and_labels_are_not_used(term) -> None:
    data, alignment = split(0), Alignment(term, epochs=3)
    start = fit(data, ANCHORS, SHORT).encoder
    other = label_free(data.train, replace(data.test, label=np.roll(data.test.label, 8)))
    first, again, last = (
        align(start, given, ANCHORS, SHORT, seed, alignment).weights for given, seed in ((data, 0), (other, 0), (data, 1))
    )
    assert all(first[name].tobytes() == again[name].tobytes() for name in first)
    assert any(first[name].tobytes() != last[name].tobytes() for name in first)
    turned = label_free(data.train, data.test.with_values(data.test.values[::-1]))  # weight zero does not read the measured rows
    first, again = (align(start, given, ANCHORS, SHORT, 0, replace(alignment, weight=0)).weights for given in (data, turned))
    assert all(first[name].tobytes() == again[name].tobytes() for name in first)


def test_noise_of_views_has_the_variance_of_noisy_copies() -> None:
    rng = np.random.default_rng(0)
    parts = [Part(f"r{number}", "can", SIMULATED, number + 0.5 * rng.normal(size=(3, 2))) for number in range(2000)]
    parts.append(Part("single", "can", SIMULATED, np.zeros(2)))
    noise = copy_noise(gather(("a", "b"), parts))
    assert noise.shape == (6000, 2)
    assert noise.std(axis=0) == pytest.approx([0.5, 0.5], rel=0.03)
    with pytest.raises(ValueError, match="several noisy copies"):
        copy_noise(gather(("a", "b"), parts[-1:]))
