"""Read rover recordings for the rover tables: features, mean range profile, and the target's range, energy and velocity along the drive."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from experiments.campaign.cases import COMPARED, ROVER, Case
from experiments.campaign.source import RecordingSource, read_both
from radartwin.features import doppler, envelope, sets, track
from radartwin.features.log import Log, distances
from radartwin.features.processed import Processed
from radartwin.io.progress import Progress
from radartwin.scene.objects.catalogue import catalogue

MOST_DRAWN = 300  # largest number of bootstrap resamples of slow statistics, which rank every feature again in each resample
Place = tuple[str, str, float]  # room, motion, distance


@dataclass(frozen=True, eq=False)
class Drive:
    """Features and time series of one rover recording.

    Attributes:
        values: {name: value} of the features defined for this motion.
        power: (F, B) range profiles in power over the range axis range_m (B,).
        nominal_m, track_m: range of the target in metres in each frame (F,), from the log (nominal_m) and as tracked (track_m).
        energy: (F,) energy in the target gate in each frame.
        velocity_mps: (F,) radial velocity of the target in m/s, or None for a recording without Doppler.
    """

    key: str
    values: dict[str, float]
    power: NDArray
    range_m: NDArray
    frame_rate_hz: float
    nominal_m: NDArray
    track_m: NDArray
    energy: NDArray
    velocity_mps: NDArray | None

    @property
    def profile(self) -> NDArray:
        """Mean range profile (B,) over frames. Each frame is scaled to unit energy before the mean."""
        return (self.power / self.power.sum(axis=1, keepdims=True)).mean(axis=0)


Drives = dict[tuple[str, Place], list[Drive]]  # key: object, place


def read(source: RecordingSource, progress: Progress) -> dict[str, Drives]:
    """Read the drives of objects and places (room, motion, distance) that are both measured and simulated. Raises ConfigError if
    there are none.
    """
    return read_both(source, ROVER, lambda case: (case.object, (case.room, case.motion, case.distance_m)), _drive, progress)


def _drive(case: Case, key: str, processed: Processed, log: Log) -> Drive:
    names, values = sets.vector(processed, log, case.motion)
    nominal = distances(log, processed.num_frames)
    along = track.around(processed, nominal, log.frame_rate_hz)
    velocity = None if processed.doppler is None else doppler.radial_velocity(processed, along)
    energy = np.maximum(envelope.target_energy(processed, along), 0.0)
    by_name = dict(zip(names, map(float, values), strict=True))
    return Drive(key, by_name, processed.power, processed.range_m, log.frame_rate_hz, nominal, along, energy, velocity)


def places(drives: Drives) -> list[Place]:
    """Return the places (room, motion, distance) of the drives, sorted in this order."""
    return sorted({place for _, place in drives})


def objects(drives: Drives, place: Place) -> list[str]:
    """Return the names of the objects at a place (room, motion, distance), sorted as in the catalogue."""
    return [name for name in catalogue() if (name, place) in drives]


def matrix(drives: Drives, names: Sequence[str], place: Place) -> tuple[list[str], NDArray[np.floating]]:
    """Return the feature names, and the feature values (objects, features) at a place, as means over repetitions."""
    features = list(drives[names[0], place][0].values)
    return features, np.array([[np.mean([one.values[f] for one in drives[name, place]]) for f in features] for name in names])


def keys(drives: dict[str, Drives], names: Iterable[str] | None = None, chosen: Iterable[Place] | None = None) -> list[str]:
    """Return the store keys of the measured and simulated drives. `names=None` stands for all objects, `chosen=None` for all places
    (room, motion, distance).
    """
    known_names, known_places = None if names is None else set(names), None if chosen is None else set(chosen)
    return [
        one.key
        for domain in COMPARED
        for (name, place), some in drives[domain].items()
        if (known_names is None or name in known_names) and (known_places is None or place in known_places)
        for one in some
    ]


def family(feature: str) -> str:
    """Return the name of the feature family of a feature, as tables print it."""
    if feature.startswith("window"):
        return "range-profile window"
    known = {"multipath_share": "multipath share", "azimuth_extent_rad": "angular extent", sets.BRIGHTNESS: "brightness"}
    known |= dict.fromkeys(("excursion_m", "track_offset_m", "track_spread_m"), "track")
    return known.get(feature, "envelope")
