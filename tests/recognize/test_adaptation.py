"""Adaptation of measured to simulated rows on Gaussian domains, with equal and with unequal class shares in the measured batch."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from class_rows import text_vectors

from radartwin.recognize.adaptation import Adapted, class_shares, skewed, weighted_statistics
from radartwin.recognize.encoder import Settings
from radartwin.recognize.learners import LEARNERS, Fitted
from radartwin.recognize.probes import standardised
from radartwin.recognize.samples import MEASURED, SIMULATED, Part, Samples, Unlabelled, gather
from radartwin.recognize.split import label_free

CLASSES = 4
SEEDS = range(8)
SETTINGS = Settings(hidden=16, epochs=30, batch=64)
ANCHORS = text_vectors([f"k{kind}" for kind in range(CLASSES)])


def domains(seed: int, each: int = 6, copies: int = 20) -> tuple[Samples, Samples]:
    """Return standardised simulated rows, and measured rows of another scale and offset whose class means differ by 0.1."""
    rng = np.random.default_rng(seed)
    centres, scale, offset = 2 * rng.normal(size=(CLASSES, 3)), rng.uniform(0.5, 2, 3), 2 * rng.normal(size=3)
    apart = 0.1 * rng.normal(size=(CLASSES, 3))
    simulated, measured = [], []
    for kind in range(CLASSES):
        for number in range(each):
            rows = centres[kind] + 0.3 * rng.normal(size=(copies, 3))
            simulated.append(Part(f"s {kind} {number}", f"k{kind}", SIMULATED, rows))
            row = offset + scale * (centres[kind] + apart[kind] + 0.3 * rng.normal(size=3))
            measured.append(Part(f"m {kind} {number}", f"k{kind}", MEASURED, row))
    return standardised(gather(tuple("abc"), simulated)), gather(tuple("abc"), measured)


def trained(simulated: Samples, measured: Samples, seed: int = 0) -> Fitted:
    return LEARNERS["network"].fit(label_free(simulated, measured), ANCHORS, SETTINGS, seed)


def bias(simulated: Samples, adapted: Adapted[Samples]) -> float:
    """Return the mean distance per feature from the mean of a class's adapted rows to the mean of its simulated rows."""
    rows = adapted.measured
    means = [rows.values[rows.label == k].mean(axis=0) - simulated.values[simulated.label == k].mean(axis=0) for k in simulated.classes]
    return float(np.abs(means).mean())


def accuracy(fitted: Fitted, adapted: Adapted[Samples]) -> float:
    """Return the mean over the classes of the share of correct rows."""
    rows = adapted.measured
    right = fitted.predict(rows.unlabelled()) == rows.label
    return float(np.mean([right[rows.label == k].mean() for k in rows.classes]))


def shares_error(adapted: Adapted[Samples]) -> float:
    """Return the total variation distance of the assumed class shares from the true shares."""
    rows = adapted.measured
    return sum(abs(share - float((rows.label == k).mean())) for k, share in adapted.shares.items()) / 2


def plain_statistics(simulated: Samples, measured: Unlabelled) -> Adapted:
    """Return the rows that are adapted by equal class shares, whatever a classifier answers."""
    return weighted_statistics(simulated, measured, lambda rows: np.full((len(rows), 4), 0.25), shrinkage=1.0)


def test_statistics_of_standardised_rows_are_the_standardised_measured_rows() -> None:
    simulated, measured = domains(0)
    adapted = plain_statistics(simulated, measured)
    assert adapted.measured.values == pytest.approx(standardised(measured).values, abs=1e-9)
    assert adapted.shares == pytest.approx(dict.fromkeys(ANCHORS, 0.25))


