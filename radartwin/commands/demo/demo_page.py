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
from radartwin.plotting import style
from radartwin.radar.detection import Peaks
from radartwin.radar.power_maps import PowerMaps
from radartwin.radar.processing import decibels
from radartwin.scene.scene import Scene
from radartwin.scene.viewer.colouring import material_label
from radartwin.simulation.origins import Origin

if TYPE_CHECKING:
    from matplotlib.figure import Figure

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
    """Draw the range profile and the range-azimuth map with a number at each peak and the name of its surface."""
    import matplotlib

    maps, peaks = picture.maps, picture.peaks
    farthest = float(peaks.range_m.max()) if len(peaks) else float(maps.range_m[-1])
    in_view = maps.range_m <= farthest + BEYOND_M
    range_m, profile = maps.range_m[in_view], decibels(maps.range_time.mean(axis=0)[in_view])
    azimuth_deg, power = np.degrees(maps.azimuth_rad[::-1]), decibels(maps.range_azimuth[::-1][:, in_view])
    top = float(power.max())
    with matplotlib.rc_context(style.style()):
        figure, (left, right) = style.figure(1, 2, width_in=11.0, height_in=4.6)
        left.plot(range_m, profile, lw=0.9)
        left.set(xlabel="range (m)", ylabel="power (dB of transmitted power)", title="Range profile, mean of all channels")
        left.set_xlim(0, range_m[-1])
        image = right.imshow(
            power.T, origin="lower", aspect="auto", interpolation="nearest", cmap=style.SEQUENTIAL, vmin=top - SHOWN_DB, vmax=top,
            extent=(*_ends(azimuth_deg), *_ends(range_m)),
        )  # fmt: skip
        right.set(xlabel="azimuth (degrees), left positive", ylabel="range (m)", title="Range and azimuth")
        for number, (at_m, angle, origin) in enumerate(zip(peaks.range_m, np.degrees(peaks.azimuth_rad), picture.origins, strict=True), 1):
            level = float(np.interp(at_m, range_m, profile))
            left.annotate(str(number), (at_m, level), xytext=(0, 4), textcoords="offset points", ha="center", fontsize=7)
            right.plot([angle], [at_m], "o", mfc="none", mec="white", ms=6, mew=0.9)
            side = -1 if angle < -45 else 1  # the name must not leave the picture, in which negative angles are on the right
            right.annotate(
                f"{number} {origin.surface}", (angle, at_m), xytext=(6 * side, 0), textcoords="offset points", color="white", fontsize=7,
                va="center", ha="left" if side > 0 else "right",
            )  # fmt: skip
        figure.colorbar(image, ax=right, label="power (dB of transmitted power)")
    return figure


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
