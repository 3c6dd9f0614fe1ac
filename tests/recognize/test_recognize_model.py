"""A saved model is unchanged after loading, loading runs no code, and a damaged file gives a one-line error."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from made_files import edit_json, recogniser, refused

from radartwin.recognize.encoder import Encoder
from radartwin.recognize.model import ARRAYS, DESCRIPTION, Recogniser


def test_a_saved_model_predicts_the_same_after_loading(tmp_path: Path):
    saved = recogniser()
    loaded = Recogniser.load(saved.save(tmp_path / "model"))
    values = np.random.default_rng(1).normal(size=(7, 4))
    assert np.array_equal(saved.probabilities(values), loaded.probabilities(values))
    assert (loaded.classes, loaded.names, loaded.features, loaded.provenance) == (
        saved.classes,
        saved.names,
        saved.features,
        saved.provenance,
    )
    other = values.copy()
    other[:, 2] = 1e6  # a feature that was constant in training
    assert np.array_equal(saved.probabilities(values), saved.probabilities(other))


def test_probabilities_are_a_softmax_of_cosines():
    """The probabilities of a unit embedding along the second prototype have a closed form."""
    eye = np.eye(3, dtype=np.float32)
    weights = {"hidden_weight": eye, "hidden_bias": np.zeros(3, np.float32), "output_weight": eye, "output_bias": np.zeros(3, np.float32)}
    for temperature, e in ((1.0, np.e), (0.5, np.e**2)):
        model = Recogniser(Encoder(weights), ("x", "y", "z"), eye, temperature, ("a", "b", "c"), {}, np.zeros(3), np.ones(3))
        assert model.probabilities(np.array([[0.0, 9.0, -4.0]]))[0] == pytest.approx([1 / (2 + e), e / (2 + e), 1 / (2 + e)])


DAMAGE: dict[str, Callable[[Path], object]] = {
    "truncated": lambda folder: (folder / ARRAYS).write_bytes((folder / ARRAYS).read_bytes()[:-8]),
    "other arrays": lambda folder: recogniser(features=4, text=6).save(folder / "other").joinpath(ARRAYS).replace(folder / ARRAYS),
    "pickle": lambda folder: (folder / ARRAYS).write_bytes(b"\x80\x04cposix\nsystem\n"),
    "no json": lambda folder: (folder / DESCRIPTION).unlink(),
    "not json": lambda folder: (folder / DESCRIPTION).write_text("{"),
    "list": lambda folder: (folder / DESCRIPTION).write_text("[]"),
    "a class too many": lambda folder: edit_json(folder / DESCRIPTION, classes=["can", "mug", "bottle", "extra"]),
    "no features": lambda folder: edit_json(folder / DESCRIPTION, features=None),
}


@pytest.mark.parametrize("damage", DAMAGE)
def test_a_damaged_model_gives_a_one_line_error(tmp_path: Path, damage: str):
    folder = recogniser().save(tmp_path / "model")
    DAMAGE[damage](folder)
    refused([str(folder)], Recogniser.load, folder)


def test_rows_with_other_features_are_refused():
    with pytest.raises(ValueError, match="4 features"):
        recogniser().probabilities(np.zeros((1, 3)))
    with pytest.raises(ValueError, match="finite"):
        recogniser().probabilities(np.full((1, 4), np.nan))
