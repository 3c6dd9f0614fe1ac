"""ROS bags written by rosbags give the written poses; unknown topics and frames are refused with the existing ones."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from radartwin.errors import PoseError
from radartwin.scene.trajectories.file import read_track
from radartwin.scene.trajectories.track import OPTICAL

rosbags = pytest.importorskip("rosbags", reason="rosbags is not installed; pip install 'radartwin[ros]'")

TIMES = np.arange(5) * 0.25
ODOMETRY, POSE, TF = "nav_msgs/msg/Odometry", "geometry_msgs/msg/PoseStamped", "tf2_msgs/msg/TFMessage"


class Bag:
    """A writer of a ROS 1 or ROS 2 bag that takes plain numbers."""

    def __init__(self, path, version):
        from rosbags.rosbag1 import Writer as Writer1
        from rosbags.rosbag2 import Writer as Writer2
        from rosbags.typesys import Stores, get_typestore

        self.version, self.store = version, get_typestore(Stores.ROS1_NOETIC if version == 1 else Stores.ROS2_HUMBLE)
        self.writer = Writer1(path) if version == 1 else Writer2(path, version=8)
        self.connections = {}

    def __enter__(self):
        self.writer.open()
        return self

    def __exit__(self, *_):
        self.writer.close()

    def type(self, name):
        return self.store.types[name]

    def header(self, time, frame):
        stamp = self.type("builtin_interfaces/msg/Time")(sec=int(time), nanosec=round(1e9 * (time % 1)))
        more = {"seq": 0} if self.version == 1 else {}
        return self.type("std_msgs/msg/Header")(stamp=stamp, frame_id=frame, **more)

    def vector(self, kind, xyz):
        return self.type(f"geometry_msgs/msg/{kind}")(*map(float, xyz))

    def pose(self, xyz, quaternion):
        return self.type("geometry_msgs/msg/Pose")(position=self.vector("Point", xyz), orientation=self.vector("Quaternion", quaternion))

    def write(self, topic, kind, message, time):
        if topic not in self.connections:
            self.connections[topic] = self.writer.add_connection(topic, kind, typestore=self.store)
        raw = self.store.serialize_ros1(message, kind) if self.version == 1 else self.store.serialize_cdr(message, kind)
        self.writer.write(self.connections[topic], round(1e9 * time), raw)

    def odometry(self, topic, time, xyz, quaternion, child="base_link"):
        zero = self.vector("Vector3", (0, 0, 0))
        twist = self.type("geometry_msgs/msg/TwistWithCovariance")(self.type("geometry_msgs/msg/Twist")(zero, zero), np.zeros(36))
        where = self.type("geometry_msgs/msg/PoseWithCovariance")(self.pose(xyz, quaternion), np.zeros(36))
        self.write(topic, ODOMETRY, self.type(ODOMETRY)(self.header(time, "odom"), child, where, twist), time)

    def stamped(self, topic, time, xyz, quaternion):
        self.write(topic, POSE, self.type(POSE)(self.header(time, "map"), self.pose(xyz, quaternion)), time)

    def transform(self, topic, time, parent, child, xyz, quaternion):
        move = self.type("geometry_msgs/msg/Transform")(self.vector("Vector3", xyz), self.vector("Quaternion", quaternion))
        message = self.type("geometry_msgs/msg/TransformStamped")(self.header(time, parent), child, move)
        self.write(topic, TF, self.type(TF)([message]), time)


def yaw(degrees):
    return Rotation.from_euler("z", degrees, degrees=True).as_quat()


@pytest.mark.parametrize("version", [1, 2])
def test_odometry_is_read_as_written(tmp_path, version):
    path = tmp_path / ("run.bag" if version == 1 else "run")
    with Bag(path, version) as bag:
        for time in TIMES:
            bag.odometry("/odom", time, (0.2 * time, 0, 0.1), yaw(90 * time))
    track = read_track(path)
    assert np.allclose(track.times_s, TIMES)
    assert np.allclose(track.poses[:, 0, 3], 0.2 * TIMES)
    assert np.allclose(track.poses[-1, :3, 0], [0, 1, 0])
    assert track.frames(10.0).shape == (11, 4, 4)


def test_a_topic_selects_its_poses_and_without_one_the_topics_are_listed(tmp_path):
    with Bag(tmp_path / "run", 2) as bag:
        for time in TIMES:
            bag.odometry("/odom", time, (0, 0, 0), yaw(0))
            bag.stamped("/mocap/radar", time, (1, 0.1 * time, 0.4), yaw(0))
    assert np.allclose(read_track(tmp_path / "run", topic="/mocap/radar").poses[-1, :3, 3], [1, 0.1, 0.4])
    for topic in (None, "/odometry"):
        with pytest.raises(PoseError, match=r"/mocap/radar \(geometry_msgs/PoseStamped\), /odom \(nav_msgs/Odometry\)"):
            read_track(tmp_path / "run", topic=topic)


def test_transforms_are_chained_and_optical_frames_converted(tmp_path):
    with Bag(tmp_path / "run", 2) as bag:
        bag.transform("/tf_static", 0.0, "base_link", "radar_link", (0.3, 0, 0.4), yaw(0))
        optical = Rotation.from_matrix(np.linalg.inv(OPTICAL)).as_quat()  # a camera that looks along the radar's x
        bag.transform("/tf_static", 0.0, "radar_link", "camera_optical_frame", (0, 0, 0), optical)
        for time in TIMES:
            bag.transform("/tf", time, "odom", "base_link", (time, 0, 0), yaw(90))
            bag.transform("/tf", time, "map", "odom", (0, 5, 0), yaw(0))
    track = read_track(tmp_path / "run", topic="/tf", frame="radar_link")
    assert np.allclose(track.poses[:, :3, 3], [(t, 5.3, 0.4) for t in TIMES])
    assert np.allclose(track.poses[0, :3, 0], [0, 1, 0])
    camera = read_track(tmp_path / "run", topic="/tf", frame="camera_optical_frame")
    assert np.allclose(camera.poses, track.poses)
    assert np.allclose(read_track(tmp_path / "run", topic="/tf", frame="radar_link@odom").poses[:, 1, 3], 0.3)
    for frame in (None, "lidar", "radar_link@earth"):
        with pytest.raises(PoseError, match=r"base_link \(in odom\)"):
            read_track(tmp_path / "run", topic="/tf", frame=frame)


def test_invalid_and_short_bags_are_refused(tmp_path):
    (tmp_path / "run.bag").write_bytes(b"#ROSBAG V2.0\nnothing more")
    with pytest.raises(PoseError, match="ROS bag"):
        read_track(tmp_path / "run.bag")
    (tmp_path / "folder").mkdir()
    with pytest.raises(PoseError, match="ROS bag"):
        read_track(tmp_path / "folder")
    with Bag(tmp_path / "short", 2) as bag:
        bag.stamped("/pose", 0.0, (0, 0, 0), yaw(0))
    with pytest.raises(PoseError, match="at least two"):
        read_track(tmp_path / "short")
