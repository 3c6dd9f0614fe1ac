"""Build vessels as smooth parametric meshes: cans with rim seams, bottles with oval or flat-sided cross-sections, and a mug with a handle.

All meshes stand on z = 0 and are closed; the z axis is their vertical axis. Vertex normals point outwards and are smooth, except at edges
of 30 degrees or more.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence

import numpy as np
import trimesh
from numpy.typing import NDArray

from radartwin.errors import MeshError
from radartwin.scene.objects.shapes import SMOOTH_RAD, revolution

AROUND = 128  # number of facets around a body of revolution; the ray tracer restores the curvature from vertex normals
QUADRANT = 24  # number of facets in a quarter of an oval
RING_M = 0.004  # largest vertical distance between two rings of vertices of an oval vessel
SEAM_M = 0.0012  # distance by which the rim seams of a food can protrude from its wall
END_M = 0.054  # outer diameter of the seam at the upper end of a drink can
Outline = Sequence[tuple[float, float]]  # radius and height in metres of points along the outside of a body of revolution


def straightened(profile_m: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Add profile points at 0.3 mm from both ends of every straight segment that is at least 5 mm long.

    Without these points, the averaged vertex normals at a bend would make the whole straight facet look curved to the ray tracer.
    """
    out = [profile_m[0]]
    for start, stop in itertools.pairwise(np.asarray(profile_m, float)):
        length = float(np.linalg.norm(stop - start))
        if length >= 0.005:
            out += [tuple(start + (stop - start) * share) for share in (0.0003 / length, 1 - 0.0003 / length)]
        out.append(tuple(stop))
    return out


