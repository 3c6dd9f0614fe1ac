"""Draw lines and text labels over a scene: a grid on the floor, the axes, and the track and field of view of the radar."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from radartwin.scene.scene import Scene
from radartwin.scene.viewer.colouring import RGB

TRACK_RGB, BORESIGHT_RGB, GRID_RGB, LABEL_RGB = (194, 65, 12), (244, 164, 96), (168, 180, 192), (29, 39, 51)
AXES_RGB = ((200, 40, 40), (30, 140, 60), (40, 80, 200))
BORESIGHT_M = 1.0
FIELD_RAD = np.radians([50.0, 15.0])  # half the angular width of the drawn field of view, in azimuth and elevation
PYRAMID_M = 0.25
MAX_TICKS = 25  # largest number of boresight directions drawn along the track


def overlay(scene: Scene, poses: np.ndarray | None) -> dict[str, Any]:
    """Return the lines and text labels that are drawn over a scene and, if `poses` is given, over the track of the radar.

    Args:
        poses: (F, 4, 4) sensor-to-world poses of the radar's track, or None for a scene without a track.
    Returns:
        lines: list of lines, each a dictionary {from, to, colour, width in pixels}.
        labels: list of text labels, each a dictionary {text, at, colour}.
        radar: position and boresight of the radar in the first frame, as a dictionary {position, boresight}; None without a track.
        frame: (2, 3) lowest and highest corner of the box around scene and grid, metres.
    """
    frame, lines, labels = _grid(*scene.bounds)
    for surface in scene:
        if surface.provenance.get("layout"):
            low, high = surface.mesh.bounds
            labels.append(_label(surface.name, [*((low + high) / 2)[:2], high[2] + 0.06], LABEL_RGB))
    radar = None
    if poses is not None:
        track_lines, track_labels = _track(poses)
        lines, labels = lines + track_lines, labels + track_labels
        radar = {"position": poses[0, :3, 3].tolist(), "boresight": poses[0, :3, 0].tolist()}
    return {"frame": frame, "lines": lines, "labels": labels, "radar": radar}


def _line(start: Any, end: Any, colour: RGB, width: float) -> dict[str, Any]:
    return {"from": np.round(start, 4).tolist(), "to": np.round(end, 4).tolist(), "colour": colour, "width": width}


def _label(text: str, at: Any, colour: RGB) -> dict[str, Any]:
    return {"text": text, "at": [float(x) for x in at], "colour": colour}


def _grid(low: np.ndarray, high: np.ndarray) -> tuple[list[list[float]], list[dict[str, Any]], list[dict[str, Any]]]:
    """Return the box, lines and labels of a grid of 1 m, or 0.1 m for small scenes, just below the floor, with the axes at its corner."""
    step = 1.0 if np.ptp([low, high], axis=0)[:2].max() > 1.5 else 0.1
    first, last = np.floor(low[:2] / step + 1e-6) * step, np.ceil(high[:2] / step - 1e-6) * step
    z = float(low[2]) - 0.01 * step
    across, along = (np.arange(first[k], last[k] + step / 2, step) for k in (0, 1))
    lines = [_line([x, first[1], z], [x, last[1], z], GRID_RGB, 1.0) for x in across]
    lines += [_line([first[0], y, z], [last[0], y, z], GRID_RGB, 1.0) for y in along]
    labels = [_label(f"grid {step:g} m", [last[0], first[1], z], (92, 106, 121))]
    corner = np.array([first[0], first[1], z])
    for name, direction, colour in zip("xyz", np.eye(3), AXES_RGB, strict=True):
        lines.append(_line(corner, corner + step * direction, colour, 3.0))
        labels.append(_label(name, corner + 1.15 * step * direction, colour))
    return [[float(first[0]), float(first[1]), float(low[2])], [float(last[0]), float(last[1]), float(high[2])]], lines, labels


def _track(poses: np.ndarray) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Return the lines and labels of the radar's track, its boresight along the track, and its field of view in the first frame."""
    positions = poses[:, :3, 3]
    lines = [_line(a, b, TRACK_RGB, 3.0) for a, b in pairwise(positions) if not np.array_equal(a, b)]
    for k in np.unique(np.linspace(0, len(poses) - 1, min(len(poses), MAX_TICKS)).astype(int))[1:]:
        lines.append(_line(positions[k], positions[k] + 0.12 * poses[k, :3, 0], BORESIGHT_RGB, 2.0))
    lines.append(_line(positions[0], positions[0] + BORESIGHT_M * poses[0, :3, 0], TRACK_RGB, 5.0))
    across, up = np.tan(FIELD_RAD) * PYRAMID_M
    corners = [poses[0, :3, :3] @ [PYRAMID_M, u * across, v * up] + positions[0] for u, v in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    for k, corner in enumerate(corners):
        lines += [_line(positions[0], corner, TRACK_RGB, 2.0), _line(corner, corners[(k + 1) % 4], TRACK_RGB, 2.0)]
    labels = [_label("radar", positions[0] + [0, 0, 0.1], TRACK_RGB)]
    length = float(np.linalg.norm(np.diff(positions, axis=0), axis=1).sum())
    if length > 0.05:
        labels.append(_label(f"end, after {length:.2f} m", positions[-1] + [0, 0, 0.1], TRACK_RGB))
    return lines, labels
