"""Classify given features by nearest centroids, logistic regression, a random forest with a vote, or matching of whole signatures.

Paper, recognition with simulation-trained representations (leave-one-out nearest-centroid probe, also within strata of equal distance),
contrastive alignment (linear probes: logistic regression on embeddings) and scene-level recognition (random forest on frames, majority vote
per recording; matching of raw signatures). Functions that return (recordings,) give one label per recording, in the order of
`Samples.per_recording`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import InputError
from radartwin.recognize.samples import Samples, Unlabelled
from radartwin.recognize.split import Split

FOLDS = 12  # equals the number of objects, so that each fold leaves out one object


def leave_one_out_centroid(rows: Samples, groups: NDArray | None = None, stratified: bool = False) -> NDArray[np.str_]:
    """Return for each row (N,) the class of the nearest centroid (Euclidean), computed from the rows of all other groups.

    Ties go to the first class by name.

    Args:
        rows: features on comparable scales.
        groups: (N,) rows with equal entries are left out together; None leaves out all rows of a recording together.
        stratified: compute the centroids from the row's own stratum only.
    Raises:
        InputError: fewer than two classes remain when a group is left out.
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
    """Return for each test row (N,) the class of the nearest centroid of the training rows; ties go to the first class by name."""
    # scikit-learn's NearestCentroid is not used, because it divides by zero if every class has one row.
    classes, kind = np.unique(train.label, return_inverse=True)
    sums, counts = _sums(train.values, kind, len(classes))
    return classes[((test.values[:, None] - sums / counts[:, None]) ** 2).sum(axis=2).argmin(axis=1)]


def _sums(values: NDArray, kind: NDArray, classes: int) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Return the sum (K, D) and the number (K,) of the rows of each class."""
    sums = np.zeros((classes, values.shape[1]))
    np.add.at(sums, kind, values)
    return sums, np.bincount(kind, minlength=classes)


def linear_probe(recordings: Samples, groups: NDArray) -> NDArray[np.str_]:
    """Return for each row (N,) the class that logistic regression predicts after training on other groups.

    Cross-validation with FOLDS folds of whole groups; every class has the same total weight.

    Args:
        recordings: features on comparable scales.
        groups: (N,) rows with equal entries are left out together: recordings, or objects.
    """
    from sklearn.model_selection import GroupKFold, cross_val_predict

    folds = GroupKFold(min(FOLDS, np.unique(groups).size))
    return np.asarray(cross_val_predict(logistic_regression(), recordings.values, recordings.label, groups=groups, cv=folds))


def transferred_probe(split: Split) -> NDArray[np.str_]:
    """Return for each test row (N,) the class that logistic regression predicts after training on the training rows."""
    return logistic_regression().fit(split.train.values, split.train.label).predict(split.unlabelled.values)


def logistic_regression():
    """Return an untrained logistic regression of scikit-learn in which every class has the same total weight."""
    from sklearn.linear_model import LogisticRegression

    return LogisticRegression(max_iter=5000, class_weight="balanced")


def forest(split: Split, seed: int, trees: int) -> NDArray[np.str_]:
    """Return a label per recording (recordings,): a random forest classifies each frame, and the frames of a recording vote."""
    from sklearn.ensemble import RandomForestClassifier

    trained = RandomForestClassifier(trees, class_weight="balanced", random_state=seed, n_jobs=1).fit(split.train.values, split.train.label)
    return vote(split.unlabelled.recording, trained.predict_proba(split.unlabelled.values), trained.classes_)


def vote(recording: NDArray[np.str_], scores: NDArray[np.float64], classes: NDArray[np.str_]) -> NDArray[np.str_]:
    """Return the most frequent class of each recording's frames (recordings,), sorted by recording name.

    Ties go to the class with the larger mean score.

    Args:
        recording: (N,) name of each frame's recording.
        scores: (N, K) score of each class for each frame.
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
    """Return for each test recording (recordings,) the label of the training signature with the highest Pearson correlation.

    A signature is one row, such as a flattened range-time map in decibels. Only training signatures of the
    recording's stratum are compared, if there are any.

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


def standardised(samples: Samples) -> Samples:
    """Scale each feature to zero mean and unit standard deviation over the samples; a constant feature becomes zero."""
    spread = samples.values.std(axis=0)
    return samples.with_values((samples.values - samples.values.mean(axis=0)) / np.where(spread > 0, spread, np.inf))
