"""The chart of speed against accuracy as one page for a browser: axes to choose from, details under the pointer, no network."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

from experiments.speed.chart import LOOKS
from experiments.speed.methods import DEFAULT, OURS
from experiments.speed.pareto import front

COSTS = {
    "seconds_frame": "processor-seconds a frame", "wall_s_frame": "wall-clock seconds a frame", "memory_mib": "memory above idle (MiB)",
    "rays": "rays a frame",
}  # fmt: skip
ERRORS = {
    "profile_error_db": "error of the range profile (dB)", "signal_error": "error of the signal",
    "free_error_db": "error of the range profile after one gain (dB)", "feature_error": "error of the features (spreads)",
    "recognition_error": "not recognised (share)",
}  # fmt: skip
TOLD = ("setup_s", "frames timed", "offset_db", "n")


def page(rows: Sequence[Mapping[str, Any]]) -> str:
    """The page, from the rows of the table."""
    measured = [row for row in rows if not row["claim"]]
    panels = []
    for name in dict.fromkeys(row["problem"] for row in measured):
        mine = [row for row in measured if row["problem"] == name]
        panels.append(
            {"title": mine[0]["title"], "truth": mine[0]["domain"], "points": [_point(row) for row in mine], "fronts": _fronts(mine)}
        )
    families = {row["family"]: LOOKS[row["family"]][1] for row in measured}
    content = {
        "panels": panels,
        "costs": COSTS,
        "errors": ERRORS,
        "families": families,
        "machine": measured[0]["machine"] if measured else "",
    }
    data = json.dumps(content).replace("<", "\\u003c")
    return _PAGE.replace("/*DATA*/", data)


def _point(row: Mapping[str, Any]) -> dict[str, Any]:
    kept = {key: row[key] for key in (*COSTS, *ERRORS, *TOLD)}
    default = (row["family"], row["setting"]) == (OURS, DEFAULT)
    name = f"{row['family']}, {row['setting']}"
    return kept | {"name": name, "colour": LOOKS[row["family"]][1], "default": default, "exact": bool(row["exact"])}


def _fronts(mine: Sequence[Mapping[str, Any]]) -> dict[str, list[int]]:
    """Indices on the front of each pair of axes; what has no figure or knows the answer is on none."""
    found = {}
    for cost in COSTS:
        for error in ERRORS:
            real = [i for i, row in enumerate(mine) if not row["exact"] and row[cost] and row[error] is not None]
            marks = front([(mine[i][cost], mine[i][error]) for i in real])
            found[f"{cost} {error}"] = [i for i, on in zip(real, marks, strict=True) if on]
    return found


_PAGE = """<!DOCTYPE html>
<html lang="en"><head><meta charset="utf-8"><meta name="viewport" content="width=device-width"><title>Speed against accuracy</title>
<style>
body { font: 14px/1.45 system-ui, sans-serif; margin: 1.5rem auto; max-width: 84rem; padding: 0 1rem; color: #1b1b1b; }
main { display: grid; grid-template-columns: repeat(auto-fit, minmax(25rem, 1fr)); gap: 1rem; }
h2 { font-size: 14px; margin: 0; } svg { width: 100%; height: auto; } label { margin-right: 1.2rem; }
#told { position: fixed; background: #fffffff2; border: 1px solid #888; padding: .4rem .6rem; font-size: 12px; }
#told { pointer-events: none; display: none; }
.muted { color: #666; font-size: 12px; } text { font: 10px system-ui, sans-serif; fill: #444; } .grid { stroke: #eee; }
</style></head><body>
<h1>Speed against accuracy</h1>
<p>Fast is left, accurate is down. The line is the front: nothing is cheaper and more accurate. The star is the default; a hollow mark
knows the exact answer and is on no front. <span class="muted" id="machine"></span></p>
<p><label>across <select id="cost"></select></label><label>up <select id="error"></select></label></p>
<p id="families"></p><main id="panels"></main><div id="told"></div>
<script>
const data = /*DATA*/;
const W = 420, H = 300, M = {l: 52, r: 16, t: 8, b: 36};
const make = (name, attributes, parent, text) => {
  const one = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const key in attributes) one.setAttribute(key, attributes[key]);
  if (text !== undefined) one.textContent = text;
  return parent.appendChild(one);
};
const pick = (id, options) => {
  const list = document.getElementById(id);
  for (const key in options) list.add(new Option(options[key], key));
  list.onchange = draw;
};
const number = v => v === null || v === undefined || v === "" ? "not measured" : typeof v === "number" ? +v.toPrecision(3) : v;
const axis = (values, least) => {
  const known = values.filter(v => v !== null && v !== "" && v > 0);
  const low = Math.floor(Math.log10(Math.max(Math.min(...known), least))), high = Math.ceil(Math.log10(Math.max(...known)) + 1e-9);
  return known.length ? [low, Math.max(high, low + 1)] : null;
};
function draw() {
  const cost = document.getElementById("cost").value, error = document.getElementById("error").value;
  const all = data.panels.flatMap(p => p.points), home = document.getElementById("panels");
  const xs = axis(all.map(p => p[cost]), 1e-4), ys = axis(all.map(p => p[error]), 1e-3);
  home.replaceChildren();
  if (!xs || !ys) { home.textContent = "Nothing is measured on these axes yet."; return; }
  const x = v => M.l + (Math.log10(Math.max(v, 10 ** xs[0])) - xs[0]) / (xs[1] - xs[0]) * (W - M.l - M.r);
  const y = v => H - M.b - (Math.log10(Math.max(v, 10 ** ys[0])) - ys[0]) / (ys[1] - ys[0]) * (H - M.t - M.b);
  for (const panel of data.panels.filter(p => p.points.some(q => q[cost] && q[error] !== null && q[error] !== ""))) {
    const box = home.appendChild(document.createElement("section"));
    box.innerHTML = "<h2></h2><div class=muted></div>";
    box.children[0].textContent = panel.title;
    box.children[1].textContent = "answer: " + panel.truth;
    const svg = make("svg", {viewBox: `0 0 ${W} ${H}`, role: "img"}, box);
    for (let k = xs[0]; k <= xs[1]; k++) {
      make("line", {x1: x(10 ** k), x2: x(10 ** k), y1: M.t, y2: H - M.b, class: "grid"}, svg);
      make("text", {x: x(10 ** k), y: H - M.b + 14, "text-anchor": "middle"}, svg, Math.abs(k) > 3 ? "1e" + k : 10 ** k);
    }
    for (let k = ys[0]; k <= ys[1]; k++) {
      make("line", {x1: M.l, x2: W - M.r, y1: y(10 ** k), y2: y(10 ** k), class: "grid"}, svg);
      make("text", {x: M.l - 6, y: y(10 ** k) + 3, "text-anchor": "end"}, svg, 10 ** k);
    }
    make("text", {x: (W + M.l) / 2, y: H - 6, "text-anchor": "middle"}, svg, data.costs[cost]);
    make("text", {transform: `translate(12 ${H / 2}) rotate(-90)`, "text-anchor": "middle"}, svg, data.errors[error]);
    const on = panel.fronts[cost + " " + error].map(i => panel.points[i]).sort((a, b) => a[cost] - b[cost] || b[error] - a[error]);
    if (on.length) {
      let way = `M${x(on[0][cost])} ${M.t}`;
      for (const p of on) way += ` H${x(p[cost])} V${y(p[error])}`;
      make("path", {d: way + ` H${W - M.r}`, fill: "none", stroke: "#999"}, svg);
    }
    for (const p of panel.points.filter(p => p[cost] && p[error] !== null && p[error] !== "")) {
      const at = {cx: x(p[cost]), cy: y(p[error]), r: 4.5, fill: p.exact ? "white" : p.colour, stroke: p.colour};
      const mark = p.default
        ? make("path", {d: star(at.cx, at.cy, 9), fill: p.colour, stroke: "black"}, svg)
        : make("circle", at, svg);
      if (p.default) make("text", {x: at.cx + 10, y: at.cy + 3}, svg, "default");
      mark.onmousemove = event => {
        const told = document.getElementById("told"), lines = [p.name];
        for (const key in data.costs) lines.push(data.costs[key] + ": " + number(p[key]));
        for (const key in data.errors) lines.push(data.errors[key] + ": " + number(p[key]));
        lines.push("set-up, s: " + number(p.setup_s), "frames timed: " + p["frames timed"] + ", rounds: " + p.n);
        told.innerText = lines.join("\\n");
        told.style.cssText = `display:block;left:${Math.min(event.clientX + 14, innerWidth - 320)}px;top:${event.clientY + 14}px`;
      };
      mark.onmouseleave = () => document.getElementById("told").style.display = "none";
    }
  }
}
const star = (x, y, r) => "M" + Array.from({length: 10}, (_, i) => {
  const a = Math.PI * (i / 5 - 0.5), s = i % 2 ? 0.42 * r : r;
  return (x + s * Math.cos(a)).toFixed(1) + " " + (y + s * Math.sin(a)).toFixed(1);
}).join("L") + "Z";
document.getElementById("machine").textContent = data.machine;
for (const name in data.families) {
  const mark = document.getElementById("families").appendChild(document.createElement("label"));
  mark.textContent = "\u25cf " + name;
  mark.style.color = data.families[name];
}
pick("cost", data.costs); pick("error", data.errors); draw();
</script></body></html>
"""
