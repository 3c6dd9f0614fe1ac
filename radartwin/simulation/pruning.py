"""Remove weak paths. The comparison of path amplitudes includes the gain of the antenna element at both ends of each path.

All shares below which paths are left out are multiples of TARGET_ERROR. If TARGET_ERROR is divided by five, the signals of the furnished
laboratory and squash court, with and without a can, change by 0.009 to 0.027, because many weak paths add up. Paths between two objects,
between object and room, and of clutter are many and weak, so they have higher thresholds than the paths of the room.
"""

import math
from collections.abc import Sequence

import numpy as np

from radartwin.compiled import compiled, fixed
from radartwin.radar.chirp import Radar
from radartwin.simulation.paths import Paths

TARGET_ERROR = 1e-3
PRUNE = TARGET_ERROR  # paths below this share of the strongest path of the same sensor pose are left out
EARLY = 0.3  # factor on thresholds where amplitudes are only estimated, before the amplitudes are computed
TRACED = 0.2 * TARGET_ERROR  # share below which hits are dropped during tracing, where amplitudes have no antenna gains yet
SHADED = 0.3 * TARGET_ERROR  # a change by a shadow below this share of the strongest path of the frame is left out
LEGS = 20 * TARGET_ERROR  # pairs of legs with a field below this share of the undisturbed direct field are left out
MIRRORED = 0.1 * TARGET_ERROR  # a leg whose mirrors reflect less than this has no field
# Paths between small objects and room below this share of the strongest path of the room are left out. Error: 0.002 of the signal of the
# cluttered atrium.
PAIRS = 10 * TARGET_ERROR
PAIRS_OF_DRIVES = 10 * PAIRS  # the same share for clutter that many drives see; error: 0.05 of the signal of the laboratory with clutter
# In a drive, paths of clutter below this share of the strongest path of clutter are left out. Errors: 0.003 of the direct signal of the
# clutter, 0.01 of its signal with the room.
CLUTTER = 10 * TARGET_ERROR
# In a drive, paths of an object under test below this share of its strongest path are left out. A third of this share changes the object's
# signal by 0.006.
THING = 3 * TARGET_ERROR
DIFFUSE_POWER = 100 * TARGET_ERROR**2  # largest share of the diffuse power of a sensor pose that is left out: 1 % in amplitude


def level(paths: Paths, radar: Radar) -> np.ndarray:
    """Return the largest amplitude (N,) of each path over the frequency nodes, including the gain of the radar's antenna elements."""
    return largest(paths.amplitude) * both_gains(radar, paths.departure, paths.arrival)


def both_gains(radar: Radar, departure: np.ndarray, arrival: np.ndarray) -> np.ndarray:
    """Return the antenna gain (N,) of paths at both ends together. The directions (N, 3) at the sensor are in the sensor frame."""
    gain = radar.gain(departure)
    return gain * (gain if np.array_equal(departure, arrival) else radar.gain(arrival))


def largest(amplitude: np.ndarray) -> np.ndarray:
    """Return the largest magnitude (N,) of each row of complex amplitudes (N, Q)."""
    return _largest(fixed(np.asarray(amplitude, complex)))


@compiled
def _largest(amplitude: np.ndarray) -> np.ndarray:
    out = np.empty(len(amplitude))
    for n in range(len(amplitude)):
        most = 0.0
        for q in range(amplitude.shape[1]):
            most = max(most, amplitude[n, q].real ** 2 + amplitude[n, q].imag ** 2)
        out[n] = math.sqrt(most)
    return out


def strong_masks(parts: Sequence[Paths], radar: Radar, share: float) -> list[np.ndarray]:
    """Return, for each `Paths` object of the list `parts`, a mask of its strong paths.

    For each sensor pose, the function finds the largest amplitude over the paths of all `Paths` objects in the list. A path is strong if
    its amplitude is at least `share` (a number from 0 to 1) times the largest amplitude at its sensor pose.
    """
    levels = [level(part, radar) for part in parts]
    most = strongest(parts, levels, parts[0].poses if parts else 0)
    return [(part_levels >= share * most[part.pose]) & (part_levels > 0) for part, part_levels in zip(parts, levels, strict=True)]


def strongest(parts: Sequence[Paths], levels: Sequence[np.ndarray], frames: int) -> np.ndarray:
    """Return the largest level (F,) of the paths of each frame. A `Paths` object of one pose is valid for all F frames."""
    most = np.zeros(frames)
    for part, part_levels in zip(parts, levels, strict=True):
        if part.poses == 1:
            most = np.maximum(most, part_levels.max(initial=0.0))
        else:
            np.maximum.at(most, part.pose, part_levels)
    return most


def pruned(part: Paths, radar: Radar, share: float) -> Paths:
    """Return the paths whose amplitude is at least `share` (0 to 1) times the amplitude of the strongest path at the same sensor pose."""
    return part.where(strong_masks([part], radar, share)[0])
