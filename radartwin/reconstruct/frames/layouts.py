"""Detect which program wrote a folder of frames (the folder layout), and read the frames."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

from radartwin.errors import MissingError, ScanError
from radartwin.reconstruct.axes import POSE_CONVENTIONS, TO_Z_UP
from radartwin.reconstruct.frames.folder import INDEX, load_own
from radartwin.reconstruct.frames.formats import ARKIT_UNIT_M, POSE_FILE_UNIT_M, TUM_UNIT_M, load_arkit, load_pose_file, load_tum
from radartwin.reconstruct.frames.frames import Frames


@dataclasses.dataclass(frozen=True)
class Layout:
    """A known layout of files in a folder of frames, and the command-line options that apply to such folders.

    Attributes:
        metadata_file: name of the file that holds the camera poses.
        unit_m: default value of metres per count of the depth pictures; None if `metadata_file` states the unit.
    """

    metadata_file: str
    unit_m: float | None
    options: tuple[str, ...]


OWN = Layout(INDEX, None, ())
ARKIT = Layout("frame_N.json", ARKIT_UNIT_M, ("--depth-unit", "--up"))
TUM = Layout("groundtruth.txt", TUM_UNIT_M, ("--intrinsics", "--depth-unit", "--up", "--poses"))
POSE_FILE = Layout("pose.txt", POSE_FILE_UNIT_M, TUM.options)


def layout_of(folder: Path) -> Layout:
    """Detect the layout of a folder of frames from its file names. The docstring of `load_frames` lists the errors."""
    if not folder.is_dir():
        raise MissingError(f"{folder} is not a folder; give the folder that holds the scan's frames")
    if (folder / INDEX).is_file():
        return OWN
    if any(folder.glob("frame_*.json")):
        return ARKIT
    for layout in (TUM, POSE_FILE):
        if (folder / layout.metadata_file).is_file():
            return layout
    if any(folder.glob("depth_*.png")) or any((folder / name).is_dir() for name in ("depth", "color", "colour", "rgb")):
        raise ScanError(f"{folder}: pictures but no poses; add frame_N.json, pose.txt or groundtruth.txt, whichever the app exports")
    raise ScanError(f"{folder}: no frames found; give a folder with {INDEX}, frame_N.json (ARKit), pose.txt or groundtruth.txt (TUM)")


def load_frames(
    folder: str | Path,
    intrinsics: Sequence[float] | None = None,
    depth_unit_m: float | None = None,
    up: str | None = None,
    colour_only: bool = False,
    poses: str | None = None,
) -> Frames:
    """Open a folder of frames in any known folder layout: ARKit export of 3d Scanner App, TUM RGB-D, pose.txt, or RadarTwin's own layout.

    This function checks the poses, the numbers of files and some depth pictures. All pictures of a frame are checked when the frame is
    read.

    Args:
        intrinsics: (fx, fy, cx, cy) in pixels of the depth picture, only for pose.txt and TUM. By default the intrinsics are read from the
            folder's file intrinsics.json, {"fx": , "fy": , "cx": , "cy": }.
        depth_unit_m: metres per count of the depth pictures. The default of the folder layout is 1/5000 m for TUM and 1 mm otherwise.
        up: world axis of the poses that points up (x, y, z, -x, -y, -z). ARKit folders and RadarTwin's own folders define this axis. For
            pose.txt and TUM the default is the axis nearest to the cameras' mean upward direction.
        poses: pose convention, one of `radartwin.reconstruct.axes.POSE_CONVENTIONS`, only for pose.txt and TUM; "opencv" by default.
        colour_only: whether to ignore the depth pictures, because a monocular model estimates the depth; the depth pictures may then be
            missing.
    Raises:
        MissingError: the folder or one of its pictures does not exist.
        ScanError: the folder layout is unknown, poses or intrinsics are missing, the numbers of files differ, a picture is damaged or has
            no depth, the depth unit is implausible, or an option does not apply to this folder layout.
        PoseError: a pose is mirrored or not rigid.
    """
    folder = Path(folder)
    layout = layout_of(folder)
    if up is not None and up not in TO_Z_UP:
        raise ScanError(f"--up {up} is unknown; choose {', '.join(TO_Z_UP)}")
    if poses is not None and poses not in POSE_CONVENTIONS:
        raise ScanError(f"--poses {poses} is unknown; choose {', '.join(POSE_CONVENTIONS)}")
    given = {"--intrinsics": intrinsics, "--depth-unit": depth_unit_m, "--up": up, "--poses": poses}
    for option, value in given.items():
        if value is not None and option not in layout.options:
            raise ScanError(f"{folder}: {option} does not apply because {layout.metadata_file} defines it; leave {option} out")
    if depth_unit_m is not None and colour_only:
        raise ScanError(f"{folder}: --depth-unit does not apply with --depth-model, which reads no depth pictures; leave one of them out")
    if depth_unit_m is not None and not 0 < depth_unit_m < float("inf"):
        raise ScanError(f"--depth-unit {depth_unit_m:g}: give metres per count above zero, 0.001 for millimetres")
    unit = depth_unit_m or layout.unit_m
    if layout is OWN or unit is None:
        return load_own(folder, colour_only)
    if layout is ARKIT:
        return load_arkit(folder, unit, up or "y", colour_only)
    load = load_tum if layout is TUM else load_pose_file
    return load(folder, intrinsics, unit, up, colour_only, poses or "opencv")
