"""Name segments by their geometry: floor, ceiling, wall_1, level_1, plane_1, part_1."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import trimesh

from radartwin.reconstruct.segmentation.bodies import LEVEL, UPRIGHT
from radartwin.reconstruct.segmentation.faces import Segment

MIN_WALL_M2 = 1.0  # a smaller upright plane is furniture


def segment_names(mesh: trimesh.Trimesh, segments: Sequence[Segment]) -> list[str]:
    """Return the names of the segments. Equal kinds are numbered in the order of the segments.

    The floor is the largest level plane that faces up. The ceiling is the largest level plane above it that faces down.
    """
    names: list[str] = [""] * len(segments)
    order = sorted(range(len(segments)), key=lambda k: -segments[k].area_m2)
    centre = np.asarray(mesh.triangles_center)[:, 2]
    heights = [float(centre[s.faces].mean()) for s in segments]

    def vertical(k: int) -> float:
        normal = segments[k].normal
        return float(normal[2]) if normal is not None else 0.0

    floor = next((k for k in order if vertical(k) > LEVEL), None)
    if floor is not None:
        names[floor] = "floor"
    below = heights[floor] if floor is not None else -np.inf
    ceiling = next((k for k in order if vertical(k) < -LEVEL and heights[k] > below), None)
    if ceiling is not None:
        names[ceiling] = "ceiling"
    counts: dict[str, int] = {}
    for k, segment in enumerate(segments):
        if not names[k]:
            kind = _kind(segment, vertical(k))
            counts[kind] = counts.get(kind, 0) + 1
            names[k] = f"{kind}_{counts[kind]}"
    return names


def _kind(segment: Segment, vertical: float) -> str:
    if segment.normal is None:
        return "part"
    if abs(vertical) > LEVEL:
        return "level"
    return "wall" if abs(vertical) < UPRIGHT and segment.area_m2 >= MIN_WALL_M2 else "plane"
