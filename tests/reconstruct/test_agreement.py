"""If a scan has a wrong depth unit or a wrong pose convention, RadarTwin finds that overlapping camera views disagree. The error message
names the depth unit or the pose convention with which the views agree.
"""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from radartwin.errors import ScanError
from radartwin.reconstruct.frames.frames import Frame, Frames
from radartwin.reconstruct.frames.layouts import layout_of, load_frames
from radartwin.reconstruct.fusion.agreement import check_agreement
from radartwin.reconstruct.scan_file import ScanWarning
from radartwin.scene import rooms
from radartwin.testbed.scanner import scan

OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])  # OpenGL camera axes: y up, z backward
WRITTEN = {
    "opencv": lambda pose: pose,
    "opengl": lambda pose: pose @ OPENGL,
    "opencv-inverse": np.linalg.inv,
    "opengl-inverse": lambda pose: np.linalg.inv(pose @ OPENGL),
}
SLAM_LENS = (518.0, 519.0, 325.5, 253.5)


@pytest.fixture(scope="module")
def walk() -> Frames:
    """Return twelve noisy simulated camera views of a laboratory."""
    return scan(rooms.lab(detail="shell"), seed=0, frames=12, colour_every=0)[0]


def written(frames: Frames, folder: Path, convention: str = "opencv", unit_m: float = 0.001) -> tuple[Path, tuple[float, ...]]:
    """Write the frames in the pose.txt folder layout with the given pose convention. Returns the folder and the camera intrinsics."""
    (folder / "depth").mkdir(parents=True)
    rows = []
    for i, frame in enumerate(frames):
        Image.fromarray(np.rint(frame.depth_m / unit_m).astype(np.uint16)).save(folder / "depth" / f"{i}.png")
        pose = WRITTEN[convention](frame.pose)
        rows.append([*pose[:3, 3], *Rotation.from_matrix(pose[:3, :3]).as_quat()])
    np.savetxt(folder / "pose.txt", np.array(rows), fmt="%.9f")
    lens = frames[0].intrinsics
    return folder, (lens[0, 0], lens[1, 1], lens[0, 2], lens[1, 2])


def checked(folder: Path, lens, convention: str = "opencv", unit_m: float | None = None) -> None:
    frames = load_frames(folder, lens, unit_m, up="z", poses=convention)
    check_agreement(frames, unit_m or layout_of(folder).unit_m, convention)


@pytest.mark.parametrize(
    ("convention", "other"),
    [("opencv", "opengl"), ("opengl", "opencv-inverse"), ("opencv-inverse", "opengl-inverse"), ("opengl-inverse", "opencv")],
)
def test_only_the_right_pose_convention_is_accepted(walk, tmp_path, convention, other):
    folder, lens = written(walk, tmp_path / "frames", convention)
    checked(folder, lens, convention)
    assert np.allclose(load_frames(folder, lens, up="z", poses=convention).poses, walk.poses, atol=1e-6)
    with pytest.raises(ScanError, match=rf"are \d+ mm apart; the poses look like .*: give --poses {convention}$"):
        checked(folder, lens, other)


def test_wrong_depth_unit_is_refused_with_the_right_unit_and_both_room_sizes(walk, tmp_path):
    folder, lens = written(walk, tmp_path / "frames")
    checked(folder, lens)
    with pytest.raises(
        ScanError, match=r"read with 0\.0002 m per count \(a room of .*better with 0\.001 m per count \(a room of 6 x 5"
    ) as caught:
        checked(folder, lens, unit_m=0.0002)
    assert str(caught.value).endswith("give the better unit as --depth-unit")


def test_rotating_camera_leaves_the_unit_open_and_lists_both(tmp_path):
    path = np.tile([[0, 0, 1.0, 2.0], [-1, 0, 0, 2.5], [0, -1, 0, 1.4], [0, 0, 0, 1]], (3, 1, 1))
    path[:, :3, :3] = Rotation.from_rotvec(np.outer([0, 12, 24], [0, 0, 1]), degrees=True).as_matrix() @ path[:, :3, :3]
    still = scan(rooms.lab(detail="shell"), poses=path, strength=0.0, colour_every=0)[0]
    folder, lens = written(still, tmp_path / "frames")
    with pytest.warns(
        ScanWarning, match=r"do not determine the unit of depth: it may be 0\.001 .*, as given, or 0\.0002 .*check --depth-unit"
    ):
        checked(folder, lens)


def test_poses_without_overlapping_views_give_a_warning(walk):
    far = [
        Frame(f.name, f.pose + np.pad([[0.0], [0.0], [50.0 * i]], ((0, 1), (3, 0))), f.intrinsics, f.depth_m)
        for i, f in enumerate(walk[:2])
    ]
    with pytest.warns(ScanWarning, match="no two views overlap at the given poses"):
        check_agreement(Frames.of(far), None, None)


def test_some_blank_depth_pictures_are_accepted(walk, tmp_path):
    shown = (1, 3)
    blank = [Frame(f.name, f.pose, f.intrinsics, f.depth_m * (i in shown)) for i, f in enumerate(walk[:5])]
    folder, lens = written(Frames.of(blank), tmp_path / "frames")
    frames = load_frames(folder, lens, up="z")
    assert [bool(f.depth_m.any()) for f in frames] == [i in shown for i in range(5)]


def test_real_frames_agree_without_warnings(shared_data):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        checked(shared_data / "scans" / "slambook2_rgbd", SLAM_LENS)
        check_agreement(load_frames(shared_data / "scans" / "arkit_lidar_chair_scan", up="z"), 0.001, None)
