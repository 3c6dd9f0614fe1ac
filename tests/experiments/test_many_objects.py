"""Tests of the table many_objects on synthetic recordings of objects of the assortment."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from fake_campaign import STILL, FakeCampaign, config, draw_all, find, sides_of

from experiments.recognition import many_objects
from experiments.recognition.copies import copies
from experiments.recognition.labelled_probe import PRETRAINED, RAW, RIVAL
from experiments.recognition.protocol import scaled
from experiments.recognition.readings import by_side
from radartwin.errors import ConfigError
from radartwin.runs.experiment import Result, check_result
from radartwin.scene.objects.assortment import assortment
from radartwin.store.products import Store

OBJECTS = [entry.name for kind in ("food can", "mug", "flat bottle", "round bottle") for entry in assortment()[kind][:2]]


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> Result:
    def source(gap: float) -> FakeCampaign:
        return FakeCampaign(objects=OBJECTS, frames=24, repetitions=2, turns=2, gap=gap)

    settings = config("many_objects", "supervision.copies=3", "supervision.seeds=2", "supervision.encoder.epochs=10", *STILL)
    sides, store = {PRETRAINED: source(0.1), RIVAL: source(0.5)}, Store(tmp_path_factory.mktemp("many"))
    frame = sides_of(sides)
    rows = {name: scaled(copies(store, sides, settings, of)) for name, of in by_side(frame).items()}
    return many_objects.score(settings, frame, rows)


def test_the_simulation_of_the_object_itself_recognises_it_and_that_of_another_does_not(result: Result) -> None:
    check_result(result)
    accuracy = {
        method: find(result, metric="accuracy", method=method, attribute=None, **{"labels per class": 0})["value"]
        for method in (RAW, PRETRAINED, many_objects.OTHER)
    }
    assert accuracy[PRETRAINED] > 0.5  # chance is 1 in 8
    assert accuracy[many_objects.OTHER] < 0.25
    loss = find(result, method=f"{PRETRAINED} - {many_objects.OTHER}", **{"labels per class": 0})
    assert loss["value"] == pytest.approx(accuracy[PRETRAINED] - accuracy[many_objects.OTHER])
    assert draw_all(result) == {"many_objects"}


def test_the_primary_endpoint_is_the_mean_over_labels_and_states_the_claim(result: Result) -> None:
    gains = {row["labels per class"]: row for row in result.rows if row.get("method") == f"{PRETRAINED} - {RAW}"}
    assert gains["1, 2 and 4"]["value"] == pytest.approx(np.mean([gains[k]["value"] for k in (1, 2, 4)]))
    assert [bool(row["claim"]) for row in gains.values()] == [False] * 4 + [True]
    assert gains["1, 2 and 4"]["test"] == "permutation"
    assert gains["1, 2 and 4"]["n"] == len(OBJECTS) * 2 * 2  # objects, distances and repetitions


def test_labels_are_saved_where_the_encoder_is_better_without_labels_than_raw_features_with_one() -> None:
    import pandas as pd

    curves = {f"{PRETRAINED}, 0": 0.5, f"{RAW}, 0": 0.1, f"{RAW}, 1": 0.4, f"{RAW}, 2": 0.6, f"{RAW}, 4": 0.7}
    places = {"object": ["mug", "can"], "room": "void", "motion": "turntable", "distance_m": 1.0}
    estimate = many_objects._saved(0)(pd.DataFrame({**places, **{name: [value] * 2 for name, value in curves.items()}}), 20, 0)
    assert estimate.value == pytest.approx(1.5)  # halfway between the accuracies with one and with two labels


def test_every_object_has_the_model_of_another_object_of_its_kind() -> None:
    kinds = {entry.name: kind for kind, entries in assortment().items() for entry in entries}
    other = many_objects.another_of_its_kind(list(kinds))
    assert sorted(other.values()) == sorted(kinds)
    assert all(kinds[name] == kinds[model] and name != model for name, model in other.items())


def test_the_set_turns_without_room_and_needs_the_testbed(tmp_path: Path) -> None:
    settings = many_objects.of_assortment(config("many_objects", "profile=paper"))
    assert len(settings.profile.campaign.turntable_objects) >= 48
    assert (settings.profile.campaign.turntable_room, settings.measured.gap.person, settings.measured.gap.clutter) == ("void", 0.0, 0.0)
    settings.measured.provider = "recordings"
    with pytest.raises(ConfigError, match="use measured=testbed"):
        many_objects.of_assortment(settings)
