"""ROS bags that the package rosbags has written give the original poses. The error for an unknown name lists the existing names."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from radartwin.errors import PoseError
from radartwin.scene.trajectories.file import read_track
from radartwin.scene.trajectories.track import OPTICAL

rosbags = pytest.importorskip("rosbags", reason="rosbags is not installed; pip install 'radartwin[ros]'")

TIMES = np.arange(5) * 0.25
ODOMETRY, POSE, TF = "nav_msgs/msg/Odometry", "geometry_msgs/msg/PoseStamped", "tf2_msgs/msg/TFMessage"


def message(store, version, kind, time, frame, child, xyz, quaternion):
    """Build the ROS message of a body at this position with this orientation."""

    def new(name, *values):
        return store.types[name](*values)

    sequence = [0] if version == 1 else []
    stamp = new("builtin_interfaces/msg/Time", int(time), round(1e9 * (time % 1)))
    header = new("std_msgs/msg/Header", *sequence, stamp, frame)
    place, rotation = map(float, xyz), new("geometry_msgs/msg/Quaternion", *map(float, quaternion))
    if kind == TF:
        move = new("geometry_msgs/msg/Transform", new("geometry_msgs/msg/Vector3", *place), rotation)
        return new(TF, [new("geometry_msgs/msg/TransformStamped", header, child, move)])
    pose = new("geometry_msgs/msg/Pose", new("geometry_msgs/msg/Point", *place), rotation)
    if kind == POSE:
        return new(POSE, header, pose)
    still = new("geometry_msgs/msg/Vector3", 0.0, 0.0, 0.0)
    twist = new("geometry_msgs/msg/TwistWithCovariance", new("geometry_msgs/msg/Twist", still, still), np.zeros(36))
    return new(ODOMETRY, header, child, new("geometry_msgs/msg/PoseWithCovariance", pose, np.zeros(36)), twist)


def write_bag(path, *bodies, version=2):
    """Write the bodies (topic, kind, time, frame, child, xyz, quaternion) as a bag of ROS 1 or ROS 2."""
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import Writer as Writer2
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS1_NOETIC if version == 1 else Stores.ROS2_HUMBLE)
    connections = {}
    with Writer1(path) if version == 1 else Writer2(path, version=8) as writer:
        for topic, kind, time, *body in bodies:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=store)
            serialize = store.serialize_ros1 if version == 1 else store.serialize_cdr
            writer.write(connections[topic], round(1e9 * time), serialize(message(store, version, kind, time, *body), kind))


def yaw(degrees):
    return Rotation.from_euler("z", degrees, degrees=True).as_quat()


@pytest.mark.parametrize("version", [1, 2])
def test_odometry_is_read_as_written(tmp_path, version):
    path = tmp_path / ("run.bag" if version == 1 else "run")
    write_bag(
        path, *(("/odom", ODOMETRY, time, "odom", "base_link", (0.2 * time, 0, 0.1), yaw(90 * time)) for time in TIMES), version=version
    )
    track = read_track(path)
    assert np.allclose(track.times_s, TIMES)
    assert np.allclose(track.poses[:, 0, 3], 0.2 * TIMES)
    assert np.allclose(track.poses[-1, :3, 0], [0, 1, 0])
    assert track.frames(10.0).shape == (11, 4, 4)


def test_a_topic_selects_its_poses_and_without_one_the_topics_are_listed(tmp_path):
    robot = [("/odom", ODOMETRY, time, "odom", "base_link", (0, 0, 0), yaw(0)) for time in TIMES]
    radar = [("/mocap/radar", POSE, time, "map", "", (1, 0.1 * time, 0.4), yaw(0)) for time in TIMES]
    write_bag(tmp_path / "run", *robot, *radar)
    assert np.allclose(read_track(tmp_path / "run", topic="/mocap/radar").poses[-1, :3, 3], [1, 0.1, 0.4])
    for topic in (None, "/odometry"):
        with pytest.raises(PoseError, match=r"/mocap/radar \(geometry_msgs/PoseStamped\), /odom \(nav_msgs/Odometry\)"):
            read_track(tmp_path / "run", topic=topic)


def test_transforms_are_refused_and_optical_frames_converted(tmp_path):
    optical = Rotation.from_matrix(np.linalg.inv(OPTICAL)).as_quat()  # a camera that looks along the radar's x
    still = ("/tf", TF, 0.0, "odom", "base_link", (0, 0, 0), yaw(0))
    write_bag(tmp_path / "run", still, *(("/odom", ODOMETRY, time, "odom", "camera_optical", (time, 0, 0), optical) for time in TIMES))
    assert np.allclose(read_track(tmp_path / "run").poses[:, :3, :3], np.eye(3))
    with pytest.raises(PoseError, match="topic /tf is tf2_msgs/TFMessage, not poses"):
        read_track(tmp_path / "run", topic="/tf")


def test_invalid_and_short_bags_are_refused(tmp_path):
    (tmp_path / "run.bag").write_bytes(b"#ROSBAG V2.0\nnothing more")
    with pytest.raises(PoseError, match="ROS bag"):
        read_track(tmp_path / "run.bag")
    (tmp_path / "folder").mkdir()
    with pytest.raises(PoseError, match="ROS bag"):
        read_track(tmp_path / "folder")
    write_bag(tmp_path / "short", ("/pose", POSE, 0.0, "map", "", (0, 0, 0), yaw(0)))
    with pytest.raises(PoseError, match="at least two"):
        read_track(tmp_path / "short")
