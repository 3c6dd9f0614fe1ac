"""Camera frames of every folder layout, and scans whose depth unit or pose convention is wrong, so that overlapping views disagree."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from radartwin.errors import ScanError
from radartwin.reconstruct.frames.folder import save_frames
from radartwin.reconstruct.frames.frames import Frame, Frames, points, rescaled
from radartwin.reconstruct.frames.layouts import layout_of, load_frames
from radartwin.reconstruct.fusion.agreement import check_agreement
from radartwin.reconstruct.scan_file import ScanWarning
from radartwin.scene import rooms
from radartwin.testbed.scanner import scan

LENS = np.array([[40.0, 0, 15.5], [0, 40, 11.5], [0, 0, 1]])
COLOUR_LENS = rescaled(LENS, (32, 24), (64, 48))


def wall(name: str = "0", x: float = 0.0, distance: float = 2.0) -> Frame:
    """Return the frame of a camera at x that looks horizontally along +y at a wall."""
    pose = np.array([[1.0, 0, 0, x], [0, 0, 1, 0], [0, -1, 0, 1.5], [0, 0, 0, 1]])
    depth = np.full((24, 32), distance, np.float32)
    depth[0, 0] = 0
    colour = np.full((48, 64, 3), (200, 100, 50), np.uint8)
    return Frame(name, pose, LENS, depth, colour, COLOUR_LENS, np.full((24, 32), 2, np.uint8))


def stored(folder: Path) -> Path:
    return save_frames(Frames.of([wall("a"), wall("b", 0.1)]), folder)


def arkit(folder: Path, count: int = 3, flip: float = 1.0, unit: float = 1000.0) -> Path:
    """Write an ARKit folder with a level camera at the origin, 1.5 m up, that looks along -z of ARKit's y-up world."""
    folder.mkdir()
    for i in range(count):
        pose = np.eye(4)
        pose[0, 0] = flip
        pose[:3, 3] = (0.1 * i, 1.5, 0)
        camera = {"cameraPoseARFrame": pose.ravel().tolist(), "intrinsics": [1447.0, 0, 960, 0, 1447, 720, 0, 0, 1]}
        (folder / f"frame_{i:05d}.json").write_text(json.dumps(camera))
        Image.fromarray(np.full((192, 256), 2 * unit, np.uint16)).save(folder / f"depth_{i:05d}.png")
        Image.fromarray(np.full((192, 256), 2, np.uint8)).save(folder / f"conf_{i:05d}.png")
    return folder


def pose_file(folder: Path, lines: list[str], count: int | None = None) -> Path:
    for name in ("color", "depth"):
        (folder / name).mkdir(parents=True)
    for i in range(len(lines) if count is None else count):
        Image.fromarray(np.full((24, 32), 2000, np.uint16)).save(folder / "depth" / f"{i + 1}.pgm")
        Image.fromarray(np.full((24, 32, 3), 90, np.uint8)).save(folder / "color" / f"{i + 1}.png")
    (folder / "pose.txt").write_text("\n".join(lines))
    return folder


def test_own_layout_returns_the_saved_frames(tmp_path):
    frames = load_frames(stored(tmp_path / "own"))
    assert frames.names == ("a", "b")
    for old, new in zip((wall("a"), wall("b", 0.1)), frames, strict=True):
        assert np.allclose(new.pose, old.pose, atol=1e-12)
        assert np.allclose(new.depth_m, old.depth_m, atol=0.0005)  # the file stores depth in whole millimetres
        assert np.abs(np.asarray(new.colour).astype(int) - np.asarray(old.colour)).max() <= 3  # a JPEG
        assert np.array_equal(np.asarray(new.confidence), np.asarray(old.confidence))
        assert np.allclose(new.intrinsics, LENS)
    part = frames[1:]
    assert (part.names, part[0].pose[0, 3]) == (("b",), pytest.approx(0.1))
    assert np.array_equal(part.with_poses(np.eye(4)[None])[0].pose, np.eye(4))
    for path in (tmp_path / "own" / "depth").iterdir():
        path.unlink()
    frame = load_frames(tmp_path / "own", colour_only=True)[0]
    assert frame.colour is not None
    assert frame.depth_m.shape == frame.colour.shape[:2]
    assert not frame.depth_m.any()


def test_arkit_axes_are_converted_to_z_up_and_opencv(tmp_path):
    frames = load_frames(arkit(tmp_path / "arkit"))
    assert np.allclose(frames[0].pose[:3, 3], (0, 0, 1.5))
    assert np.allclose(frames[0].pose[:3, 2], (0, 1, 0))  # ARKit looks along -z, which the turn from y up to z up makes +y
    assert np.allclose(frames[0].pose[:3, 1], (0, 0, -1))  # the rows of a picture run downwards
    middle = points(frames[0])[95:97, 127:129].reshape(-1, 3).mean(axis=0)
    assert np.allclose(middle, (0, 2, 1.5), atol=0.01)


