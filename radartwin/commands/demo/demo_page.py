"""Write the page of `radartwin demo`: one HTML file that shows the room, the echoes, the surface of each peak, and the next commands to
type.
"""

from __future__ import annotations

import html
import io
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from radartwin.io import files
from radartwin.label.material_map import draw_materials
from radartwin.label.z_buffer import Camera
from radartwin.plotting import style
from radartwin.radar.detection import Peaks
from radartwin.radar.power_maps import PowerMaps
from radartwin.radar.processing import decibels
from radartwin.scene.scene import Scene
from radartwin.scene.viewer.colouring import material_label
from radartwin.simulation.origins import Origin

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.image import AxesImage

PAGE = Path(__file__).with_name("page.html")
SHOWN_DB = 50.0  # powers further below the strongest echo are not shown
BEYOND_M = 1.0  # range shown beyond the farthest peak
# a peak has echoes of several surfaces if the power of its own surface differs from the power of all surfaces by at least this ratio
MIXED_DB = 3.0


@dataclass(frozen=True)
class Picture:
    """The echoes of the recording: its power maps, its peaks from the strongest to the weakest, and the origin of each peak."""

    maps: PowerMaps
    peaks: Peaks
    origins: list[Origin]


def write_page(path: Path, room: str, scene: Scene, picture: Picture) -> Path:
    """Write the page atomically and return its path.

    Args:
        room: the HTML page of the scene, as `radartwin.scene.viewer.page.view` writes it.
        scene: the labelled scene, with distinct names of the surfaces.
    """
    import matplotlib

    with matplotlib.rc_context(style.style()):
        drawing = io.StringIO()
        draw(picture).savefig(drawing, format="svg", metadata={"Date": None})
    echoes = drawing.getvalue()
    parts = {
        "<!--ROOM-->": html.escape(room, quote=True),
        "<!--ECHOES-->": echoes[echoes.index("<svg") :],
        "<!--ROWS-->": "\n".join(_rows(scene, picture)),
    }
    text = PAGE.read_text(encoding="utf-8")
    for mark, content in parts.items():
        text = text.replace(mark, content)
    return files.write_atomically(path, text)


def draw(picture: Picture) -> Figure:
    """Draw the range profile, and the map of `draw_map`."""
    import matplotlib

    maps, peaks = picture.maps, picture.peaks
    in_view = _in_view(picture)
    range_m, profile = maps.range_m[in_view], decibels(maps.range_time.mean(axis=0)[in_view])
    with matplotlib.rc_context(style.style()):
        figure, (left, right) = style.figure(1, 2, width_in=11.0, height_in=4.6)
        left.plot(range_m, profile, lw=0.9)
        left.set(xlabel="range (m)", ylabel="power (dB of transmitted power)", title="Range profile, mean of all channels")
        left.set_xlim(0, range_m[-1])
        for number, at_m in enumerate(peaks.range_m, 1):
            level = float(np.interp(at_m, range_m, profile))
            left.annotate(str(number), (at_m, level), xytext=(0, 4), textcoords="offset points", ha="center", fontsize=7)
        image = draw_map(right, picture)
        figure.colorbar(image, ax=right, label="power (dB of transmitted power)")
    return figure


def draw_map(axis: Axes, picture: Picture) -> AxesImage:
    """Draw the power over range and azimuth, with a number at each peak and the name of its surface."""
    maps, peaks, in_view = picture.maps, picture.peaks, _in_view(picture)
    azimuth_deg, power = np.degrees(maps.azimuth_rad[::-1]), decibels(maps.range_azimuth[::-1][:, in_view])
    top = float(power.max())
    image = axis.imshow(
        power.T, origin="lower", aspect="auto", interpolation="nearest", cmap=style.SEQUENTIAL, vmin=top - SHOWN_DB, vmax=top,
        extent=(*_ends(azimuth_deg), *_ends(maps.range_m[in_view])),
    )  # fmt: skip
    axis.set(xlabel="azimuth (degrees), left positive", ylabel="range (m)", title="Range and azimuth")
    for number, (at_m, angle, origin) in enumerate(zip(peaks.range_m, np.degrees(peaks.azimuth_rad), picture.origins, strict=True), 1):
        axis.plot([angle], [at_m], "o", mfc="none", mec="white", ms=6, mew=0.9)
        side = -1 if angle < -45 else 1  # the name must not leave the picture, in which negative angles are on the right
        axis.annotate(
            f"{number} {origin.surface}", (angle, at_m), xytext=(6 * side, 0), textcoords="offset points", color="white", fontsize=7,
            va="center", ha="left" if side > 0 else "right",
        )  # fmt: skip
    return image


def draw_strip(scene: Scene, picture: Picture, camera: Camera) -> Figure:
    """Draw three panels side by side: the scan in its own colours, the same view by material, and the map of `draw_map`."""
    import matplotlib

    with matplotlib.rc_context(style.style()):
        figure, axes = style.figure(1, 3, width_in=11.0, height_in=3.9)
        patches = draw_materials(scene, axes[:2], camera)
        image = draw_map(axes[2], picture)
        figure.colorbar(image, ax=axes[2], label="power (dB of transmitted power)")
        figure.legend(handles=patches, loc="outside lower left", ncols=2, fontsize=6.5)
    return figure


def _in_view(picture: Picture) -> np.ndarray:
    """Return which range bins the pictures show: those up to BEYOND_M behind the farthest peak."""
    range_m, peaks = picture.maps.range_m, picture.peaks
    return range_m <= (float(peaks.range_m.max()) + BEYOND_M if len(peaks) else np.inf)


def _rows(scene: Scene, picture: Picture) -> list[str]:
    """Return one row of HTML for each peak."""
    surfaces, rows, peaks = {surface.name: surface for surface in scene}, [], picture.peaks
    levels_db = decibels(peaks.power)
    for number, origin in enumerate(picture.origins, 1):
        index, surface = number - 1, surfaces.get(origin.surface)
        cells = [str(number), f"{peaks.range_m[index]:.2f}", f"{np.degrees(peaks.azimuth_rad[index]):.0f}", f"{levels_db[index]:.0f}"]
        if surface is None:
            cells += ["no surface", "", "", ""]
        else:
            confidence = surface.provenance.get("confidence")
            mixed = "one surface" if abs(origin.level_db) < MIXED_DB else "several surfaces"
            cells += [
                surface.name,
                str(surface.provenance.get("minc", "")) + (f" ({confidence:.0%})" if isinstance(confidence, float) else ""),
                material_label(surface.material),
                f"{round(origin.level_db, 1) + 0.0:+.1f} dB, {mixed}",
            ]
        rows.append("<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in cells) + "</tr>")
    return rows


def _ends(axis: np.ndarray) -> tuple[float, float]:
    """Return the outer edges of the first and the last cell of an evenly spaced axis."""
    half = (axis[1] - axis[0]) / 2
    return float(axis[0] - half), float(axis[-1] + half)
