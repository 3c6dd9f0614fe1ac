"""The columns of the frame that are read from a recording. Each motion has its own columns; arrays are the values of one cell.

A turntable recording has `localised`: whether the strongest echo over all ranges lies in the target gate, `energy_noise` (2,): the mean
energy in the target gate and the mean noise power of a range bin, and the averages over frames (AVERAGES) of the power (B,) in the bins
`range_m`. If its revolutions are whole and have enough frames, it has the features of the set `rotation`, the same features and the picture
of each whole revolution (`revolutions`, `pictures`), and the range-Doppler signature of a revolution (N, R). A corner reflector also has
the power (F, B) of its first revolution, the channel signals (1, A, B) of its first frame, and the Bartlett power map (1, B, azimuths) of
this frame; other objects have (0, ...). A rail recording has ranges (F,) in metres: the logged range `nominal_m`, and the tracked range of
each tracker. A drive has the features of its motion, the features (F, D) of each frame (`frames`) with their names (D,), the power (F, B),
its mean (B,) after each frame is scaled to unit energy (`profile`), and in each frame (F,) the logged and the tracked range of the target,
the energy in the target gate and the radial velocity, (0,) without Doppler. Its detections (N, 3) are the frame number, range in metres and
azimuth in radians.
"""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from experiments.campaign.cases import RAIL, REFLECTOR, ROVER, Case
from radartwin.features import cloud, doppler, envelope, families, peak_track
from radartwin.features.extent import AZIMUTH_RAD
from radartwin.features.log import Log, Nominal, angles, distances
from radartwin.features.processed import Processed
from radartwin.features.profile import FAR_M, NEAR_M, gate
from radartwin.features.range_time import picture
from radartwin.features.signature import signature
from radartwin.radar.processing import steering

Columns = Mapping[str, Any]  # name: number, text, or array
TRACKERS = ("continuous", "brightest")  # track without jumps, and strongest bin of each frame


def read(case: Case, processed: Processed, log: Log) -> Columns:
    """Return the columns of one recording."""
    return READERS[case.motion](case, processed, log)


def _turntable(case: Case, processed: Processed, log: Log) -> Columns:
    target_m = float(distances(log, processed.num_frames)[0])
    inside = (processed.range_m >= NEAR_M) & (processed.range_m <= FAR_M)
    strongest = int(np.where(inside, processed.power.mean(axis=0), 0).argmax())
    angle_rad = angles(log, processed.num_frames)
    first_revolution = angle_rad < angle_rad[0] + 2 * np.pi - 1e-9
    energy = envelope.target_energy(processed, distances(log, processed.num_frames))
    return {
        **(_whole(processed, log, target_m) if envelope.resolved(angle_rad) else {}),
        "localised": bool(gate(processed.range_m, target_m)[strongest]),
        "energy_noise": np.array([energy.mean(), processed.noise_floor.mean()], float),
        "range_m": processed.range_m,
        **{f"{name}_power": average(processed.power.astype(float)) for name, average in AVERAGES.items()},
        "revolution": processed.power[first_revolution if case.object.startswith(REFLECTOR) else slice(0)],
        "first_frame": (first := processed.channels[: case.object.startswith(REFLECTOR)]),
        "azimuth_map": np.abs(first.swapaxes(1, 2) @ steering(processed.radar, AZIMUTH_RAD)) ** 2,
    }


def _whole(processed: Processed, log: Log, target_m: float) -> Columns:
    """Return the columns of a turntable recording with one whole revolution or more."""
    angle_rad = angles(log, processed.num_frames)
    period = envelope.frames_per_revolution(angle_rad)
    turns = [slice(start, start + period) for start in range(0, processed.num_frames - period + 1, period)]
    rows, pictures = [], []
    for piece, at in ((processed.frames(at), at) for at in turns):
        rows.append(families.vector(piece, Nominal(log.frame_rate_hz, log.distance_m[at], angle_rad[at]), "rotation")[1])
        pictures.append(picture(piece, angle_rad[at], target_m).ravel())
    return {
        **_features(processed, log, "rotation"),
        "revolutions": np.stack(rows),
        "pictures": np.stack(pictures),
        "signature": signature(processed, angle_rad, target_m),
    }


def _rail(case: Case, processed: Processed, log: Log) -> Columns:
    nominal = distances(log, processed.num_frames)
    low, high = nominal.min() - peak_track.SEARCH_M, nominal.max() + peak_track.SEARCH_M
    return {
        "frame_rate_hz": log.frame_rate_hz,
        "nominal_m": nominal,
        "continuous": peak_track.track(processed, low, high, log.frame_rate_hz),
        "brightest": peak_track.brightest(processed, low, high),
    }


def _features(processed: Processed, log: Log, name: str) -> Columns:
    names, values = families.vector(processed, log, name)
    return dict(zip(names, map(float, values), strict=True))


def _drive(case: Case, processed: Processed, log: Log) -> Columns:
    nominal = distances(log, processed.num_frames)
    along = peak_track.around(processed, nominal, log.frame_rate_hz)
    clouds = cloud.detections(processed)
    names, values = families.frames(processed, log, case.motion)
    return {
        **_features(processed, log, case.motion),
        "frames": values,
        "frame_features": np.array(names),
        "frame_rate_hz": log.frame_rate_hz,
        "power": processed.power,
        "profile": (processed.power / processed.power.sum(axis=1, keepdims=True)).mean(axis=0),
        "range_m": processed.range_m,
        "nominal_m": nominal,
        "track_m": along,
        "energy": np.maximum(envelope.target_energy(processed, along), 0.0),
        "velocity_mps": np.zeros(0) if processed.doppler is None else doppler.radial_velocity(processed, along),
        "detections": np.concatenate([np.column_stack([np.full(len(points), number), points]) for number, points in enumerate(clouds)]),
    }


AVERAGES: dict[str, Callable[[np.ndarray], np.ndarray]] = {  # averages of the power (F, B) over frames
    "mean": lambda power: power.mean(axis=0),
    "amplitude": lambda power: np.sqrt(power).mean(axis=0) ** 2,
    "db": lambda power: np.exp(np.log(np.maximum(power, 1e-30)).mean(axis=0)),
    "median": lambda power: np.median(power, axis=0),
}
READERS: dict[str, Callable[[Case, Processed, Log], Columns]] = {
    "turntable": _turntable, **dict.fromkeys(RAIL, _rail), **dict.fromkeys(ROVER, _drive),
}  # fmt: skip
