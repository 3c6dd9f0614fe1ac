"""Detect which program wrote a folder of frames (the folder layout), and read the frames.

ARKit export     3d Scanner App: depth_N.png (uint16 mm), conf_N.png (0..2), frame_N.json (intrinsics of the 1920x1440 picture;
                 cameraPoseARFrame, camera-to-world by rows, camera x right, y up, z back, world y up), frame_N.jpg for some frames
pose.txt         slambook2: color/N.png, depth/N.pgm or .png (uint16 mm), pose.txt with a line tx ty tz qx qy qz qw per frame
TUM RGB-D        rgb.txt, depth.txt (time file), groundtruth.txt (time tx ty tz qx qy qz qw); depth in 1/5000 m. See Sturm et
                 al. 2012, A Benchmark for the Evaluation of RGB-D SLAM Systems, and the data set's file format page
frames.json      RadarTwin's own layout, see `folder`
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from radartwin.errors import InputError, MissingError, ScanError
from radartwin.io import untrusted_json
from radartwin.io.files import inside
from radartwin.io.one_line import plural
from radartwin.reconstruct.frames.folder import INDEX, load_own
from radartwin.reconstruct.frames.frames import CAMERA_FLIP, POSE_CONVENTIONS, Frames, camera_to_world, rescaled, scan_digest, z_up
from radartwin.reconstruct.frames.pictures import Files, opened, picture_size
from radartwin.scene.mesh_file import TO_Z_UP
from radartwin.scene.trajectories.file import TUM as TUM_COLUMNS
from radartwin.scene.trajectories.file import number_rows, numbered
from radartwin.scene.trajectories.track import from_quaternions, pose_matrices

ARKIT_PICTURE = (1920, 1440)  # size (width, height) in pixels of the picture to which the exported intrinsics refer
TUM_MAX_S = 0.02  # largest time difference between a depth picture and its pose or colour picture, as in the tools of the TUM data set


class Layout(NamedTuple):
    """A known layout of files in a folder of frames, and the command-line options that apply to such folders.

    Attributes:
        metadata_file: name of the file that holds the camera poses.
        unit_m: default value of metres per count of the depth pictures; None if `metadata_file` states the unit.
    """

    metadata_file: str
    unit_m: float | None
    options: tuple[str, ...]


OWN = Layout(INDEX, None, ())
ARKIT = Layout("frame_N.json", 0.001, ("--depth-unit", "--up"))
TUM = Layout("groundtruth.txt", 0.0002, ("--intrinsics", "--depth-unit", "--up", "--poses"))
POSE_FILE = Layout("pose.txt", 0.001, TUM.options)


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
        poses: pose convention, one of `frames.POSE_CONVENTIONS`, only for pose.txt and TUM; "opencv" by default.
        colour_only: whether to ignore the depth pictures, because a monocular model estimates the depth; the depth pictures may then be
            missing.
    Raises:
        MissingError: the folder or one of its pictures does not exist.
        ScanError: the folder layout is unknown, poses or intrinsics are missing, the numbers of files differ, a picture is damaged or has
            no depth, the depth unit is implausible, or an option does not apply to this folder layout.
        PoseError: a row of a pose file is damaged, or a pose is mirrored or not rigid.
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
    unit_m = depth_unit_m or layout.unit_m
    if unit_m is None:
        return load_own(folder, colour_only)
    if layout is ARKIT:
        return load_arkit(folder, unit_m, up or "y", colour_only)
    return load_one_camera(folder, layout, intrinsics, unit_m, up, colour_only, poses or "opencv")


def load_arkit(folder: Path, unit_m: float, up: str, colour_only: bool) -> Frames:
    """Open an ARKit export of 3d Scanner App."""
    cameras = {p.stem.removeprefix("frame_"): p for p in sorted(folder.glob("frame_*.json"))}
    depths = {p.stem.removeprefix("depth_"): p for p in folder.glob("depth_*.png")}
    colours = {p.stem.removeprefix("frame_"): p for p in folder.glob("frame_*.jpg")}
    confidences = {p.stem.removeprefix("conf_"): p for p in folder.glob("conf_*.png")}
    if not colour_only and (odd := sorted(cameras.keys() ^ depths.keys())):
        text = f"{len(cameras)} frame_N.json and {len(depths)} depth_N.png; number {odd[0]} lacks one of the two; export it again"
        raise ScanError(f"{folder}: {text}")
    numbers = sorted(cameras.keys() & colours.keys() if colour_only else cameras)
    described = [_arkit_camera(cameras[n]) for n in numbers]
    poses = z_up(np.array([pose for pose, _ in described]).reshape(-1, 4, 4) @ CAMERA_FLIP, up)
    files = [Files(depths.get(n), colours.get(n), confidences.get(n)) for n in numbers]

    def lens(i: int, kind: str, size: tuple[int, int]) -> np.ndarray:
        return rescaled(described[i][1], ARKIT_PICTURE, size)

    return opened(folder, numbers, poses, files, lens, unit_m, colour_only, scan_digest(cameras.values()))


def _arkit_camera(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Read a frame's camera-to-world pose (4, 4) in ARKit's axes, and its intrinsics (3, 3) in pixels."""
    try:
        content = untrusted_json.read(path)
        pose = np.array(content["cameraPoseARFrame"], dtype=np.float64).reshape(4, 4)
        return pose, np.array(content["intrinsics"], dtype=np.float64).reshape(3, 3)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ScanError(f"{path}: no camera pose and intrinsics ({type(error).__name__}: {error}); export the frame again") from error


