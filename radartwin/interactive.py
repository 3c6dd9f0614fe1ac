"""A figure as one page for a browser: zoom, pan, and the values under the pointer. No network.

The page shows the figure's own vector drawing, so that it looks as on paper, and knows the data that was drawn: points of lines, bars and
scatters by their series, and pictures' values.
"""

from __future__ import annotations

import html
import io
import json
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

POINTS_MOST = 5000  # of one series; more are thinned evenly
POINTS_PER_INCH = 72  # of a drawing's own coordinates


def page(drawing: Figure, title: str) -> str:
    """The page of a figure that has been laid out (`savefig` or `draw_without_rendering` does it)."""
    stream = io.StringIO()
    drawing.savefig(stream, format="svg", metadata={"Date": None})
    drawn = stream.getvalue()
    drawn = drawn[drawn.index("<svg") :]
    size = [float(inches) * POINTS_PER_INCH for inches in drawing.get_size_inches()]
    data = json.dumps({"size": size, "axes": [_axes(one, size) for one in drawing.axes]}).replace("<", "\\u003c")
    return _PAGE.replace("/*TITLE*/", html.escape(title)).replace("<!--DRAWING-->", drawn).replace("/*DATA*/", data)


def _axes(axes: Axes, size: list[float]) -> dict[str, Any]:
    """What a reader may ask of one pair of axes."""
    box = axes.get_position()
    return {
        "box": _rounded([box.x0 * size[0], (1 - box.y1) * size[1], box.x1 * size[0], (1 - box.y0) * size[1]]),
        "title": axes.get_title(),
        "x": _scale(axes.xaxis, axes.get_xlim(), axes.get_xscale(), axes.get_xlabel()),
        "y": _scale(axes.yaxis, axes.get_ylim(), axes.get_yscale(), axes.get_ylabel()),
        "series": _series(axes),
        "pictures": _pictures(axes),
    }


def _scale(axis: Any, limits: tuple[float, float], scale: str, label: str) -> dict[str, Any]:
    """Limits, kind of scale, label, and names of places where the axis has names instead of figures."""
    from matplotlib.ticker import FixedFormatter, FuncFormatter

    formatter = axis.get_major_formatter()
    names = []
    if isinstance(formatter, FixedFormatter | FuncFormatter):
        told = zip(axis.get_majorticklocs(), (text.get_text() for text in axis.get_majorticklabels()), strict=False)
        names = [[float(place), text] for place, text in told if text]
    return {"low": float(limits[0]), "high": float(limits[1]), "log": scale == "log", "label": label, "names": names}


