"""Normalise features by ranks: replace each value by its rank among the recordings of its domain (simulation or measurement).

u_i = (rank_i - 1/2) / n per feature; equal values have their mean rank. An increasing function of a feature does not change its ranks, so
that any such difference between the two domains disappears. The method uses no labels (paper, scene-level recognition, label-free:
per-feature rank normalisation).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import InputError


def rank_normalise(matrix: NDArray, groups: NDArray | None = None) -> NDArray[np.float64]:
    """Replace each value by its normalised rank in its column, above 0 and below 1.

    Args:
        matrix: (n, features), rows of one domain.
        groups: (n,) group of each row, such as its distance; each group is ranked separately. None ranks all rows together.
    Raises:
        InputError: values are not finite, or groups has another length.

    >>> rank_normalise(np.array([[3.0], [10.0], [10.0], [1.0]]))[:, 0].tolist()
    [0.375, 0.75, 0.75, 0.125]
    """
    from scipy.stats import rankdata

    matrix = np.asarray(matrix, dtype=np.float64)
    if matrix.ndim != 2 or not np.isfinite(matrix).all():
        raise InputError(f"rank normalisation: give a matrix (rows, features) of finite values, not {matrix.shape}")
    if groups is not None and np.shape(groups) != (len(matrix),):
        raise InputError(f"rank normalisation: {np.shape(groups)} groups for {len(matrix)} rows; give one group per row")
    ranked = np.empty_like(matrix)
    labels = np.zeros(len(matrix), dtype=int) if groups is None else np.unique(groups, return_inverse=True)[1]
    for label in range(labels.max() + 1 if len(labels) else 0):
        rows = labels == label
        ranked[rows] = (rankdata(matrix[rows], axis=0) - 0.5) / rows.sum()
    return ranked
