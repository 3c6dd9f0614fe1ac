"""What recognition reads off a campaign: feature rows per recording, frame or noise-augmented copy, with the keys of the recordings."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from radartwin.errors import InputError
from radartwin.features import envelope, sets, track
from radartwin.features.log import Log, Nominal, distances
from radartwin.features.processed import Processed
from radartwin.recognize.augment import added_noise, copies
from radartwin.recognize.samples import MEASURED, SIMULATED, Part, Samples, gather
from radartwin.store.products import Store, save_arrays

ROOTS = ["radartwin.features.sets", "radartwin.recognize.augment"]
_TURNTABLE = "turntable"


class Case(Protocol):
    """One recording of the study, in either domain."""

    @property
    def object(self) -> str: ...
    @property
    def room(self) -> str: ...
    @property
    def motion(self) -> str: ...
    @property
    def distance_m(self) -> float: ...
    @property
    def repetition(self) -> int: ...


class Campaign(Protocol):
    """Where recordings come from: experiments.campaign, or a test's own."""

    def cases(self, domain: Any, **chosen: Any) -> Sequence[Any]: ...
    def prepare(self, wanted: Any, materials: Any = None) -> None: ...
    def processed(self, domain: Any, case: Any, materials: Any = None) -> tuple[str, Processed]: ...
    def log(self, case: Any, domain: str = "measured") -> Log: ...


@dataclass(frozen=True, eq=False)
class Readings:
    """Feature rows and the keys of the recordings they were read from."""

    samples: Samples
    keys: tuple[str, ...]


def recording_name(domain: str, case: Case) -> str:
    """Sorts by object, room, motion, distance and repetition, and names its domain."""
    return f"{case.object} {case.room} {case.motion} {case.distance_m:g} m #{case.repetition} {domain}"


def stratum(case: Case) -> str:
    """What recordings are matched by: equal distance at the start."""
    return f"{case.distance_m:g} m"


def shared_cases(campaign: Campaign, motion: str, room: str | None = None, domain: str = "twin") -> tuple[list[Any], list[Any]]:
    """(measured, simulated) cases of the objects and distances that both have, at distances that tell two objects or more apart; of the
    measured ones equally many of each object.

    Raises:
        InputError: there are none.
    """
    chosen = {"motion": motion} | ({"room": room} if room else {})
    cases = [campaign.cases(side, **chosen) for side in ("measured", domain)]
    places = set.intersection(*({(case.object, case.room, case.distance_m) for case in side} for side in cases))
    objects = {(where, distance): {o for o, w, d in places if (w, d) == (where, distance)} for _, where, distance in places}
    kept = {(o, where, distance) for o, where, distance in places if len(objects[where, distance]) > 1}
    if not kept:
        place = f" in {room}" if room else ""
        raise InputError(f"the campaign has no {motion} recordings{place} of two objects at one distance, both measured and simulated")
    measured, simulated = ([case for case in side if (case.object, case.room, case.distance_m) in kept] for side in cases)
    return balanced(measured), simulated


def balanced(cases: Sequence[Any]) -> list[Any]:
    """As many recordings of every object at a place as of the one with the fewest there, the first repetitions."""
    found: dict[tuple[str, float], dict[str, list[Any]]] = {}
    for case in sorted(cases, key=lambda case: case.repetition):
        found.setdefault((case.room, case.distance_m), {}).setdefault(case.object, []).append(case)
    kept = {id(case) for of in found.values() for some in of.values() for case in some[: min(map(len, of.values()))]}
    return [case for case in cases if id(case) in kept]


def vectors(
    campaign: Campaign, domain: str, cases: Sequence[Case], features: str, without: Sequence[str] = (), materials: Any = None
) -> Readings:
    """One row per recording, of a turntable one row per revolution."""
    return _read(campaign, domain, cases, materials, lambda processed, log: sets.vector(processed, log, features, without), revolutions)


def frames(
    campaign: Campaign, domain: str, cases: Sequence[Case], features: str, without: Sequence[str] = (), materials: Any = None
) -> Readings:
    """One row per frame."""
    return _read(campaign, domain, cases, materials, lambda processed, log: sets.frames(processed, log, features, without))


def signatures(campaign: Campaign, domain: str, cases: Sequence[Case], materials: Any = None, rows: int = 50) -> Readings:
    """The whole range-time signature of each recording as one row: decibels of 0.3 to 5.5 m, its frames interpolated to `rows`."""

    def picture_of(processed: Processed, log: Log) -> tuple[list[str], np.ndarray]:
        names, level = sets.frames(processed, log, "raw")
        wanted = np.linspace(0, len(level) - 1, rows)
        before = np.minimum(wanted.astype(int), len(level) - 1)
        after, share = np.minimum(before + 1, len(level) - 1), (wanted - before)[:, None]
        picture = (1 - share) * level[before] + share * level[after]
        return [f"{row} {name}" for row in range(rows) for name in names], picture.ravel()

    return _read(campaign, domain, cases, materials, picture_of)


