"""Poses of sensors and bodies at given places."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation


def placed(places_m: ArrayLike, turn: Rotation | None = None) -> np.ndarray:
    """Return the poses (F, 4, 4) at places (F, 3), with one rotation or F rotations."""
    places_m = np.asarray(places_m, float)
    poses = np.tile(np.eye(4), (len(places_m), 1, 1))
    poses[:, :3, 3] = places_m
    if turn is not None:
        poses[:, :3, :3] = turn.as_matrix()
    return poses


def turning(axis: str, angles_rad: ArrayLike, place_m: ArrayLike = (0.0, 0.0, 0.0)) -> np.ndarray:
    """Return the poses (F, 4, 4) at one place that are turned about an axis by F angles."""
    angles = np.atleast_1d(np.asarray(angles_rad, float))
    return placed(np.tile(place_m, (len(angles), 1)), Rotation.from_euler(axis, angles[:, None]))


def posed(places_m: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """Return the sensor poses (F, 4, 4) at places whose antenna axis, the sensor's z, is `axes` (F, 3) and that look at the origin."""
    z = axes / np.linalg.norm(axes, axis=1, keepdims=True)
    x = -places_m - np.einsum("ni,ni->n", -places_m, z)[:, None] * z
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    return placed(places_m, Rotation.from_matrix(np.stack([x, np.cross(z, x), z], axis=2)))
