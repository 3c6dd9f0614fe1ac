"""Write the page of `radartwin demo` in one HTML file, and its pictures side by side as `demo.png`."""

from __future__ import annotations

import html
import io
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from radartwin.io import files
from radartwin.label.material_map import draw_materials, legend
from radartwin.label.photos import load_textured
from radartwin.label.surface_labels import VLM
from radartwin.plotting import style
from radartwin.radar.detection import Peaks
from radartwin.radar.power_maps import PowerMaps
from radartwin.radar.processing import decibels
from radartwin.scene.scene import Scene
from radartwin.scene.surface import Surface
from radartwin.scene.thing_names import LANDMARKS, Thing, things
from radartwin.scene.viewer.colouring import surface_label
from radartwin.scene.viewer.page import view
from radartwin.simulation.origins import Origin

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PAGE = Path(__file__).with_name("page.html")
STRIP = "demo.png"
SHOWN_DB = 50.0  # powers further below the strongest echo are not shown
BEYOND_M = (0.15, 0.8)  # distances shown to the sides of the room, and behind its far end
MARKED = 12  # number of the strongest echoes that the pictures mark
LABEL_M = 2.2  # width of the names on each side of the map, in metres of the map
LONGER_M = 0.15  # an echo at a range of so much more than the farthest point of its surface took a longer way
# A peak has echoes of several surfaces if the power of its own surface differs from the power of all surfaces by at least the first ratio.
# Beyond the second ratio, the peak is not named by its surface.
MIXED_DB, UNCLEAR_DB = 3.0, 10.0


@dataclass(frozen=True)
class Echoes:
    """The echoes of a recording."""

    maps: PowerMaps
    peaks: Peaks  # strongest first
    origins: list[Origin]  # of each peak
    pose: np.ndarray  # of the radar (4, 4) in the scene
    scene: Scene  # with distinct names of the surfaces

    @cached_property
    def names(self) -> list[str]:
        """What each peak comes from, such as "wall behind the sofa", with a note if the echo took a longer way than there and back."""
        named = {surface.name: (surface.mesh, thing) for surface, thing in self.things}
        names = []
        for range_m, origin in zip(self.peaks.range_m, self.origins, strict=True):
            if origin.surface not in named:
                names.append("no surface")
            elif abs(origin.level_db) > UNCLEAR_DB:
                names.append("several things together")
            else:
                mesh, thing = named[origin.surface]
                away = np.linalg.norm(np.asarray(mesh.vertices) - self.pose[:3, 3], axis=1).max()
                names.append(f"{thing}{' by a detour' if range_m > away + LONGER_M else ''}")
        return names

    @cached_property
    def things(self) -> list[tuple[Surface, Thing]]:
        """The surfaces with the thing that each of them is."""
        return list(zip(self.scene, things(self.scene), strict=True))

    @cached_property
    def landmarks(self) -> list[tuple[str, np.ndarray]]:
        """Name and outline (N, 2) of large furniture from above, in metres right and ahead of the radar."""
        from scipy.spatial import ConvexHull

        plans = [(thing.category, _plan(surface, self.pose)) for surface, thing in self.things if thing.category in LANDMARKS]
        return [(name, points[ConvexHull(points).vertices]) for name, points in plans]

    @cached_property
    def outlines(self) -> list[np.ndarray]:
        """Outlines (N, 2) of walls and large furniture from above, in metres right and ahead of the radar."""
        lines = [np.vstack([corners, corners[:1]]) for _, corners in self.landmarks]
        for surface, thing in self.things:
            points = _plan(surface, self.pose)
            if thing.category.endswith("wall") and np.ptp(points, axis=0).max() > 1:
                along = points @ np.linalg.eigh(np.cov(points.T))[1][:, -1]
                lines.append(points[[along.argmin(), along.argmax()]])
        return lines

    @property
    def view_m(self) -> tuple[float, float]:
        """Half the width and the length in metres of the part of the map that is shown: the room ahead of the radar and a margin."""
        corners = np.vstack(self.outlines)
        return float(np.abs(corners[:, 0]).max()) + BEYOND_M[0], float(corners[:, 1].max()) + BEYOND_M[1]

    @property
    def marked(self) -> list[int]:
        """Indices of the strongest echoes that lie in the shown part of the map."""
        wide, far = self.view_m
        sideways, ahead = (self.peaks.range_m * ratio(self.peaks.azimuth_rad) for ratio in (np.sin, np.cos))
        return [k for k in range(len(self.names)) if abs(sideways[k]) < wide and ahead[k] < far][:MARKED]


