"""Tests of the contrastive encoder: its losses compared with NumPy, determinism, early stopping and options."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from class_rows import class_rows, text_vectors

from radartwin.recognize.encoder import Encoder, Settings
from radartwin.recognize.losses import text_loss
from radartwin.recognize.networks import TWO_LAYERS
from radartwin.recognize.samples import MEASURED, SIMULATED, Samples, join
from radartwin.recognize.split import Split, draw_shots, label_free
from radartwin.recognize.training import fit, held_out, train

OBJECTS = ("can", "mug", "bottle")
SETTINGS = Settings(hidden=16, epochs=30, batch=64)
ANCHORS = text_vectors(OBJECTS, 8)


def rows(domain: str, seed: int, each: int = 3, copies: int = 4) -> Samples:
    return class_rows(domain, seed, OBJECTS, 5, each, copies)


def split() -> Split:
    return label_free(rows(SIMULATED, 1), rows(MEASURED, 2, copies=1))


def test_early_stopping_uses_simulated_recordings():
    data = split()
    held = held_out(data.simulated, seed=0)
    assert held <= set(data.simulated.recording)
    assert sorted(name.split()[1] for name in held) == sorted(OBJECTS)
    mask = np.isin(data.train.recording, list(held))
    patient = replace(SETTINGS, patience=3)
    _, losses = train(TWO_LAYERS, data.train.take(~mask), data.train.take(mask), ANCHORS, patient, 0, SETTINGS.epochs)
    trained = fit(data, ANCHORS, patient)
    assert trained.epochs == int(np.argmin(losses)) + 1
    assert len(losses) <= min(SETTINGS.epochs, trained.epochs + 3)


def test_the_loss_is_info_nce_from_radar_to_text():
    import torch
    from scipy.special import log_softmax

    rng = np.random.default_rng(0)
    z = rng.normal(size=(6, 8))
    z /= np.linalg.norm(z, axis=1, keepdims=True)
    y, texts = np.array([0, 0, 1, 1, 1, 0]), np.stack([ANCHORS[label] for label in OBJECTS])  # no row of the data belongs to the third text
    weight = torch.ones(3).double()
    loss = float(text_loss(torch.from_numpy(z), torch.from_numpy(y), torch.from_numpy(texts).double(), weight, SETTINGS.temperature))
    logits = z @ texts.T / SETTINGS.temperature
    assert loss == pytest.approx(-np.mean(log_softmax(logits, axis=1)[np.arange(6), y]))


def test_the_paired_term_needs_labels_and_moves_pairs_together():
    with pytest.raises(ValueError, match="few_shot"):
        fit(split(), ANCHORS, replace(SETTINGS, paired=1.0))
    simulated, measured = rows(SIMULATED, 1), rows(MEASURED, 2, each=6, copies=1)
    shifted = measured.with_values(measured.values + 1.5)  # measured features shifted by a constant difference from the simulated features
    known, rest = draw_shots(shifted, 3, seed=0)
    data = Split("few_shot", join(simulated, known), rest, 3)

    def apart(paired: float) -> float:
        encoder = fit(data, ANCHORS, replace(SETTINGS, paired=paired, epochs=20)).encoder
        cosines = []
        for label, stratum in sorted(set(zip(known.label, known.stratum, strict=True))):
            here = (simulated.label == label) & (simulated.stratum == stratum)
            there = (known.label == label) & (known.stratum == stratum)
            if here.any():
                cosines.append(float((encoder.embed(simulated.values[here]) @ encoder.embed(known.values[there]).T).mean()))
        return float(np.mean(cosines))

    assert apart(1.0) > apart(0.0)


def test_messages_name_the_mistake():
    with pytest.raises(ValueError, match=r"features of shape \(N, 5\)"):
        fit(split(), ANCHORS, replace(SETTINGS, epochs=1)).encoder.embed(np.zeros((2, 4)))
    with pytest.raises(ValueError, match="not those of two layers"):
        Encoder({"hidden_weight": np.zeros((2, 2), np.float32)})


def test_training_without_simulated_rows_takes_all_epochs():
    known, rest = draw_shots(rows(MEASURED, 2, each=4, copies=1), 2, seed=0)
    assert fit(Split("few_shot", known, rest, 2), ANCHORS, SETTINGS).epochs == SETTINGS.epochs
