"""Tests of the configured scene: its room, its target, and the position of the target."""

import numpy as np
import pytest
from composing import compose

from radartwin.builders.radar import build_radar
from radartwin.builders.scene import TARGET, build_room, build_target, lowest_m
from radartwin.builders.trajectory import build_course, build_start
from radartwin.config.trajectory import DepthTrajectory, StartTrajectory
from radartwin.errors import ConfigError
from radartwin.scene import objects, rooms


@pytest.mark.parametrize("name", ["lab", "atrium", "squash_court"])
def test_configured_room_is_the_procedural_room(name):
    config = compose([f"scene={name}", "scene.detail=shell", "materials=true"])
    assert build_room(config.scene, config.materials).names == rooms.room(name, detail="shell").names
    start = build_start(DepthTrajectory(), rooms.room(name))
    assert np.allclose(start, rooms.bench(name, 0.4).sensor_pose)
    void = compose(["scene=void"])
    assert (len(build_room(void.scene, void.materials)), void.scene.stand) == (0, True)


@pytest.mark.parametrize("name", list(objects.catalogue()))
def test_object_faces_the_radar_at_its_aim_point(name):
    target = build_target(compose(["scene=empty", f"scene.target={name}"]).scene)
    assert {s.name for s in target} == {TARGET}
    assert {s.kind for s in target} == {"object"}
    low, high = lowest_m(target), max(s.mesh.bounds[1, 2] for s in target)
    assert high - low == pytest.approx(objects.entry(name).size_m[2], abs=2e-4)
    assert -low == pytest.approx(objects.entry(name).aim_m, abs=1e-4)
    if name == "mug":
        assert target[1].mesh.bounds[1, 0] < 0  # the handle of the mug points to the radar


def test_target_position_is_the_height_of_its_foot():
    config = compose(["scene=squash_court", "scene.target=mug", "scene.target_position_m=[4,0.5,0.7]", "trajectory=static"])
    target, room, radar = build_target(config.scene), rooms.room("squash_court"), build_radar(config.radar)
    place = np.array(config.scene.target_position_m) - [0, 0, lowest_m(target)]
    course = build_course(config.trajectory, radar, room, place)
    foot = min((s.mesh.vertices + course.target_poses[0, :3, 3])[:, 2].min() for s in target)
    assert np.allclose(course.target_poses[0, :2, 3], [4, 0.5])
    assert foot == pytest.approx(0.7)
    assert isinstance(config.trajectory, StartTrajectory)
    start = build_start(config.trajectory, room)
    on_boresight = build_course(config.trajectory, radar, room)
    assert np.allclose(on_boresight.target_poses[0, :3, 3], start[:3, 3] + config.trajectory.distance_m * start[:3, 0])


@pytest.mark.parametrize(
    ("overrides", "words"),
    [
        (["scene.target=mugg"], "scene.target=mugg is not known; options: .*mug"),
        (["scene=atrium", "scene.back=glass"], r"not read by scene=lab\|atrium; choose scene=squash_court"),
        (["scene=empty", "scene.detail=shell"], r"not read by scene=empty\|void\|plate; choose scene=lab\|atrium\|squash_court"),
        (["scene=squash_court", "scene.back=brick"], "solid, glass"),
        (["scene.detail=messy"], "shell, furnished, cluttered"),
        (["scene.size_m=[6,5]"], r"must be \[length,width,height\]"),
        (["scene.size_m=[6,5,0]"], "above zero"),
        (["scene.target=mug", "scene.target_size_m=0.2"], "has its own size"),
        (["scene.target=none", "scene.stand=true"], "leaves nothing to place"),
        (["scene.target_position_m=[1,2]"], r"must be \[x,y,z\]"),
        (["scene=void", "materials=vlm"], "scene=void has no room; choose scene=lab or materials=uniform"),
    ],
)
def test_impossible_scene_is_refused(overrides, words):
    with pytest.raises(ConfigError, match=words):
        compose(overrides)
