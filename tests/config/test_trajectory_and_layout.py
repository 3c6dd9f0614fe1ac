"""Tests of the configured trajectory and furniture layout: positions, and impossible values that are refused before any ray is traced."""

import warnings

import numpy as np
import pytest
from composing import compose

from radartwin.builders.radar import build_radar
from radartwin.builders.scene import add_layout, build_room
from radartwin.builders.trajectory import build_course, check_course
from radartwin.errors import ConfigError, LayoutError, MissingError, PoseError
from radartwin.scene.scene import Scene
from radartwin.scene.trajectories import trajectory


def course(*overrides):
    """Return the composed configuration, the room, and the poses of sensor and target."""
    config = compose(["scene=lab", *overrides])
    room = build_room(config.scene, config.materials)
    return config, room, build_course(config.trajectory, build_radar(config.radar), room)


def written(tmp_path, shift=(0.0, 0.0, 0.0), frames=21):
    """Write a trajectory file in TUM format, and return the override that selects it: 1 s along +x from (1, 0, 0.4) at 0.4 m/s."""
    path = tmp_path / "drive.txt"
    times = np.linspace(0, 1, frames)
    path.write_text("\n".join(f"{100 + t:.6f} {1 + 0.4 * t + shift[0]} {shift[1]} {0.4 + shift[2]} 0 0 0 1" for t in times))
    return f"trajectory.path={path}"


@pytest.mark.parametrize(("option", "degrees"), [("rail", 0.0), ("diagonal", 45.0)])
def test_a_rail_carries_the_target_60_cm_at_its_angle_and_drives_have_the_papers_length(option, degrees):
    _, _, found = course(f"trajectory={option}")
    path = found.target_poses[:, :3, 3]
    assert len(found.sensor_poses) == 1
    assert np.linalg.norm(path[0] - found.sensor_poses[0, :3, 3]) == pytest.approx(1.0)
    step = path[-1] - path[0]
    assert np.linalg.norm(step) == pytest.approx(0.6, abs=0.011)  # the last frame is within a step of the end
    assert np.degrees(np.arctan2(step[1], step[0])) == pytest.approx(degrees)
    speed = np.linalg.norm(np.diff(path, axis=0), axis=1) * 10
    assert np.allclose(speed, 0.1)
    for drive, length, drive_mps, axis in (("depth", 1.0, 0.2, 0), ("lateral", 1.2, 0.24, 1)):
        path = course(f"trajectory={drive}")[2].sensor_poses[:, :3, 3]
        assert len(path) == 50
        assert np.allclose(path[:, 2], 0.4)
        assert np.ptp(path[:, axis]) == pytest.approx(length - drive_mps / 10)


def test_file_gives_a_pose_per_radar_frame(tmp_path):
    _, _, found = course("trajectory=file", written(tmp_path))
    assert found.sensor_poses.shape == (11, 4, 4)
    assert np.allclose(found.sensor_poses[:, 0, 3], 1 + 0.04 * np.arange(11))
    assert np.allclose(found.target_poses[0, :3, 3], [2, 0, 0.4])
    _, _, later = course("trajectory=file", written(tmp_path), "trajectory.start_s=0.5", "trajectory.frames=3")
    assert np.allclose(later.sensor_poses[:, 0, 3], [1.2, 1.24, 1.28])
    mounted = course("trajectory=file", written(tmp_path), "trajectory.mount_m=[0.1,0,0.2]", "trajectory.mount_deg=[0,0,90]")[2]
    assert np.allclose(mounted.sensor_poses[0, :3, 3], [1.1, 0, 0.6])
    assert np.allclose(mounted.sensor_poses[0, :3, 0], [0, 1, 0])


def checked(*overrides):
    config, room, found = course(*overrides)
    check_course(room, build_radar(config.radar), found)


