"""Implement `radartwin view SCENE --live`: read the scene, the radar, the pose at the start and the recording, and serve the page."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from radartwin.errors import ConfigError

if TYPE_CHECKING:
    import numpy as np

    from radartwin.live.playback import Playback
    from radartwin.scene.scene import Scene

TARGET_M = 2.0  # distance of the corner reflector in a procedural room


def live(options: argparse.Namespace) -> int:
    """Serve the live page. Raises ConfigError if an option belongs to the standalone page, and other UserErrors."""
    from radartwin.builders.radar import named_radar
    from radartwin.live.playback import Playback
    from radartwin.live.serve import serve
    from radartwin.radar.captures import load_capture
    from radartwin.radar.chirp import Radar

    for name, standard in (("out", None), ("by", "material")):
        if getattr(options, name) != standard:
            raise ConfigError(f"view --live writes no page and colours by material; leave --{name} out, or leave --live out")
    radar = named_radar(options.radar) if options.radar else None
    playback = Playback(load_capture(options.recording, radar), options.recording.name) if options.recording else None
    scene, start = _scene(options, playback)
    radar = playback.recording.radar if playback else radar or Radar.iwr1843()
    return serve(scene, radar, start, options.port, playback)


def _scene(options: argparse.Namespace, playback: Playback | None) -> tuple[Scene, np.ndarray]:
    """Return the scene, and the radar's pose (4, 4) in the first frame of the recording, the trajectory, or a simulation."""
    from radartwin.builders.scene import build_target
    from radartwin.builders.trajectory import build_start
    from radartwin.config.scene import ROOMS, RoomScene
    from radartwin.config.trajectory import StaticTrajectory
    from radartwin.scene import rooms
    from radartwin.scene.scene import Scene
    from radartwin.scene.trajectories.trajectory import pose

    procedural = str(options.scene) in ROOMS and not options.scene.exists()
    scene = rooms.room(str(options.scene)) if procedural else Scene.load(options.scene)
    if playback and playback.poses is not None:
        playback.poses = scene.placed(playback.poses, str(options.recording))
    start = playback.pose(0) if playback else None
    if start is None and options.trajectory:
        from radartwin.scene.trajectories.file import read_track

        start = scene.placed(read_track(options.trajectory).poses[0], str(options.trajectory))
    if start is None:
        start = build_start(StaticTrajectory(), scene)
    if options.layout:
        from radartwin.scene.layouts.layout import Layout
        from radartwin.scene.layouts.place import furnish

        scene = furnish(scene, Layout.load(options.layout), start)
    elif procedural and playback is None:
        place = pose(start[:3, 3] + TARGET_M * start[:3, 0])
        scene += Scene(surface.moved(place) for surface in build_target(RoomScene()))
    return scene, start