def write_page(folder: Path, scene: Scene, echoes: Echoes) -> Path:
    """Write the page, its pictures and the view of the labelled scene into a folder, and return the path of the page."""
    import matplotlib

    room = view(scene, folder / "scene" / "view.html", echoes.pose, title="The scan, coloured by material")
    scan, strip = load_textured(folder / "scene"), io.BytesIO()
    with matplotlib.rc_context({**style.style(), "axes.titlesize": 11, "legend.fontsize": 9}):
        map_alone, axis = style.figure(width_in=8.2, height_in=4.3)
        _draw_map(axis, echoes)
        pictures = {"<!--PICTURES-->": draw_room(scene, scan), "<!--MAP-->": [map_alone], "<!--PROFILE-->": [draw_profile(echoes)]}
        parts = {mark: "\n".join(map(_svg, figures)) for mark, figures in pictures.items()}
        draw_strip(scene, scan, echoes).savefig(strip, format="png", dpi=100)
    parts |= {"<!--ROOM-->": html.escape(room.read_text(encoding="utf-8"), quote=True), "<!--ROWS-->": "\n".join(_rows(scene, echoes))}
    text = PAGE.read_text(encoding="utf-8")
    for mark, content in parts.items():
        text = text.replace(mark, content)
    files.write_atomically(folder / STRIP, style.fewer_colours(strip.getvalue(), 256))
    return files.write_atomically(folder / "index.html", text)


def draw_room(scene: Scene, scan: Scene | None) -> list[Figure]:
    """Draw the scan, and the materials of its surfaces in the same view with a legend, as two figures."""
    figures, axes = zip(*(style.figure(width_in=4.6, height_in=5.1) for _ in range(2)), strict=True)
    handles = legend({name: name for name in draw_materials(axes, scene, scan, 600)})
    figures[1].legend(handles=handles, loc="outside lower center", ncols=4)
    axes[0].set_anchor("N")
    return list(figures)


def draw_strip(scene: Scene, scan: Scene | None, echoes: Echoes) -> Figure:
    """Draw the scan, the materials and the map of the echoes side by side."""
    figure, axes = style.figure(1, 3, width_in=15.0, height_in=4.4, width_ratios=(1, 1, 2.15))
    handles = legend({name: name for name in draw_materials(axes[:2], scene, scan, 600)})
    figure.legend(handles=handles, loc="outside lower left", ncols=7, handlelength=1.2, columnspacing=1.2)
    _draw_map(axes[2], echoes)
    return figure


def draw_profile(echoes: Echoes) -> Figure:
    """Draw the power over range with the numbers of the marked echoes."""
    figure, axis = style.figure(width_in=8.2, height_in=2.5)
    shown = echoes.maps.range_m <= echoes.view_m[1]
    range_m, profile = echoes.maps.range_m[shown], decibels(echoes.maps.range_time.mean(axis=0)[shown])
    axis.plot(range_m, profile, lw=0.9)
    axis.set(xlabel="range (m)", ylabel="power (dB of\ntransmitted power)", title="power over range", xlim=(0, range_m[-1]))
    for k in echoes.marked:
        level = float(np.interp(echoes.peaks.range_m[k], range_m, profile))
        axis.annotate(str(k + 1), (echoes.peaks.range_m[k], level), xytext=(0, 4), textcoords="offset points", ha="center")
    return figure


