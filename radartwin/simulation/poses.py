"""Rigid poses: checks, and relative motion and velocity at the start of each frame."""

from collections.abc import Mapping

import numpy as np
from scipy.spatial.transform import Rotation

from radartwin.errors import PoseError
from radartwin.radar.field_checks import check_rigid

MOMENT = 1e-4  # time step for the finite difference of a velocity, in frame periods
AT_REST = 1e-12  # largest change of a pose that counts as no motion


def check_poses(poses: np.ndarray, what: str) -> np.ndarray:
    """Return checked rigid poses (F, 4, 4) float64; a single pose (4, 4) becomes one frame.

    Raises:
        PoseError: the shape is wrong, there are no frames, or a pose is not finite or not rigid. The message names `what` and the frame.
    """
    try:
        poses = np.asarray(poses, float)
    except (TypeError, ValueError) as error:
        raise PoseError(f"{what} must be numbers of shape (F, 4, 4) ({error})") from None
    if poses.shape == (4, 4):
        poses = poses[None]
    if poses.ndim != 3 or poses.shape[1:] != (4, 4):
        raise PoseError(f"{what} must have shape (F, 4, 4), not {poses.shape}")
    if len(poses) == 0:
        raise PoseError(f"{what} holds zero frames; give at least one pose")
    check_rigid(poses, what)
    return poses


def check_motion(motion: Mapping[str, np.ndarray] | None, names: set[str], frames: int) -> tuple[dict[str, np.ndarray], int]:
    """Return checked object poses by surface name, repeated for all frames, and the number of frames.

    Args:
        names: of the scene's surfaces. frames: number of sensor poses. A single pose of the sensor or of an object holds for all frames.
    Raises:
        PoseError: a pose is wrong, a surface is unknown, or the numbers of frames differ.
    """
    if motion is not None and not isinstance(motion, Mapping):
        raise PoseError(f"motion must map surface names to poses (F, 4, 4), not be a {type(motion).__name__}")
    checked = {name: check_poses(poses, f"motion of {name!r}") for name, poses in (motion or {}).items()}
    for name in checked:
        if name not in names:
            raise PoseError(f"motion names surface {name!r}, which the scene does not have; it has: {', '.join(sorted(map(str, names)))}")
    lengths = {frames, *(len(p) for p in checked.values())} - {1}
    if len(lengths) > 1:
        raise PoseError(f"sensor poses and motion differ in length: {sorted(lengths)} frames")
    count = lengths.pop() if lengths else 1
    return {name: repeated(poses, count) for name, poses in checked.items()}, count


def repeated(poses: np.ndarray, frames: int) -> np.ndarray:
    """Repeat a single pose for all frames, and return several poses unchanged."""
    return poses if len(poses) == frames else np.repeat(poses, frames, axis=0)


def at_rest(*poses: np.ndarray) -> bool:
    """Return whether no pose sequence (F, 4, 4) moves."""
    return all(bool((np.abs(sequence - sequence[:1]) < AT_REST).all()) for sequence in poses)


def inverse(poses: np.ndarray) -> np.ndarray:
    """Return the inverses of rigid poses (F, 4, 4)."""
    rotation = np.swapaxes(poses[:, :3, :3], 1, 2)
    out = np.zeros_like(poses)
    out[:, :3, :3] = rotation
    out[:, :3, 3] = -np.einsum("fij,fj->fi", rotation, poses[:, :3, 3])
    out[:, 3, 3] = 1
    return out


def _advanced(poses: np.ndarray, share: float) -> np.ndarray:
    """Return the poses a fraction `share` of a frame period later, along the geodesic. The last frame moves like the one before."""
    if len(poses) == 1:
        return poses
    following = np.concatenate([poses[1:], poses[-1:]])
    before = poses.copy()
    following[-1], before[-1] = poses[-1], poses[-2]
    turn = Rotation.from_matrix(np.swapaxes(before[:, :3, :3], 1, 2) @ following[:, :3, :3]).as_rotvec()
    out = poses.copy()
    out[:, :3, :3] = poses[:, :3, :3] @ Rotation.from_rotvec(share * turn).as_matrix()
    out[:, :3, 3] += share * (following[:, :3, 3] - before[:, :3, 3])
    return out


def relative(sensor: np.ndarray, group: np.ndarray | None, frame_rate_hz: float) -> tuple[np.ndarray, np.ndarray]:
    """Return sensor poses in the frame of a moving group of surfaces, and the velocity of the sensor in this frame.

    The group is at rest in its own frame, so that only the sensor's motion changes a path.

    Args:
        sensor, group: poses (F, 4, 4) to the world. group=None: the group is at rest in the world.
    Returns:
        Sensor poses (F, 4, 4) and velocities (F, 3) in m/s, at frame starts.
    """
    (sensor, group_now), (sensor_later, group_later) = moments(sensor, np.eye(4)[None] if group is None else group)
    now, later = inverse(group_now) @ sensor, inverse(group_later) @ sensor_later
    return now, (later[:, :3, 3] - now[:, :3, 3]) / MOMENT * frame_rate_hz


def moments(*poses: np.ndarray) -> tuple[tuple[np.ndarray, ...], tuple[np.ndarray, ...]]:
    """Return the pose sequences (F, 4, 4) at frame starts, and the same sequences MOMENT frame periods later."""
    return poses, tuple(_advanced(one, MOMENT) for one in poses)


def rigid_groups(motion: Mapping[str, np.ndarray]) -> list[list[str]]:
    """Group the names of surfaces that have equal poses and therefore keep their relative positions."""
    groups: list[list[str]] = []
    for name, poses in motion.items():
        for group in groups:
            if np.array_equal(motion[group[0]], poses):
                group.append(name)
                break
        else:
            groups.append([name])
    return groups
