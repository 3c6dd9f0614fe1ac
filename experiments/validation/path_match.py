"""Match the propagation paths of two methods by path length and by the directions at both ends."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

LENGTH_M, ANGLE_DEG = 0.005, 0.5
SAME_M, SAME_DEG = 2e-5, 0.01  # largest difference between paths of one image: a hundred times single precision at 10 m


@dataclass(frozen=True)
class PathSet:
    """N propagation paths that one method found."""

    length_m: np.ndarray  # (N,)
    departure: np.ndarray  # (N, 3) directions in the sensor frame
    arrival: np.ndarray  # (N, 3) directions in the sensor frame
    amplitude: np.ndarray  # (N,) complex, in the middle of the frequency sweep
    small: np.ndarray  # (N,) whether the path reflects at a small surface
    clear: np.ndarray  # (N,) whether the path's first Fresnel zone is known to be free of edges and obstacles

    def where(self, keep: np.ndarray) -> PathSet:
        """Return the paths that the mask or index array `keep` selects."""
        return PathSet(*(values[keep] for values in vars(self).values()))

    @property
    def level_db(self) -> np.ndarray:
        return 20 * np.log10(np.abs(self.amplitude) + 1e-30)

    def strong(self, dynamic_db: float) -> PathSet:
        """Return the paths whose level is within `dynamic_db` of the strongest path."""
        return self.where(self.level_db >= self.level_db.max(initial=-np.inf) - dynamic_db)


def together(paths: PathSet) -> PathSet:
    """Return the paths after all paths of the same image source are added into one path."""
    left, groups = np.ones(len(paths.length_m), bool), []
    for i in np.argsort(-np.abs(paths.amplitude), kind="stable"):
        if left[i]:
            same = left & (np.abs(paths.length_m - paths.length_m[i]) < SAME_M)
            same[same] &= _apart_deg(paths.where(same), paths.departure[i], paths.arrival[i]) < SAME_DEG
            same[i] = True
            left &= ~same
            groups.append((i, paths.amplitude[same].sum()))
    first = paths.where(np.array([i for i, _ in groups], int))
    return replace(first, amplitude=np.array([total for _, total in groups]))


def _apart_deg(paths: PathSet, departure: np.ndarray, arrival: np.ndarray) -> np.ndarray:
    """Return for each path (N,) the larger angle in degrees at its two ends, from chords, which are accurate for small angles."""
    chords = [np.linalg.norm(direction - other, axis=1) for direction, other in ((paths.departure, departure), (paths.arrival, arrival))]
    return np.degrees(2 * np.arcsin(np.clip(np.maximum(*chords) / 2, 0, 1)))


def partners(of: PathSet, among: PathSet) -> np.ndarray:
    """Return for each path of `of` the index of the nearest path of `among` in length and angle; -1 if none is in tolerance."""
    out = np.full(len(of.length_m), -1)
    for i in range(len(out)):
        misfit = np.maximum(
            np.abs(among.length_m - of.length_m[i]) / LENGTH_M, _apart_deg(among, of.departure[i], of.arrival[i]) / ANGLE_DEG
        )
        if len(misfit) and misfit.min() < 1:
            out[i] = int(misfit.argmin())
    return out
