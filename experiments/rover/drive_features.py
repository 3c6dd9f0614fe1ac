"""What the rover tables read off each recording, in either domain: features, mean profile, track, energy and velocity along the drive."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from experiments.recognition.readings import Campaign, Case
from experiments.turntable.rotations import DOMAINS
from radartwin.errors import ConfigError
from radartwin.features import doppler, envelope, sets, track
from radartwin.features.log import distances
from radartwin.io.progress import Progress
from radartwin.scene.objects.catalogue import catalogue

MOTIONS = ("depth", "lateral")
Place = tuple[str, str, float]  # room, motion, distance


@dataclass(frozen=True, eq=False)
class Drive:
    """One recording.

    Attributes:
        values: features of the motion's set by name.
        power: (F, B). range_m: (B,). track_m, nominal_m, energy, rate_mps, velocity_mps: (F,); velocity None without Doppler.
    """

    case: Case
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
        """(B,): mean over frames of each frame's profile over its own energy."""
        return (self.power / self.power.sum(axis=1, keepdims=True)).mean(axis=0)


Drives = dict[tuple[str, Place], list[Drive]]  # by object and place


def read(campaign: Campaign, progress: Progress) -> dict[str, Drives]:
    """Drives of both domains at the objects and places that both have, in the catalogue's order.

    Raises:
        ConfigError: the campaign has none in common.
    """
    cases = {domain: [case for motion in MOTIONS for case in campaign.cases(domain, motion=motion)] for domain in DOMAINS}
    common = set.intersection(*({_where(case) for case in chosen} for chosen in cases.values()))
    if not common:
        raise ConfigError("the rover's campaign has no object and place that is both measured and simulated")
    order = {name: number for number, name in enumerate(catalogue())}
    found: dict[str, Drives] = {domain: {} for domain in DOMAINS}
    wanted = [(domain, case) for domain in DOMAINS for case in cases[domain] if _where(case) in common]
    campaign.prepare(wanted)
    for domain, case in progress.over(sorted(wanted, key=lambda one: (one[0], order[one[1].object], str(one[1]))), "rover recordings"):
        found[domain].setdefault(_where(case), []).append(_drive(campaign, domain, case))
    return found


def _where(case: Case) -> tuple[str, Place]:
    return case.object, (case.room, case.motion, case.distance_m)


def _drive(campaign: Campaign, domain: str, case: Case) -> Drive:
    key, processed = campaign.processed(domain, case)
    log = campaign.log(case, domain)
    names, values = sets.vector(processed, log, case.motion)
    nominal = distances(log, processed.num_frames)
    along = track.around(processed, nominal, log.frame_rate_hz)
    velocity = None if processed.doppler is None else doppler.radial_velocity(processed, along)
    energy = np.maximum(envelope.target_energy(processed, along), 0.0)
    told = dict(zip(names, (float(value) for value in values), strict=True))
    return Drive(case, key, told, processed.power, processed.range_m, log.frame_rate_hz, nominal, along, energy, velocity)


def places(drives: Drives) -> list[Place]:
    """In the order of rooms, motions and distances."""
    return sorted({place for _, place in drives})


def objects(drives: Drives, place: Place) -> list[str]:
    """At a place, in the catalogue's order."""
    return [name for name in catalogue() if (name, place) in drives]


def matrix(drives: Drives, names: Sequence[str], place: Place) -> tuple[list[str], NDArray[np.floating]]:
    """Feature names, and values (objects, features): means over repetitions."""
    features = list(drives[names[0], place][0].values)
    return features, np.array([[np.mean([one.values[f] for one in drives[name, place]]) for f in features] for name in names])


def keys(drives: dict[str, Drives], names: Iterable[str], chosen: Iterable[Place]) -> list[str]:
    names, chosen = set(names), set(chosen)
    return [
        one.key for domain in DOMAINS for (name, place), some in drives[domain].items() if name in names and place in chosen for one in some
    ]


def family(feature: str) -> str:
    """Of a feature's name, as tables print it."""
    if feature.startswith("window"):
        return "range-profile window"
    known = {"multipath_share": "multipath share", "azimuth_extent_rad": "angular extent", "brightness_db": "brightness"}
    known |= dict.fromkeys(("excursion_m", "track_offset_m", "track_spread_m"), "track")
    return known.get(feature, "envelope")
