"""Compute what the radar receives in a scene: range profile, range-azimuth map and the strongest paths with their surfaces.

Levels are of received over transmitted power, of a path at the centre frequency with the gain of the antenna element, in decibels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from radartwin.constants import SPEED_OF_LIGHT
from radartwin.radar.chirp import Radar
from radartwin.radar.power_maps import power_maps
from radartwin.radar.processing import decibels
from radartwin.scene.scene import Scene
from radartwin.simulation.backends.mitsuba import Traced
from radartwin.simulation.origins import distances_m
from radartwin.simulation.paths import Paths
from radartwin.simulation.pruning import both_gains

FLOOR_DB = -200.0  # level of an empty range bin
SHOWN_PATHS = 30  # number of paths in an answer
TOUCHING_M = 0.003  # a point this near to two surfaces lies on both, at the edge where they meet
NEAR_SURFACE_M = 0.05  # a point farther than this from every surface lies on none

CLICK_RAD = 0.02  # a click within this angle of a path chooses it; about 12 pixels
TOGETHER_RAD = 0.003  # paths within this angle of the nearest to a click run together
LEG_POINTS = 200  # points of each leg of a path that are compared with a click


@dataclass(frozen=True, eq=False)
class Spectra:
    """Hold the range profile and the range-azimuth map of one frame."""

    range_m: np.ndarray  # (B,)
    azimuth_rad: np.ndarray  # (A,) positive to the left
    profile_db: np.ndarray  # (B,) mean power of all channels and chirps
    map_db: np.ndarray  # (A, B) power per direction, by Bartlett beamforming


@dataclass(frozen=True, eq=False)
class LivePath:
    """Hold one propagation path of the room, or the coherent sum of paths of an object that the radar cannot separate."""

    level_db: float  # received over transmitted power, with the gain of the antenna element
    length_m: float  # from the transmitter to the receiver
    bounces: int  # reflections and diffractions
    points: np.ndarray  # (V, 3) corners in the world, from the radar back to the radar
    owner: str = ""  # name of the object, or "" for a path of the room
    partial: bool = False  # whether corners between the first and the last are unknown

    @property
    def delay_s(self) -> float:
        return self.length_m / SPEED_OF_LIGHT

    @property
    def range_m(self) -> float:
        """Range at which the radar shows the path: half of its length."""
        return self.length_m / 2


def spectra(iq: np.ndarray, radar: Radar) -> Spectra:
    """Compute the range profile and the range-azimuth map of one frame of samples (C, T, R, N)."""
    maps = power_maps(iq[None], radar)
    profile_db, map_db = (np.maximum(decibels(power), FLOOR_DB) for power in (maps.range_time.mean(axis=0), maps.range_azimuth))
    return Spectra(maps.range_m, maps.azimuth_rad, profile_db, map_db)


def path_at(paths: Sequence[LivePath], eye: np.ndarray, direction: np.ndarray) -> int | None:
    """Return the number of the path nearest to a view ray (of several together the strongest), or None beyond CLICK_RAD.

    paths: strongest first. eye: origin (3,) of the ray. direction: unit vector (3,) of the ray.
    """
    share = np.linspace(0, 1, LEG_POINTS)[:, None, None]
    angles = []
    for path in paths:
        away = (path.points[:-1] + share * np.diff(path.points, axis=0)).reshape(-1, 3) - eye
        cosine = away @ direction / np.maximum(np.linalg.norm(away, axis=1), 1e-9)
        angles.append(float(np.arccos(np.clip(cosine.max(), -1, 1))))
    if not angles or min(angles) > CLICK_RAD:
        return None
    return int(np.argmax(np.array(angles) < min(angles) + TOGETHER_RAD))


def strongest_paths(traced: Traced, radar: Radar, sensor_pose: np.ndarray) -> list[LivePath]:
    """Return the SHOWN_PATHS strongest paths, strongest first, without diffuse paths and shadows.

    A path of the room and its reverse are listed once. Paths of an object with equal bounces and nearly equal ranges are summed.
    """
    paths = [path for part in traced.static for path in _room_paths(part, radar, sensor_pose)]
    for names, parts in traced.groups.items():
        paths += [path for part in parts for path in _object_paths(part, radar, sensor_pose, names[0])]
    paths.sort(key=lambda path: -path.level_db)
    return paths[:SHOWN_PATHS]


def surfaces_at(path: LivePath, scene: Scene) -> list[str]:
    """Return the names of the surfaces of a scene at the corners of a path, in its order; where two surfaces meet, both names."""
    if not len(scene):
        return []
    points = path.points[1:-1]
    names = [surface.name or f"surface {index}" for index, surface in enumerate(scene)]
    table = np.array([distances_m(surface.mesh, points, NEAR_SURFACE_M) for surface in scene])
    out = []
    for p in range(len(points)):
        nearest = float(table[:, p].min())
        touching = [name for name, away in zip(names, table[:, p], strict=True) if away <= max(nearest, TOUCHING_M)]
        out.append(" and ".join(dict.fromkeys(touching)) if np.isfinite(nearest) else "unknown")
    return out


def _room_paths(part: Paths, radar: Radar, pose: np.ndarray) -> list[LivePath]:
    levels = np.abs(_field(part, radar))
    order = np.argsort(-levels, kind="stable")[: 2 * SHOWN_PATHS]
    seen, out = set[tuple](), []
    for n in order:
        if part.points is None:
            points, partial = _corners(part, n, pose)
        else:
            points, partial = part.points[n][np.isfinite(part.points[n]).all(axis=1)], False
        length = float(part.length_m[n])
        corners = np.round(points, 3).tolist()
        either = () if partial else tuple(map(tuple, min(corners, corners[::-1])))  # the same for both directions of the path
        key = round(length, 5), round(float(levels[n]) / float(levels[order[0]]), 5), either
        if levels[n] <= 0 or (key in seen and part.bounces[n] > 1):
            continue
        seen.add(key)
        out.append(LivePath(_db(float(levels[n])), length, int(part.bounces[n]), _closed(points, pose), partial=partial))
    return out


def _object_paths(part: Paths, radar: Radar, pose: np.ndarray, name: str) -> list[LivePath]:
    """Return one path for each number of bounces and each interval of two range bins, with the corners of its strongest tube."""
    field = _field(part, radar)
    levels = np.abs(field)
    field *= np.exp(2j * np.pi * part.frequencies_hz[_middle(part)] * part.length_m / SPEED_OF_LIGHT)
    # rounded to two range bins, so that the tubes of one echo stay together
    bins = np.round(part.length_m / (4 * radar.range_resolution_m))
    out = []
    for bounces, near in np.unique(np.column_stack([part.bounces, bins]), axis=0):
        tubes = np.flatnonzero((part.bounces == bounces) & (bins == near))
        n = tubes[np.argmax(levels[tubes])]
        points, partial = _corners(part, n, pose)
        out.append(
            LivePath(_db(float(np.abs(field[tubes].sum()))), float(part.length_m[n]), int(bounces), _closed(points, pose), name, partial)
        )
    return out


def _field(part: Paths, radar: Radar) -> np.ndarray:
    """Return the complex amplitude (N,) of each path in the middle of the sweep, with the element gain, without the propagation phase."""
    return part.amplitude[:, _middle(part)] * both_gains(radar, part.departure, part.arrival)


def _middle(part: Paths) -> int:
    return part.amplitude.shape[1] // 2


def _corners(part: Paths, n: np.integer | int, pose: np.ndarray) -> tuple[np.ndarray, bool]:
    """Return the corners (V, 3) of a path without stored points, and whether corners in the middle are missing.

    Of two bounces, the first is at the distance s along the departure d with |last - s d| + s = length_in. Of more, only the last is known.
    """
    departure, arrival = pose[:3, :3] @ part.departure[n], pose[:3, :3] @ part.arrival[n]
    last, length_in = part.length_out_m[n] * arrival, float(part.length_in_m[n])
    bounces = int(part.bounces[n])
    if bounces == 2:
        first = (length_in**2 - last @ last) / (2 * (length_in - last @ departure))
        return np.stack([first * departure, last]) + pose[:3, 3], False
    return (last + pose[:3, 3])[None], bounces > 1


def _closed(points: np.ndarray, pose: np.ndarray) -> np.ndarray:
    return np.concatenate([pose[None, :3, 3], points, pose[None, :3, 3]])


def _db(amplitude: float) -> float:
    return max(float(decibels(amplitude**2)), FLOOR_DB)


def span_db(values: Sequence[float] | np.ndarray, dynamic_db: float) -> tuple[float, float]:
    """Return the limits of a level scale: the largest value rounded up to 5 dB, and below; FLOOR_DB is darkest."""
    if len(values) and np.max(values) <= FLOOR_DB:
        return FLOOR_DB, FLOOR_DB + dynamic_db
    top = 5 * float(np.ceil((np.max(values) if len(values) else 0.0) / 5))
    return top - dynamic_db, top
