"""Read a campaign's recordings as feature rows: a row per recording, revolution, frame, range-time signature or noisy copy."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from experiments.campaign.cases import COMPARED, Case
from experiments.campaign.columns import revolutions
from experiments.campaign.source import RecordingSource
from radartwin.errors import InputError
from radartwin.features import sets
from radartwin.features.log import Log, angles, distances
from radartwin.features.pictures import flattened, picture
from radartwin.features.processed import Processed
from radartwin.recognize.samples import MEASURED, SIMULATED, Part, Samples, gather

MOTION, FEATURES = "turntable", "rotation"  # motion and feature set of the turntable tables
PROFILES = 50  # number of range profiles of a range-time signature
Reader = Callable[[Processed, Log], tuple[list[str], np.ndarray]]  # returns feature names and values


@dataclass(frozen=True, eq=False)
class Readings:
    """Rows of features, and the store keys of the recordings from which the features were computed."""

    samples: Samples
    keys: tuple[str, ...]


def recording_name(domain: str, case: Case) -> str:
    """Return a name that contains the domain (measured or simulated) and sorts by object, room, motion, distance, repetition and draw."""
    draw = f" draw {case.draw}" if case.draw else ""
    return f"{case.object} {case.room} {case.motion} {case.distance_m:g} m #{case.repetition}{draw} {domain}"


def stratum(case: Case) -> str:
    """Return as text the distance of a case. Recordings of equal distance form a stratum (group); features are ranked within each
    stratum.
    """
    return f"{case.distance_m:g} m"


def shared_cases(source: RecordingSource, motion: str, room: str | None = None, domain: str = "twin") -> tuple[list[Case], list[Case]]:
    """Return (measured, simulated) cases of the objects, rooms and distances that both domains contain.

    Distances with fewer than two objects are left out. For all objects in the same room and at the same distance, the number of measured
    cases is equal.

    Raises:
        InputError: no case is left.
    """
    chosen = {"motion": motion} | ({"room": room} if room else {})
    cases = [source.cases(side, **chosen) for side in ("measured", domain)]
    places = set.intersection(*({(case.object, case.room, case.distance_m) for case in side} for side in cases))
    objects = {(where, distance): {o for o, w, d in places if (w, d) == (where, distance)} for _, where, distance in places}
    shared = {(o, where, distance) for o, where, distance in places if len(objects[where, distance]) > 1}
    if not shared:
        place = f" in {room}" if room else ""
        raise InputError(
            f"the campaign has no {motion} recordings{place} of two objects at one distance, both measured and simulated; add objects"
        )
    measured, simulated = ([case for case in side if (case.object, case.room, case.distance_m) in shared] for side in cases)
    return balanced(measured), simulated


def paired(source: RecordingSource, motion: str) -> list[tuple[str, Case]]:
    """Return the (domain, case) pairs of `shared_cases`."""
    return [(domain, case) for domain, cases in zip(COMPARED, shared_cases(source, motion), strict=True) for case in cases]


def balanced(cases: Sequence[Case]) -> list[Case]:
    """Keep an equal number of repetitions for all objects in the same room and distance: the smallest number that any object has."""
    found: dict[tuple[str, float], dict[str, list[Case]]] = {}
    for case in sorted(cases, key=lambda case: case.repetition):
        found.setdefault((case.room, case.distance_m), {}).setdefault(case.object, []).append(case)
    chosen = {case for by_object in found.values() for some in by_object.values() for case in some[: min(map(len, by_object.values()))]}
    return [case for case in cases if case in chosen]


def vectors(source: RecordingSource, domain: str, cases: Sequence[Case], features: str, without: Sequence[str] = ()) -> Readings:
    """Read one feature row per recording. For a turntable, read one feature row per revolution."""
    return _read(source, domain, cases, lambda processed, log: sets.vector(processed, log, features, without), by_revolution=True)


def pictures(source: RecordingSource, domain: str, cases: Sequence[Case]) -> Readings:
    """Read the picture of each turntable revolution (radartwin.features.pictures) as one row."""
    return _read(source, domain, cases, picture_row, by_revolution=True)


def picture_row(processed: Processed, log: Log) -> tuple[list[str], np.ndarray]:
    return flattened(picture(processed, angles(log, processed.num_frames), float(np.mean(distances(log, processed.num_frames)))))


def frames(source: RecordingSource, domain: str, cases: Sequence[Case], features: str, materials: Any = None) -> Readings:
    return _read(source, domain, cases, lambda processed, log: sets.frames(processed, log, features), materials)


def signatures(source: RecordingSource, domain: str, cases: Sequence[Case]) -> Readings:
    """Read the range-time signature of each recording as one feature row.

    A signature holds levels in dB from 0.3 to 5.5 m in range, interpolated in time to PROFILES profiles.
    """

    def signature(processed: Processed, log: Log) -> tuple[list[str], np.ndarray]:
        names, level = sets.frames(processed, log, "raw")
        times = np.linspace(0, len(level) - 1, PROFILES)
        before = np.minimum(times.astype(int), len(level) - 1)
        after, share = np.minimum(before + 1, len(level) - 1), (times - before)[:, None]
        picture = (1 - share) * level[before] + share * level[after]
        return [f"{row} {name}" for row in range(PROFILES) for name in names], picture.ravel()

    return _read(source, domain, cases, signature)


def _read(
    source: RecordingSource, domain: str, cases: Sequence[Case], reader: Reader, materials: Any = None, by_revolution: bool = False
) -> Readings:
    source.prepare([(domain, case) for case in cases], materials)
    recordings = ((case, *source.processed(domain, case, materials), source.log(case, domain)) for case in cases)
    return read_rows(domain, recordings, reader, by_revolution)


def read_rows(domain: str, recordings: Iterable[tuple[Case, str, Processed, Log]], reader: Reader, by_revolution: bool = False) -> Readings:
    """Collect the feature rows that `reader` computes for each (case, store key, processed recording, log)."""
    parts, keys, names = [], [], []
    for case, key, processed, log in recordings:
        for suffix, piece, piece_log in revolutions(processed, log) if by_revolution else [("", processed, log)]:
            names, values = reader(piece, piece_log)
            parts.append(part(domain, case, values, suffix))
        keys.append(key)
    return Readings(gather(names, parts), tuple(sorted(keys)))


def part(domain: str, case: Case, values: np.ndarray, suffix: str = "") -> Part:
    name = recording_name(domain, case)
    return Part(name + suffix, case.object, MEASURED if domain == "measured" else SIMULATED, values, stratum(case), name)
