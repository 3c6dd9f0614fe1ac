"""Removal of paths that are too weak to matter, with the element pattern applied at both ends."""

from collections.abc import Sequence

import numpy as np

from radartwin.radar.antenna import element_gain
from radartwin.radar.chirp import Radar
from radartwin.simulation.paths import Paths


def level(paths: Paths, radar: Radar) -> np.ndarray:
    """(N,) largest amplitude over the sweep, including the gain of the radar's elements."""
    gain = element_gain(radar.element, paths.departure) * element_gain(radar.element, paths.arrival)
    return np.abs(paths.amplitude).max(axis=1, initial=0.0) * gain


class Pruner:
    """Keeps paths of at least `share` of the strongest path of their pose, among all parts added so far.

    Attributes:
        strongest: (F,) level of the strongest path of each pose.
    """

    def __init__(self, radar: Radar, share: float, poses: int):
        self._radar, self._share = radar, share
        self.strongest = np.zeros(poses)

    def add(self, paths: Paths) -> Paths:
        """The paths that are strong enough."""
        return paths.where(self.mask(paths))

    def mask(self, paths: Paths) -> np.ndarray:
        """(N,) whether each path is strong enough."""
        levels = level(paths, self._radar)
        np.maximum.at(self.strongest, paths.pose, levels)
        return (levels >= self._share * self.strongest[paths.pose]) & (levels > 0)


def strong_masks(parts: Sequence[Paths], radar: Radar, share: float) -> list[np.ndarray]:
    """For each part of the same poses, the mask of paths with at least `share` of the strongest path of their pose in all parts."""
    levels = [level(part, radar) for part in parts]
    strongest = np.zeros(parts[0].poses if parts else 0)
    for part, part_levels in zip(parts, levels, strict=True):
        np.maximum.at(strongest, part.pose, part_levels)
    return [(part_levels >= share * strongest[part.pose]) & (part_levels > 0) for part, part_levels in zip(parts, levels, strict=True)]


def pruned(part: Paths, radar: Radar, share: float) -> Paths:
    """The paths with at least `share` of the strongest path of their pose."""
    return part.where(strong_masks([part], radar, share)[0])
