"""Read trajectories from odometry or stamped poses in ROS 1 and ROS 2 bags, with the package rosbags (the extra `ros`).

A topic gives the poses of a moving body, whose axes are x forward, y left, z up (REP 103). Poses of a coordinate frame whose name ends in
`_optical` or `_optical_frame` have camera axes, and the reader converts these poses. The caller adds the radar's pose on the body with
`Track.mounted`.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from radartwin.errors import BackendError, PoseError
from radartwin.scene.trajectories.track import Track, from_quaternions, pose_matrices

ODOMETRY, POSE = "nav_msgs/msg/Odometry", "geometry_msgs/msg/PoseStamped"


def read_bag(path: str | Path, topic: str | None = None) -> Track:
    """Read the timed poses of a body in a ROS bag.

    Args:
        topic: name of a topic with Odometry or PoseStamped messages; None if the bag has a single such topic.
    Raises:
        BackendError: rosbags is not installed.
        PoseError: the file is not a ROS bag, the topic is unknown (the message lists the existing names), or a pose is invalid.
    """
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.highlevel.anyreader import AnyReaderError
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise BackendError("ROS bags need the package rosbags; install it with pip install 'radartwin[ros]'") from error
    path = Path(path)
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            kinds = {c.topic: c.msgtype for c in reader.connections}
            topic = _choose_topic(topic, kinds, path)
            connections = [c for c in reader.connections if c.topic == topic]
            messages: list[Any] = [reader.deserialize(data, c.msgtype) for c, _, data in reader.messages(connections)]
    except PoseError:
        raise
    except (AnyReaderError, OSError, ValueError, KeyError) as error:
        text = " ".join(str(error).split())[:160]
        raise PoseError(f"{path} cannot be read as a ROS bag ({text}); give a .bag, a .mcap or the folder of a ROS 2 bag") from error
    source = f"{path}, topic {topic}"
    poses = [m.pose.pose if kinds[topic] == ODOMETRY else m.pose for m in messages]
    pairs = ((p.position, p.orientation) for p in poses)
    values = np.array([[p.x, p.y, p.z, q.x, q.y, q.z, q.w] for p, q in pairs], dtype=np.float64).reshape(-1, 7)
    times_s = np.array([m.header.stamp.sec + 1e-9 * m.header.stamp.nanosec for m in messages])
    rotations = from_quaternions(values[:, 3:], lambda k: f"{source}, pose {k}")
    optical = kinds[topic] == ODOMETRY and messages[0].child_frame_id.endswith(("_optical", "_optical_frame"))
    return Track(times_s, pose_matrices(values[:, :3], rotations), source).from_axes("optical" if optical else "sensor")


def _choose_topic(topic: str | None, kinds: dict[str, str], path: Path) -> str:
    usable = {name for name, kind in kinds.items() if kind in (ODOMETRY, POSE)}
    listed = ", ".join(f"{name} ({kind.replace('/msg/', '/')})" for name, kind in sorted(kinds.items())) or "no topics"
    if topic is None:
        if len(usable) != 1:
            raise PoseError(f"{path} holds {len(usable)} topics with poses; choose one with topic=: it has {listed}")
        return usable.pop()
    if topic not in kinds:
        raise PoseError(f"{path} has no topic {topic}; it has {listed}")
    if kinds[topic] not in (ODOMETRY, POSE):
        raise PoseError(f"{path}: topic {topic} is {kinds[topic].replace('/msg/', '/')}, not poses; it has {listed}")
    return topic
