"""Draw lines and text labels over a scene: a grid on the floor, the axes, and the track and field of view of the radar."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from radartwin.scene.scene import Scene

RGB = tuple[int, int, int]
TRACK_RGB, BORESIGHT_RGB, GRID_RGB, LABEL_RGB = (194, 65, 12), (244, 164, 96), (168, 180, 192), (29, 39, 51)
AXES_RGB = ((200, 40, 40), (30, 140, 60), (40, 80, 200))
BORESIGHT_M = 1.0
FIELD_RAD = np.radians([50.0, 15.0])  # half the angular width of the drawn field of view, in azimuth and elevation
PYRAMID_M = 0.25
MAX_TICKS = 25  # largest number of boresight directions drawn along the track


class Overlay:
    """Collect the lines and text labels that are drawn over a scene and, if `poses` is given, over the track of the radar.

    Args:
        poses: (F, 4, 4) sensor-to-world poses of the radar's track, or None for a scene without a track.
    Attributes:
        lines: list of lines, each a dictionary {from, to, colour, width in pixels}.
        labels: list of text labels, each a dictionary {text, at, colour}.
        radar: position and boresight of the radar in the first frame, as a dictionary {position, boresight}; None without a track.
        frame: (2, 3) lowest and highest corner of the box around scene and grid, metres.
    """

    def __init__(self, scene: Scene, poses: np.ndarray | None) -> None:
        self.lines: list[dict[str, Any]] = []
        self.labels: list[dict[str, Any]] = []
        self.radar: dict[str, list[float]] | None = None
        self._add_grid(*scene.bounds)
        for surface in scene:
            if surface.provenance.get("layout"):
                low, high = surface.mesh.bounds
                self._label(surface.name, [*((low + high) / 2)[:2], high[2] + 0.06], LABEL_RGB)
        if poses is not None:
            self._add_track(poses)
            self.radar = {"position": poses[0, :3, 3].tolist(), "boresight": poses[0, :3, 0].tolist()}

    def _line(self, start: np.ndarray, end: np.ndarray, colour: RGB, width: float) -> None:
        self.lines.append({"from": np.round(start, 4).tolist(), "to": np.round(end, 4).tolist(), "colour": colour, "width": width})

    def _label(self, text: str, at: Any, colour: RGB) -> None:
        self.labels.append({"text": text, "at": [float(x) for x in at], "colour": colour})

    def _add_grid(self, low: np.ndarray, high: np.ndarray) -> None:
        """Add a grid with a spacing of 1 m, or 0.1 m for small scenes, just below the floor, and the axes at the grid's corner of smallest
        x and y.
        """
        step = 1.0 if np.ptp([low, high], axis=0)[:2].max() > 1.5 else 0.1
        first, last = np.floor(low[:2] / step + 1e-6) * step, np.ceil(high[:2] / step - 1e-6) * step
        self.frame = [[float(first[0]), float(first[1]), float(low[2])], [float(last[0]), float(last[1]), float(high[2])]]
        z = float(low[2]) - 0.01 * step
        for x in np.arange(first[0], last[0] + step / 2, step):
            self._line(np.array([x, first[1], z]), np.array([x, last[1], z]), GRID_RGB, 1.0)
        for y in np.arange(first[1], last[1] + step / 2, step):
            self._line(np.array([first[0], y, z]), np.array([last[0], y, z]), GRID_RGB, 1.0)
        corner = np.array([first[0], first[1], z])
        self._label(f"grid {step:g} m", [last[0], first[1], z], (92, 106, 121))
        for name, direction, colour in zip("xyz", np.eye(3), AXES_RGB, strict=True):
            self._line(corner, corner + step * direction, colour, 3.0)
            self._label(name, corner + 1.15 * step * direction, colour)

    def _add_track(self, poses: np.ndarray) -> None:
        positions = poses[:, :3, 3]
        for a, b in pairwise(positions):
            if not np.array_equal(a, b):
                self._line(a, b, TRACK_RGB, 3.0)
        for k in np.unique(np.linspace(0, len(poses) - 1, min(len(poses), MAX_TICKS)).astype(int))[1:]:
            self._line(positions[k], positions[k] + 0.12 * poses[k, :3, 0], BORESIGHT_RGB, 2.0)
        self._line(positions[0], positions[0] + BORESIGHT_M * poses[0, :3, 0], TRACK_RGB, 5.0)
        across, up = np.tan(FIELD_RAD) * PYRAMID_M
        corners = [poses[0, :3, :3] @ [PYRAMID_M, u * across, v * up] + positions[0] for u, v in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        for k, corner in enumerate(corners):
            self._line(positions[0], corner, TRACK_RGB, 2.0)
            self._line(corner, corners[(k + 1) % 4], TRACK_RGB, 2.0)
        self._label("radar", positions[0] + [0, 0, 0.1], TRACK_RGB)
        length = float(np.linalg.norm(np.diff(positions, axis=0), axis=1).sum())
        if length > 0.05:
            self._label(f"end, after {length:.2f} m", positions[-1] + [0, 0, 0.1], TRACK_RGB)
