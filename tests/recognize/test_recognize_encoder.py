"""Tests of the contrastive encoder: its losses compared with NumPy, determinism, early stopping and options."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from radartwin.recognize.encoder import Encoder, Settings, nearest_text
from radartwin.recognize.losses import text_loss
from radartwin.recognize.networks import TWO_LAYERS
from radartwin.recognize.samples import MEASURED, SIMULATED, Part, Samples, gather, join
from radartwin.recognize.split import Split, draw_shots, label_free
from radartwin.recognize.training import fit, held_out, train

OBJECTS = ("can", "mug", "bottle")
SETTINGS = Settings(hidden=16, epochs=30, batch=64)
ANCHORS: dict[str, np.ndarray] = dict(
    zip(OBJECTS, np.linalg.qr(np.random.default_rng(9).normal(size=(8, 3)))[0].T.astype(np.float32), strict=True)
)


def rows(domain: str, seed: int, each: int = 3, copies: int = 4, spread: float = 0.2) -> Samples:
    rng, centres = np.random.default_rng(seed), np.random.default_rng(0).normal(size=(3, 5))
    parts = [
        Part(f"{domain} {label} {number}", label, domain, centres[kind] + spread * rng.normal(size=(copies, 5)), f"{number} m")
        for kind, label in enumerate(OBJECTS)
        for number in range(each)
    ]
    return gather(tuple("abcde"), parts)


def split() -> Split:
    return label_free(rows(SIMULATED, 1), rows(MEASURED, 2, copies=1))


def test_a_trained_encoder_recognises_objects_by_their_description():
    one = split()
    trained = fit(one, ANCHORS, SETTINGS)
    answers = nearest_text(trained.encoder, one.unlabelled, ANCHORS, SETTINGS.temperature)
    assert (answers == one.test.per_recording().label).mean() > 0.85
    assert np.linalg.norm(trained.encoder.embed(one.test.values), axis=1) == pytest.approx(np.ones(9), abs=1e-5)


def test_weights_depend_on_the_seed_and_not_on_test_labels_and_values():
    one = split()
    swapped = replace(one.test, label=np.roll(one.test.label, 3), values=one.test.values + 1)
    given = ((one.test, 4), (swapped, 4), (one.test, 5))
    first, again, other = (fit(label_free(one.train, test), ANCHORS, SETTINGS, seed).encoder.weights for test, seed in given)
    assert all(np.array_equal(first[name], again[name]) for name in first)
    assert not np.array_equal(first["hidden_weight"], other["hidden_weight"])


def test_early_stopping_uses_simulated_recordings():
    one = split()
    held = held_out(one.simulated, seed=0)
    assert held <= set(one.simulated.recording)
    assert sorted(name.split()[1] for name in held) == sorted(OBJECTS)
    mask = np.isin(one.train.recording, list(held))
    patient = replace(SETTINGS, patience=3)
    _, losses = train(TWO_LAYERS, one.train.take(~mask), one.train.take(mask), ANCHORS, patient, 0, SETTINGS.epochs)
    trained = fit(one, ANCHORS, patient)
    assert trained.epochs == int(np.argmin(losses)) + 1
    assert len(losses) <= min(SETTINGS.epochs, trained.epochs + 3)


def test_training_without_simulated_rows_takes_all_epochs():
    known, rest = draw_shots(rows(MEASURED, 2, each=4, copies=1), 2, seed=0)
    assert fit(Split("few_shot", known, rest, 2), ANCHORS, SETTINGS).epochs == SETTINGS.epochs


def test_the_loss_is_info_nce_from_radar_to_text():
    import torch
    from scipy.special import log_softmax

    rng = np.random.default_rng(0)
    z = rng.normal(size=(6, 8))
    z /= np.linalg.norm(z, axis=1, keepdims=True)
    y, texts = np.array([0, 0, 1, 1, 1, 0]), np.stack([ANCHORS[label] for label in OBJECTS])  # no row of the data belongs to the third text
    weight = torch.ones(3).double()
    found = float(text_loss(torch.from_numpy(z), torch.from_numpy(y), torch.from_numpy(texts).double(), weight, SETTINGS.temperature))
    logits = z @ texts.T / SETTINGS.temperature
    assert found == pytest.approx(-np.mean(log_softmax(logits, axis=1)[np.arange(6), y]))


def test_the_paired_term_needs_labels_and_moves_pairs_together():
    with pytest.raises(ValueError, match="few_shot"):
        fit(split(), ANCHORS, replace(SETTINGS, paired=1.0))
    simulated, measured = rows(SIMULATED, 1), rows(MEASURED, 2, each=6, copies=1)
    shifted = measured.with_values(measured.values + 1.5)  # measured features shifted by a constant difference from the simulated features
    known, rest = draw_shots(shifted, 3, seed=0)
    one = Split("few_shot", join(simulated, known), rest, 3)

    def apart(paired: float) -> float:
        encoder = fit(one, ANCHORS, replace(SETTINGS, paired=paired, epochs=20)).encoder
        found = []
        for label, stratum in sorted(set(zip(known.label, known.stratum, strict=True))):
            here = (simulated.label == label) & (simulated.stratum == stratum)
            there = (known.label == label) & (known.stratum == stratum)
            if here.any():
                found.append(float((encoder.embed(simulated.values[here]) @ encoder.embed(known.values[there]).T).mean()))
        return float(np.mean(found))

    assert apart(1.0) > apart(0.0)


def test_messages_name_the_mistake():
    with pytest.raises(ValueError, match="class mug has no text embedding"):
        fit(split(), {label: ANCHORS[label] for label in ("can", "bottle")}, SETTINGS)
    with pytest.raises(ValueError, match=r"features of shape \(N, 5\)"):
        fit(split(), ANCHORS, SETTINGS).encoder.embed(np.zeros((2, 4)))
    with pytest.raises(ValueError, match="not those of two layers"):
        Encoder({"hidden_weight": np.zeros((2, 2), np.float32)})