def test_drive_through_a_wall_or_under_the_floor_is_refused(tmp_path):
    checked("trajectory=file", written(tmp_path))
    with pytest.raises(PoseError, match="passes through surface 'wall_front' between frames"):
        checked("trajectory=file", written(tmp_path, (4.8, 1.0, 0)))
    with pytest.raises(PoseError, match=r"frame 0 is under the floor: z = -0\.1 m"):
        checked("trajectory=file", written(tmp_path, (0, 0, -0.5)))
    with pytest.raises(PoseError, match="above the ceiling"):
        checked("trajectory=file", written(tmp_path, (0, 0, 5)))
    config, room, found = course("trajectory=file", written(tmp_path, (0, 0, 5)))
    open_above = Scene([s for s in room if "ceiling" not in s.name and s.mesh.bounds[1, 2] < 2.0])
    check_course(open_above, build_radar(config.radar), found)  # a scan without a ceiling has no upper limit
    with pytest.raises(PoseError, match="has no ceiling"):
        check_course(open_above, build_radar(config.radar), course("trajectory=file", written(tmp_path, (0, 0, -0.5)))[2])


def test_speed_beyond_the_radar_s_doppler_range_is_one_warning():
    fast = trajectory.depth_sweep(np.eye(4), 30.0, 10.0)
    with pytest.warns(UserWarning, match="its Doppler is unambiguous only up to 7.5") as caught:
        trajectory.check_speed(fast, 10.0, 7.5)
    assert len(caught) == 1
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        trajectory.check_speed(fast, 10.0, 10.5)
        trajectory.check_speed(np.eye(4)[None], 10.0, 0.1)


def furnish(*overrides):
    chosen = [] if any(o.startswith("trajectory=") for o in overrides) else ["trajectory=static"]
    config, room, found = course(*chosen, *overrides)
    return room, add_layout(config.scene, room, found.sensor_poses[0])


def test_sentence_or_file_adds_objects_to_the_room(tmp_path):
    room, scene = furnish("scene.sentence='a mug on the table 1.5 m in front of the door'")
    mug = [s for s in scene.surfaces[len(room) :] if s.name == "mug"]
    assert mug
    middle = np.mean([s.mesh.bounds.mean(axis=0) for s in mug[:1]], axis=0)
    assert middle[0] == pytest.approx(4.5, abs=0.03)
    (tmp_path / "layout.yaml").write_text("objects:\n  - {object: corner_reflector, position_m: [3.0, 0.0]}\n")
    room, scene = furnish(f"scene.layout={tmp_path / 'layout.yaml'}")
    assert [s.name for s in scene.surfaces[len(room) :]] == ["corner_reflector"]
    assert furnish()[1] is not None


WRONG = {
    "unreadable sentence": (["scene.sentence='be a good twin'"], LayoutError, "supported are"),
    "unknown object": (["scene.sentence='a teapot on the floor'"], LayoutError, "teapot"),
    "absent layout": (["scene.layout=none.yaml"], MissingError, "none.yaml"),
    "layout and sentence": (["scene.layout=a.yaml", "scene.sentence='a mug on the floor'"], ConfigError, "one of them"),
    "file for a drive": (["trajectory=depth", "trajectory.path=a.txt"], ConfigError, "trajectory=file"),
    "file and a start": (["trajectory=file", "trajectory.path=a.txt", "trajectory.position_m=[0,0,1]"], ConfigError, "position_m"),
    "unknown axes": (["trajectory=file", "trajectory.path=a.txt", "trajectory.axes=camera"], ConfigError, "optical"),
    "angle of a turntable": (["trajectory=turntable", "trajectory.angle_deg=3"], ConfigError, r"choose trajectory=rail\|diagonal"),
    "incomplete mount": (["trajectory=file", "trajectory.path=a.txt", "trajectory.mount_m=[1]"], ConfigError, "three numbers"),
    "start before the file": (["trajectory=file", "trajectory.path=a.txt", "trajectory.start_s=-1"], ConfigError, "start_s"),
}


@pytest.mark.parametrize(("overrides", "error", "word"), WRONG.values(), ids=WRONG)
def test_wrong_setting_is_one_line(overrides, error, word):
    with pytest.raises(error, match=word) as caught:
        furnish(*overrides)
    assert "\n" not in str(caught.value)
