"""Write a figure as one HTML page on which the reader can zoom, pan, and read data values with pointer or keys. The page works offline.

The page shows Matplotlib's vector drawing of the figure. The page also contains the data of the figure: for each series, the points of
lines, scatter plots, error bars and bars, and the pixel values of images. Date axes, shaded meshes and image cells of unequal width are
drawn, but the page cannot show their values.
"""

from __future__ import annotations

import html
import io
import json
import re
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MAX_POINTS = 5000  # points of one series; longer series are thinned
MAX_CELLS = 200_000  # cells of a picture; the page has no values of larger pictures
POINTS_PER_INCH = 72  # unit of the drawing's coordinates
STEPS = 256  # number of samples of a scale that is neither linear nor logarithmic
PAGE = Path(__file__).with_name("pages.html")


def page(drawing: Figure, title: str) -> str:
    """Return the HTML page of a figure. The figure's layout must be final (after `savefig` or `draw_without_rendering`)."""
    stream = io.StringIO()
    drawing.savefig(stream, format="svg", metadata={"Date": None})
    drawn = stream.getvalue()
    drawn = _numbered(drawn[drawn.index("<svg") :])
    size = [float(inches) * POINTS_PER_INCH for inches in drawing.get_size_inches()]
    data = json.dumps({"size": size, "axes": [_axes(one, size) for one in drawing.axes]}).replace("<", "\\u003c")
    text = PAGE.read_text(encoding="utf-8")
    return text.replace("/*TITLE*/", html.escape(title)).replace("<!--DRAWING-->", drawn).replace("/*DATA*/", data)


def _numbered(drawn: str) -> str:
    """Replace Matplotlib's identifiers of shared SVG elements by numbers, because the identifiers depend on memory addresses."""
    names = {name: f"part{number}" for number, name in enumerate(dict.fromkeys(re.findall(r'id="([a-zA-Z]+[0-9a-f]{10})"', drawn)))}
    return re.sub(r"\b[a-zA-Z]+[0-9a-f]{10}\b", lambda found: names.get(found[0], found[0]), drawn)


def _axes(axes: Axes, size: list[float]) -> dict[str, Any]:
    box = axes.get_position()
    return {
        "box": _rounded([box.x0 * size[0], (1 - box.y1) * size[1], box.x1 * size[0], (1 - box.y0) * size[1]]),
        "title": axes.get_title(),
        "x": _scale(axes.xaxis, axes.get_xlim(), _label(axes, "x")),
        "y": _scale(axes.yaxis, axes.get_ylim(), _label(axes, "y")),
        "series": _series(axes),
        "pictures": _pictures(axes),
    }


def _label(axes: Axes, name: str) -> str:
    """Return the label of an axis. If the axis has no label, return the label of an axis that shares its scale."""
    shared = getattr(axes, f"get_shared_{name}_axes")().get_siblings(axes)
    return next((text for one in (axes, *shared) if (text := getattr(one, f"get_{name}label")())), "")


def _scale(axis: Any, limits: tuple[float, float], label: str) -> dict[str, Any]:
    """Return limits, kind and label of an axis scale, and the tick names if the axis has names instead of numbers."""
    from matplotlib.ticker import FixedFormatter, FuncFormatter

    names = []
    if isinstance(axis.get_major_formatter(), FixedFormatter | FuncFormatter):
        ticks = zip(axis.get_majorticklocs(), (text.get_text() for text in axis.get_majorticklabels()), strict=False)
        names = [[float(place), text] for place, text in ticks if text]
    kind = axis.get_scale()
    out = {"low": float(limits[0]), "high": float(limits[1]), "log": kind == "log", "label": label, "names": names}
    if kind not in ("linear", "log"):
        transform = axis.get_transform()
        ends = transform.transform(np.array(limits, float))
        out["steps"] = _rounded(transform.inverted().transform(np.linspace(ends[0], ends[1], STEPS + 1)))
    return out


