"""Whether the views agree as they are read, before long work.

A camera that moves sees the same places from several sides, and only the right unit of depth and the right meaning of the poses put them
into one place. So overlapping views are compared under every unit and meaning there is, all at one scale: where another than the given
one agrees clearly better, the given one is refused and the other named.
"""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np

from radartwin.errors import ScanError
from radartwin.reconstruct.axes import READINGS, camera_to_world
from radartwin.reconstruct.frames.folder import INDEX
from radartwin.reconstruct.frames.frames import Frames, points
from radartwin.reconstruct.frames.pictures import UNITS_M, plausible
from radartwin.reconstruct.frames.plausible import ScanWarning
from radartwin.reconstruct.fusion.alignment import disagreement
from radartwin.reconstruct.fusion.views import prepared
from radartwin.reconstruct.fusion.volume import View

LOOKED_AT = 40  # views, evenly over the scan
MEDIAN_M = 2.0  # all are compared as if the middle of the depth pictures were this far
CLEARLY = 0.5  # another reading must at least halve the disagreement
ALIKE = 1.5  # readings this near to one another are not told apart
SOUND_M = 0.01  # below it nothing is wrong: a phone's noise and drift, at MEDIAN_M
SUSPECT_M = 0.06  # above it something is, whatever it is; twice the drift of a phone over a large hall makes 0.05


@dataclass(frozen=True)
class Reading:
    """One way to read the frames: pairs of views that overlap, and how far they lie apart (metres at MEDIAN_M)."""

    name: str
    pairs: int
    apart_m: float

    def better_than(self, other: Reading) -> bool:
        if not self.pairs or self.pairs < 0.7 * other.pairs:
            return False
        return not other.pairs or (other.apart_m > SOUND_M and self.apart_m < CLEARLY * other.apart_m)


def check_agreement(frames: Frames, unit_m: float | None, reading: str | None, told_by: str = INDEX) -> None:
    """Refuse a depth unit, or a reading of the poses, that another one beats clearly; warn where nothing fits or nothing tells.

    Args:
        frames: in the world of their poses, whichever way is up.
        unit_m: metres per count that the depth was read with; None where it is not a matter of choice.
        reading: of the poses, one of `axes.READINGS`; None where the layout says.
        told_by: the file that says it then.
    Raises:
        ScanError: naming what agrees better, and how well.
    """
    count = len(frames)
    if count < 2:
        return
    chosen = [frames[int(i)] for i in np.unique(np.linspace(0, count - 1, min(count, LOOKED_AT)).round())]
    seen = np.concatenate([f.depth_m[f.depth_m > 0][::50] for f in chosen])
    if not len(seen):
        return
    depth_m = float(np.median(seen))
    scale = MEDIAN_M / depth_m
    views = [_scaled(prepared(frame, np.inf, colour=False), scale) for frame in chosen]
    poses = np.array([frame.pose for frame in chosen])
    poses[:, :3, 3] *= scale

    names = list(READINGS)
    raw = _as_written(poses, reading or "opencv")
    found = disagreement(views, [camera_to_world(raw, name) for name in names])
    ways = {name: Reading(name, *one) for name, one in zip(names, found, strict=True)}
    given = ways[reading or "opencv"]
    best = min((w for w in ways.values() if w.better_than(given)), key=lambda w: w.apart_m, default=None)
    if best is not None:
        remedy = f"give --poses {best.name}" if reading else f"mend them in {told_by}"
        raise ScanError(
            f"{frames.source}: read as {READINGS[given.name]}, {_apart(given, scale)}; "
            f"the poses look like {READINGS[best.name]}, by which {_apart(best, scale)}: {remedy}"
        )
    if unit_m is not None:
        _check_unit(frames.source, chosen, views, poses, unit_m, depth_m, given)
    if given.pairs and given.apart_m > SUSPECT_M:
        what = f"poses ({READINGS[given.name]}), intrinsics or depth unit may be wrong"
        warnings.warn(f"{frames.source}: {_apart(given, scale)}, where some millimetres are usual; {what}", ScanWarning, stacklevel=2)
    if not given.pairs:
        text = "no two views overlap as the poses put them, so nothing tells whether poses and depth unit are right"
        warnings.warn(f"{frames.source}: {text}; look at the scene with radartwin view", ScanWarning, stacklevel=2)


def _check_unit(source: str, chosen: list, views: list[View], poses: np.ndarray, unit_m: float, depth_m: float, given: Reading) -> None:
    """Compare the views as if the depth were in each unit that a room allows: depth k times as large is motion k times as small."""
    others = [u for u in UNITS_M if not np.isclose(u, unit_m, rtol=0.01) and plausible(depth_m * u / unit_m)]
    moved = []
    for unit in others:
        moved.append(poses.copy())
        moved[-1][:, :3, 3] *= unit_m / unit
    found = [Reading(f"{unit:g}", *one) for unit, one in zip(others, disagreement(views, moved), strict=True)]

    def told(reading: Reading, unit: float) -> str:
        x, y, z = _size_m(chosen, unit / unit_m)
        apart = f"views {100 * reading.apart_m / MEDIAN_M:.1f} % of the depth apart" if reading.pairs else "no overlapping views"
        return f"{unit:g} m per count (a room of {x:.2g} x {y:.2g} x {z:.2g} m, {apart})"

    better = [(r, u) for r, u in zip(found, others, strict=True) if r.better_than(given)]
    if better:
        least = min(r.apart_m for r, _ in better)
        fits = [told(r, u) for r, u in better if r.apart_m < ALIKE * least]
        raise ScanError(
            f"{source}: the depth was read with {told(given, unit_m)}, and fits the poses better with {' or '.join(fits)}; "
            "give that as --depth-unit"
        )
    alike = [told(r, u) for r, u in zip(found, others, strict=True) if r.pairs >= 0.7 * given.pairs and r.apart_m < ALIKE * given.apart_m]
    if alike:
        text = f"the views do not tell the unit of depth: it may be {told(given, unit_m)}, as it was read, or {' or '.join(alike)}"
        warnings.warn(f"{source}: {text}; check --depth-unit", ScanWarning, stacklevel=3)


def _as_written(poses: np.ndarray, reading: str) -> np.ndarray:
    """The inverse of `camera_to_world`: the poses as the file has them."""
    flipped = camera_to_world(poses, "opengl") if reading.startswith("opengl") else poses
    return camera_to_world(flipped, "opencv-inverse") if reading.endswith("-inverse") else flipped


def _scaled(view: View, factor: float) -> View:
    return View(view.pose, view.intrinsics, (view.depth * np.float32(factor)).astype(np.float32), view.slope, view.weight)


def _size_m(chosen: list, factor: float) -> np.ndarray:
    """Extent of what the views see (3,), metres, were the depth `factor` times as large; the outer hundredths left out."""
    seen = []
    for frame in chosen:
        spread = points(frame)[::8, ::8].reshape(-1, 3) - frame.pose[:3, 3]
        seen.append(spread[np.isfinite(spread).all(axis=1)] * factor + frame.pose[:3, 3])
    low, high = np.quantile(np.concatenate(seen), [0.01, 0.99], axis=0)
    return high - low


def _apart(reading: Reading, scale: float) -> str:
    if not reading.pairs:
        return "no two views overlap"
    return f"overlapping views lie {1000 * reading.apart_m / scale:.0f} mm apart"
