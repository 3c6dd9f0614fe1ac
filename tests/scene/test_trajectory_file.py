"""Tests of trajectories from files: formats, interpolation, axes, and error messages that name the line."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from radartwin.errors import MissingError, PoseError
from radartwin.scene.trajectories.file import parse_track, read_track
from radartwin.scene.trajectories.track import OPTICAL, Track
from radartwin.scene.trajectories.trajectory import look_at, pose

TUM = "# t x y z qx qy qz qw\n0.0 0 0 0.4 0 0 0 1\n0.5 0.1 0 0.4 0 0 0.3826834 0.9238795\n1.0 0.2 0 0.4 0 0 0.7071068 0.7071068\n"


def test_tum_is_read_line_by_line_with_comments(tmp_path):
    path = tmp_path / "run.txt"
    path.write_text(TUM)
    track = read_track(path)
    assert track.times_s.tolist() == [0, 0.5, 1]
    assert np.allclose(track.poses[2, :3, 3], [0.2, 0, 0.4])
    assert np.allclose(track.poses[2, :3, 0], [0, 1, 0], atol=1e-6)  # turned left by 90 degrees: forward is now +y


def test_csv_columns_are_found_by_name_in_any_order(tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("tz,ty,tx,Timestamp,qw,qz,qy,qx,comment_id\n0.4,0,0,10,1,0,0,0,7\n0.4,0,0.2,11,1,0,0,0,8\n")
    track = read_track(path)
    assert track.times_s.tolist() == [10, 11]
    assert np.allclose(track.poses[1, :3, 3], [0.2, 0, 0.4])
    path.write_text("t,x,y,z,yaw_deg\n0,0,0,0.4,90\n1,0,0.1,0.4,90\n")
    assert np.allclose(read_track(path).poses[0, :3, 0], [0, 1, 0])


def test_frames_interpolate_positions_linearly_and_rotations_along_the_shortest_arc():
    poses = parse_track(TUM, "run", csv=False).frames(10.0)
    assert poses.shape == (11, 4, 4)
    assert np.allclose(poses[:, 0, 3], 0.02 * np.arange(11))
    yaw = np.degrees(np.arctan2(poses[:, 1, 0], poses[:, 0, 0]))
    assert np.allclose(yaw, 9 * np.arange(11), atol=1e-4)


def test_times_outside_the_track_are_refused():
    track = parse_track(TUM, "run", csv=False)
    assert track.frames(10.0, 11).shape == (11, 4, 4)
    with pytest.raises(PoseError, match="holds 11 frames at 10 Hz, not 12"):
        track.frames(10.0, 12)
    with pytest.raises(PoseError, match="covers 0 to 1 s"):
        track.at([-0.1])
    with pytest.raises(PoseError, match="fewer frames"):
        track.at([0.5, 1.2])


def test_camera_axes_are_converted_to_sensor_axes():
    want = look_at([1, 2, 0.4], [3, 5, 0.4])
    camera = want.copy()
    camera[:3, :3] = np.stack([-want[:3, 1], -want[:3, 2], want[:3, 0]], axis=1)  # x right, y down, z forward
    track = Track(np.array([0.0, 1.0]), np.stack([camera, camera]))
    assert np.allclose(track.from_axes("optical").poses[0], want)
    assert np.allclose(OPTICAL @ OPTICAL.T, np.eye(3))
    with pytest.raises(PoseError, match="optical"):
        track.from_axes("camera")  # type: ignore[arg-type]


def test_a_mounted_sensor_moves_with_its_body():
    body = np.stack([np.eye(4), pose([0, 0, 0], Rotation.from_euler("z", 90, degrees=True).as_matrix())])
    radar = Track(np.array([0.0, 1.0]), body).mounted(pose([0.3, 0, 0.1]))
    assert np.allclose(radar.poses[:, :3, 3], [[0.3, 0, 0.1], [0, 0.3, 0.1]])


LINE = "0 0 0 0.4 0 0 0 1\n"
WRONG = {  # {case: (text, part of the message)}; a text that begins with "t," is a CSV file
    "a picture": (bytes(range(128, 256)).decode("latin-1"), "text"),
    "a missing column": ("t,x,y\n0,0,0\n", "lacks the column z, qx"),
    "nothing in it": ("", "0 poses"),
    "one pose": (LINE, "at least two"),
    "a word": (LINE + "1 0 0 x 0 0 0 1\n", "line 2: 8 numbers"),
    "seven numbers": (LINE + "1 0 0 0 0 0 1\n", "line 2: 8 numbers"),
    "nan": (LINE + "1 0 nan 0 0 0 0 1\n", "line 2: NaN"),
    "the same time": (LINE + "1 0 0 0 0 0 0 1\n1 1 0 0 0 0 0 1\n", "line 3: its time 1 s equals that of"),
    "back in time": (LINE + "# between\n-1 0 0 0 0 0 0 1\n", "line 3: its time -1 s is earlier than"),
    "a quaternion too long": (LINE + "1 0 0 0.4 0 0 0 2\n", "line 2: the quaternion has length 2"),
    "a quaternion of nothing": (LINE + "1 0 0 0.4 0 0 0 0\n", "length 0"),
    "millimetres far": (LINE + "500 900000 0 400 0 0 0 1\n", "convert the coordinates to metres"),
    "millimetres near": (LINE + "1 200 0 0.4 0 0 0 1\n" + "2 0 0 0.4 0 0 0 1\n", "millimetres|metres"),
    "nanoseconds": (LINE + "100000000 0.1 0 0.4 0 0 0 1\n", "nanoseconds"),
}


@pytest.mark.parametrize(("text", "word"), WRONG.values(), ids=WRONG)
def test_an_invalid_file_is_refused_with_its_line(text, word, tmp_path):
    path = tmp_path / ("run.csv" if text.startswith("t,") else "run.tum")
    path.write_bytes(text.encode("latin-1"))
    with pytest.raises(PoseError, match=word) as caught:
        read_track(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)
    with pytest.raises(MissingError, match="TUM or CSV"):
        read_track(tmp_path / "none.txt")
