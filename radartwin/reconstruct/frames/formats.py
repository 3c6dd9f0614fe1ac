"""Read folders of frames that other programs write.

ARKit export     3d Scanner App: depth_N.png (uint16 mm), conf_N.png (0..2), frame_N.json (intrinsics of the 1920x1440 picture;
                 cameraPoseARFrame, camera-to-world by rows, camera x right, y up, z back, world y up), frame_N.jpg for some frames
pose.txt         slambook2: color/N.png, depth/N.pgm or .png (uint16 mm), pose.txt with a line tx ty tz qx qy qz qw per frame
TUM RGB-D        rgb.txt, depth.txt (time file), groundtruth.txt (time tx ty tz qx qy qz qw); depth in 1/5000 m. See Sturm et
                 al. 2012, A Benchmark for the Evaluation of RGB-D SLAM Systems, and the data set's file format page
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
from radartwin.reconstruct.axes import CAMERA_FLIP, TO_Z_UP, camera_to_world, z_up
from radartwin.reconstruct.frames.frames import Frame, Frames, rescaled, scan_digest
from radartwin.reconstruct.frames.pictures import check_depth, picture_size, read_colour, read_depth, read_picture
from radartwin.scene.trajectories.track import from_quaternions, pose_matrices

ARKIT_PICTURE = (1920, 1440)  # size (width, height) in pixels of the picture to which the exported intrinsics refer
ARKIT_UNIT_M = POSE_FILE_UNIT_M = 0.001
TUM_UNIT_M = 0.0002
TUM_MAX_S = 0.02  # largest time difference between a depth picture and its pose or colour picture, as in the tools of the TUM data set


def load_arkit(folder: Path, unit_m: float, up: str, colour_only: bool) -> Frames:
    """Open an ARKit export of 3d Scanner App."""
    cameras = {p.stem.removeprefix("frame_"): p for p in sorted(folder.glob("frame_*.json"))}
    depths = {p.stem.removeprefix("depth_"): p for p in sorted(folder.glob("depth_*.png"))}
    colours = {p.stem.removeprefix("frame_"): p for p in sorted(folder.glob("frame_*.jpg"))}
    if colour_only:
        numbers = sorted(cameras.keys() & colours.keys())
    else:
        numbers = sorted(cameras)
        if odd := sorted(cameras.keys() ^ depths.keys()):
            raise ScanError(
                f"{folder}: {len(cameras)} frame_N.json and {len(depths)} depth_N.png; number {odd[0]} lacks one of the two; export it "
                "again"
            )
        check_depth([depths[n] for n in numbers], unit_m, str(folder))
    described = [_arkit_camera(cameras[n]) for n in numbers]
    poses = z_up(np.array([pose for pose, _ in described]).reshape(-1, 4, 4) @ CAMERA_FLIP, up)

    def read(i: int) -> Frame:
        colour = read_colour(colours[numbers[i]]) if numbers[i] in colours else None
        camera = rescaled(described[i][1], ARKIT_PICTURE, colour.shape[1::-1]) if colour is not None else None
        if colour_only and colour is not None and camera is not None:
            return Frame.without_depth(numbers[i], poses[i], colour, camera)
        depth = read_depth(depths[numbers[i]], unit_m)
        confidence_file = folder / f"conf_{numbers[i]}.png"
        confidence = read_picture(confidence_file) if confidence_file.is_file() else None
        if confidence is not None and confidence.shape != depth.shape:
            raise ScanError(f"{confidence_file} has {confidence.shape} pixels but the depth {depth.shape}; export the frame again")
        return Frame(numbers[i], poses[i], rescaled(described[i][1], ARKIT_PICTURE, depth.shape[::-1]), depth, colour, camera, confidence)

    return Frames(numbers, poses, read, str(folder), scan_digest(cameras.values()))


def _arkit_camera(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Read a frame's camera-to-world pose (4, 4) in ARKit's axes, and its intrinsics (3, 3) in pixels."""
    try:
        content = untrusted_json.read(path)
        pose = np.array(content["cameraPoseARFrame"], dtype=np.float64).reshape(4, 4)
        return pose, np.array(content["intrinsics"], dtype=np.float64).reshape(3, 3)
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ScanError(f"{path}: no camera pose and intrinsics ({type(error).__name__}: {error}); export the frame again") from error


def load_pose_file(
    folder: Path, intrinsics: Sequence[float] | None, unit_m: float, up: str | None, colour_only: bool, convention: str
) -> Frames:
    """Open a folder of frames whose poses are in pose.txt; `convention` is one of `axes.POSE_CONVENTIONS`."""
    rows = _numbers(folder / "pose.txt", 7)
    depths = _pictures(folder, ("depth",))
    colours = _pictures(folder, ("color", "colour", "rgb"))
    counted = colours if colour_only else depths
    if len(counted) != len(rows) or (colours and len(colours) != len(rows)):
        raise ScanError(
            f"{folder}: {plural(len(rows), 'pose')}, {len(depths)} depth and {len(colours)} colour pictures; give one of each per frame"
        )
    names = [p.stem for p in counted]
    poses = camera_to_world(_poses(rows, folder / "pose.txt"), convention)
    pictures = _Pictures(names, depths, colours, unit_m, colour_only)
    return _one_camera(folder, pictures, poses, intrinsics, up, folder / "pose.txt")


