"""The live page on a viser server without a browser: names of objects, late clicks, and the playback of a recording."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
import viser
from processes import wait_until

import radartwin as rt
from radartwin.live.controls import Controls
from radartwin.live.live_page import Page
from radartwin.live.playback import Playback
from radartwin.live.setting import split
from radartwin.live.tracing import LiveTracer
from radartwin.scene import objects, rooms
from radartwin.scene.scene import Scene, Surface
from radartwin.scene.trajectories.trajectory import pose

RADAR = rt.Radar.iwr1843()


@pytest.fixture
def server() -> Iterator[Any]:
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    yield server
    server.stop()


def reflectors(*names: str) -> Scene:
    """Return reflectors with these names, side by side 2 m from the origin."""
    mesh = objects.trihedral(0.1).apply_transform(np.diag([-1.0, -1, 1, 1])).apply_translation([2.0, 0, 0])
    return Scene([Surface(mesh.copy().apply_translation([0, k, 0]), "metal", name, role="object") for k, name in enumerate(names)])


def opened(server: Any, scene: Scene) -> tuple[Page, LiveTracer]:
    tracer = LiveTracer(Scene([]), RADAR, split(scene)[1])
    return Page(server, scene, pose([0.0, 0, 0]), tracer, Mock()), tracer


def test_an_object_with_the_name_of_the_radar_does_not_replace_it(server: Any) -> None:
    page, _ = opened(server, reflectors("radar", "radar 2"))
    assert set(page.setting.object_poses) == {"radar 2", "radar 3"}
    page.move_radar(pose([0.5, 0, 0]))
    assert page.setting.radar_pose[0, 3] == 0.5
    assert page.setting.object_poses["radar 3"][0, 3] > 1.5


def test_a_click_on_a_path_of_an_older_answer_has_no_effect(server: Any) -> None:
    page, tracer = opened(server, reflectors("target"))
    answer = tracer.answer(page.setting)
    page.show(replace(answer, paths=[answer.paths[0]] * 8))
    page.show(few := replace(answer, paths=answer.paths[:1]))
    page.choose(5)
    page.show(few)
    assert page._path_number is None


def test_a_click_beside_a_path_chooses_it_and_another_click_drops_it(server: Any) -> None:
    page, tracer = opened(server, reflectors("target"))
    answer = tracer.answer(page.setting)
    page.show(replace(answer, paths=answer.paths[:1]))
    eye, middle = np.array([1.0, -3.0, 1.0]), np.array([1.0, 0.0, 0.0])
    for away, chosen in ((0.3, None), (0.04, 0), (-0.04, None)):  # 0.02 rad are 6 cm here
        ray = middle + np.array([0, 0, away]) - eye
        page._clicked(eye, ray / np.linalg.norm(ray))
        assert page._path_number == chosen


def test_objects_are_placed_by_numbers_and_removed(server: Any) -> None:
    page, tracer = opened(server, reflectors("a", "b"))
    page.place("b", np.array([1.0, 2.0, 0.5]), 90.0)
    placed = page.setting.object_poses["b"]
    assert np.allclose(placed, pose([1.0, 2.0, 0.5], np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])))
    page.add_object("mug")
    assert set(page.setting.object_poses) == {"a", "b", "mug"}
    page.remove_object("a")
    page.remove_object("mug")
    assert page.controls._thing.options == ("radar", "b")
    assert [path.owner for path in tracer.answer(page.setting).paths][:1] == ["b"]
    page.add_object("mug")
    assert set(page.setting.object_poses) == {"b", "mug"}
    page.remove_object("mug")
    page.remove_object("b")
    page.show(tracer.answer(page.setting))
    assert "no echoes" in page.controls._map_caption.content
    sector = page.controls._map.image[:, :430].astype(int)  # without the bar of colours
    assert not (sector[..., 1] > sector[..., 2] + 60).any(), "no green or yellow"


@pytest.mark.parametrize("name", ["atrium", "lab", "squash_court"])
def test_a_radar_outside_the_room_is_warned_of(server: Any, name: str) -> None:
    room = rooms.room(name)
    page = Page(server, room, pose([1.0, 1.0, 1.0]), LiveTracer(split(room)[0], RADAR), Mock())
    low, high = room.bounds
    assert not page._stage.outside((low + high) / 2)
    for axis in range(3):
        for side in (low, high):
            assert page._stage.outside(np.where(np.arange(3) == axis, side + (side - (low + high) / 2), (low + high) / 2))


def test_a_recording_that_is_stopped_and_started_again_plays_at_its_frame_rate(server: Any) -> None:
    radar = replace(RADAR, frame_rate_hz=10.0, num_chirps=1)
    recording = rt.Recording(np.zeros((400, 1, 2, 4, 256), np.complex64), radar)
    controls = Controls(server, Mock(), Playback(recording, "capture"), 5.0)
    for plays in (True, False, True, False, True, False, True):
        controls._plays.value = plays
    wait_until(lambda: controls.frame > 0, 10)
    before = controls.frame
    time.sleep(1.0)
    controls._plays.value = False
    assert controls.frame - before <= 11
    for frames in (1, 2):
        slider = Controls(server, Mock(), Playback(rt.Recording(recording.iq[:frames], radar), "capture"), 5.0)._frame
        assert (slider.min, slider.max) == (0, frames - 1)
