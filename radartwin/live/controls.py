"""The panel of the live page: profile, map, list of paths, sliders and choices."""

from __future__ import annotations

import html
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from radartwin.live.birds_eye import map_limits, map_picture
from radartwin.live.echoes import FLOOR_DB, SHOWN_PATHS, LivePath, Spectra
from radartwin.live.playback import Playback
from radartwin.live.setting import MATERIALS, MAX_BOUNCES, RADAR
from radartwin.live.tracing import LiveAnswer
from radartwin.scene import objects
from radartwin.scene.viewer.colouring import RGB

PANEL_PX = 540
PROFILE_PX = 230
PROFILE_DYNAMIC_DB = 70.0  # range of levels in the profile
SIMULATED, MEASURED = "#0072B2", "#D55E00"
NO_PATH = "none"
STYLE = (
    "<style>.rt{font:12px/1.45 system-ui,sans-serif;margin:0 .6em}.rt th{text-align:left;padding-right:1em;font-weight:600;"
    "vertical-align:top}.rt i{display:inline-block;width:.9em;height:.9em;margin:0 .35em -.1em 0;border:1px solid #8888}"
    ".rt span{margin-right:.9em;white-space:nowrap}.rt b.draft{color:#b45309}.rt b.done{color:#15803d}.rt b.bad{color:#b91c1c}</style>"
)