def test_pose_file_up_axis_is_found_from_the_cameras(tmp_path):
    lines = ["0 0 0 0 0 0 1", "0.1 0 0.5 0 0 0 1"]  # cameras whose axes are the world's: y down
    frames = load_frames(pose_file(tmp_path / "p", lines), intrinsics=(40, 40, 15.5, 11.5))
    assert np.allclose(frames[0].pose[:3, 1], (0, 0, -1))
    assert np.allclose(frames[1].pose[:3, 3] - frames[0].pose[:3, 3], (0.1, 0.5, 0))
    assert frames[0].colour is not None
    (tmp_path / "p" / "intrinsics.json").write_text('{"fx": 40, "fy": 40, "cx": 15.5, "cy": 11.5}')
    assert np.allclose(load_frames(tmp_path / "p")[0].intrinsics, LENS)


def test_tum_pictures_take_the_pose_nearest_in_time(tmp_path):
    folder = tmp_path / "tum"
    (folder / "depth").mkdir(parents=True)
    (folder / "rgb").mkdir()
    for time in ("1.00", "2.00", "9.00"):
        Image.fromarray(np.full((24, 32), 10_000, np.uint16)).save(folder / "depth" / f"{time}.png")
        Image.fromarray(np.full((24, 32, 3), 90, np.uint8)).save(folder / "rgb" / f"{time}.png")
    (folder / "depth.txt").write_text("# depth\n" + "".join(f"{t} depth/{t}.png\n" for t in ("1.00", "2.00", "9.00")))
    (folder / "rgb.txt").write_text("# rgb\n" + "".join(f"{t}1 rgb/{t}.png\n" for t in ("1.00", "2.00")))
    quarter = "-0.7071068 0 0 0.7071068"  # level in a z-up world
    (folder / "groundtruth.txt").write_text(f"# time\n0.99 1 0 0 {quarter}\n1.05 5 0 0 {quarter}\n2.01 2 0 0 {quarter}\n")
    frames = load_frames(folder, intrinsics=(40, 40, 15.5, 11.5))
    assert frames.poses[:, 0, 3].tolist() == [1, 2]  # the third has no pose within 20 ms
    assert frames[0].depth_m[5, 5] == pytest.approx(2.0)  # the depth unit of the file is 1/5000 m
    assert frames[0].colour is not None


OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])  # OpenGL camera axes: y up, z backward
WRITTEN = {
    "opencv": lambda pose: pose,
    "opengl": lambda pose: pose @ OPENGL,
    "opencv-inverse": np.linalg.inv,
    "opengl-inverse": lambda pose: np.linalg.inv(pose @ OPENGL),
}


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


@pytest.mark.parametrize(("convention", "other"), [*zip(WRITTEN, [*WRITTEN][1:] + [*WRITTEN][:1], strict=True)])
def test_only_the_right_pose_convention_is_accepted(walk, tmp_path, convention, other):
    folder, lens = written(walk, tmp_path / "frames", convention)
    checked(folder, lens, convention)
    assert np.allclose(load_frames(folder, lens, up="z", poses=convention).poses, walk.poses, atol=1e-6)
    with pytest.raises(ScanError, match=rf"are \d+ mm apart; the poses look like .*: give --poses {convention}$"):
        checked(folder, lens, other)


def test_wrong_depth_unit_is_refused_with_the_right_unit_and_both_room_sizes(walk, tmp_path, inside):
    folder, lens = written(walk, tmp_path / "frames")
    words = r"read with 0\.0002 m per count \(a room of .*with 0\.001 m per count \(a room of 6 x 5.*give the better unit as --depth-unit$"
    with pytest.raises(ScanError, match=words):
        checked(folder, lens, unit_m=0.0002)
    for option, value, remedy in (("--poses", "opengl", "give --poses opencv"), ("--depth-unit", "0.005", "--depth-unit 0.001")):
        done = inside("reconstruct", folder, "--out", "out", "--up", "z", "--intrinsics", *map(str, lens), option, value)
        assert (done.returncode, remedy in done.stderr) == (2, True), done.stderr
        assert not (tmp_path / "out").exists()


def test_views_that_rotate_only_lie_far_apart_or_are_blank_leave_the_unit_open(walk, tmp_path):
    path = np.tile([[0, 0, 1.0, 2.0], [-1, 0, 0, 2.5], [0, -1, 0, 1.4], [0, 0, 0, 1]], (3, 1, 1))
    path[:, :3, :3] = Rotation.from_rotvec(np.outer([0, 12, 24], [0, 0, 1]), degrees=True).as_matrix() @ path[:, :3, :3]
    still = scan(rooms.lab(detail="shell"), poses=path, strength=0.0, colour_every=0)[0]
    folder, lens = written(still, tmp_path / "frames")
    words = r"do not determine the unit of depth: it may be 0\.001 .*, as given, or 0\.0002 .*check --depth-unit"
    with pytest.warns(ScanWarning, match=words):
        checked(folder, lens)
    far = walk[:2].with_poses(walk.poses[:2] + np.pad([[[0.0], [0.0], [z]] for z in (0.0, 50.0)], ((0, 0), (0, 1), (3, 0))))
    with pytest.warns(ScanWarning, match="no two views overlap at the given poses"):
        check_agreement(far, None, None)
    blank = [Frame(f.name, f.pose, f.intrinsics, f.depth_m * (i in (1, 3))) for i, f in enumerate(walk[:5])]
    folder, lens = written(Frames.of(blank), tmp_path / "blank")
    assert [bool(f.depth_m.any()) for f in load_frames(folder, lens, up="z")] == [False, True, False, True, False]
