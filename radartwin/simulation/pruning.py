"""Leaving out paths too weak to matter, the element pattern at both ends included."""

from collections.abc import Sequence

import numpy as np

from radartwin.radar.antenna import element_gain
from radartwin.radar.chirp import Radar
from radartwin.simulation.paths import Paths


def level(paths: Paths, radar: Radar) -> np.ndarray:
    """(N,) largest amplitude over the sweep, as the radar's elements see it."""
    gain = element_gain(radar.element, paths.departure) * element_gain(radar.element, paths.arrival)
    return np.abs(paths.amplitude).max(axis=1, initial=0.0) * gain


class Pruner:
    """Keeps paths of at least `share` of the strongest of their pose, in parts that come one after the other."""

    def __init__(self, radar: Radar, share: float, poses: int):
        self._radar, self._share = radar, share
        self.strongest = np.zeros(poses)

    def add(self, paths: Paths) -> Paths:
        """Those that stand out of all paths so far."""
        return paths.where(self.worth(paths))

    def worth(self, paths: Paths) -> np.ndarray:
        """(N,) mask of those."""
        one = level(paths, self._radar)
        np.maximum.at(self.strongest, paths.pose, one)
        return (one >= self._share * self.strongest[paths.pose]) & (one > 0)


def outstanding(parts: Sequence[Paths], radar: Radar, share: float) -> list[np.ndarray]:
    """Masks of the paths that are at least a share of the strongest of their pose in all parts, which have the same poses."""
    levels = [level(part, radar) for part in parts]
    strongest = np.zeros(parts[0].poses if parts else 0)
    for part, one in zip(parts, levels, strict=True):
        np.maximum.at(strongest, part.pose, one)
    return [(one >= share * strongest[part.pose]) & (one > 0) for part, one in zip(parts, levels, strict=True)]


def pruned(parts: Sequence[Paths], radar: Radar, share: float) -> list[Paths]:
    """Parts of the same poses without paths below a share of the strongest of their pose in all of them."""
    return [part.where(mask) for part, mask in zip(parts, outstanding(parts, radar, share), strict=True)]
