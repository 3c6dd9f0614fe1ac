"""Feature rows of a frame's recordings: a row for each revolution, picture of a revolution, frame of a drive, or range-time signature."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments.campaign.cases import COMPARED, MEASURED, REFLECTOR, Case
from experiments.campaign.frame import Frame, features
from radartwin.errors import InputError
from radartwin.features.profile import FAR_M, NEAR_M
from radartwin.recognize import samples
from radartwin.recognize.learners.interface import Reads
from radartwin.recognize.samples import SIMULATED, Part, Samples, gather

MOTION, FEATURES = "turntable", "rotation"  # motion and feature set of the turntable tables
TURNTABLE = {"motions": (MOTION,), "several": True}  # arguments of `Query` of most of these tables
PROFILES = 50  # number of range profiles of a range-time signature


def recording_name(domain: str, case: Case | Any) -> str:
    """Return a name of a Case or row that sorts by object, room, motion, distance, repetition, draw and domain."""
    draw = f" draw {case.draw}" if case.draw else ""
    return f"{case.object} {case.room} {case.motion} {case.distance_m:g} m #{case.repetition}{draw} {domain}"


def stratum(distance_m: float) -> str:
    """Return a distance as text. Recordings of equal distance form a stratum (group); features are ranked within each stratum."""
    return f"{distance_m:g} m"


def gathered(rows: Frame, names: Sequence[str], values: Iterable[NDArray], turns: bool = False) -> Samples:
    """Return the feature rows of recordings, sorted by the names of the recordings. The values of a recording are (n, D), of D features, or
    (D,); with `turns`, each row is a revolution, which counts as a recording of its own.
    """
    parts = []
    for row, vectors in zip(rows.itertuples(), values, strict=True):
        name, domain = recording_name(row.domain, row), samples.MEASURED if row.domain == MEASURED else SIMULATED
        cut = [(f"{name} turn {number:02d}", revolution) for number, revolution in enumerate(vectors)] if turns else [(name, vectors)]
        parts += [Part(recording, row.object, domain, part, stratum(row.distance_m), name) for recording, part in cut]
    return gather(names, parts)


def revolutions(frame: Frame, kind: Reads = "features", domain: str = MEASURED) -> Samples:
    """Return the rotation features or the picture of each revolution of the turntable recordings of a domain."""
    rows = frame[frame.domain == domain]
    if kind == "features":
        return gathered(rows, features(rows), rows.revolutions, turns=True)
    return gathered(rows, cells(rows.pictures.iloc[0].shape[1]), rows.pictures, turns=True)


def cells(count: int) -> list[str]:
    """Return the names of the cells of a picture or a signature."""
    return [f"cell {number}" for number in range(count)]


def without(rows: Samples, *names: str) -> Samples:
    """Return the rows without some of their features."""
    kept = [name not in names for name in rows.names]
    return rows.with_values(rows.values[:, kept], np.array(rows.names)[kept].tolist())


def by_side(frame: Frame) -> dict[str, Frame]:
    """Return for each simulation, by its name in the column `side`, its recordings and the measured ones."""
    sides = frame.side[frame.domain != MEASURED].unique()
    return {name: frame[(frame.domain == MEASURED) | (frame.side == name)] for name in sides}


def frames(rows: Frame) -> Samples:
    """Return the features of each frame of drives."""
    return gathered(rows, rows.frame_features.iloc[0].tolist(), rows.frames)


def profile_db(power: NDArray, range_m: NDArray) -> NDArray:
    """Return range profiles (..., B) in dB from 0.3 to 5.5 m in range."""
    return 10 * np.log10(np.maximum(power[..., (range_m >= NEAR_M) & (range_m <= FAR_M)], np.finfo(np.float32).tiny))


def signatures(rows: Frame) -> Samples:
    """Return the range-time signature of each drive as one row: its levels (`profile_db`), interpolated to PROFILES profiles."""

    def signature(level: NDArray) -> NDArray:
        times = np.linspace(0, len(level) - 1, PROFILES)
        before = np.minimum(times.astype(int), len(level) - 1)
        after, share = np.minimum(before + 1, len(level) - 1), (times - before)[:, None]
        return ((1 - share) * level[before] + share * level[after]).ravel()

    values = [signature(profile_db(row.power, row.range_m).astype(np.float64)) for row in rows.itertuples()]
    return gathered(rows, cells(len(values[0])), values)


def reflector(rows: Frame) -> Frame:
    """Return the recording of the reflector at its middle distance in each domain. Raises InputError if there is none."""
    reflectors = rows[rows.object == REFLECTOR]
    if set(reflectors.domain) < set(COMPARED):
        where = " and ".join(sorted({f"{motion} in {room}" for motion, room in zip(rows.motion, rows.room, strict=True)}))
        raise InputError(f"calibration: the campaign has no {where} recording of the {REFLECTOR}; record one")
    distances = sorted(reflectors.distance_m.unique())
    return reflectors[reflectors.distance_m == distances[len(distances) // 2]].drop_duplicates("domain")