@pytest.mark.parametrize("share", [0.25, 0.5])
def test_weights_halve_the_bias_of_batches_of_unequal_shares(share: float) -> None:
    errors = []
    for seed in SEEDS:
        simulated, full = domains(seed)
        batch, fitted = skewed(full, seed, share), trained(simulated, full, seed)
        pair = plain_statistics(simulated, batch), weighted_statistics(simulated, batch, fitted.probabilities)
        errors.append([(bias(simulated, adapted), shares_error(adapted), accuracy(fitted, adapted)) for adapted in pair])
    plain, weighted = np.mean(errors, axis=0)
    assert plain[0] > 0.3
    assert weighted[0] < 0.6 * plain[0]
    assert sum(two[0] < adapted[0] for adapted, two in errors) >= 7
    assert weighted[1] < 0.6 * plain[1]
    assert weighted[2] >= plain[2]


def test_labels_of_measured_rows_are_not_used() -> None:
    simulated, measured = domains(0)
    fitted = trained(simulated, measured)
    other = replace(measured, label=np.roll(measured.label, 6))
    for adapt in (plain_statistics, lambda s, m: weighted_statistics(s, m, fitted.probabilities)):
        assert np.array_equal(adapt(simulated, measured).measured.values, adapt(simulated, other).measured.values)
        assert np.array_equal(adapt(simulated, measured).measured.values, adapt(simulated, measured.unlabelled()).measured.values)


def test_a_constant_measured_feature_gets_the_simulated_mean() -> None:
    simulated, measured = domains(0)
    constant = measured.values.copy()
    constant[:, 1] = 7.0
    assert plain_statistics(simulated, measured.with_values(constant)).measured.values[:, 1] == pytest.approx(np.zeros(24), abs=1e-12)


def test_class_shares_are_those_of_a_mixture_with_known_densities() -> None:
    """The mean probability for equal shares is biased towards equal shares, and expectation-maximisation is not."""
    rng, true = np.random.default_rng(0), np.array([0.7, 0.2, 0.1])
    x = 1.5 * rng.choice(3, size=6000, p=true) + rng.normal(size=6000)
    density = np.exp(-((x[:, None] - 1.5 * np.arange(3)) ** 2) / 2)
    probabilities = density / density.sum(axis=1, keepdims=True)
    assert class_shares(probabilities, shrinkage=0.0) == pytest.approx(true, abs=0.03)
    assert np.abs(probabilities.mean(axis=0) - true).max() > 0.1
    certain = np.eye(2)[[0, 0, 0, 0, 1]]  # shrinkage mixes counted and equal shares
    assert class_shares(certain, 0.25) == pytest.approx([0.75 * 0.8 + 0.125, 0.75 * 0.2 + 0.125])
    assert class_shares(certain, 1.0) == pytest.approx([0.5, 0.5])


def test_a_skewed_batch_has_few_recordings_of_a_third_of_the_classes() -> None:
    parts = [
        Part(f"{kind} {number} turn {revolution}", f"k{kind}", MEASURED, np.zeros(1), source=f"{kind} {number}")
        for kind in range(6)
        for number in range(4)
        for revolution in range(3)
    ]
    batch = skewed(gather(("a",), parts), seed=1)
    counts = sorted(np.unique(batch.label, return_counts=True)[1].tolist())
    assert counts == [3, 3, 12, 12, 12, 12]
    assert np.array_equal(batch.recording, skewed(gather(("a",), parts), seed=1).recording)
    drawn = {tuple(skewed(gather(("a",), parts), seed).source) for seed in range(6)}
    assert len(drawn) > 3
    kept = skewed(gather(("a",), parts), seed=1, share=0.5, kept=2)
    assert sorted(np.unique(kept.label, return_counts=True)[1].tolist()) == [6, 6, 6, 12, 12, 12]


def test_messages_name_the_mistake() -> None:
    simulated, measured = domains(0)
    for other in (measured.with_values(measured.values, tuple("xyz")), measured.take(np.zeros(24, bool))):
        with pytest.raises(ValueError, match="rows of the same features"):
            plain_statistics(simulated, other)
    with pytest.raises(ValueError, match="shrinkage of 2"):
        weighted_statistics(simulated, measured, lambda rows: np.ones((24, 4)) / 4, shrinkage=2)
    with pytest.raises(ValueError, match="give 0 < share < 1"):
        skewed(measured, 0, share=1)