Pieces = list[tuple[str, Processed, Log]]


def whole(processed: Processed, log: Log) -> Pieces:
    """A recording in one piece."""
    return [("", processed, log)]


def revolutions(processed: Processed, log: Log) -> Pieces:
    """A turntable recording revolution by revolution, what is left of the last one dropped; any other in one piece."""
    if log.angle_rad is None:
        return whole(processed, log)
    period = envelope.frames_per_revolution(log.angle_rad)
    pieces: Pieces = []
    for number in range(processed.num_frames // period):
        at = slice(number * period, (number + 1) * period)
        pieces.append((f" turn {number:02d}", processed.frames(at), Nominal(log.frame_rate_hz, log.distance_m[at], log.angle_rad[at])))
    return pieces


def _read(
    campaign: Campaign, domain: str, cases: Sequence[Case], materials: Any,
    reader: Callable[[Processed, Log], tuple[list[str], np.ndarray]], cut: Callable[[Processed, Log], Pieces] = whole,
) -> Readings:  # fmt: skip
    parts, keys, names = [], [], []
    campaign.prepare([(domain, case) for case in cases], materials)
    for case in cases:
        key, processed = campaign.processed(domain, case, materials)
        for piece, part, log in cut(processed, campaign.log(case, domain)):
            names, values = reader(part, log)
            parts.append(_part(domain, case, values, piece))
        keys.append(key)
    return Readings(gather(names, parts), tuple(sorted(keys)))


def _part(domain: str, case: Case, values: np.ndarray, piece: str = "") -> Part:
    side, name = MEASURED if domain == "measured" else SIMULATED, recording_name(domain, case)
    return Part(name + piece, case.object, side, values, stratum(case), name)


def noise_copies(
    campaign: Campaign, store: Store, simulated: Sequence[Case], measured: Sequence[Case], features: str, count: int, seed: int,
    without: Sequence[str] = (), materials: Any = None,
) -> Readings:  # fmt: skip
    """`count` rows per simulated recording, each of a copy with the noise of the measured recordings at its distance.

    The rows are kept in the store. The measured side gives target energies and noise floors, whatever the objects are.
    """
    noise = {}
    for name in sorted({stratum(case) for case in simulated}):
        ours = np.array([_energy(campaign, "twin", case, materials) for case in simulated if stratum(case) == name])
        theirs = np.array([_energy(campaign, "measured", case, None) for case in measured if stratum(case) == name])
        noise[name] = added_noise(ours[:, 0], theirs[:, 0], float(np.median(theirs[:, 1]))) if len(theirs) else 0.0
    parts, keys, names = [], [], []
    for number, case in enumerate(sorted(simulated, key=lambda case: recording_name("twin", case))):
        key, processed = campaign.processed("twin", case, materials)
        log = campaign.log(case, "twin")

        def build(folder: Path, processed: Processed = processed, log: Log = log, case: Case = case, number: int = number) -> None:
            made = [sets.vector(one, log, features, without) for one in copies(processed, noise[stratum(case)], count, [seed, number])]
            save_arrays(folder, {"names": np.array(made[0][0]), "values": np.stack([values for _, values in made])})

        spec = {
            "recording": key, "features": features, "without": list(without), "noise": noise[stratum(case)], "count": count, "seed": seed,
            "number": number, "distance_m": log.distance_m, "angle_rad": log.angle_rad,
        }  # fmt: skip
        kept = store.fetch("noise_copies", spec, ROOTS, build).arrays()
        names = [str(name) for name in kept["names"]]
        parts.append(_part("twin", case, kept["values"]))
        keys.append(key)
    return Readings(gather(names, parts), tuple(sorted(keys)))


def _energy(campaign: Campaign, domain: str, case: Case, materials: Any) -> tuple[float, float]:
    """(mean energy in the target gate, noise per range bin) of a recording."""
    _, processed = campaign.processed(domain, case, materials)
    log = campaign.log(case, domain)
    nominal = distances(log, processed.num_frames)
    where = nominal if case.motion == _TURNTABLE else track.around(processed, nominal, log.frame_rate_hz)
    return float(envelope.target_energy(processed, where).mean()), float(processed.noise_floor.mean())
