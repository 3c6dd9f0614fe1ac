"""Read turntable recordings for the turntable tables: rotation features, range-Doppler signature, and visibility of the target."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from experiments.campaign.cases import COMPARED, Case
from experiments.campaign.source import RecordingSource, read_both
from radartwin.errors import InputError
from radartwin.features import sets
from radartwin.features.log import Log, angles, distances
from radartwin.features.processed import Processed
from radartwin.features.profile import FAR_M, NEAR_M, gate
from radartwin.features.signature import signature
from radartwin.io.progress import Progress


@dataclass(frozen=True, eq=False)
class Turn:
    """Features of one turntable recording.

    Attributes:
        values: {name: value} of the rotation features.
        signature: range-Doppler signature (N, R) of a revolution, see radartwin.features.signature.
        localised: whether the strongest echo over all ranges lies in the target gate.
    """

    case: Case
    key: str
    values: dict[str, float]
    signature: NDArray[np.float64]
    localised: bool


Turns = dict[tuple[str, float], list[Turn]]  # key: object, distance


def read(source: RecordingSource, progress: Progress) -> dict[str, Turns]:
    """Read the recordings of all objects and distances that are both measured and simulated, sorted as in the catalogue.

    Raises:
        ConfigError: the measured and the simulated recordings have no common object and distance.
        InputError: the recordings differ in the number of frames per revolution.
    """
    found = read_both(source, ("turntable",), lambda case: (case.object, case.distance_m), _turn, progress)
    frames = sorted({len(turn.signature) for turns in found.values() for some in turns.values() for turn in some})
    if len(frames) > 1:
        raise InputError(
            f"revolutions of {' and '.join(map(str, frames))} frames cannot be compared; record all turntables at one frame rate and period"
        )
    return found


def _turn(case: Case, key: str, processed: Processed, log: Log) -> Turn:
    names, values = sets.vector(processed, log, "rotation")
    target_m = float(distances(log, processed.num_frames)[0])
    revolution = signature(processed, angles(log, processed.num_frames), target_m)
    inside = (processed.range_m >= NEAR_M) & (processed.range_m <= FAR_M)
    strongest = int(np.where(inside, processed.power.mean(axis=0), 0).argmax())
    localised = bool(gate(processed.range_m, target_m)[strongest])
    return Turn(case, key, dict(zip(names, map(float, values), strict=True)), revolution, localised)


def objects(turns: Turns) -> list[str]:
    """Return the names of the recorded objects, sorted as in the catalogue."""
    return list(dict.fromkeys(name for name, _ in turns))


def distances_m(turns: Turns) -> list[float]:
    """Return the recorded distances in metres, smallest first."""
    return sorted({distance for _, distance in turns})


def chosen(turns: Turns, names: Sequence[str], distance_m: float | None = None) -> list[Turn]:
    """Return the recordings of these objects at one distance in metres. `distance_m=None` returns all distances."""
    return [turn for (name, distance), some in turns.items() if name in names and distance_m in (None, distance) for turn in some]


def samples(turns: Turns, feature: str, name: str) -> NDArray[np.float64]:
    """Return the values of a feature in all recordings of the object `name`."""
    return np.array([turn.values[feature] for turn in chosen(turns, [name])])


def object_means(turns: Turns, feature: str, names: Sequence[str], distance_m: float | None = None) -> NDArray[np.float64]:
    """Average a feature for each object, first over repetitions and then over distances, so that every distance has equal weight."""
    found = []
    for name in names:
        cells = [key for key in turns if key[0] == name and distance_m in (None, key[1])]
        found.append(np.mean([np.mean([turn.values[feature] for turn in turns[key]]) for key in cells]))
    return np.array(found)


def keys(turns: Turns, names: Sequence[str] | None = None, distance_m: float | None = None) -> list[str]:
    """Return the store keys of one domain's recordings. `names=None` stands for all objects, `distance_m=None` for all distances."""
    return [turn.key for turn in chosen(turns, objects(turns) if names is None else names, distance_m)]


def keys_of_both(turns: dict[str, Turns], names: Sequence[str] | None = None, distance_m: float | None = None) -> list[str]:
    """Return the store keys of the measured and the simulated recordings. The arguments have the same meaning as those of `keys`."""
    return [key for domain in COMPARED for key in keys(turns[domain], names, distance_m)]


def is_can(name: str) -> bool:
    """Return whether an object is one of the six cans that differ only in height."""
    return "can_" in name
