"""Check rigid poses, and compute relative motion and velocity at the start of each radar frame."""

from collections.abc import Mapping

import numpy as np
from scipy.spatial.transform import Rotation

from radartwin.errors import PoseError
from radartwin.radar.field_checks import check_rigid

MOMENT = 1e-4  # time step of the finite difference that gives a velocity, as a fraction of the frame period
ObjectPoses = Mapping[str, np.ndarray]  # poses (F, 4, 4) from a surface's own frame to the world, by the name of a moving surface
AT_REST = 1e-12  # a pose sequence whose matrix entries change by less than this counts as at rest


def check_poses(poses: np.ndarray, what: str) -> np.ndarray:
    """Check rigid poses and return them as a float64 array (F, 4, 4). A single pose (4, 4) becomes an array (1, 4, 4).

    Args:
        poses: 4 x 4 transformation matrices of F frames.
        what: name of the poses in error messages.
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


def check_motion(motion: ObjectPoses | None, names: set[str], frames: int) -> tuple[dict[str, np.ndarray], int]:
    """Check the object poses of a simulation. A single pose of the sensor or of an object is valid for all frames.

    Args:
        motion: object poses (F, 4, 4) or (4, 4) by surface name; None if no surface moves.
        names: names of the scene's surfaces.
        frames: number of sensor poses.
    Returns:
        The checked poses (F, 4, 4) by surface name, and the number of frames F.
    Raises:
        PoseError: a pose is invalid, the scene has no surface of a name in `motion`, or the numbers of frames differ.
    """
    if motion is not None and not isinstance(motion, Mapping):
        raise PoseError(f"motion must map surface names to poses (F, 4, 4), not be a {type(motion).__name__}")
    checked = {name: check_poses(poses, f"motion of {name!r}") for name, poses in (motion or {}).items()}
    for name in checked:
        if name not in names:
            raise PoseError(f"motion names surface {name!r}, which the scene does not have; it has: {', '.join(sorted(map(str, names)))}")
    lengths = {frames, *(len(p) for p in checked.values())} - {1}
    if len(lengths) > 1:
        raise PoseError(f"sensor poses and motion have {sorted(lengths)} frames; give one number of frames for all")
    count = lengths.pop() if lengths else 1
    return {name: repeated(poses, count) for name, poses in checked.items()}, count


def repeated(poses: np.ndarray, frames: int) -> np.ndarray:
    """Repeat a single pose (1, 4, 4) `frames` times; return `poses` unchanged if it already has one pose per frame."""
    return poses if len(poses) == frames else np.repeat(poses, frames, axis=0)


def at_rest(*poses: np.ndarray) -> bool:
    """Return whether every array of poses (F, 4, 4) has the same pose in all its frames."""
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
    """Move each pose forward in time by the fraction `share` (0 to 1) of a frame period, and return the moved poses (F, 4, 4).

    The function interpolates between successive frames with constant velocity and constant rotation rate. The last frame moves like the
    second to last frame.
    """
    if len(poses) == 1:
        return poses
    following = np.concatenate([poses[1:], poses[-1:]])
    before = poses.copy()
    following[-1], before[-1] = poses[-1], poses[-2]
    rotation = Rotation.from_matrix(np.swapaxes(before[:, :3, :3], 1, 2) @ following[:, :3, :3]).as_rotvec()
    out = poses.copy()
    out[:, :3, :3] = poses[:, :3, :3] @ Rotation.from_rotvec(share * rotation).as_matrix()
    out[:, :3, 3] += share * (following[:, :3, 3] - before[:, :3, 3])
    return out


def relative(sensor: np.ndarray, group: np.ndarray | None, frame_rate_hz: float) -> tuple[np.ndarray, np.ndarray]:
    """Compute the poses and velocities of the sensor in the coordinate frame of a moving group of surfaces.

    The surfaces are at rest in this coordinate frame, so that only the sensor's motion changes the length of a path.

    Args:
        sensor: (F, 4, 4) poses of the sensor in the world.
        group: (F, 4, 4) poses of the group of surfaces in the world; None if the group is at rest in the world.
        frame_rate_hz: number of frames per second.
    Returns:
        Sensor poses (F, 4, 4) and sensor velocities (F, 3) in m/s at the start of each frame, in the coordinate frame of the group.
    """
    (sensor, group_now), (sensor_later, group_later) = moments(sensor, np.eye(4)[None] if group is None else group)
    now, later = inverse(group_now) @ sensor, inverse(group_later) @ sensor_later
    return now, (later[:, :3, 3] - now[:, :3, 3]) / MOMENT * frame_rate_hz


def moments(*poses: np.ndarray) -> tuple[tuple[np.ndarray, ...], tuple[np.ndarray, ...]]:
    """Return the poses (F, 4, 4) at the start of each frame, and the poses (F, 4, 4) that follow MOMENT frame periods after the start of
    each frame.
    """
    return poses, tuple(_advanced(track, MOMENT) for track in poses)


def rigid_groups(motion: ObjectPoses) -> list[list[str]]:
    """Group the names of moving surfaces that have equal poses in all frames and therefore move together like one rigid body."""
    groups: list[list[str]] = []
    for name, poses in motion.items():
        for group in groups:
            if np.array_equal(motion[group[0]], poses):
                group.append(name)
                break
        else:
            groups.append([name])
    return groups