def smoothed(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """Average the vertex normals of a mesh across edges of less than 30 degrees, and duplicate the vertices along sharper edges."""
    out = trimesh.graph.smooth_shade(mesh, angle=float(SMOOTH_RAD), facet_minarea=None)
    return trimesh.Trimesh(out.vertices, out.faces, vertex_normals=out.vertex_normals, process=False)


def deformed(mesh: trimesh.Trimesh, move: Callable[[NDArray], NDArray]) -> trimesh.Trimesh:
    """Move the vertices of a mesh by a function of their positions (N, 3) in metres. Smooth parts stay smooth and flat plates flat."""
    merged = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    merged.merge_vertices()
    return smoothed(trimesh.Trimesh(move(merged.vertices), merged.faces, process=False))


def divided(outline_m: Outline, step_m: float) -> list[tuple[float, float]]:
    """Divide the segments of an outline into equal parts that are at most `step_m` long.

    >>> len(divided([(0.0, 0.0), (0.01, 0.0)], 0.004))
    4
    """
    out = [outline_m[0]]
    for start, stop in itertools.pairwise(np.asarray(outline_m, float)):
        parts = max(1, int(np.ceil(np.linalg.norm(stop - start) / step_m)))
        out += [tuple(start + (stop - start) * k / parts) for k in range(1, parts + 1)]
    return out


def food_can(diameter_m: float, height_m: float) -> Outline:
    """Return the outline of a three-piece food can: a straight body between two protruding rim seams, with ends recessed by 4 mm.

    Args:
        diameter_m: outer diameter of the rim seams in metres, as in trade can sizes.
    """
    outer, body, rim, deep = diameter_m / 2, diameter_m / 2 - SEAM_M, 0.003, 0.004
    half = [(0, deep), (body - 0.002, deep), (body - 0.001, 0.0005), (body, 0), (outer - 0.0004, 0), (outer, 0.0004), (outer, rim)]
    return [*half, (body, rim + 0.0008), *[(r, height_m - z) for r, z in reversed([*half, (body, rim + 0.0008)])]]


def drink_can(diameter_m: float, height_m: float) -> Outline:
    """Return the outline of a two-piece drink can.

    The can has a domed base with a standing ring, a straight wall, a neck, and an upper end recessed below the rim seam.

    Args:
        diameter_m: diameter of the straight wall in metres.
    """
    wall, ring, end = diameter_m / 2, 0.024, END_M / 2
    dome = [(float(r), 0.0105 - 0.0095 * float(r / (ring - 0.002)) ** 2) for r in np.linspace(0, ring - 0.002, 9)]
    low = [(ring - 0.001, 0.0002), (ring, 0), (ring + 0.001, 0.0004), (wall - 0.004, 0.008), (wall - 0.001, 0.0125), (wall, 0.017)]
    bend = np.linspace(0, 1, 9)
    neck = [(wall - (wall - end + 0.0015) * float(3 * t**2 - 2 * t**3), height_m - 0.0025 - 0.0165 * float(1 - t)) for t in bend]
    seam = [(end, height_m - 0.0022), (end, height_m), (end - 0.002, height_m), (end - 0.003, height_m - 0.006), (0, height_m - 0.006)]
    return straightened([*dome, *low, *neck, *seam])


def oval(sections_m: Sequence[tuple[float, float, float, float]] | np.ndarray, ring_m: float = RING_M) -> trimesh.Trimesh:
    """Build a closed vessel whose cross-sections are superellipses |x/a|^n + |y/b|^n = 1.

    Between the given cross-sections, the parameters a, b and n are interpolated by monotone cubic polynomials of the height.

    Args:
        sections_m: (N, 4) cross-sections from the bottom upwards, as rows of height z, half width a along x and half depth b along y in
            metres, and exponent n (2: an ellipse, 6: flat sides with rounded corners). Flat ends close the first and the last
            cross-section.
        ring_m: largest vertical distance between two rings of vertices, in metres.
    Raises:
        MeshError: there are fewer than two cross-sections, heights do not rise, or a width, depth or exponent is invalid.
    """
    sections = np.asarray(sections_m, float)
    if sections.ndim != 2 or sections.shape[1] != 4 or len(sections) < 2 or (np.diff(sections[:, 0]) <= 0).any():
        raise MeshError("oval: give at least two sections (z, a, b, n) with rising z")
    if (sections[:, 1:3] <= 0).any() or (sections[:, 3] < 1).any():
        raise MeshError("oval: half width and depth must be positive and the exponent at least 1")
    from scipy.interpolate import PchipInterpolator

    levels = sections[:, 0]
    counts = np.maximum(2, np.ceil(np.diff(levels) / ring_m).astype(int) + 1)
    between = [np.linspace(low, high, count)[:-1] for (low, high), count in zip(itertools.pairwise(levels), counts, strict=True)]
    heights = np.concatenate([*between, levels[-1:]])
    shape = PchipInterpolator(sections[:, 0], sections[:, 1:])(heights)
    rings = np.array([superellipse(a, b, n) for a, b, n in shape])
    points = np.concatenate([rings, np.broadcast_to(heights[:, None, None], (*rings.shape[:2], 1))], axis=2)
    return smoothed(_tube(points, np.array([[0, 0, heights[0]], [0, 0, heights[-1]]])))


def _tube(rings: np.ndarray, middles: np.ndarray) -> trimesh.Trimesh:
    """Build the closed mesh of rings (R, A, 3), counter-clockwise seen from the last ring; fans about `middles` (2, 3) close the ends."""
    count, around = rings.shape[:2]
    a = np.arange((count - 1) * around)
    k, following = np.arange(around), (np.arange(around) + 1) % around
    b, last = a - a % around + (a + 1) % around, (count - 1) * around
    first_middle = np.full(around, count * around)
    faces = [[a, b, b + around], [a, b + around, a + around], [first_middle, following, k], [first_middle + 1, last + k, last + following]]
    points = np.vstack([rings.reshape(-1, 3), middles])
    return trimesh.Trimesh(points, np.concatenate([np.stack(face, axis=1) for face in faces]), process=False)


def superellipse(a: float, b: float, n: float) -> np.ndarray:
    """Return points (4 * QUADRANT, 2) of the superellipse |x/a|^n + |y/b|^n = 1, in counter-clockwise order.

    The spacing of the points depends in equal parts on arc length and on curvature.

    >>> bool(np.allclose(np.linalg.norm(superellipse(1, 1, 2), axis=1), 1, atol=1e-3))
    True
    """
    angle = np.linspace(0, np.pi / 2, 2001)
    fine = np.stack([a * np.cos(angle) ** (2 / n), b * np.sin(angle) ** (2 / n)], axis=1)
    step = np.diff(fine, axis=0)
    length = np.linalg.norm(step, axis=1)
    course = np.arctan2(step[:, 1], step[:, 0])
    bend = np.abs(np.diff(course, prepend=course[:1]))
    share = np.concatenate([[0], np.cumsum(length / length.sum() + bend / bend.sum())]) / 2
    at = np.linspace(0, 1, QUADRANT + 1)[:-1]
    quarter = np.stack([np.interp(at, share, fine[:, k]) for k in (0, 1)], axis=1)
    half = np.concatenate([quarter, [[0.0, b]], quarter[:0:-1] * [-1, 1]])
    return np.concatenate([half, -half])


def mug(diameter_m: float, height_m: float) -> trimesh.Trimesh:
    """Build the outside of a mug: a straight cup with a rounded foot, closed at the top by a lid of the same material.

    The lid is needed because the ray tracer needs closed bodies. A level radar sees the lid edge-on, so the lid has little effect on the
    echo.
    """
    radius = diameter_m / 2
    foot = [(radius - 0.006 + 0.006 * np.sin(t), 0.006 - 0.006 * np.cos(t)) for t in np.linspace(0, np.pi / 2, 7)]
    lip = [(radius - 0.002 + 0.002 * np.cos(t), height_m - 0.002 + 0.002 * np.sin(t)) for t in np.linspace(0, np.pi / 2, 5)]
    return revolution(straightened([(0, 0), *foot, *lip, (0, height_m)]), AROUND)


def handle(wall_m: float, low_m: float, high_m: float, reach_m: float) -> trimesh.Trimesh:
    """Build the handle of a mug: a bow in the xz plane with flat ends, which reaches from the wall out to x = wall_m + reach_m.

    The bow begins at (x, z) = (wall_m, low_m) and ends at (wall_m, high_m).

    The ends of the bow stay 1 mm off the wall. The cross-section is an ellipse, 13 mm along y and 9 mm in the plane of the bow.

    Args:
        wall_m: distance in metres of the mug's wall from the z axis.
    """
    t = np.linspace(0, np.pi, 33)
    middle, rise = (low_m + high_m) / 2, (high_m - low_m) / 2
    path = np.stack([wall_m + 0.001 + reach_m * np.sin(t) ** 0.8, np.zeros_like(t), middle - rise * np.cos(t)], axis=1)
    tangent = np.gradient(path, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    tangent[0], tangent[-1] = [1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]
    across = np.array([0.0, 1.0, 0.0])
    inward = np.cross(tangent, across)
    angle = 2 * np.pi * np.arange(32) / 32
    rings = (
        path[:, None] + (0.013 / 2) * np.cos(angle)[None, :, None] * across + (0.009 / 2) * np.sin(angle)[None, :, None] * inward[:, None]
    )
    bow = _tube(rings, path[[0, -1]])
    # the normals of vertices depend on the first corner of a face
    return smoothed(trimesh.Trimesh(bow.vertices, bow.faces[:, [1, 2, 0]], process=False))
