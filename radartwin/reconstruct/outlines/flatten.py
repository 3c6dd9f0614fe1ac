"""Make the planes of a scan exactly upright, level or perpendicular to each other if their directions deviate by only a small angle.

The depth noise of a scan is millimetres to centimetres, which is one to several wavelengths at 77 GHz. With this noise, a painted wall
would scatter diffusely like rubble instead of reflecting specularly. A plane fitted to thousands of faces has an error of a fraction of a
millimetre, so planar segments are replaced by their planes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import trimesh

from radartwin.reconstruct.segmentation.face_arrays import Segment

# a plane is rotated to a regular direction (upright, level or along the walls) if its normal is within this angle of the direction
NEARLY = np.radians(1.5)
# and if the rotation increases the root mean square distance between plane and faces by at most NOISES times the noise, or SLACK_M if that
# is less; the faces of a model have no noise, so that its walls keep their directions within EXACT_M
NOISES, SLACK_M, EXACT_M = 2.0, 0.003, 1e-4


def regular(mesh: trimesh.Trimesh, segments: Sequence[Segment]) -> tuple[list[Segment], float]:
    """Rotate planes that are nearly upright, level or perpendicular to each other to exactly these directions.

    Returns:
        The segments with their rotated planes.
        The main horizontal direction of the walls in radians, modulo 90 degrees.
    """
    centre, area = np.asarray(mesh.triangles_center), np.asarray(mesh.area_faces)
    main = _main_direction(segments)
    out = []
    for segment in segments:
        normal = None if segment.normal is None else _nearest_regular(segment.normal, main)
        if normal is None:
            out.append(segment)
            continue
        weight, at = area[segment.faces] / area[segment.faces].sum(), centre[segment.faces]
        offset = float(weight @ (at @ normal))
        before = weight @ (at @ segment.normal - segment.offset_m) ** 2
        after = weight @ (at @ normal - offset) ** 2
        keep = after <= before + min(NOISES**2 * before + EXACT_M**2, SLACK_M**2)
        out.append(replace(segment, normal=normal, offset_m=offset) if keep else segment)
    return out, main


def _main_direction(segments: Sequence[Segment]) -> float:
    """Return the heading of the normals of most of the wall area in radians, modulo 90 degrees; 0 without walls."""
    upright = [s for s in segments if s.normal is not None and abs(s.normal[2]) < np.sin(np.radians(5.0))]
    if not upright:
        return 0.0
    turned = np.array([(s.normal[0] + 1j * s.normal[1]) ** 4 for s in upright if s.normal is not None])  # equal for walls at right angles
    area = np.array([s.area_m2 for s in upright])
    near = np.abs(np.angle(turned[:, None] / turned)) < 4 * NEARLY
    return float(np.angle(area * near[(near @ area).argmax()] @ turned)) / 4


def _nearest_regular(normal: np.ndarray, main: float) -> np.ndarray | None:
    """Return the level, upright or main direction nearest to a normal; None if it is more than NEARLY away."""
    if abs(normal[2]) > np.cos(NEARLY):
        return np.array([0.0, 0.0, np.sign(normal[2])])
    if abs(normal[2]) > np.sin(NEARLY):
        return None
    heading = np.arctan2(normal[1], normal[0])
    square = main + np.round((heading - main) / (np.pi / 2)) * np.pi / 2
    heading = square if abs(heading - square) < NEARLY else heading
    return np.array([np.cos(heading), np.sin(heading), 0.0])