def _series(axes: Axes) -> list[dict[str, Any]]:
    """Return the points (x, y) of all lines, scatter plots, error bars and bars in data coordinates. The point of a bar has the bar's value
    as a third number.
    """
    from matplotlib.collections import PathCollection
    from matplotlib.container import BarContainer, ErrorbarContainer

    found, parts = [], set()
    for bars in axes.containers:
        if isinstance(bars, BarContainer):
            flat = bars.orientation == "horizontal"
            ends = [
                (p.get_x() + p.get_width(), p.get_y() + p.get_height() / 2)
                if flat
                else (p.get_x() + p.get_width() / 2, p.get_y() + p.get_height())
                for p in bars.patches
            ]
            found.append((bars.get_label(), np.column_stack([np.reshape(ends, (-1, 2)), np.asarray(bars.datavalues, float).ravel()])))
            if bars.errorbar is not None:
                parts |= {id(part) for part in (bars.errorbar[0], *bars.errorbar[1])}
        elif isinstance(bars, ErrorbarContainer):
            line, caps, _ = bars
            parts |= {id(part) for part in (line, *caps)}
            if line is not None:
                found.append((bars.get_label(), _points(line.get_xdata(orig=False), line.get_ydata(orig=False))))
    for line in axes.lines:
        if id(line) not in parts and line.get_transform() == axes.transData:
            found.append((line.get_label(), _points(line.get_xdata(orig=False), line.get_ydata(orig=False))))
    for some in axes.collections:
        if isinstance(some, PathCollection):
            found.append((some.get_label(), np.ma.filled(np.ma.asarray(some.get_offsets(), float), np.nan)))
    series = []
    for label, points in found:
        points = points[np.isfinite(points).all(axis=1)]
        points = points[:: -(-len(points) // MAX_POINTS) or 1]
        if len(points):
            name = "" if str(label).startswith("_") else str(label)
            series.append({"name": name, "points": [_rounded(p) for p in points.tolist()]})
    return series


def _points(x: Any, y: Any) -> np.ndarray:
    """Return points (N, 2) from x and y, with NaN in place of masked values."""
    return np.column_stack([np.ma.filled(np.ma.asarray(one, float), np.nan) for one in (x, y)])


def _pictures(axes: Axes) -> list[dict[str, Any]]:
    """Return the images and the meshes of equal cells. For each image or mesh, the result holds the extent (left, right, first, last) in
    axis units, and the rows of values from `first` to `last` on the vertical axis.
    """
    from matplotlib.collections import QuadMesh

    found = []
    for image in axes.images:
        left, right, bottom, top = image.get_extent()
        values = np.ma.filled(np.ma.asarray(image.get_array(), float), np.nan)
        found.append((left, right, bottom, top, values[::-1] if image.origin == "upper" else values))
    for mesh in axes.collections:
        if isinstance(mesh, QuadMesh):
            corners, values = np.asarray(mesh.get_coordinates()), np.ma.filled(np.ma.asarray(mesh.get_array(), float), np.nan)
            x, y = corners[0, :, 0], corners[:, 0, 1]
            even = all(np.allclose(np.diff(one), one[1] - one[0], rtol=1e-3, atol=1e-9 * abs(one[1] - one[0])) for one in (x, y))
            straight = np.allclose(corners[:, :, 0], x) and np.allclose(corners[:, :, 1], y[:, None])
            if even and straight and values.size == (len(x) - 1) * (len(y) - 1):
                found.append((x[0], x[-1], y[0], y[-1], values.reshape(len(y) - 1, len(x) - 1)))
    return [
        {
            "extent": _rounded([left, right, low, high]),
            "values": [[float(f"{v:.4g}") if np.isfinite(v) else None for v in row] for row in values],
        }
        for left, right, low, high, values in found
        if values.ndim == 2 and values.size <= MAX_CELLS
    ]


def _rounded(values: Any) -> list[float]:
    return [float(f"{value:.6g}") for value in values]