def load_one_camera(
    folder: Path, layout: Layout, intrinsics: Sequence[float] | None, unit_m: float, up: str | None, colour_only: bool, convention: str
) -> Frames:
    """Open a folder in the layout POSE_FILE or TUM: one camera, whose colour pictures and depth pictures show the same view.

    `convention` is one of `frames.POSE_CONVENTIONS`.
    """
    names, rows, depths, colours = (_tum if layout is TUM else _pose_file)(folder, colour_only)
    file = folder / layout.metadata_file
    rotations = from_quaternions(rows[:, 3:], lambda k: f"{file}: pose {k + 1}")
    poses = camera_to_world(pose_matrices(rows[:, :3], rotations), convention)
    camera = _camera(folder, intrinsics)
    first = next((path for path in (*depths, *colours) if path is not None), None)
    first_size = picture_size(first) if first else (0, 0)
    centre = camera[:2, 2]
    if first and not np.all((centre > 0) & (centre < first_size)):
        size = f"the picture {first.name} of {first_size[0]} x {first_size[1]} pixels"
        raise ScanError(f"{folder}: cx, cy = {centre[0]:g}, {centre[1]:g} lie outside {size}; give the intrinsics of these pictures")

    def lens(i: int, kind: str, size: tuple[int, int]) -> np.ndarray:
        return camera if kind == "depth" else rescaled(camera, first_size, size)

    files = [Files(None if colour_only else depths[i], colours[i] if colours else None) for i in range(len(names))]
    return opened(folder, names, z_up(poses, up or _upward(poses, folder)), files, lens, unit_m, colour_only, scan_digest([file]))


_Listed = tuple[list[str], np.ndarray, Sequence[Path], Sequence[Path | None]]  # names, rows tx ty tz qx qy qz qw (N, 7), depths, colours


def _pose_file(folder: Path, colour_only: bool) -> _Listed:
    """List the frames of a folder whose poses are in pose.txt, in the order of the numbers in the file names."""
    rows = _rows(folder / "pose.txt", TUM_COLUMNS[1:])
    depths = _pictures(folder, ("depth",))
    colours = _pictures(folder, ("color", "colour", "rgb"))
    counted = colours if colour_only else depths
    if len(counted) != len(rows) or (colours and len(colours) != len(rows)):
        counts = f"{plural(len(rows), 'pose')}, {len(depths)} depth and {len(colours)} colour pictures"
        raise ScanError(f"{folder}: {counts}; give one of each per frame")
    return [p.stem for p in counted], rows, depths, colours


