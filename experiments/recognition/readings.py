"""Read a campaign's recordings as feature rows: a row per recording, revolution, frame, range-time signature or noisy copy."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from experiments.campaign.campaign import Campaign
from experiments.campaign.cases import Case
from experiments.campaign.source import RecordingSource
from experiments.recognition import alone
from radartwin.config.config import Config
from radartwin.errors import InputError
from radartwin.features import envelope, sets, track
from radartwin.features.log import Log, Nominal, distances
from radartwin.features.processed import Processed
from radartwin.io.progress import Progress
from radartwin.recognize import randomise
from radartwin.recognize.augment import added_noise, noisy
from radartwin.recognize.samples import MEASURED, SIMULATED, Part, Samples, gather
from radartwin.store.products import Store, save_arrays

ROOTS = ["radartwin.features.sets", "radartwin.recognize.augment", "experiments.recognition.alone"]
MOTION, FEATURES = "turntable", "rotation"  # motion and feature set of the turntable tables
Reader = Callable[[Processed, Log], tuple[list[str], np.ndarray]]  # returns feature names and values


@dataclass(frozen=True, eq=False)
class Readings:
    """Rows of features, and the store keys of the recordings from which the features were computed."""

    samples: Samples
    keys: tuple[str, ...]


def recording_name(domain: str, case: Case) -> str:
    """Return a name that contains the domain (measured or simulated) and sorts by object, room, motion, distance and repetition."""
    return f"{case.object} {case.room} {case.motion} {case.distance_m:g} m #{case.repetition} {domain}"


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
        raise InputError(f"the campaign has no {motion} recordings{place} of two objects at one distance, both measured and simulated")
    measured, simulated = ([case for case in side if (case.object, case.room, case.distance_m) in shared] for side in cases)
    return balanced(measured), simulated


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


def frames(source: RecordingSource, domain: str, cases: Sequence[Case], features: str, materials: Any = None) -> Readings:
    return _read(source, domain, cases, lambda processed, log: sets.frames(processed, log, features), materials)


def signatures(source: RecordingSource, domain: str, cases: Sequence[Case], rows: int = 50) -> Readings:
    """Read the range-time signature of each recording as one feature row.

    A signature holds levels in dB from 0.3 to 5.5 m in range, interpolated in time to `rows` profiles.
    """

    def signature(processed: Processed, log: Log) -> tuple[list[str], np.ndarray]:
        names, level = sets.frames(processed, log, "raw")
        times = np.linspace(0, len(level) - 1, rows)
        before = np.minimum(times.astype(int), len(level) - 1)
        after, share = np.minimum(before + 1, len(level) - 1), (times - before)[:, None]
        picture = (1 - share) * level[before] + share * level[after]
        return [f"{row} {name}" for row in range(rows) for name in names], picture.ravel()

    return _read(source, domain, cases, signature)


def revolutions(processed: Processed, log: Log) -> list[tuple[str, Processed, Log]]:
    """Split a turntable recording into whole revolutions, each as (name suffix, recording, log). Other recordings are not split."""
    if log.angle_rad is None:
        return [("", processed, log)]
    period = envelope.frames_per_revolution(log.angle_rad)
    pieces: list[tuple[str, Processed, Log]] = []
    for number in range(processed.num_frames // period):
        at = slice(number * period, (number + 1) * period)
        pieces.append((f" turn {number:02d}", processed.frames(at), Nominal(log.frame_rate_hz, log.distance_m[at], log.angle_rad[at])))
    return pieces


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
            parts.append(_part(domain, case, values, suffix))
        keys.append(key)
    return Readings(gather(names, parts), tuple(sorted(keys)))


def _part(domain: str, case: Case, values: np.ndarray, suffix: str = "") -> Part:
    name = recording_name(domain, case)
    return Part(name + suffix, case.object, MEASURED if domain == "measured" else SIMULATED, values, stratum(case), name)


def measured_and_copies(
    config: Config, source: RecordingSource, store: Store, progress: Progress, without: Sequence[str] = ()
) -> tuple[Readings, Readings]:
    """Return (features of measured turntable revolutions, features of noisy copies of simulated turntable revolutions)."""
    cases, twins = shared_cases(source, MOTION)
    progress.say(f"{len(twins)} simulated revolutions, {config.supervision.copies} copies of each; {len(cases)} measured recordings")
    copied = noise_copies(config, store, source, twins, cases, without)
    return vectors(source, "measured", cases, FEATURES, without), copied


def noise_copies(
    config: Config, store: Store, source: RecordingSource, simulated: Sequence[Case], measured: Sequence[Case],
    without: Sequence[str] = (), measured_source: RecordingSource | None = None,
) -> Readings:  # fmt: skip
    """Compute features of `supervision.copies` noisy copies per simulated recording, with the noise level of measured recordings.

    The noise level of a copy comes from the measured recordings at the same distance. The store keeps the computed feature rows of the
    noisy copies. The noisy copies use target energies and noise floors of measured recordings, but no class labels.

    Args:
        measured_source: source of the measured recordings; None stands for the same source as the simulated recordings (`source`).
    """
    measured_source = measured_source or source
    source.prepare([("twin", case) for case in simulated])
    measured_source.prepare([("measured", case) for case in measured])
    count, seed, noise = config.supervision.copies, config.seed, {}
    for name in sorted({stratum(case) for case in simulated}):
        ours = np.array([_energy(source, "twin", case) for case in simulated if stratum(case) == name])
        theirs = np.array([_energy(measured_source, "measured", case) for case in measured if stratum(case) == name])
        noise[name] = added_noise(ours[:, 0], theirs[:, 0], float(np.median(theirs[:, 1]))) if len(theirs) else 0.0
    parts, keys, names = [], [], []
    for number, case in enumerate(sorted(simulated, key=lambda case: recording_name("twin", case))):
        key, processed = source.processed("twin", case)
        log = source.log(case, "twin")

        def build(folder: Path, case: Case = case, processed: Processed = processed, log: Log = log, number: int = number) -> None:
            made = _copies(config, source, case, processed, noise[stratum(case)], [seed, number])
            read = [sets.vector(copy, log, FEATURES, without) for copy in made]
            save_arrays(folder, {"names": np.array(read[0][0]), "values": np.stack([values for _, values in read])})

        spec = {
            "recording": key, "features": FEATURES, "without": list(without), "noise": noise[stratum(case)], "count": count, "seed": seed,
            "number": number, "randomise": asdict(config.supervision.randomise), "variants": config.supervision.variants,
            "distance_m": log.distance_m, "angle_rad": log.angle_rad,
        }  # fmt: skip
        stored = store.fetch("noise_copies", spec, ROOTS, build).arrays()
        names = [str(name) for name in stored["names"]]
        parts.append(_part("twin", case, stored["values"]))
        keys.append(key)
    return Readings(gather(names, parts), tuple(sorted(keys)))


def _copies(
    config: Config, source: RecordingSource, case: Case, processed: Processed, noise_power: float, seed: Sequence[int]
) -> Iterator[Processed]:
    """Yield the copies of a simulated recording: drawn turntables and targets, each with several drawn receivers and noises."""
    strengths = randomise.Randomisation(**asdict(config.supervision.randomise))
    count = config.supervision.copies
    variants = min(config.supervision.variants, count) if strengths.moves_target else 1
    nominal = None
    if strengths.moves_target:
        assert isinstance(source, Campaign), "drawn targets need a campaign that simulates them"
        nominal = alone.record(source, case, randomise.OFF, seed)
    for variant in range(variants):
        target = processed
        if nominal is not None and isinstance(source, Campaign):
            target = randomise.exchanged(processed, nominal, alone.record(source, case, strengths, [*seed, variant]))
        for number in range(variant, count, variants):
            own = [*seed, number]
            power = noise_power * randomise.noise_factor(strengths, own)
            yield noisy(randomise.received(target, strengths, own), power, np.random.default_rng(own))


def _energy(source: RecordingSource, domain: str, case: Case) -> tuple[float, float]:
    """Return (mean energy in the target gate, noise power per range bin) of a recording."""
    _, processed = source.processed(domain, case)
    log = source.log(case, domain)
    range_m = distances(log, processed.num_frames)
    if case.motion != MOTION:
        range_m = track.around(processed, range_m, log.frame_rate_hz)
    return float(envelope.target_energy(processed, range_m).mean()), float(processed.noise_floor.mean())
