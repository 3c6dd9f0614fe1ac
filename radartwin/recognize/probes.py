"""Recognisers without training of their own features: centroids, linear probes, forest with a vote, whole signatures.

Paper, recognition with simulation-trained representations (leave-one-out nearest-centroid probe, also within strata of equal distance),
contrastive alignment (linear probes) and scene-level recognition (random forest on frames, majority vote per recording; matching of raw
signatures). All take what scikit-learn has. Answers are per recording, (n,), in the order of `Samples.per_recording`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import InputError
from radartwin.recognize.samples import Samples, Unlabelled
from radartwin.recognize.split import Split

TREES = 100


def leave_one_out_centroid(recordings: Samples, stratified: bool = False) -> NDArray[np.str_]:
    """The nearest class centroid for each recording, from all the others; `stratified`: from those of its own stratum.

    Args:
        recordings: one row per recording, features on comparable scales.
    Raises:
        InputError: several rows of one recording, or a stratum with recordings of one class only.
    """
    if np.unique(recordings.recording).size != len(recordings):
        raise InputError("leave-one-out: give one row per recording, or its other rows would tell its label")
    answer = np.empty(len(recordings), dtype=recordings.label.dtype)
    for stratum in np.unique(recordings.stratum) if stratified else [None]:
        rows = np.flatnonzero(recordings.stratum == stratum) if stratum is not None else np.arange(len(recordings))
        if np.unique(recordings.label[rows]).size < 2:
            raise InputError(f"leave-one-out: stratum {stratum!r} needs recordings of two classes")
        for row in rows:
            others = recordings.take(rows[rows != row])
            answer[row] = nearest_centroid(others, recordings.take([row]))[0]
    return answer


def nearest_centroid(train: Samples, test: Unlabelled) -> NDArray[np.str_]:
    """The nearest class centroid of the training rows (Euclidean), for each row; of equally near ones the first by name.

    Not scikit-learn's NearestCentroid, which divides by zero where every class has one row.
    """
    classes, inverse = np.unique(train.label, return_inverse=True)
    centroids = np.zeros((len(classes), train.values.shape[1]))
    np.add.at(centroids, inverse, train.values)
    centroids /= np.bincount(inverse)[:, None]
    return classes[((test.values[:, None] - centroids) ** 2).sum(axis=2).argmin(axis=1)]


def linear_probe(recordings: Samples, groups: NDArray) -> NDArray[np.str_]:
    """Logistic regression on each recording from those of all other groups, classes weighted alike.

    Args:
        recordings: one row per recording, features on comparable scales.
        groups: (N,) what is left out together: recordings, or objects, so that an object's class is told by other objects alone.
    """
    from sklearn.linear_model import LogisticRegression
    from sklearn.model_selection import LeaveOneGroupOut, cross_val_predict

    probe = LogisticRegression(max_iter=5000, class_weight="balanced")
    return np.asarray(cross_val_predict(probe, recordings.values, recordings.label, groups=groups, cv=LeaveOneGroupOut()))


def transferred_probe(split: Split) -> NDArray[np.str_]:
    """Logistic regression learned from the split's training rows, for each row to score."""
    from sklearn.linear_model import LogisticRegression

    probe = LogisticRegression(max_iter=5000, class_weight="balanced").fit(split.train.values, split.train.label)
    return probe.predict(split.unlabelled.values)


def forest(split: Split, seed: int, trees: int = TREES) -> NDArray[np.str_]:
    """Random forest on the frames to learn from, then the majority of a recording's frames, (recordings,)."""
    from sklearn.ensemble import RandomForestClassifier

    trained = RandomForestClassifier(trees, class_weight="balanced", random_state=seed, n_jobs=1).fit(split.train.values, split.train.label)
    return vote(split.unlabelled.recording, trained.predict_proba(split.unlabelled.values), trained.classes_)


def vote(recording: NDArray[np.str_], scores: NDArray[np.float64], classes: NDArray[np.str_]) -> NDArray[np.str_]:
    """The class most frames of a recording take, recordings in the order of their names; a tie goes to the larger mean score.

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
    """The label of the training signature that correlates best with each recording's, within its stratum where training has it.

    A signature is one row, such as a flattened range-time map in decibels; Pearson's correlation over all of it.

    Raises:
        InputError: a signature that does not vary.
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
        raise InputError(f"the signature of recording {recording[int(norm.argmin())]} does not vary, so nothing correlates with it")
    return centred / norm


def standardised(samples: Samples, reference: Unlabelled | None = None) -> Samples:
    """Features less their mean over standard deviation, of the reference rows (default: the samples' own), labels unseen.

    A feature that does not vary becomes zero.
    """
    rows = (samples if reference is None else reference).values
    spread = rows.std(axis=0)
    return samples.with_values((samples.values - rows.mean(axis=0)) / np.where(spread > 0, spread, np.inf))
