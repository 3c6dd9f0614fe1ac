"""Build surfaces of the measurement equipment (tripod, rover, turntable drive, cables), which a scan of the room does not contain.

Each function returns surfaces placed relative to the sensor or the target. The entry `provenance["fixture"]` marks these surfaces, so that
the testbed can leave some of them out if `Gaps.clutter` is below 1. All parts stay 1 cm apart and 1 cm from other surfaces, because faces
in contact shadow each other. The sizes are those of ordinary parts: a photographic tripod, a mecanum rover of 40 x 35 cm with a mast, and a
geared motor in a box. We know of no published drawing of such measurement equipment.
"""

from __future__ import annotations

import numpy as np
import trimesh

from radartwin.errors import SceneError
from radartwin.scene import objects
from radartwin.scene.rooms import GAP, surface
from radartwin.scene.scene import Scene, Surface
from radartwin.scene.trajectories.trajectory import pose
from radartwin.testbed.motion_errors import about_z

ROVER = "rover"  # surface name of all parts of a rover, which move together
_BELOW = 0.05  # distance in metres from the radar's origin down to its mount: half a board and a bracket
_SIDES = 24  # number of side faces of a cylinder
_SPREAD_M = 0.35  # horizontal distance from the radar to the tripod's feet
_DISC_M = 0.03  # thickness of the turntable's disc
_CABLE_M = 0.8  # length of the cable on the floor


def tripod(sensor_pose: np.ndarray) -> Scene:
    """Build a tripod under a radar at rest: a head, and three legs to the floor at z = 0. One leg stands behind the radar.

    `sensor_pose` (4, 4) must have a horizontal viewing direction. A radar below 0.3 m raises SceneError.
    """
    height = float(sensor_pose[2, 3])
    if height < 0.3:
        raise SceneError(f"tripod: the radar is {height:g} m above the floor; give at least 0.3 m")
    top = height - _BELOW
    parts = [_fixture("tripod_head", objects.cylinder(0.04, 0.04, _SIDES).apply_transform(pose([0, 0, top - 0.02])), "dark metal")]
    for number, degrees in enumerate((60, 180, 300)):
        out = np.array([np.cos(np.radians(degrees)), np.sin(np.radians(degrees)), 0.0])
        hip, foot = 0.05 * out + [0, 0, top - 0.04 - 2 * GAP], _SPREAD_M * out + [0, 0, 2 * GAP]
        parts.append(_fixture(f"tripod_leg_{number}", _rod(hip, foot, 0.011), "dark metal"))
    return Scene(part.moved(_on_floor(sensor_pose)) for part in parts)


def rover(height_m: float = 0.4) -> Scene:
    """Build a rover under and behind its radar, in the radar's coordinates. To move it, simulate with the motion `{ROVER: sensor_poses}`.

    The chassis and wheels are one metal block 3 cm above the floor. Computer and battery are on the rear of the block, and a mast is behind
    the radar.

    Args:
        height_m: height of the radar above the floor.
    Raises:
        SceneError: the radar is lower than 0.3 m.
    """
    if height_m < 0.3:
        raise SceneError(f"rover: its radar is {height_m:g} m above the floor; give at least 0.3 m")
    floor = -height_m
    top = floor + 0.15
    chassis = objects.box([-0.30, -0.175, floor + 0.03], [0.10, 0.175, top])
    computer = objects.box([-0.26, -0.08, top + GAP], [-0.12, 0.08, top + 0.08])
    mast = objects.cylinder(0.012, 0.02 - top - GAP, _SIDES).apply_transform(pose([-0.05, 0.0, (top + GAP + 0.02) / 2]))
    names = ("painted metal", "plastic", "metal")
    return Scene(_fixture(ROVER, mesh, finish) for mesh, finish in zip((chassis, computer, mast), names, strict=True))


def turntable_drive(position: np.ndarray) -> Scene:
    """Build the motor and gear under a turntable's disc, beside its post (see `rooms.support`). `position` (3,) is the top of the disc.

    Motor box and gear box are rotated about the vertical, so that none of their faces is perpendicular to the line of sight of a radar on
    the x axis. A disc that is too low for a motor raises SceneError.
    """
    x, y, top = (float(v) for v in position)
    under = top - _DISC_M - 2 * GAP
    if under < 0.15:
        raise SceneError(f"turntable_drive: the disc is at z = {top:g} m, too low for a motor under it; give at least 0.2 m")
    motor = _turned_box([x + 0.11, y, under - 0.04], [0.08, 0.10, 0.08], 20)
    gear = _turned_box([x, y + 0.10, under - 0.025], [0.09, 0.06, 0.05], -15)
    return Scene([_fixture("turntable_motor", motor, "painted metal"), _fixture("turntable_gear", gear, "plastic")])


def radar_rig(sensor_pose: np.ndarray) -> Scene:
    """Build the equipment at the radar for turntable recordings: a tripod, and a cable that hangs from behind the radar to the floor."""
    height = float(sensor_pose[2, 3])
    hanging = _rod(np.array([-0.10, 0.06, height - 0.02]), np.array([-0.16, 0.06, 3 * GAP]), 0.004)
    return tripod(sensor_pose) + Scene([_fixture("cable_radar", hanging, "plastic").moved(_on_floor(sensor_pose))])


def target_rig(sensor_pose: np.ndarray, target: np.ndarray) -> Scene:
    """Build the equipment at the target for turntable recordings: the turntable drive, and a cable on the floor.

    The cable runs from below the target to the left. `target` (3,) is the top of the turntable's disc.
    """
    across = sensor_pose[:3, 1]
    foot = np.array([target[0], target[1], 0.0])
    lying = _rod(foot + 0.15 * across + [0, 0, 0.014], foot + (0.15 + _CABLE_M) * across + [0, 0, 0.014], 0.004)
    return turntable_drive(target) + Scene([_fixture("cable_turntable", lying, "plastic")])


def _on_floor(sensor_pose: np.ndarray) -> np.ndarray:
    """Return the pose (4, 4) on the floor below a sensor pose with a horizontal viewing direction."""
    out = pose([*sensor_pose[:2, 3], 0.0])
    out[:2, :2] = sensor_pose[:2, :2]
    return out


def _fixture(name: str, mesh: trimesh.Trimesh, finish: str) -> Surface:
    made = surface(name, mesh, finish, role="object")
    plain = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    return made.replaced(mesh=plain, provenance={**made.provenance, "fixture": True})


def _turned_box(centre: list[float], size: list[float], yaw_deg: float) -> trimesh.Trimesh:
    half = np.array(size) / 2
    return objects.box((-half).tolist(), half.tolist()).apply_transform(pose(centre, about_z(np.radians(yaw_deg))))


def _rod(start: np.ndarray, end: np.ndarray, radius_m: float) -> trimesh.Trimesh:
    """Build a closed cylinder with radius `radius_m` between the points `start` (3,) and `end` (3,)."""
    along = np.asarray(end, float) - start
    length = float(np.linalg.norm(along))
    rotation = np.asarray(trimesh.geometry.align_vectors([0, 0, 1], along / length))[:3, :3]
    return objects.cylinder(radius_m, length, _SIDES).apply_transform(pose((np.asarray(start) + end) / 2, rotation))
