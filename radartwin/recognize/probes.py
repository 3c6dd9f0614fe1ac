"""Classifiers on given features: nearest centroids, linear probes, random forest with a vote, matching of whole signatures.

Paper, recognition with simulation-trained representations (leave-one-out nearest-centroid probe, also within strata of equal distance),
contrastive alignment (linear probes) and scene-level recognition (random forest on frames, majority vote per recording; matching of raw
signatures). Predictions are per recording, (n,), in the order of `Samples.per_recording`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import InputError
from radartwin.recognize.samples import Samples, Unlabelled
from radartwin.recognize.split import Split

TREES = 100
FOLDS = 12  # the number of objects, so that each object is left out alone


def leave_one_out_centroid(rows: Samples, groups: NDArray | None = None, stratified: bool = False) -> NDArray[np.str_]:
    """(N,): class of the nearest centroid (Euclidean) of all rows of other groups; ties go to the first class by name.

    Args:
        rows: features on comparable scales.
        groups: (N,) rows with equal entries are left out together; None: the rows of a recording.
        stratified: take centroids of the row's own stratum only.
    Raises:
        InputError: fewer than two classes remain without a group.
    """
    groups = rows.recording if groups is None else groups
    classes, kind = np.unique(rows.label, return_inverse=True)
    answer = np.empty(len(rows), dtype=rows.label.dtype)
    for stratum in np.unique(rows.stratum) if stratified else [None]:
        here = np.flatnonzero(rows.stratum == stratum) if stratum is not None else np.arange(len(rows))
        sums, counts = _sums(rows.values[here], kind[here], len(classes))
        for group in np.unique(groups[here]):
            out = here[groups[here] == group]
            own, own_counts = _sums(rows.values[out], kind[out], len(classes))
            left = counts - own_counts
            if (left > 0).sum() < 2:
                raise InputError(f"leave-one-out: without {group} fewer than two classes remain; record more objects")
            centroids = (sums - own) / np.maximum(left, 1)[:, None]
            away = ((rows.values[out][:, None] - centroids) ** 2).sum(axis=2)
            answer[out] = classes[np.where(left > 0, away, np.inf).argmin(axis=1)]
    return answer


def nearest_centroid(train: Samples, test: Unlabelled) -> NDArray[np.str_]:
    """(N,): class of the nearest centroid of the training rows; ties go to the first class by name.

    scikit-learn's NearestCentroid divides by zero if every class has one row.
    """
    classes, kind = np.unique(train.label, return_inverse=True)
    sums, counts = _sums(train.values, kind, len(classes))
    return classes[((test.values[:, None] - sums / counts[:, None]) ** 2).sum(axis=2).argmin(axis=1)]


def _sums(values: NDArray, kind: NDArray, classes: int) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Sum (K, D) and number (K,) of the rows of each class."""
    sums = np.zeros((classes, values.shape[1]))
    np.add.at(sums, kind, values)
    return sums, np.bincount(kind, minlength=classes)


def linear_probe(recordings: Samples, groups: NDArray) -> NDArray[np.str_]:
    """(N,): logistic regression trained on other groups, with equal class weights, in FOLDS folds of whole groups.

    Args:
        recordings: features on comparable scales.
        groups: (N,) rows with equal entries are left out together: recordings, or objects.
    """
    from sklearn.linear_model import LogisticRegression
    from sklearn.model_selection import GroupKFold, cross_val_predict

    probe = LogisticRegression(max_iter=5000, class_weight="balanced")
    folds = GroupKFold(min(FOLDS, np.unique(groups).size))
    return np.asarray(cross_val_predict(probe, recordings.values, recordings.label, groups=groups, cv=folds))


def transferred_probe(split: Split) -> NDArray[np.str_]:
    """(N,): logistic regression trained on the training rows, for each row to score."""
    from sklearn.linear_model import LogisticRegression

    probe = LogisticRegression(max_iter=5000, class_weight="balanced").fit(split.train.values, split.train.label)
    return probe.predict(split.unlabelled.values)


def forest(split: Split, seed: int, trees: int = TREES) -> NDArray[np.str_]:
    """(recordings,): random forest trained on frames, then the majority vote of the frames of each recording."""
    from sklearn.ensemble import RandomForestClassifier

    trained = RandomForestClassifier(trees, class_weight="balanced", random_state=seed, n_jobs=1).fit(split.train.values, split.train.label)
    return vote(split.unlabelled.recording, trained.predict_proba(split.unlabelled.values), trained.classes_)


def vote(recording: NDArray[np.str_], scores: NDArray[np.float64], classes: NDArray[np.str_]) -> NDArray[np.str_]:
    """(recordings,): the most frequent class of each recording's frames, in the order of names; ties go to the larger mean score.

    Args:
        recording: (N,) of each frame. scores: (N, K) of each frame and class.
    """
    names, inverse = np.unique(recording, return_inverse=True)
    votes = np.zeros((len(names), len(classes)))
    np.add.at(votes, (inverse, scores.argmax(axis=1)), 1.0)
    means = np.zeros_like(votes)
    np.add.at(means, inverse, scores)
    means /= np.bincount(inverse)[:, None]
    top = votes == votes.max(axis=1, keepdims=True)
    return classes[np.where(top, means, -np.inf).argmax(axis=1)]


def match_signatures(split: Split) -> NDArray[np.str_]:
    """(recordings,): label of the training signature with the highest Pearson correlation, within the recording's stratum if possible.

    A signature is one row, such as a flattened range-time map in decibels.

    Raises:
        InputError: a signature is constant.
    """
    train, test = split.train, split.unlabelled
    scores = _unit(train.values, train.recording) @ _unit(test.values, test.recording).T
    same = train.stratum[:, None] == test.stratum
    scores = np.where(same | ~same.any(axis=0), scores, -np.inf)
    return train.label[scores.argmax(axis=0)]


def _unit(rows: NDArray, recording: NDArray) -> NDArray:
    centred = rows - rows.mean(axis=1, keepdims=True)
    norm = np.linalg.norm(centred, axis=1, keepdims=True)
    if not (norm > 0).all():
        raise InputError(f"the signature of recording {recording[int(norm.argmin())]} is constant; check the recording")
    return centred / norm


def standardised(samples: Samples, reference: Unlabelled | None = None) -> Samples:
    """Features with the mean and standard deviation of the reference rows (default: the samples' own) removed.

    A constant feature becomes zero.
    """
    rows = (samples if reference is None else reference).values
    spread = rows.std(axis=0)
    return samples.with_values((samples.values - rows.mean(axis=0)) / np.where(spread > 0, spread, np.inf))
