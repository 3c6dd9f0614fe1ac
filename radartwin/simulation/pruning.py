"""Removal of weak paths. Their amplitudes are compared with the element gain at both ends of the path."""

from collections.abc import Sequence

import numpy as np

from radartwin.radar.antenna import element_gain
from radartwin.radar.chirp import Radar
from radartwin.simulation.paths import Paths


def level(paths: Paths, radar: Radar) -> np.ndarray:
    """Return the largest amplitude (N,) of each path over the sweep, including the gain of the radar's elements."""
    gain = element_gain(radar.element, paths.departure) * element_gain(radar.element, paths.arrival)
    return np.abs(paths.amplitude).max(axis=1, initial=0.0) * gain


class Pruner:
    """Keep paths with at least `share` times the amplitude of the strongest path of their pose in all parts added so far.

    Attributes:
        strongest: (F,) amplitude of the strongest path of each pose.
    """

    def __init__(self, radar: Radar, share: float, poses: int):
        self._radar, self._share = radar, share
        self.strongest = np.zeros(poses)

    def add(self, paths: Paths) -> Paths:
        """Add a part and return its paths that are strong enough."""
        return paths.where(self.mask(paths))

    def mask(self, paths: Paths) -> np.ndarray:
        """Add a part and return a mask (N,) of its paths that are strong enough."""
        levels = level(paths, self._radar)
        np.maximum.at(self.strongest, paths.pose, levels)
        return (levels >= self._share * self.strongest[paths.pose]) & (levels > 0)


def strong_masks(parts: Sequence[Paths], radar: Radar, share: float) -> list[np.ndarray]:
    """Return, for each part, a mask of the paths with at least `share` times the amplitude of their pose's strongest path in all parts."""
    levels = [level(part, radar) for part in parts]
    strongest = np.zeros(parts[0].poses if parts else 0)
    for part, part_levels in zip(parts, levels, strict=True):
        np.maximum.at(strongest, part.pose, part_levels)
    return [(part_levels >= share * strongest[part.pose]) & (part_levels > 0) for part, part_levels in zip(parts, levels, strict=True)]


def pruned(part: Paths, radar: Radar, share: float) -> Paths:
    """Return the paths with at least `share` times the amplitude of the strongest path of their pose."""
    return part.where(strong_masks([part], radar, share)[0])