class Controls:
    """Add the panel to a viser server. `actions` is the `Page`, whose functions the panel calls."""

    def __init__(self, server: Any, actions: Any, playback: Playback | None, farthest_m: float) -> None:
        from viser import uplot

        self._gui, self._actions, self._playback = server.gui, actions, playback
        gui = server.gui
        gui.configure_theme(show_logo=False, show_share_button=False)
        gui.set_panel_label("RadarTwin live")
        gui.main_panel.dock_right()
        gui.main_panel.set_width(PANEL_PX)
        self._status = gui.add_html("")
        zero = np.array([0.0, farthest_m])
        series = [uplot.Series(label="range (m)"), uplot.Series(label="simulated (dB)", stroke=SIMULATED, width=1.5)]
        if playback is not None:
            series.append(uplot.Series(label="measured (dB)", stroke=MEASURED, width=1.2))
        self._profile = gui.add_uplot(
            (zero, *(np.array([-200.0, -200.0]) for _ in series[1:])), tuple(series), height=PROFILE_PX,
            scales={"x": uplot.Scale(time=False, auto=False, range=(0.0, farthest_m)), "y": uplot.Scale(auto=False, range=(-150.0, -60.0))},
            axes=(uplot.Axis(label="range (m)", size=36, labelSize=18), uplot.Axis(label="power (dB)", size=52, labelSize=18)),
            padding=(8, 14, 0, 0),
        )  # fmt: skip
        self._caption = gui.add_html("", visible=playback is not None)
        self._farthest_m = farthest_m
        self._add_paths()
        range_m, azimuth_rad = np.linspace(0, farthest_m, 16), np.radians(np.arange(-90.0, 91.0))
        empty = Spectra(range_m, azimuth_rad, np.zeros(16), np.full((181, 16), -200.0))
        self._map = gui.add_image(map_picture(empty, farthest_m), format="png")
        self._map_caption = gui.add_html("")
        if playback is not None:
            self._add_recording(playback)
        self._add_simulation()
        self._legend = gui.add_html("")
        self._add_places()
        self._show_status("<b class='draft'>computing the first answer</b>, which takes some seconds")

    @property
    def frame(self) -> int:
        return int(self._frame.value)

    def show_status(self, answer: LiveAnswer, count: int, outside: bool) -> None:
        draft = "<b class='draft'>draft</b>, the complete answer follows when nothing moves"
        kind = "<b class='done'>complete</b>" if answer.complete else draft
        warning = "<br><b class='bad'>the radar is outside the room</b>" if outside else ""
        self._show_status(f"answer {count}: {kind} · {1000 * answer.seconds:.0f} ms · strongest paths: {len(answer.paths)}{warning}")

    def fail(self, message: str) -> None:
        """Show why a setting cannot be simulated. The last answer stays on the page."""
        self._show_status(f"<b class='bad'>not simulated:</b> {html.escape(message)}")

    def _show_status(self, text: str) -> None:
        self._status.content = _html(text)

    def caption(self, text: str) -> None:
        self._caption.content = _html(html.escape(text))

    def legend(self, colours: Mapping[str, RGB]) -> None:
        items = "".join(f"<span><i style='background:rgb{colour}'></i>{html.escape(name)}</span>" for name, colour in colours.items())
        self._legend.content = _html(f"<b>materials</b><br>{items}")

    def show_profile(self, range_m: np.ndarray, simulated_db: np.ndarray, measured_db: np.ndarray | None, top_db: float) -> None:
        from viser import uplot

        values = [range_m, simulated_db, *([] if measured_db is None else [measured_db])]
        limits = uplot.Scale(auto=False, range=(top_db - PROFILE_DYNAMIC_DB, top_db))
        if self._profile.scales["y"] != limits:
            self._profile.scales = {**self._profile.scales, "y": limits}
        self._profile.data = tuple(np.asarray(v, np.float64) for v in values)

    def show_map(self, spectra: Spectra) -> None:
        self._map.image = map_picture(spectra, self._farthest_m)
        top = map_limits(spectra, self._farthest_m)[1]
        if spectra.map_db.max() <= FLOOR_DB:
            self._map_caption.content = _html("<b>no echoes:</b> no path leads back to the radar")
            return
        self._map_caption.content = _html(
            f"map from above: 0 dB is {top:.0f} dB of the transmitted power; lines in the room: paths in the same colours, 0 dB is the "
            "strongest path"
        )

    def show_paths(self, paths: Sequence[LivePath], path_number: int | None, card: str) -> None:
        self._options = [f"{k + 1}: {p.level_db:.1f} dB, {p.range_m:.2f} m, {p.owner or 'room'}" for k, p in enumerate(paths)]
        self._path.options = (NO_PATH, *self._options)
        self._path.value = NO_PATH if path_number is None else self._options[path_number]
        self._card.content = _html(f"<table>{card}</table>" if card else "click a path in the room, or choose one here")

    def show_things(self, names: Sequence[str], name: str, pose: np.ndarray) -> None:
        """Offer the radar and the objects in the list of things, and show the place of one of them."""
        if self._thing.options != tuple(names):
            self._thing.options = tuple(names)
        self._thing.value = name
        self._position.value = tuple(float(v) for v in np.round(pose[:3, 3], 3))
        self._heading.value = round(float(np.degrees(np.arctan2(pose[1, 0], pose[0, 0]))), 1)
        self._remove.disabled = name == RADAR

    def _add_paths(self) -> None:
        self._options: list[str] = []
        self._path = self._gui.add_dropdown("path", (NO_PATH,))
        self._card = self._gui.add_html("")

        def chosen() -> None:
            value = self._path.value
            self._actions.choose(self._options.index(value) if value in self._options else None)

        self._path.on_update(_by_user(chosen))

    def _add_simulation(self) -> None:
        with self._gui.add_folder("simulation"):
            self.bounces = self._gui.add_slider("bounces", min=1, max=MAX_BOUNCES, step=1, initial_value=MAX_BOUNCES)
            self.materials = self._gui.add_dropdown("materials", tuple(MATERIALS))
            self.drawn_paths = self._gui.add_slider("drawn paths", min=0, max=SHOWN_PATHS, step=1, initial_value=12)
        self.bounces.on_update(lambda _: self._actions.ask())
        self.materials.on_update(lambda _: self._actions.change_materials())
        self.drawn_paths.on_update(lambda _: self._actions.draw())

    def _add_places(self) -> None:
        with self._gui.add_folder("places"):
            self._thing = self._gui.add_dropdown("radar or object", (RADAR,))
            self._position = self._gui.add_vector3("x, y, z (m)", (0.0, 0.0, 0.0), step=0.01)
            self._heading = self._gui.add_number("heading (degrees)", 0.0, step=1.0, hint="of the boresight or x axis, from +x to the left")
            self._remove = self._gui.add_button("remove the object", disabled=True)
            added = self._gui.add_dropdown("new object", tuple(objects.catalogue()))
            self._gui.add_button("add the object").on_click(lambda _: self._actions.add_object(added.value))
            self._gui.add_button("move all back to the start").on_click(lambda _: self._actions.reset())
            self._gui.add_button("show the first view").on_click(lambda event: self._actions.look_again(event.client.camera))
        self._remove.on_click(lambda _: self._actions.remove_object(self._thing.value))

        def typed() -> None:
            self._actions.place(self._thing.value, np.array(self._position.value), float(self._heading.value))

        self._thing.on_update(_by_user(lambda: self._actions.select(self._thing.value)))
        self._position.on_update(_by_user(typed))
        self._heading.on_update(_by_user(typed))

    def _add_recording(self, playback: Playback) -> None:
        with self._gui.add_folder("recording"):
            self._frame = self._gui.add_slider("frame", min=0, max=playback.frames - 1, step=1, initial_value=0)
            self._plays = self._gui.add_checkbox("play", False)
            self.which_map = self._gui.add_dropdown("map", ("simulated", "measured"))
        self._frame.on_update(lambda _: self._actions.show_frame(self.frame))
        self.which_map.on_update(lambda _: self._actions.draw())
        self._playback_token = object()  # identifies the newest start or stop of the playback
        self._plays.on_update(lambda _: self._play(playback))

    def _play(self, playback: Playback) -> None:
        token = self._playback_token = object()
        if self._plays.value:
            threading.Thread(target=self._advance, args=(playback, token), name="playback", daemon=True).start()

    def _advance(self, playback: Playback, token: object) -> None:
        """Advance the frame at the frame rate until the last frame, or until the user stops."""
        while self._playback_token is token and self.frame < playback.frames - 1:
            started = time.monotonic()
            self._frame.value = self.frame + 1  # viser then calls the function of the slider
            time.sleep(max(0.0, 1 / playback.recording.radar.frame_rate_hz - (time.monotonic() - started)))
        if self._playback_token is token:
            self._plays.value = False


def _by_user(act: Callable[[], object]) -> Callable[[Any], object]:
    """Return a function of an event that acts only if a user, and not this program, has changed the value."""
    return lambda event: act() if event.client is not None else None


def _html(text: str) -> str:
    return f"{STYLE}<div class='rt'>{text}</div>"
