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
from radartwin.scene import objects
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
    page._clicked(5)
    page.show(few)
    page._clicked(0)
    page.show(few)
    assert page._path_number == 0


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


@pytest.mark.parametrize("frames", [1, 2])
def test_the_frame_slider_ends_at_the_last_frame(frames: int, server: Any) -> None:
    recording = rt.Recording(np.zeros((frames, 1, 2, 4, 256), np.complex64), replace(RADAR, num_chirps=1))
    controls = Controls(server, Mock(), Playback(recording, "capture"), 5.0)
    assert (controls._frame.min, controls._frame.max, controls.frame) == (0, frames - 1, 0)