def _draw_map(axis: Axes, echoes: Echoes) -> None:
    """Draw the range-azimuth map from above, the radar at the bottom, over the outlines of the room, with the name of each echo."""
    from matplotlib.patches import Rectangle

    maps, (wide, far) = echoes.maps, echoes.view_m
    shown = maps.range_m <= np.hypot(wide, far)
    range_m, power = maps.range_m[shown], decibels(maps.range_azimuth[:, shown])
    x, y = -np.outer(np.sin(maps.azimuth_rad), range_m), np.outer(np.cos(maps.azimuth_rad), range_m)
    top = float(power.max())
    frame = Rectangle((-wide, 0), 2 * wide, far, fc="none", ec="none")
    axis.add_patch(frame)
    image = axis.pcolormesh(x, y, power, cmap=style.SEQUENTIAL, vmin=top - SHOWN_DB, vmax=top, shading="gouraud", rasterized=True)
    angle = np.linspace(-np.pi / 2, np.pi / 2, 90)
    arcs = [np.column_stack([at_m * np.sin(angle), at_m * np.cos(angle)]) for at_m in range(1, int(far) + 1)]
    lines = [(line, 0.9, 0.9) for line in echoes.outlines] + [(arc, 0.4, 0.35) for arc in arcs]
    for drawn in [image, *(axis.plot(*line.T, color="white", lw=width, alpha=alpha)[0] for line, width, alpha in lines)]:
        drawn.set_clip_path(frame)
    for thing, corners in echoes.landmarks:
        x, y = np.clip(corners, (-wide, 0), (wide, far)).mean(axis=0)
        if corners[:, 1].max() > 0.2:
            height = corners[:, 1].min() + 0.12 if corners[:, 1].min() > 0 else y
            axis.text(x, height, thing, color="white", alpha=0.9, fontsize=7, ha="center", va="center", style="italic")
    for at_m in range(1, int(far) + 1):
        axis.text(0.03, at_m, f"{at_m} m", color="white", alpha=0.8, fontsize=7, va="bottom")
    axis.plot([0], [0.05], "^", color="white", ms=7, mec="black")
    axis.set(xlim=(-wide - LABEL_M, wide + LABEL_M), ylim=(-0.05, far), aspect="equal", title="radar echoes, seen from above")
    axis.set_axis_off()
    azimuth, marked = echoes.peaks.azimuth_rad, echoes.marked
    at = np.column_stack([-np.sin(azimuth), np.cos(azimuth)]) * echoes.peaks.range_m[:, None]
    for side in (-1, 1):
        column = sorted((k for k in marked if (at[k, 0] >= 0) == (side > 0)), key=lambda k: at[k, 1])
        for height, k in zip(_apart(at[column, 1], 0.065 * far, 0.97 * far), column, strict=True):
            axis.plot(*at[k], "o", mfc="none", mec="white", ms=6, mew=1.0)
            axis.annotate(
                f"{k + 1}  {echoes.names[k]}", at[k], xytext=(side * (wide + 0.08), height), va="center", fontsize=9,
                ha="left" if side > 0 else "right",
                arrowprops={"arrowstyle": "-", "lw": 0.6, "color": "#b0b0b0", "relpos": (float(side < 0), 0.5)},
            )  # fmt: skip


def _plan(surface: Surface, pose: np.ndarray) -> np.ndarray:
    """Return the vertices (N, 2) of a surface from above, in metres right and ahead of the radar."""
    local = (np.asarray(surface.mesh.vertices) - pose[:3, 3]) @ pose[:3, :3]
    return np.column_stack([-local[:, 1], local[:, 0]])


def _apart(heights: np.ndarray, step: float, highest: float) -> np.ndarray:
    """Move ascending heights up until they are `step` apart, and down again where they would exceed `highest`."""
    moved = np.array(heights, float)
    for k in range(1, len(moved)):
        moved[k] = max(moved[k], moved[k - 1] + step)
    for k in range(len(moved) - 1, -1, -1):
        moved[k] = min(moved[k], (moved[k + 1] if k + 1 < len(moved) else highest + step) - step)
    return moved


def _svg(figure: Figure) -> str:
    drawing = io.StringIO()
    figure.savefig(drawing, format="svg", metadata={"Date": None})
    return drawing.getvalue()[drawing.getvalue().index("<svg") :]


def _rows(scene: Scene, echoes: Echoes) -> list[str]:
    """Return one row of HTML for each peak."""
    surfaces, rows, levels_db = {surface.name: surface for surface in scene}, [], decibels(echoes.peaks.power)
    for index, origin in enumerate(echoes.origins):
        angle_deg = np.degrees(echoes.peaks.azimuth_rad[index])
        cells = [str(index + 1), echoes.names[index], f"{echoes.peaks.range_m[index]:.2f}", f"{angle_deg:.0f}", f"{levels_db[index]:.0f}"]
        surface = surfaces.get(origin.surface)
        if surface is None or abs(origin.level_db) > UNCLEAR_DB:
            cells += ["", "", ""]
        else:
            confidence = surface.provenance.get("confidence")
            mixed = "one thing" if abs(origin.level_db) < MIXED_DB else "several things"
            cells += [
                surface_label(surface),
                f"{confidence:.0%}" if isinstance(confidence, float) and surface.provenance.get("source") == VLM else "given",
                f"{round(origin.level_db, 1) + 0.0:+.1f} dB, {mixed}",
            ]
        rows.append("<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in cells) + "</tr>")
    return rows