def _series(axes: Axes) -> list[dict[str, Any]]:
    """Points of lines, scatters and bars, in the coordinates of the axes."""
    from matplotlib.collections import PathCollection
    from matplotlib.container import BarContainer

    found = []
    for line in axes.lines:
        if line.get_transform() == axes.transData:
            found.append((str(line.get_label()), np.column_stack([line.get_xdata(), line.get_ydata()])))
    for some in axes.collections:
        if isinstance(some, PathCollection):
            found.append((str(some.get_label()), np.asarray(some.get_offsets(), float)))
    for bars in axes.containers:
        if isinstance(bars, BarContainer):
            ends = [(p.get_x() + p.get_width() / 2, p.get_y() + p.get_height()) for p in bars.patches]
            if bars.orientation == "horizontal":
                ends = [(p.get_x() + p.get_width(), p.get_y() + p.get_height() / 2) for p in bars.patches]
            found.append((str(bars.get_label()), np.array(ends, float)))
    series = []
    for label, points in found:
        points = np.asarray(points, float).reshape(-1, 2)
        points = points[np.isfinite(points).all(axis=1)]
        points = points[:: -(-len(points) // POINTS_MOST) or 1]
        if len(points):
            series.append({"name": "" if label.startswith("_") else label, "points": [_rounded(p) for p in points.tolist()]})
    return series


def _pictures(axes: Axes) -> list[dict[str, Any]]:
    """Images and meshes with even cells: extent and rows of values, the first row lowest."""
    from matplotlib.collections import QuadMesh

    found = []
    for image in axes.images:
        left, right, bottom, top = image.get_extent()
        values = np.ma.filled(np.ma.asarray(image.get_array(), float), np.nan)
        found.append((left, right, min(bottom, top), max(bottom, top), values[::-1] if image.origin == "upper" else values))
    for mesh in axes.collections:
        if isinstance(mesh, QuadMesh):
            corners = np.asarray(mesh.get_coordinates())
            values = np.ma.filled(np.ma.asarray(mesh.get_array(), float), np.nan).reshape(corners.shape[0] - 1, corners.shape[1] - 1)
            found.append((corners[0, 0, 0], corners[0, -1, 0], corners[0, 0, 1], corners[-1, 0, 1], values))
    return [
        {
            "extent": _rounded([left, right, low, high]),
            "values": [[None if not np.isfinite(v) else round(float(v), 1) for v in row] for row in values],
        }
        for left, right, low, high, values in found
        if values.ndim == 2
    ]


def _rounded(values: Any) -> list[float]:
    return [float(f"{value:.5g}") for value in values]


_PAGE = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width"><title>/*TITLE*/</title>
<style>
body { font: 14px/1.45 system-ui, sans-serif; margin: 1rem auto; max-width: 84rem; padding: 0 1rem; color: #1b1b1b; }
#drawing { border: 1px solid #ddd; touch-action: none; overflow: hidden; } #drawing svg { width: 100%; height: auto; display: block; }
#drawing:focus { outline: 2px solid #0072b2; }
#told { min-height: 1.5em; font-variant-numeric: tabular-nums; } .muted { color: #666; font-size: 12px; }
</style></head><body>
<h1>/*TITLE*/</h1>
<p id="told" role="status" aria-live="polite"></p>
<div id="drawing" tabindex="0" aria-label="figure">
<!--DRAWING-->
</div>
<p class="muted">Wheel, + and -: zoom. Drag, arrows: move. Double click, 0: the whole figure. Values under the pointer stand above it.</p>
<script>
const data = /*DATA*/;
const holder = document.getElementById("drawing"), svg = holder.querySelector("svg"), told = document.getElementById("told");
const [W, H] = data.size;
let view = [0, 0, W, H];
const mark = document.createElementNS("http://www.w3.org/2000/svg", "circle");
for (const [key, value] of Object.entries({r: 4, fill: "none", stroke: "#000", "stroke-width": 1.2, visibility: "hidden"}))
  mark.setAttribute(key, value);
svg.append(mark);
function show() { svg.setAttribute("viewBox", view.join(" ")); }
svg.removeAttribute("width"); svg.removeAttribute("height"); show();
function zoom(factor, x, y) {
  const w = Math.min(W, Math.max(W / 50, view[2] * factor)), f = w / view[2];
  view = [x - (x - view[0]) * f, y - (y - view[1]) * f, w, view[3] * f]; bound();
}
function bound() {
  view[0] = Math.min(Math.max(0, view[0]), W - view[2]); view[1] = Math.min(Math.max(0, view[1]), H - view[3]); show();
}
function at(event) {
  const box = svg.getBoundingClientRect();
  return [view[0] + (event.clientX - box.left) / box.width * view[2], view[1] + (event.clientY - box.top) / box.height * view[3]];
}
function place(scale, share) {
  if (!scale.log) return scale.low + share * (scale.high - scale.low);
  return scale.low * (scale.high / scale.low) ** share;
}
function share(scale, value) {
  if (!scale.log) return (value - scale.low) / (scale.high - scale.low);
  return Math.log(value / scale.low) / Math.log(scale.high / scale.low);
}
function said(scale, value, fallback) {
  const name = scale.names.find(([p]) => Math.abs(share(scale, p) - share(scale, value)) < 1e-3 || Math.abs(p - value) < 0.26);
  return (scale.label || fallback) + " " + (name ? name[1] : Number(value.toPrecision(4)));
}
function tell(event) {
  const [x, y] = at(event);
  mark.setAttribute("visibility", "hidden");
  const axes = data.axes.find(({box}) => x >= box[0] && x <= box[2] && y >= box[1] && y <= box[3]);
  if (!axes) { told.textContent = ""; return; }
  const [x0, y0, x1, y1] = axes.box, here = [place(axes.x, (x - x0) / (x1 - x0)), place(axes.y, (y1 - y) / (y1 - y0))];
  let best = null, least = 12 * view[2] / svg.getBoundingClientRect().width;
  for (const {name, points} of axes.series) for (const p of points) {
    const px = x0 + share(axes.x, p[0]) * (x1 - x0), py = y1 - share(axes.y, p[1]) * (y1 - y0), d = Math.hypot(px - x, py - y);
    if (d < least) { least = d; best = {name, p, px, py}; }
  }
  const parts = axes.title ? [axes.title] : [];
  if (best) {
    if (best.name) parts.push(best.name);
    mark.setAttribute("cx", best.px); mark.setAttribute("cy", best.py); mark.setAttribute("visibility", "visible");
  }
  const [a, b] = best ? best.p : here;
  parts.push(said(axes.x, a, "across"), said(axes.y, b, "up"));
  for (const {extent, values} of axes.pictures) {
    const i = Math.floor((here[0] - extent[0]) / (extent[1] - extent[0]) * values[0].length);
    const k = Math.floor((here[1] - extent[2]) / (extent[3] - extent[2]) * values.length);
    if (k >= 0 && k < values.length && i >= 0 && i < values[0].length && values[k][i] !== null) parts.push("value " + values[k][i]);
  }
  told.textContent = parts.join(" · ");
}
let held = null;
holder.addEventListener("wheel", e => { e.preventDefault(); zoom(e.deltaY > 0 ? 1.2 : 1 / 1.2, ...at(e)); }, {passive: false});
holder.addEventListener("pointerdown", e => { held = at(e); holder.setPointerCapture(e.pointerId); });
holder.addEventListener("pointerup", () => { held = null; });
holder.addEventListener("pointermove", e => {
  if (held) { const [x, y] = at(e); view[0] += held[0] - x; view[1] += held[1] - y; bound(); } else tell(e);
});
holder.addEventListener("dblclick", () => { view = [0, 0, W, H]; show(); });
holder.addEventListener("keydown", e => {
  const middle = [view[0] + view[2] / 2, view[1] + view[3] / 2], step = {ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1],
    ArrowDown: [0, 1]}[e.key];
  if (e.key === "+" || e.key === "=") zoom(1 / 1.2, ...middle); else if (e.key === "-") zoom(1.2, ...middle);
  else if (e.key === "0") { view = [0, 0, W, H]; show(); }
  else if (step) { view[0] += step[0] * view[2] / 10; view[1] += step[1] * view[3] / 10; bound(); } else return;
  e.preventDefault();
});
document.body.dataset.ready = "yes";
</script></body></html>
"""
