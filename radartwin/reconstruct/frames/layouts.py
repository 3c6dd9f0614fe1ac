"""Which layout a folder of frames has, what that layout leaves to be said, and the frames in it."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

from radartwin.errors import MissingError, ScanError
from radartwin.reconstruct.axes import READINGS, TO_Z_UP
from radartwin.reconstruct.frames.folder import INDEX, load_own
from radartwin.reconstruct.frames.formats import ARKIT_UNIT_M, POSE_FILE_UNIT_M, TUM_UNIT_M, load_arkit, load_pose_file, load_tum
from radartwin.reconstruct.frames.frames import Frames


@dataclasses.dataclass(frozen=True)
class Layout:
    """A known layout.

    Attributes:
        told_by: the file that says what need not be given.
        unit_m: metres per count of its depth pictures; None where the file says.
        reads: options it takes.
    """

    name: str
    told_by: str
    unit_m: float | None
    reads: tuple[str, ...]


OWN = Layout("own", INDEX, None, ())
ARKIT = Layout("ARKit", "frame_N.json", ARKIT_UNIT_M, ("--depth-unit", "--up"))
TUM = Layout("TUM", "groundtruth.txt", TUM_UNIT_M, ("--intrinsics", "--depth-unit", "--up", "--poses"))
POSE_FILE = Layout("pose.txt", "pose.txt", POSE_FILE_UNIT_M, TUM.reads)


def layout_of(folder: Path) -> Layout:
    """The layout of a folder, by its files.

    Raises:
        MissingError: no such folder. ScanError: none of the known layouts.
    """
    if not folder.is_dir():
        raise MissingError(f"{folder} is not a folder; give the folder that holds the scan's frames")
    if (folder / INDEX).is_file():
        return OWN
    if any(folder.glob("frame_*.json")):
        return ARKIT
    for layout in (TUM, POSE_FILE):
        if (folder / layout.told_by).is_file():
            return layout
    if any(folder.glob("depth_*.png")) or any((folder / name).is_dir() for name in ("depth", "color", "colour", "rgb")):
        raise ScanError(f"{folder}: pictures but no poses; add frame_N.json, pose.txt or groundtruth.txt, whichever the app exports")
    raise ScanError(f"{folder}: no frames found; known are {INDEX}, frame_N.json (ARKit), pose.txt and groundtruth.txt (TUM)")


def load_frames(
    folder: Path,
    intrinsics: Sequence[float] | None = None,
    depth_unit_m: float | None = None,
    up: str | None = None,
    colour_only: bool = False,
    poses: str | None = None,
) -> Frames:
    """See `Frames.load`."""
    layout = layout_of(folder)
    if up is not None and up not in TO_Z_UP:
        raise ScanError(f"--up {up}: choose {', '.join(TO_Z_UP)}")
    if poses is not None and poses not in READINGS:
        raise ScanError(f"--poses {poses}: choose {', '.join(READINGS)}")
    given = {"--intrinsics": intrinsics, "--depth-unit": depth_unit_m, "--up": up, "--poses": poses}
    for option, value in given.items():
        if value is not None and option not in layout.reads:
            raise ScanError(f"{folder}: {option} is not read, {layout.told_by} says it; leave {option} out")
    if depth_unit_m is not None and colour_only:
        raise ScanError(f"{folder}: --depth-unit is not read with --depth-model, which takes no depth pictures; leave one of them out")
    if depth_unit_m is not None and not 0 < depth_unit_m < float("inf"):
        raise ScanError(f"--depth-unit {depth_unit_m:g}: give metres per count above zero, 0.001 for millimetres")
    unit = depth_unit_m or layout.unit_m
    if layout is OWN or unit is None:
        return load_own(folder, colour_only)
    if layout is ARKIT:
        return load_arkit(folder, unit, up or "y", colour_only)
    load = load_tum if layout is TUM else load_pose_file
    return load(folder, intrinsics, unit, up, colour_only, poses or "opencv")
