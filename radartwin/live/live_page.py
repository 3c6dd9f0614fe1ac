"""Build the live page: the 3D scene, the radar's answer and the controls, on a viser server."""

from __future__ import annotations

import html
import threading
from collections.abc import Callable
from typing import Any

import numpy as np

from radartwin.live.controls import PROFILE_DYNAMIC_DB, Controls
from radartwin.live.echoes import LivePath, path_at, span_db, surfaces_at
from radartwin.live.playback import Playback, shifted_db
from radartwin.live.setting import RADAR, LiveSetting, Movable, free_name, split, with_materials
from radartwin.live.stage import Stage
from radartwin.live.tracing import LiveAnswer, LiveTracer
from radartwin.scene import objects
from radartwin.scene.scene import Scene
from radartwin.scene.trajectories.trajectory import pose

SIMILAR_M = 0.3  # largest change in length of a path that stays chosen when something moves
BEFORE_RADAR_M = 1.5  # distance from the radar at which a new object appears


class Page:
    """Show a scene on a viser server.

    Args:
        start: sensor-to-world pose (4, 4) of the radar at the start.
        tracer: tracer of the same scene, which gets the objects that the user adds.
        request: function that receives each new setting.
    """

    def __init__(
        self,
        server: Any,
        scene: Scene,
        start: np.ndarray,
        tracer: LiveTracer,
        request: Callable[[LiveSetting], object],
        playback: Playback | None = None,
    ) -> None:
        self._server, self._tracer, self._request, self._playback = server, tracer, request, playback
        room, movables = split(scene)
        self._room, self._start, self._movables = with_materials(room), start, {m.name: m for m in movables}
        self.answer: LiveAnswer | None = None  # newest answer
        self._path_number: int | None = None
        self._count = 0
        self._lock = threading.RLock()
        self._stage = Stage(server, self._changed, self._clicked)
        self.look_again = self._stage.look_again
        self._stage.look(room, start)
        self._stage.show_room(room, movables)
        self._stage.add_radar(start)
        for movable in movables:
            self._stage.add_object(movable)
        extent = float(np.linalg.norm(np.ptp(room.bounds, axis=0))) if len(room) else 10.0
        self._farthest_m = float(np.clip(np.ceil(extent), 3.0, tracer.radar.unambiguous_range_m))
        self.controls = Controls(server, self, playback, self._farthest_m)
        self.controls.legend(self._stage.colours)
        self.controls.show_things([RADAR, *self._movables], RADAR, start)

    @property
    def setting(self) -> LiveSetting:
        """Return the setting that the page shows now."""
        controls = self.controls
        with self._lock:
            poses = {name: self._stage.pose(name) for name in self._movables}
        return LiveSetting(self._stage.pose(RADAR), poses, controls.materials.value, int(controls.bounces.value))

    def ask(self) -> None:
        """Request the answer to the present setting."""
        self._request(self.setting)

    def change_materials(self) -> None:
        with self._lock, self._server.atomic():
            self._stage.show_room(self._room(self.controls.materials.value), list(self._movables.values()))
            self.controls.legend(self._stage.colours)
        self.ask()

    def add_object(self, name: str) -> None:
        """Put an object of the catalogue in front of the radar, turned towards the radar."""
        entry = objects.entry(name)
        radar = self._stage.pose(RADAR)
        place = radar.copy()
        place[:3, :3] = radar[:3, :3] @ np.diag([-1.0, -1.0, 1.0])
        place[:3, 3] = radar[:3, 3] + BEFORE_RADAR_M * radar[:3, 0] - entry.aim_m * radar[:3, 2]
        with self._lock:
            free = free_name(name, [RADAR, *self._movables])
            movable = Movable(free, entry.surfaces(name=free), place)
            self._tracer.add(movable)
            self._stage.add_object(movable)
            self._movables = {**self._movables, free: movable}  # another thread may be reading the old dictionary
            self.controls.legend(self._stage.colours)
        self._changed(free)

    def remove_object(self, name: str) -> None:
        with self._lock:
            if name not in self._movables:
                return
            self._movables = {other: movable for other, movable in self._movables.items() if other != name}
            self._stage.remove(name)
        self._changed(RADAR)

    def reset(self) -> None:
        """Put the radar and all objects back to the places at which they started."""
        with self._lock, self._server.atomic():
            self._stage.place(RADAR, self._start)
            for name, movable in self._movables.items():
                self._stage.place(name, movable.pose)
        self._changed(RADAR)

    def select(self, name: str) -> None:
        """Show the place of the radar or of an object."""
        with self._lock:
            self.controls.show_things([RADAR, *self._movables], name, self._stage.pose(name))

    def place(self, name: str, position: np.ndarray, heading_deg: float) -> None:
        """Move the radar or an object to a position (3,) in metres, with its x axis at `heading_deg` from +x to the left and its tilt."""
        with self._lock:
            rotation = self._stage.pose(name)[:3, :3]
            angle = np.radians(heading_deg) - np.arctan2(rotation[1, 0], rotation[0, 0])
            turn = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
            self._stage.place(name, pose(position, turn @ rotation))
        self._changed(name)

    def move_radar(self, radar_pose: np.ndarray) -> None:
        """Move the radar to a sensor-to-world pose (4, 4), as a drag does."""
        self._stage.place(RADAR, radar_pose)
        self._changed(RADAR)

    def show_frame(self, frame: int) -> None:
        """Show a frame of the recording, and move the radar to its recorded pose."""
        assert self._playback is not None
        recorded = self._playback.pose(frame)
        if recorded is not None:
            self.move_radar(recorded)
        self.draw()

    def show(self, answer: LiveAnswer) -> None:
        """Show an answer. The chosen path stays chosen if the answer has a similar one."""
        with self._lock:
            before, self.answer = self.answer, answer
            self._count += before is None or answer.setting is not before.setting
            if before and self._path_number is not None:
                self._path_number = _same_path(before.paths[self._path_number], answer.paths)
            self.draw()

    def _changed(self, name: str) -> None:
        self.select(name)
        self.ask()

    def _clicked(self, eye: np.ndarray, direction: np.ndarray) -> None:
        with self._lock:
            paths = self.answer.paths[: int(self.controls.drawn_paths.value)] if self.answer else []
            number = path_at(paths, eye, direction)
            if number is not None:
                self.choose(None if self._path_number == number else number)

    def choose(self, number: int | None) -> None:
        """Choose a path, or none. A late choice of a path that is not in the present answer has no effect."""
        with self._lock:
            count = len(self.answer.paths) if self.answer else 0
            if number != self._path_number and (number is None or number < count):
                self._path_number = number
                self.draw()

    def draw(self) -> None:
        with self._lock:
            answer = self.answer
            if answer is None:
                return
            paths = answer.paths[: int(self.controls.drawn_paths.value)]
            path_number = self._path_number if self._path_number is not None and self._path_number < len(paths) else None
            spectra, measured, caption = answer.spectra, None, ""
            if self._playback is not None:
                frame = self.controls.frame
                recorded = self._playback.spectra(frame)
                measured = recorded.profile_db if self._playback.calibrated else shifted_db(recorded.profile_db, spectra.profile_db)
                caption = self._playback.caption(frame)
                if self.controls.which_map.value == "measured":
                    spectra = recorded
            seen = answer.spectra.range_m <= self._farthest_m
            top = span_db(answer.spectra.profile_db[seen], PROFILE_DYNAMIC_DB)[1]
            profile = answer.spectra.profile_db[seen]
            with self._server.atomic():
                self.controls.show_profile(answer.spectra.range_m[seen], profile, None if measured is None else measured[seen], top)
                self.controls.show_map(spectra)
                self.controls.caption(caption)
                self._stage.show_paths(paths, path_number)
                self.controls.show_paths(paths, path_number, self._card(paths, path_number, answer))
                self.controls.show_status(answer, self._count, self._stage.outside(answer.setting.radar_pose[:3, 3]))
            self._server.flush()

    def _card(self, paths: list[LivePath], path_number: int | None, answer: LiveAnswer) -> str:
        if path_number is None:
            return ""
        path = paths[path_number]
        surfaces = surfaces_at(path, self._tracer.scene(answer.setting))
        unknown = ", …" if path.partial else ""
        rows = {
            "level": f"{path.level_db:.1f} dB received over transmitted power",
            "range": f"{path.range_m:.3f} m (half of {path.length_m:.3f} m)",
            "delay": f"{1e9 * path.delay_s:.2f} ns",
            "bounces": str(path.bounces),
            "surfaces": " → ".join(map(html.escape, surfaces)) + unknown,
        }
        return "".join(f"<tr><th>{name}</th><td>{text}</td></tr>" for name, text in rows.items())


def _same_path(path: LivePath, paths: list[LivePath]) -> int | None:
    """Return the number of the path with equal owner and bounces and the nearest length, or None from SIMILAR_M on."""
    away = [abs(p.length_m - path.length_m) if (p.owner, p.bounces) == (path.owner, path.bounces) else np.inf for p in paths]
    nearest = int(np.argmin(away)) if away else 0
    return nearest if away and away[nearest] < SIMILAR_M else None