def _tum(folder: Path, colour_only: bool) -> _Listed:
    """List the frames of a folder in the TUM RGB-D format: the pictures that have a pose, with the colour picture nearest in time."""
    truth = _rows(folder / "groundtruth.txt", TUM_COLUMNS)
    colour_times, colour_files = _listed(folder / "rgb.txt") if (folder / "rgb.txt").is_file() else (np.zeros(0), [])
    times, depths = (colour_times, []) if colour_only else _listed(folder / "depth.txt")
    nearest = [(i, pose, _nearest(colour_times, time)) for i, time in enumerate(times) if (pose := _nearest(truth[:, 0], time)) is not None]
    if not nearest:
        raise ScanError(f"{folder}: no picture has a pose within {TUM_MAX_S} s in groundtruth.txt; use files of one clock")
    colours = [None if colour is None else colour_files[colour] for _, _, colour in nearest]
    names = [f"{times[i]:.6f}" for i, _, _ in nearest]
    return names, truth[[pose for _, pose, _ in nearest], 1:], [] if colour_only else [depths[i] for i, _, _ in nearest], colours


def _camera(folder: Path, intrinsics: Sequence[float] | None) -> np.ndarray:
    file = folder / "intrinsics.json"
    if intrinsics is None and file.is_file():
        try:
            content = untrusted_json.read(file)
            intrinsics = [float(content[key]) for key in ("fx", "fy", "cx", "cy")]
        except (ValueError, KeyError, TypeError) as error:
            raise ScanError(f'{file}: give {{"fx": , "fy": , "cx": , "cy": }} in pixels ({type(error).__name__}: {error})') from error
    if intrinsics is None:
        raise ScanError(f"{folder}: the layout has no camera intrinsics; give --intrinsics FX FY CX CY or add {file.name}")
    if len(intrinsics) != 4 or not np.isfinite(intrinsics).all() or min(intrinsics[:2]) <= 0:
        raise ScanError(f"{folder}: intrinsics {list(intrinsics)}; give fx, fy, cx, cy in pixels, the focal lengths positive")
    fx, fy, cx, cy = intrinsics
    return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1.0]])


def _rows(path: Path, columns: Sequence[str]) -> np.ndarray:
    """Read the numbers (N, columns) of a text file with one row per line; the character # starts a comment."""
    text = re.sub(r"#.*", "", path.read_text(encoding="utf-8", errors="replace")).replace(",", " ")
    lines = numbered(text)
    if not lines:
        raise ScanError(f"{path} holds no poses; export the trajectory with the frames")
    return number_rows(lines, columns, columns, str(path))


def _listed(path: Path) -> tuple[np.ndarray, list[Path]]:
    """Read the times (N,) in seconds and the file paths from a TUM list such as depth.txt."""
    if not path.is_file():
        raise MissingError(f"{path} does not exist; a TUM folder has rgb.txt, depth.txt and groundtruth.txt")
    words = [line.split() for line in path.read_text(encoding="utf-8").splitlines() if line.strip() and not line.startswith("#")]
    try:
        return np.array([float(w[0]) for w in words]), [inside(path.parent, w[1]) for w in words]
    except InputError as error:
        raise ScanError(str(error)) from error
    except (ValueError, IndexError) as error:
        raise ScanError(f"{path}: a row must be a time and a file name") from error


def _nearest(times: np.ndarray, time: float) -> int | None:
    away = np.abs(times - time)
    return int(away.argmin()) if away.min(initial=np.inf) <= TUM_MAX_S else None


def _pictures(folder: Path, names: Sequence[str]) -> list[Path]:
    """List the pictures in the first folder among `names` that exists, ordered by the numbers in the file names."""
    for name in names:
        if (folder / name).is_dir():
            pictures = [p for p in (folder / name).iterdir() if p.suffix.lower() in (".png", ".pgm", ".jpg", ".jpeg", ".tif", ".tiff")]
            return sorted(pictures, key=lambda p: ([int(d) for d in re.findall(r"\d+", p.stem)], p.stem))
    return []


def _upward(poses: np.ndarray, folder: Path) -> str:
    """Return the world axis nearest to the mean upward direction of the cameras, because people hold cameras upright."""
    mean = -poses[:, :3, 1].mean(axis=0)
    axis = int(np.argmax(np.abs(mean)))
    if np.abs(mean[axis]) < 0.6:  # upright cameras that look 50 degrees downwards give the cosine 0.64
        vector = np.round(mean, 2).tolist()
        raise ScanError(f"{folder}: the cameras' mean up vector {vector} is near no axis; give --up as one of {', '.join(TO_Z_UP)}")
    return ("" if mean[axis] > 0 else "-") + "xyz"[axis]
