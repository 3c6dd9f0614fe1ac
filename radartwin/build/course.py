"""What a configuration sets in motion and puts into a room: the poses of a trajectory file, the objects of a layout, and checks of both."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from radartwin.config.scene import SceneConfig
from radartwin.config.trajectory import TrajectoryConfig

if TYPE_CHECKING:
    from radartwin.radar.chirp import Radar
    from radartwin.scene.scene import Scene
    from radartwin.scene.trajectories.track import Track


def read_course(config: TrajectoryConfig) -> Track:
    """The sensor's track of a trajectory file, the radar mounted on what moves.

    Raises:
        MissingError, PoseError: no file, or none that can be read.
    """
    from scipy.spatial.transform import Rotation

    from radartwin.scene.trajectories.file import read_track
    from radartwin.scene.trajectories.trajectory import pose

    assert config.path is not None  # the configuration has checked it
    mount = pose(config.mount_m or (0, 0, 0), Rotation.from_euler("xyz", config.mount_deg or (0, 0, 0), degrees=True).as_matrix())
    return read_track(config.path, config.axes, config.topic, config.frame).mounted(mount)  # type: ignore[arg-type]


def check_course(scene: Scene, radar: Radar, sensor_poses: np.ndarray, target_poses: np.ndarray) -> None:
    """Refuse a sensor that leaves the room's height, or passes through something; warn of motion too fast for the radar's Doppler.

    Args:
        scene: without the target.
        sensor_poses, target_poses: (F, 4, 4) to world.
    Raises:
        PoseError, SceneError: naming the frame.
    """
    from radartwin.scene.collision import check_path
    from radartwin.scene.trajectories import trajectory

    room = scene.only("room")
    if len(room):
        trajectory.check_height(sensor_poses, room.bounds[0, 2], _ceiling(room))
    check_path(scene, sensor_poses)
    for what, poses in (("the sensor", sensor_poses), ("the target", target_poses)):
        trajectory.check_speed(poses, radar.frame_rate_hz, radar.max_velocity_mps, what)


def _ceiling(room: Scene) -> float:
    """Height (m) of the level surface that closes the room; infinite where a scan has none."""
    top = room.bounds[1, 2]
    footprint = np.prod(np.ptp(room.bounds[:, :2], axis=0))
    meshes = [surface.mesh for surface in room]
    level = [(abs(m.face_normals[:, 2]) > 0.9) & (m.triangles_center[:, 2] > top - 0.5) for m in meshes]
    covered = sum(m.area_faces[at].sum() for m, at in zip(meshes, level, strict=True))
    return float(top) if covered > 0.2 * footprint else np.inf


def furnished(config: SceneConfig, room: Scene, sensor_pose: np.ndarray) -> Scene:
    """The room with the objects of the configured layout or sentence in it.

    Raises:
        MissingError, LayoutError: a layout that is not there, or cannot be; BackendError: a language model that cannot be asked.
    """
    if not (config.layout or config.sentence):
        return room
    from radartwin.io.chat import Endpoint
    from radartwin.scene.layouts.layout import Layout
    from radartwin.scene.layouts.model import read_sentence
    from radartwin.scene.layouts.place import furnish

    if config.layout:
        return furnish(room, Layout.load(config.layout), sensor_pose)
    assert config.sentence is not None
    endpoint = Endpoint(config.llm_url, config.llm_model) if config.llm_url and config.llm_model else None
    return furnish(room, read_sentence(config.sentence, room, sensor_pose, endpoint), sensor_pose)
