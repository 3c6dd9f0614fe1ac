"""Lines over a scene: a metre grid on its floor, its axes, the radar's track and where it looks."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from radartwin.scene.scene import Scene

TRACK, TRACK_END, GRID = (194, 65, 12), (244, 164, 96), (168, 180, 192)
AXES = ((200, 40, 40), (30, 140, 60), (40, 80, 200))
BORESIGHT_M = 1.0
FIELD_RAD = np.radians([50.0, 15.0])  # half the field in azimuth and elevation that the small pyramid shows
PYRAMID_M = 0.25
MOST_TICKS = 25

Line = dict[str, Any]


def lines(scene: Scene, poses: np.ndarray | None) -> tuple[list[Line], list[dict[str, Any]], dict[str, Any] | None]:
    """Lines {from, to, colour, width in pixels}, marks {text, at, colour}, and the radar's first {position, boresight}.

    Args:
        poses: (F, 4, 4) sensor-to-world, or None.
    """
    out, marks = _grid(*scene.bounds)
    for surface in scene:
        if surface.provenance.get("layout"):
            low, high = surface.mesh.bounds
            marks.append({"text": surface.name, "at": [*((low + high) / 2)[:2].tolist(), float(high[2]) + 0.06], "colour": (29, 39, 51)})
    if poses is None:
        return out, marks, None
    track, named = _track(poses)
    first = {"position": poses[0, :3, 3].tolist(), "boresight": poses[0, :3, 0].tolist()}
    return out + track, marks + named, first


def frame(low: np.ndarray, high: np.ndarray) -> list[list[float]]:
    """The corners of what the picture must hold: the scene and its grid."""
    (x0, y0), (x1, y1), _ = _ground(low, high)
    return [[float(x0), float(y0), float(low[2])], [float(x1), float(y1), float(high[2])]]


def _ground(low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
    """First and last grid line in x and y, and the step."""
    step = 1.0 if np.ptp([low, high], axis=0)[:2].max() > 1.5 else 0.1
    return np.floor(low[:2] / step + 1e-6) * step, np.ceil(high[:2] / step - 1e-6) * step, step


def _line(start: np.ndarray, end: np.ndarray, colour: tuple[int, int, int], width: float) -> Line:
    return {"from": np.round(start, 4).tolist(), "to": np.round(end, 4).tolist(), "colour": colour, "width": width}


def _grid(low: np.ndarray, high: np.ndarray) -> tuple[list[Line], list[dict[str, Any]]]:
    """A grid just under the floor, one metre or finer for small scenes, and the three axes at the corner nearest the origin."""
    first, last, step = _ground(low, high)
    z = float(low[2]) - 0.01 * step
    out = []
    for x in np.arange(first[0], last[0] + step / 2, step):
        out.append(_line(np.array([x, first[1], z]), np.array([x, last[1], z]), GRID, 1.0))
    for y in np.arange(first[1], last[1] + step / 2, step):
        out.append(_line(np.array([first[0], y, z]), np.array([last[0], y, z]), GRID, 1.0))
    corner = np.array([first[0], first[1], z])
    marks: list[dict[str, Any]] = [{"text": f"grid {step:g} m", "at": [float(last[0]), float(first[1]), z], "colour": (92, 106, 121)}]
    for axis, name in enumerate("xyz"):
        tip = corner + step * np.eye(3)[axis]
        out.append(_line(corner, tip, AXES[axis], 3.0))
        marks.append({"text": name, "at": (corner + 1.15 * step * np.eye(3)[axis]).tolist(), "colour": AXES[axis]})
    return out, marks


def _track(poses: np.ndarray) -> tuple[list[Line], list[dict[str, Any]]]:
    positions = poses[:, :3, 3]
    length = float(np.linalg.norm(np.diff(positions, axis=0), axis=1).sum())
    out = [_line(a, b, TRACK, 3.0) for a, b in pairwise(positions) if not np.array_equal(a, b)]
    for k in np.unique(np.linspace(0, len(poses) - 1, min(len(poses), MOST_TICKS)).astype(int))[1:]:
        out.append(_line(positions[k], positions[k] + 0.12 * poses[k, :3, 0], TRACK_END, 2.0))
    out.append(_line(positions[0], positions[0] + BORESIGHT_M * poses[0, :3, 0], TRACK, 5.0))
    out += _pyramid(poses[0])
    marks: list[dict[str, Any]] = [{"text": "radar", "at": (positions[0] + [0, 0, 0.1]).tolist(), "colour": TRACK}]
    if length > 0.05:
        marks.append({"text": f"end, {length:.2f} m on", "at": (positions[-1] + [0, 0, 0.1]).tolist(), "colour": TRACK})
    return out, marks


def _pyramid(pose: np.ndarray) -> list[Line]:
    """The edges of the radar's field, a hand long."""
    across, up = np.tan(FIELD_RAD) * PYRAMID_M
    corners = [pose[:3, :3] @ [PYRAMID_M, u * across, v * up] + pose[:3, 3] for u, v in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    rays = [_line(pose[:3, 3], corner, TRACK, 2.0) for corner in corners]
    return rays + [_line(corners[k], corners[(k + 1) % 4], TRACK, 2.0) for k in range(4)]
