"""Read trajectories from odometry, stamped poses or transforms in ROS 1 and ROS 2 bags, with the package rosbags (the extra `ros`).

A topic gives the poses of a moving body, whose axes are x forward, y left, z up (REP 103). Poses of a coordinate frame whose name ends in
`_optical` or `_optical_frame` have camera axes, and the reader converts these poses. The caller adds the radar's pose on the body with
`Track.mounted`.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from radartwin.errors import BackendError, PoseError
from radartwin.scene.trajectories.track import Track, from_quaternions, pose_matrices

ODOMETRY, POSE, TF = "nav_msgs/msg/Odometry", "geometry_msgs/msg/PoseStamped", "tf2_msgs/msg/TFMessage"


def read_bag(path: str | Path, topic: str | None = None, frame: str | None = None) -> Track:
    """Read the timed poses of a body in a ROS bag.

    Args:
        topic: name of a topic with Odometry or PoseStamped messages, or /tf for transforms; None if the bag has a single such topic.
        frame: only for transforms, the coordinate frame whose poses are read. The poses are relative to the root of the transform tree
            (map, odom, world), or to the frame PARENT if `frame` is "CHILD@PARENT".
    Raises:
        BackendError: rosbags is not installed.
        PoseError: the file is not a ROS bag, the topic or frame is unknown (the message lists the existing names), or a pose is invalid.
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
            connections = [c for c in reader.connections if c.topic == topic or (kinds[topic] == TF and c.msgtype == TF)]
            messages: list[Any] = [reader.deserialize(data, c.msgtype) for c, _, data in reader.messages(connections)]
    except PoseError:
        raise
    except (AnyReaderError, OSError, ValueError, KeyError) as error:
        text = " ".join(str(error).split())[:160]
        raise PoseError(f"{path} cannot be read as a ROS bag ({text}); give a .bag, a .mcap or the folder of a ROS 2 bag") from error
    source = f"{path}, topic {topic}"
    if kinds[topic] == TF:
        return _from_transforms(messages, frame, source)
    if frame:
        raise PoseError(f"{source} describes one body, so frame={frame} has no effect; leave it out, or choose topic /tf")
    poses = [m.pose.pose if kinds[topic] == ODOMETRY else m.pose for m in messages]
    track = Track(np.array([_seconds(m) for m in messages]), _matrices(((p.position, p.orientation) for p in poses), source), source)
    return track.from_axes("optical" if kinds[topic] == ODOMETRY and _is_optical(messages[0].child_frame_id) else "sensor")


def _choose_topic(topic: str | None, kinds: dict[str, str], path: Path) -> str:
    usable = {name for name, kind in kinds.items() if kind in (ODOMETRY, POSE)}
    usable = usable or {name for name, kind in kinds.items() if kind == TF and name == "/tf"}
    listed = ", ".join(f"{name} ({kind.replace('/msg/', '/')})" for name, kind in sorted(kinds.items())) or "no topics"
    if topic is None:
        if len(usable) != 1:
            raise PoseError(f"{path} holds {len(usable)} topics with poses; choose one with topic=: it has {listed}")
        return usable.pop()
    if topic not in kinds:
        raise PoseError(f"{path} has no topic {topic}; it has {listed}")
    if kinds[topic] not in (ODOMETRY, POSE, TF):
        raise PoseError(f"{path}: topic {topic} is {kinds[topic].replace('/msg/', '/')}, not poses; it has {listed}")
    return topic


def _from_transforms(messages: Iterable[Any], frame: str | None, source: str) -> Track:
    """Compute poses of a frame relative to the tree's root, or to the parent in `frame`, at the times of its most frequent transform."""
    edges: dict[str, tuple[str, list[Any]]] = {}
    for message in messages:
        for transform in message.transforms:
            child, parent = transform.child_frame_id.lstrip("/"), transform.header.frame_id.lstrip("/")
            edges.setdefault(child, (parent, []))[1].append(transform)
    listed = ", ".join(f"{child} (in {parent})" for child, (parent, _) in sorted(edges.items())) or "none"
    child, _, root = (frame or "").lstrip("/").partition("@")
    if child not in edges:
        problem = f"has no frame {child}" if child else "needs frame=, the frame to follow"
        raise PoseError(f"{source} {problem}; its frames: {listed}")
    links: list[Track | np.ndarray] = []
    at, seen = child, {child}
    while at in edges and at != root:
        parent, transforms = edges[at]
        poses = _matrices(((t.transform.translation, t.transform.rotation) for t in transforms), source)
        links.append(Track(np.array([_seconds(t) for t in transforms]), poses, f"{source}, frame {at}") if len(poses) > 1 else poses[0])
        if parent in seen:
            raise PoseError(f"{source}: the frames of {child} form a ring; its frames: {listed}")
        at = parent
        seen.add(parent)
    if root and at != root:
        raise PoseError(f"{source}: frame {child} is not below {root} in the tree; its frames: {listed}")
    moving = [link for link in links if isinstance(link, Track)]
    if not moving:
        raise PoseError(f"{source}: frame {child} does not move in {at}; choose another frame: {listed}")
    times = max(moving, key=lambda link: len(link.times_s)).times_s
    times = times[(times >= max(m.times_s[0] for m in moving)) & (times <= min(m.times_s[-1] for m in moving))]
    if len(times) < 2:
        raise PoseError(f"{source}: the transforms between {child} and {at} share less than two times; choose another frame: {listed}")
    poses = np.eye(4)
    for link in reversed(links):
        poses = poses @ (link.at(times) if isinstance(link, Track) else link)
    return Track(times, poses, f"{source}, frame {child} in {at}").from_axes("optical" if _is_optical(child) else "sensor")


def _matrices(pairs: Iterable[tuple[Any, Any]], source: str) -> np.ndarray:
    """Convert N pairs of (position, quaternion) messages to poses (N, 4, 4)."""
    values = np.array([[p.x, p.y, p.z, q.x, q.y, q.z, q.w] for p, q in pairs], dtype=np.float64).reshape(-1, 7)
    return pose_matrices(values[:, :3], from_quaternions(values[:, 3:], lambda k: f"{source}, pose {k}"))


def _seconds(message: Any) -> float:
    return message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec


def _is_optical(frame: str) -> bool:
    return frame.endswith(("_optical", "_optical_frame"))
