"""Tests of exported classifiers: a saved model is unchanged after loading, loading runs no code, and a damaged file
gives a one-line error.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from made_files import recogniser

from radartwin.errors import UserError
from radartwin.recognize.encoder import Encoder
from radartwin.recognize.model import ARRAYS, DESCRIPTION, Recogniser


def test_a_saved_model_predicts_the_same_after_loading(tmp_path: Path):
    one = recogniser()
    two = Recogniser.load(one.save(tmp_path / "model"))
    values = np.random.default_rng(1).normal(size=(7, 4))
    assert np.array_equal(one.probabilities(values), two.probabilities(values))
    assert (two.classes, two.names, two.features, two.provenance) == (one.classes, one.names, one.features, one.provenance)
    other = values.copy()
    other[:, 2] = 1e6  # a feature that was constant in training
    assert np.array_equal(one.probabilities(values), one.probabilities(other))


def test_probabilities_are_a_softmax_of_cosines():
    """The probabilities of a unit embedding along the second class prototype have a closed form, which is tested at two softmax
    temperatures.
    """
    eye = np.eye(3, dtype=np.float32)
    weights = {"hidden_weight": eye, "hidden_bias": np.zeros(3, np.float32), "output_weight": eye, "output_bias": np.zeros(3, np.float32)}
    for temperature, e in ((1.0, np.e), (0.5, np.e**2)):
        one = Recogniser(Encoder(weights), ("x", "y", "z"), eye, temperature, ("a", "b", "c"), {}, np.zeros(3), np.ones(3))
        assert one.probabilities(np.array([[0.0, 9.0, -4.0]]))[0] == pytest.approx([1 / (2 + e), e / (2 + e), 1 / (2 + e)])


@pytest.mark.parametrize(
    "damage", ["truncated", "other arrays", "no json", "not json", "a class too many", "pickle", "list", "no features"]
)
def test_a_damaged_model_gives_a_one_line_error(tmp_path: Path, damage: str):
    folder = recogniser().save(tmp_path / "model")
    arrays, described = folder / ARRAYS, json.loads((folder / DESCRIPTION).read_text())
    if damage == "truncated":
        arrays.write_bytes(arrays.read_bytes()[:-8])
    elif damage == "other arrays":
        arrays.write_bytes((recogniser(features=4, text=6).save(tmp_path / "other") / ARRAYS).read_bytes())
    elif damage == "no json":
        (folder / DESCRIPTION).unlink()
    elif damage == "not json":
        (folder / DESCRIPTION).write_text("{")
    elif damage == "pickle":
        arrays.write_bytes(b"\x80\x04cposix\nsystem\n")
    elif damage == "list":
        (folder / DESCRIPTION).write_text("[]")
    else:
        described |= {"classes": [*described["classes"], "extra"]} if damage == "a class too many" else {"features": None}
        (folder / DESCRIPTION).write_text(json.dumps(described))
    with pytest.raises(UserError) as caught:
        Recogniser.load(folder)
    assert str(folder) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_rows_with_other_features_are_refused():
    with pytest.raises(ValueError, match="4 features"):
        recogniser().probabilities(np.zeros((1, 3)))
    with pytest.raises(ValueError, match="finite"):
        recogniser().probabilities(np.full((1, 4), np.nan))
