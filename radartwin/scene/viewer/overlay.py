"""Draw lines and text labels over a scene: a grid on the floor, the axes, and the track and field of view of the radar."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from radartwin.scene.scene import Scene
from radartwin.scene.viewer.colouring import RGB

TRACK_RGB, BORESIGHT_RGB, GRID_RGB, LABEL_RGB = (194, 65, 12), (244, 164, 96), (168, 180, 192), (29, 39, 51)
AXES_RGB = ((200, 40, 40), (30, 140, 60), (40, 80, 200))
BORESIGHT_M, TIP_M = 1.0, 0.15  # lengths of the arrow along the boresight and of its tip
FIELD_RAD = np.radians([50.0, 15.0])  # half the angular width of the drawn field of view, in azimuth and elevation
FIELD_M = 0.8  # range at which the drawn field of view ends
ARC = np.linspace(-1, 1, 13)  # corners of its arcs, as shares of half the angular width
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
    lines: list[dict[str, Any]] = []
    labels: list[dict[str, Any]] = []

    def line(start: Any, end: Any, colour: RGB, width: float) -> None:
        lines.append({"from": np.round(start, 4).tolist(), "to": np.round(end, 4).tolist(), "colour": colour, "width": width})

    def label(text: str, at: Any, colour: RGB) -> None:
        labels.append({"text": text, "at": [float(x) for x in at], "colour": colour})

    # a grid of 1 m, or 0.1 m for small scenes, just below the floor, with the axes at its corner of smallest x and y
    low, high = scene.bounds
    step = 1.0 if np.ptp([low, high], axis=0)[:2].max() > 1.5 else 0.1
    (x0, y0), (x1, y1) = np.floor(low[:2] / step + 1e-6) * step, np.ceil(high[:2] / step - 1e-6) * step
    z = float(low[2]) - 0.01 * step
    for x in np.arange(x0, x1 + step / 2, step):
        line([x, y0, z], [x, y1, z], GRID_RGB, 1.0)
    for y in np.arange(y0, y1 + step / 2, step):
        line([x0, y, z], [x1, y, z], GRID_RGB, 1.0)
    corner = np.array([x0, y0, z])
    label(f"grid {step:g} m", [x1, y0, z], (92, 106, 121))
    for name, direction, colour in zip("xyz", np.eye(3), AXES_RGB, strict=True):
        line(corner, corner + step * direction, colour, 3.0)
        label(name, corner + 1.15 * step * direction, colour)
    for surface in scene:
        if surface.provenance.get("layout"):
            bottom, top = surface.mesh.bounds
            label(surface.name, [*((bottom + top) / 2)[:2], top[2] + 0.06], LABEL_RGB)

    radar = None
    if poses is not None:  # the track, its boresight directions, and the field of view in the first frame
        positions, first = poses[:, :3, 3], poses[0, :3, :3]
        radar = {"position": positions[0].tolist(), "boresight": first[:, 0].tolist()}
        for a, b in pairwise(positions):
            if not np.array_equal(a, b):
                line(a, b, TRACK_RGB, 3.0)
        for k in np.unique(np.linspace(0, len(poses) - 1, min(len(poses), MAX_TICKS)).astype(int))[1:]:
            line(positions[k], positions[k] + 0.12 * poses[k, :3, 0], BORESIGHT_RGB, 2.0)
        tip = positions[0] + BORESIGHT_M * first[:, 0]
        line(positions[0], tip, TRACK_RGB, 5.0)
        for side in (-1, 1):  # the tip of the arrow, level with the radar's left and right
            line(tip, tip + first @ [-TIP_M, side * TIP_M / 2, 0], TRACK_RGB, 5.0)
        border = [*((u, -1) for u in ARC), *((u, 1) for u in ARC[::-1]), (-1, -1)]
        edge = [positions[0] + first @ _direction(*(np.array(share) * FIELD_RAD)) for share in border]
        for a, b in [*pairwise(edge), *((positions[0], edge[k]) for k in (0, len(ARC) - 1, len(ARC), -2))]:
            line(a, b, TRACK_RGB, 2.0)
        label("radar", positions[0] + [0, 0, 0.1] - 0.2 * first[:, 0], TRACK_RGB)
        length = float(np.linalg.norm(np.diff(positions, axis=0), axis=1).sum())
        if length > 0.05:
            label(f"end, after {length:.2f} m", positions[-1] + [0, 0, 0.1], TRACK_RGB)
    frame = [[float(x0), float(y0), float(low[2])], [float(x1), float(y1), float(high[2])]]
    return {"frame": frame, "lines": lines, "labels": labels, "radar": radar}


def _direction(azimuth: float, elevation: float) -> np.ndarray:
    """Return the vector (3,) of length FIELD_M in the radar's frame, for angles in radians."""
    level = np.cos(elevation)
    return FIELD_M * np.array([level * np.cos(azimuth), level * np.sin(azimuth), np.sin(elevation)])
