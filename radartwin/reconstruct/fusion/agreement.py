"""Check the depth unit and the pose convention of frames by comparing overlapping views.

A moving camera sees the same surfaces from several positions. The surfaces in these views coincide only if the depth unit and the pose
convention are right. The check scales all views to the same median depth. The check then measures the distance between the surfaces of
overlapping views, for each known depth unit and pose convention. If the surfaces coincide clearly better with another unit or convention
than with those of the user, the check raises an error that names the better unit or convention.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from radartwin.errors import ScanError
from radartwin.reconstruct.frames.folder import INDEX
from radartwin.reconstruct.frames.frames import POSE_CONVENTIONS, Frame, Frames, camera_to_world, points
from radartwin.reconstruct.frames.pictures import UNITS_M, plausible
from radartwin.reconstruct.fusion.alignment import disagreement
from radartwin.reconstruct.fusion.views import prepared
from radartwin.reconstruct.fusion.volume import View
from radartwin.reconstruct.scan_file import ScanWarning

COMPARED_VIEWS = 40  # number of views that are compared, evenly distributed over the scan
MEDIAN_M = 2.0  # all views are scaled to this median depth
CLEARLY_BETTER = 0.5  # ratio of two median distances between views, at or below which the smaller distance is clearly better
EQUAL_RATIO = 1.5  # two median distances between views count as equal if their ratio is smaller than this
GOOD_M = 0.01  # smaller distances between views at MEDIAN_M can come from the depth noise and pose drift of a phone
# a larger distance between views at MEDIAN_M shows a wrong unit or convention; twice the drift of a phone in a large hall gives 0.05 m
SUSPECT_M = 0.06
MIN_PAIRS = 0.7  # smallest number of overlapping view pairs under another unit or convention, relative to the number under the user's


@dataclass(frozen=True)
class Agreement:
    """The distance between the surfaces in overlapping camera views, under one assumed depth unit or pose convention.

    Attributes:
        pairs: number of overlapping view pairs.
        apart_m: median distance between the surfaces of overlapping views, in metres, if all views are scaled to the median depth MEDIAN_M.
    """

    name: str
    pairs: int
    apart_m: float

    def better_than(self, other: Agreement) -> bool:
        if not self.pairs or self.pairs < MIN_PAIRS * other.pairs:
            return False
        return not other.pairs or (other.apart_m > GOOD_M and self.apart_m < CLEARLY_BETTER * other.apart_m)


def check_agreement(frames: Frames, unit_m: float | None, convention: str | None, metadata_file: str = INDEX) -> None:
    """Raise an error if overlapping views coincide clearly better with a depth unit or pose convention different from the user's.

    Args:
        frames: frames with their original poses, so any world axis may point up.
        unit_m: metres per count with which the depth pictures were read; None if the folder layout defines the unit.
        convention: pose convention, one of `frames.POSE_CONVENTIONS`; None if the folder layout defines the convention.
        metadata_file: name of the file that defines the pose convention if `convention` is None.
    Raises:
        ScanError: views coincide clearly better with another unit or convention. The message names this unit or convention, and gives the
            median distance between views for both.
    Warns:
        ScanWarning: the views do not coincide with any unit and convention, do not overlap, or coincide equally well with several units.
    """
    count = len(frames)
    if count < 2:
        return
    compared = [frames[int(i)] for i in np.unique(np.linspace(0, count - 1, min(count, COMPARED_VIEWS)).round())]
    depths = np.concatenate([f.depth_m[f.depth_m > 0][::50] for f in compared])
    if not len(depths):
        return
    depth_m = float(np.median(depths))
    scale = MEDIAN_M / depth_m
    views = [prepared(frame, np.inf) for frame in compared]
    views = [view._replace(depth=(view.depth * np.float32(scale)).astype(np.float32)) for view in views]
    poses = np.array([frame.pose for frame in compared])
    poses[:, :3, 3] *= scale

    given = _check_convention(frames.source, views, poses, convention, metadata_file, scale)
    if unit_m is not None:
        _check_unit(frames.source, compared, views, poses, unit_m, given)
    if given.pairs and given.apart_m > SUSPECT_M:
        cause = f"the poses ({POSE_CONVENTIONS[given.name]}), the intrinsics or the depth unit may be wrong"
        warnings.warn(f"{frames.source}: {_distance(given, scale)}, but some millimetres are usual; {cause}", ScanWarning, stacklevel=2)
    if not given.pairs:
        text = "no two views overlap at the given poses, so poses and depth unit cannot be checked"
        warnings.warn(f"{frames.source}: {text}; look at the scene with radartwin view", ScanWarning, stacklevel=2)


def _check_convention(
    source: str, views: list[View], poses: np.ndarray, convention: str | None, metadata_file: str, scale: float
) -> Agreement:
    """Compare the given pose convention with all other conventions, and return the `Agreement` of the given convention."""
    # back to the convention of the file: the inverse of `camera_to_world`
    flipped = camera_to_world(poses, "opengl") if (convention or "").startswith("opengl") else poses
    as_written = camera_to_world(flipped, "opencv-inverse") if (convention or "").endswith("-inverse") else flipped
    disagreements = disagreement(views, [camera_to_world(as_written, name) for name in POSE_CONVENTIONS])
    agreements = {name: Agreement(name, *values) for name, values in zip(POSE_CONVENTIONS, disagreements, strict=True)}
    given = agreements[convention or "opencv"]
    best = min((a for a in agreements.values() if a.better_than(given)), key=lambda a: a.apart_m, default=None)
    if best is not None:
        remedy = f"give --poses {best.name}" if convention else f"correct them in {metadata_file}"
        read = f"with poses read as {POSE_CONVENTIONS[given.name]}, {_distance(given, scale)}"
        look = f"the poses look like {POSE_CONVENTIONS[best.name]}, with which {_distance(best, scale)}"
        raise ScanError(f"{source}: {read}; {look}: {remedy}")
    return given


def _check_unit(source: str, frames: Sequence[Frame], views: list[View], poses: np.ndarray, unit_m: float, given: Agreement) -> None:
    """Compare the views for every plausible depth unit: for a unit k times larger, camera positions / k give the same scene, scaled."""
    depth_m = float(np.median(np.concatenate([f.depth_m[f.depth_m > 0][::50] for f in frames])))
    others = [u for u in UNITS_M if not np.isclose(u, unit_m, rtol=0.01) and plausible(depth_m * u / unit_m)]
    moved = []
    for unit in others:
        moved.append(poses.copy())
        moved[-1][:, :3, 3] *= unit_m / unit
    agreements = [(Agreement(f"{unit:g}", *values), unit) for unit, values in zip(others, disagreement(views, moved), strict=True)]

    def described(agreement: Agreement, unit: float) -> str:
        x, y, z = _extent_m(frames, unit / unit_m)
        apart = f"views {100 * agreement.apart_m / MEDIAN_M:.1f} % of the depth apart" if agreement.pairs else "no overlapping views"
        return f"{unit:g} m per count (a room of {x:.2g} x {y:.2g} x {z:.2g} m, {apart})"

    better = [(a, u) for a, u in agreements if a.better_than(given)]
    if better:
        smallest = min(a.apart_m for a, _ in better)
        fits = [described(a, u) for a, u in better if a.apart_m < EQUAL_RATIO * smallest]
        text = f"the depth was read with {described(given, unit_m)}, and fits the poses better with {' or '.join(fits)}"
        raise ScanError(f"{source}: {text}; give the better unit as --depth-unit")
    equal = [described(a, u) for a, u in agreements if a.pairs >= MIN_PAIRS * given.pairs and a.apart_m < EQUAL_RATIO * given.apart_m]
    if equal:
        text = f"the views do not determine the unit of depth: it may be {described(given, unit_m)}, as given, or {' or '.join(equal)}"
        warnings.warn(f"{source}: {text}; check --depth-unit", ScanWarning, stacklevel=3)


def _extent_m(frames: Sequence[Frame], factor: float) -> np.ndarray:
    """Return the extent (3,) in metres, without outliers, of the depth points of the frames, after multiplying all depths by `factor`."""
    clouds = []
    for frame in frames:
        offsets = points(frame)[::8, ::8].reshape(-1, 3) - frame.pose[:3, 3]
        clouds.append(offsets[np.isfinite(offsets).all(axis=1)] * factor + frame.pose[:3, 3])
    low, high = np.quantile(np.concatenate(clouds), [0.01, 0.99], axis=0)
    return high - low


def _distance(agreement: Agreement, scale: float) -> str:
    if not agreement.pairs:
        return "no two views overlap"
    return f"the surfaces in overlapping views are {1000 * agreement.apart_m / scale:.0f} mm apart"
