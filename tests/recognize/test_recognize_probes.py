"""Compare the linear classifiers, votes and scores with scikit-learn, scipy and counts."""

from __future__ import annotations

import numpy as np
import pytest
from class_rows import class_rows

from radartwin.recognize import probes, score
from radartwin.recognize.samples import MEASURED, SIMULATED, Part, Samples, gather
from radartwin.recognize.split import label_free


def clusters(domain: str, seed: int, spread: float = 1.0) -> Samples:
    return class_rows(domain, seed, ("k0", "k1", "k2", "k3"), 3, 6, spread=spread, strata=2)


def test_leave_one_out_centroid_matches_scikit_learn():
    from sklearn.model_selection import LeaveOneOut, cross_val_predict
    from sklearn.neighbors import NearestCentroid

    rows = clusters(MEASURED, 1)
    expected = np.asarray(cross_val_predict(NearestCentroid(), rows.values, rows.label, cv=LeaveOneOut()))
    assert np.array_equal(probes.leave_one_out_centroid(rows), expected)
    for stratum in ("0 m", "1 m"):
        here = rows.stratum == stratum
        of_stratum = rows.take(here)
        expected = np.asarray(cross_val_predict(NearestCentroid(), of_stratum.values, of_stratum.label, cv=LeaveOneOut()))
        assert np.array_equal(probes.leave_one_out_centroid(rows, stratified=True)[here], expected)


def test_groups_are_left_out_together():
    """Each row has a second row of the same group far from the other rows of their class. The expected classes leave out both."""
    rng = np.random.default_rng(0)
    parts = []
    for kind in range(3):
        for pair in range(4):
            place = 10 * rng.normal(size=3)
            parts += [Part(f"{kind} {pair} {twin}", f"k{kind}", MEASURED, place, source=f"{kind} {pair}") for twin in range(2)]
    rows = gather(("a", "b", "c"), parts)
    by_hand = []
    for row in range(len(rows)):
        rest = rows.source != rows.source[row]
        centres = {label: rows.values[rest & (rows.label == label)].mean(axis=0) for label in rows.classes}
        by_hand.append(min(centres, key=lambda label: float(np.linalg.norm(rows.values[row] - centres[label]))))
    assert probes.leave_one_out_centroid(rows, rows.source).tolist() == by_hand


def test_nearest_centroid_matches_scikit_learn_and_takes_one_row_per_class():
    from sklearn.neighbors import NearestCentroid

    train, test = clusters(SIMULATED, 1), clusters(MEASURED, 2)
    expected = NearestCentroid().fit(train.values, train.label).predict(test.values)
    assert np.array_equal(probes.nearest_centroid(train, test), expected)
    single = train.take([0, 6, 12, 18])
    assert probes.nearest_centroid(single, single).tolist() == single.label.tolist()


def test_a_vote_takes_the_majority_and_ties_go_to_the_larger_mean_score():
    scores = np.array([[0.6, 0.4], [0.6, 0.4], [0.0, 1.0], [0.9, 0.1], [0.4, 0.6]])
    recording = np.array(["b", "b", "b", "a", "a"])
    assert probes.vote(recording, scores, np.array(["x", "y"])).tolist() == ["x", "x"]
    assert probes.vote(recording[3:], np.array([[0.6, 0.4], [0.1, 0.9]]), np.array(["x", "y"])).tolist() == ["y"]


def test_signatures_match_within_their_stratum_at_any_level():
    rng = np.random.default_rng(0)
    shapes = rng.normal(size=(3, 50))
    train = [
        Part(f"t{kind} {place}", f"k{kind}", SIMULATED, shapes[(kind + place) % 3], f"{place} m") for kind in range(3) for place in range(2)
    ]
    test = [Part(f"m{kind}", f"k{kind}", MEASURED, 5 + 0.1 * shapes[(kind + 1) % 3], "1 m") for kind in range(3)]
    names = [str(number) for number in range(50)]
    assert probes.match_signatures(label_free(gather(names, train), gather(names, test))).tolist() == ["k0", "k1", "k2"]


def test_a_probe_across_objects_does_not_use_the_objects_own_rows():
    """Rows of an object reveal its class, but the rows of the other three objects of the class do not."""
    rng = np.random.default_rng(3)
    centres = 5 * rng.normal(size=(8, 10))
    parts = [Part(f"o{kind} {n}", f"o{kind}", MEASURED, centres[kind] + 0.1 * rng.normal(size=10)) for kind in range(8) for n in range(5)]
    rows = gather(tuple("abcdefghij"), parts)
    classes = {f"o{kind}": "even" if kind % 2 == 0 else "odd" for kind in range(8)}
    truth = rows.relabelled(classes)
    assert (probes.linear_probe(truth, rows.recording) == truth.label).mean() > 0.9
    assert (probes.linear_probe(truth, rows.label) == truth.label).mean() < 0.8


def test_standardised_features_have_zero_mean_and_unit_spread():
    rows = clusters(MEASURED, 5).with_values(np.column_stack([clusters(MEASURED, 5).values[:, :2], np.ones(24)]))
    scaled = probes.standardised(rows)
    assert scaled.values.mean(axis=0) == pytest.approx(np.zeros(3), abs=1e-12)
    assert scaled.values.std(axis=0) == pytest.approx([1, 1, 0])


def test_chance_and_majority_match_counts():
    rows = clusters(MEASURED, 1)
    assert score.uniform_chance(rows) == pytest.approx(1 / 4)
    assert score.majority_share(rows.relabelled({"k0": "x", "k1": "x", "k2": "x", "k3": "y"})) == pytest.approx(3 / 4)
    one_stratum_of_two = rows.take((rows.stratum == "0 m") | np.isin(rows.label, ["k0", "k1"]))
    assert score.uniform_chance(one_stratum_of_two) == pytest.approx((12 / 4 + 6 / 2) / 18)


def test_dependent_recordings_widen_the_interval():
    """Ten groups of ten dependent recordings have the interval of ten trials, which is sqrt(10) wider than that of a hundred."""
    right = np.repeat(np.arange(10) < 5, 10)
    groups = np.repeat(np.arange(10), 10)
    together, drawn_together = score.seed_mean(right, groups, 4000, 0)
    apart, drawn_apart = score.seed_mean(right, np.arange(100), 4000, 0)
    assert together == apart == 0.5
    assert drawn_together.std() / drawn_apart.std() == pytest.approx(np.sqrt(10), rel=0.15)


def test_balanced_intervals_stay_between_zero_and_one():
    truth = np.array(["a"] * 30 + ["b"] * 3)
    right = np.ones(33)
    value, drawn = score.seed_mean(right, np.arange(33), 500, 0, truth)
    assert value == drawn.min() == drawn.max() == 1
    right[30:] = [1, 0, 0]
    value, drawn = score.seed_mean(right, np.arange(33), 500, 0, truth)
    assert value == pytest.approx((1 + 1 / 3) / 2)
    assert 0.5 <= drawn.min() < value < drawn.max() <= 1


def test_objects_are_the_clusters_of_their_classes() -> None:
    parts = [Part(f"r{n}{name}", name, MEASURED, np.zeros(1), stratum="1 m") for name in ("can", "mug") for n in range(2)]
    rows = gather(("a",), parts).relabelled({"can": "symmetric", "mug": "symmetric"})
    assert set(rows.label) == {"symmetric"}
    assert sorted(rows.object) == ["can", "can", "mug", "mug"]
