"""Classify feature rows by nearest class centroid, logistic regression, a random forest with a vote, or matching of whole signatures.

The nearest-centroid classifier follows the paper's section on simulation-trained representations: it leaves one recording out, and may
compare only rows of one stratum, such as equal distance. Logistic regression on embeddings follows the paper's section on contrastive
alignment. The random forest on frames with a majority vote per recording and the matching of raw signatures follow the paper's section on
scene-level recognition. A result of shape (recordings,) holds one class per recording, in the order of `Samples.per_recording`.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import InputError
from radartwin.recognize.samples import Samples, Unlabelled
from radartwin.recognize.split import Split

FLOOR = Path(__file__).with_name("feature_floor.json")
FOLDS = 12  # number of cross-validation folds; it equals the number of objects, so that each fold can leave out one object


def leave_one_out_centroid(rows: Samples, groups: NDArray | None = None, stratified: bool = False) -> NDArray[np.str_]:
    """Return for each feature row (N,) the class whose centroid is nearest (Euclidean), with centroids of the rows of all other groups.

    If two centroids are equally near, the first class by name is returned.

    Args:
        rows: feature rows with class labels; the features have comparable scales.
        groups: (N,) names of groups; a row is classified with training rows of all groups but its own. None makes one group per recording.
        stratified: True computes the centroids only from rows of the same stratum (recording condition, such as the distance).
    Raises:
        InputError: fewer than two classes remain when one group is left out.
    """
    groups = rows.recording if groups is None else groups
    classes, kind = np.unique(rows.label, return_inverse=True)
    answer = np.empty(len(rows), dtype=rows.label.dtype)
    for stratum in np.unique(rows.stratum) if stratified else [None]:
        here = np.flatnonzero(rows.stratum == stratum) if stratum is not None else np.arange(len(rows))
        sums, counts = _sums(rows.values[here], kind[here], len(classes))
        for group in np.unique(groups[here]):
            out = here[groups[here] == group]
            out_sums, out_counts = _sums(rows.values[out], kind[out], len(classes))
            left = counts - out_counts
            if (left > 0).sum() < 2:
                raise InputError(f"leave-one-out: without {group} fewer than two classes remain; record more objects")
            centroids = (sums - out_sums) / np.maximum(left, 1)[:, None]
            away = ((rows.values[out][:, None] - centroids) ** 2).sum(axis=2)
            answer[out] = classes[np.where(left > 0, away, np.inf).argmin(axis=1)]
    return answer


def nearest_centroid(train: Samples, test: Unlabelled) -> NDArray[np.str_]:
    """Return for each test row (N,) the class with the nearest centroid of training rows; for equal distances, the first class by name."""
    # This function does not use scikit-learn's NearestCentroid, which divides by zero if every class has one row.
    classes, kind = np.unique(train.label, return_inverse=True)
    sums, counts = _sums(train.values, kind, len(classes))
    return classes[((test.values[:, None] - sums / counts[:, None]) ** 2).sum(axis=2).argmin(axis=1)]


def _sums(values: NDArray, kind: NDArray, classes: int) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Return for each of the K classes the sum of its feature rows (K, D) and the number of its rows (K,)."""
    sums = np.zeros((classes, values.shape[1]))
    np.add.at(sums, kind, values)
    return sums, np.bincount(kind, minlength=classes)


def linear_probe(recordings: Samples, groups: NDArray) -> NDArray[np.str_]:
    """Return for each row (N,) the class that logistic regression predicts after training on rows of other groups.

    The cross-validation has FOLDS folds, each of whole groups. Every class has the same total weight in the training.

    Args:
        recordings: feature rows with class labels; the features have comparable scales.
        groups: (N,) group name of each row, such as its recording or its object; the rows of a group are always in the same fold.
    """
    from sklearn.model_selection import GroupKFold, cross_val_predict

    folds = GroupKFold(min(FOLDS, np.unique(groups).size))
    return np.asarray(cross_val_predict(logistic_regression(), recordings.values, recordings.label, groups=groups, cv=folds))


def transferred_probe(split: Split) -> NDArray[np.str_]:
    """Return for each test row (N,) the class that logistic regression predicts after training on the split's training rows."""
    return logistic_regression().fit(split.train.values, split.train.label).predict(split.unlabelled.values)


def logistic_regression():
    """Return an untrained scikit-learn logistic regression in which every class has the same total weight."""
    from sklearn.linear_model import LogisticRegression

    return LogisticRegression(max_iter=5000, class_weight="balanced")


def forest(split: Split, seed: int, trees: int) -> NDArray[np.str_]:
    """Return a class per recording (recordings,): a random forest classifies each frame, and the frames of a recording vote."""
    from sklearn.ensemble import RandomForestClassifier

    trained = RandomForestClassifier(trees, class_weight="balanced", random_state=seed, n_jobs=1).fit(split.train.values, split.train.label)
    return vote(split.unlabelled.recording, trained.predict_proba(split.unlabelled.values), trained.classes_)


def vote(recording: NDArray[np.str_], scores: NDArray[np.float64], classes: NDArray[np.str_]) -> NDArray[np.str_]:
    """Return the most frequent class among each recording's frames (recordings,), sorted by the recordings' names.

    If two classes have equally many frames, the class with the larger mean score is returned.

    Args:
        recording: (N,) name of the recording that each frame belongs to.
        scores: (N, K) score of each class for each frame.
        classes: (K,) names of the classes.
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
    """Return for each test recording (recordings,) the class of the training signature with the highest Pearson correlation.

    A signature is one feature row, such as a flattened range-time map in decibels. If training signatures exist in the stratum (recording
    condition) of the test recording, only these training signatures are compared.

    Raises:
        InputError: a signature has the same value everywhere, so its correlation is undefined.
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


def standardised(samples: Samples, floor: NDArray | float = 0.0) -> Samples:
    """Scale each feature to zero mean and unit standard deviation over all rows; a feature with constant value becomes zero.

    Args:
        floor: (D,) smallest standard deviation by which a feature is divided, such as its repeatability. A feature that varies less over
            the rows than between two recordings of the same object carries no information, and division by the standard deviation of this
            feature would amplify numerical noise.
    """
    spread = np.maximum(samples.values.std(axis=0), floor)
    return samples.with_values((samples.values - samples.values.mean(axis=0)) / np.where(spread > 0, spread, np.inf))


def repeatability(names: Sequence[str]) -> NDArray[np.float64]:
    """Return the standard deviation (D,) of features of a turntable revolution between two recordings of the same object, set up anew.

    A feature without a known repeatability has 0.

    >>> bool(repeatability(["harmonic_1"])[0] > 0.01)
    True
    """
    known = _deviations()
    return np.array([known.get(name, 0.0) for name in names])


@functools.cache
def _deviations() -> dict[str, float]:
    return json.loads(FLOOR.read_text(encoding="utf-8"))["deviation"]