def load_tum(folder: Path, intrinsics: Sequence[float] | None, unit_m: float, up: str | None, colour_only: bool, convention: str) -> Frames:
    """Open a folder of frames in the TUM RGB-D format; `convention` is one of `axes.POSE_CONVENTIONS`."""
    truth = _numbers(folder / "groundtruth.txt", 8)
    depth_times, depth_files = _listed(folder / "depth.txt") if not colour_only else (np.zeros(0), [])
    colour_times, colour_files = _listed(folder / "rgb.txt") if (folder / "rgb.txt").is_file() else (np.zeros(0), [])
    times = colour_times if colour_only else depth_times
    chosen, poses, colours = [], [], []
    for i, time in enumerate(times):
        nearest = _nearest(truth[:, 0], time)
        if nearest is not None:
            chosen.append(i)
            poses.append(truth[nearest, 1:])
            matched = _nearest(colour_times, time)
            colours.append(colour_files[matched] if matched is not None else None)
    if not chosen:
        raise ScanError(f"{folder}: no picture has a pose within {TUM_MAX_S} s in groundtruth.txt; use files of one clock")
    names = [f"{times[i]:.6f}" for i in chosen]
    depths = [depth_files[i] for i in chosen] if not colour_only else []
    world = camera_to_world(_poses(np.array(poses), folder / "groundtruth.txt"), convention)
    pictures = _Pictures(names, depths, colours, unit_m, colour_only)
    return _one_camera(folder, pictures, world, intrinsics, up, folder / "groundtruth.txt")


class _Pictures(NamedTuple):
    names: list[str]
    depths: Sequence[Path]
    colours: Sequence[Path | None]
    unit_m: float
    colour_only: bool


def _one_camera(
    folder: Path, pictures: _Pictures, poses: np.ndarray, intrinsics: Sequence[float] | None, up: str | None, pose_file: Path
) -> Frames:
    """Make a `Frames` sequence for a single camera whose colour pictures and depth pictures show the same view."""
    names, depths, colours, unit_m, colour_only = pictures
    camera = _camera(folder, intrinsics)
    if not colour_only:
        check_depth(depths, unit_m, str(folder))
    first = next((c for c in colours if c is not None), None)
    size = picture_size(depths[0]) if depths else picture_size(first) if first else (0, 0)
    poses = z_up(poses, up or _upward(poses, folder))

    def read(i: int) -> Frame:
        path = colours[i] if colours else None
        colour = read_colour(path) if path is not None else None
        colour_camera = rescaled(camera, size, colour.shape[1::-1]) if colour is not None else None
        if colour_only and colour is not None and colour_camera is not None:
            return Frame.without_depth(names[i], poses[i], colour, colour_camera)
        return Frame(names[i], poses[i], camera, read_depth(depths[i], unit_m), colour, colour_camera)

    return Frames(names, poses, read, str(folder), scan_digest([pose_file]))


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


def _numbers(path: Path, columns: int) -> np.ndarray:
    """Read the numbers (N, columns) of a text file with one row per line; the character # starts a comment."""
    rows = []
    for number, line in enumerate(path.read_text(encoding="utf-8", errors="replace").splitlines(), 1):
        words = line.partition("#")[0].replace(",", " ").split()
        if not words:
            continue
        try:
            row = [float(word) for word in words]
        except ValueError:
            row = []
        if len(row) != columns:
            raise ScanError(f"{path}, line {number}: {len(words)} words; write {columns} numbers in each row")
        rows.append(row)
    if not rows:
        raise ScanError(f"{path} holds no poses; export the trajectory with the frames")
    return np.array(rows)


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
    if not len(times):
        return None
    i = int(np.argmin(np.abs(times - time)))
    return i if abs(times[i] - time) <= TUM_MAX_S else None


def _pictures(folder: Path, names: Sequence[str]) -> list[Path]:
    """List the pictures in the first folder among `names` that exists, ordered by the numbers in the file names."""
    for name in names:
        if (folder / name).is_dir():
            found = [p for p in (folder / name).iterdir() if p.suffix.lower() in (".png", ".pgm", ".jpg", ".jpeg", ".tif", ".tiff")]
            return sorted(found, key=lambda p: ([int(d) for d in re.findall(r"\d+", p.stem)], p.stem))
    return []


def _poses(rows: np.ndarray, file: Path) -> np.ndarray:
    """Convert rows (N, 7) of position and quaternion, tx ty tz qx qy qz qw, to poses (N, 4, 4). `file` is named in error messages."""
    return pose_matrices(rows[:, :3], from_quaternions(rows[:, 3:], lambda k: f"{file}: pose {k + 1}"))


def _upward(poses: np.ndarray, folder: Path) -> str:
    """Return the world axis nearest to the mean upward direction of the cameras.

    The function assumes that this axis points up, because people hold cameras upright.
    """
    mean = -poses[:, :3, 1].mean(axis=0)
    axis = int(np.argmax(np.abs(mean)))
    if np.abs(mean[axis]) < 0.6:  # upright cameras that look 50 degrees downwards give the cosine 0.64
        raise ScanError(
            f"{folder}: the cameras' mean up vector {np.round(mean, 2).tolist()} is near no axis; give --up as one of {', '.join(TO_Z_UP)}"
        )
    return ("" if mean[axis] > 0 else "-") + "xyz"[axis]
