"""Build canonical radar targets as parametric meshes: trihedral, dihedral, plate, sphere, cylinder, and any body of revolution.

All dimensions are in metres. Normals point outwards on solids and into the opening on reflectors, which open towards +x. Curved sides have
exact vertex normals. Sharp rims have separate vertices, so that no normal is an average across an edge.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import trimesh

from radartwin.errors import MeshError

SMOOTH_RAD = np.radians(30.0)  # an edge with a smaller angle between its two faces belongs to a curved surface


def plate(width_m: float, height_m: float) -> trimesh.Trimesh:
    """Build a flat rectangle that is centred at the origin and faces +x, with its width along y and its height along z."""
    _positive(width_m=width_m, height_m=height_m)
    y, z = width_m / 2, height_m / 2
    return flat([[[0, -y, -z], [0, y, -z], [0, y, z], [0, -y, z]]])


def dihedral(face_m: float, height_m: float) -> trimesh.Trimesh:
    """Build a dihedral reflector: two plates of face_m x height_m at right angles, which meet on the z axis and open towards +x."""
    _positive(face_m=face_m, height_m=height_m)
    d, z = face_m / np.sqrt(2), height_m / 2
    left = [[0, 0, -z], [d, d, -z], [d, d, z], [0, 0, z]]
    right = [[0, 0, -z], [0, 0, z], [d, -d, z], [d, -d, -z]]
    return flat([left, right])


def trihedral(leg_m: float) -> trimesh.Trimesh:
    """Build a triangular trihedral corner reflector of three right isosceles triangles, with its boresight towards +x.

    The origin is the apex, which is the phase centre. Of the three edges that meet at the apex, one rises in the xz plane. The other two
    run to the left and to the right below this edge. The peak radar cross section in the far field is 4 pi leg_m^4 / (3 lambda^2).

    Args:
        leg_m: length in metres of the two equal sides of each triangle.
    """
    _positive(leg_m=leg_m)
    azimuth = np.radians([90.0, 210.0, 330.0])
    legs = leg_m * np.stack([np.full(3, 1 / np.sqrt(3)), np.sqrt(2 / 3) * np.cos(azimuth), np.sqrt(2 / 3) * np.sin(azimuth)], axis=1)
    apex = np.zeros(3)
    return flat([[apex, apex + legs[k], apex + legs[(k + 1) % 3]] for k in range(3)])


def sphere(radius_m: float, subdivisions: int = 4) -> trimesh.Trimesh:
    """Build a sphere about the origin with exact vertex normals and 20 * 4^subdivisions faces."""
    _positive(radius_m=radius_m)
    mesh = trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius_m)
    normals = mesh.vertices / np.linalg.norm(mesh.vertices, axis=1, keepdims=True)
    return trimesh.Trimesh(mesh.vertices, mesh.faces, vertex_normals=normals, process=False)


def cylinder(radius_m: float, height_m: float, segments: int = 64) -> trimesh.Trimesh:
    """Build a closed cylinder about z, centred at the origin, with a smooth side, flat caps and sharp rims."""
    _positive(radius_m=radius_m, height_m=height_m)
    z = height_m / 2
    return revolution([(0, -z), (radius_m, -z), (radius_m, z), (0, z)], segments)


def revolution(profile_m: Sequence[tuple[float, float]] | np.ndarray, segments: int = 64) -> trimesh.Trimesh:
    """Build a body of revolution about z.

    Args:
        profile_m: (N, 2) radius and height in metres of points along the outside, from the bottom upwards; a radius of zero closes an end.
            A profile point with a bend of less than 30 degrees becomes smooth, and a larger bend becomes a sharp rim.
        segments: number of facets around the z axis.
    Raises:
        MeshError: the profile has fewer than two points or a negative radius, or there are fewer than 3 segments.
    """
    profile = np.asarray(profile_m, dtype=np.float64)
    if profile.ndim != 2 or profile.shape[0] < 2 or profile.shape[1] != 2 or (profile[:, 0] < 0).any() or segments < 3:
        raise MeshError("revolution: give a profile of at least two (radius >= 0, height) points and at least 3 segments")
    steps = np.diff(profile, axis=0)
    normals = np.stack([steps[:, 1], -steps[:, 0]], axis=1) / np.linalg.norm(steps, axis=1, keepdims=True)
    azimuth = 2 * np.pi * np.arange(segments) / segments
    around = np.stack([np.cos(azimuth), np.sin(azimuth)], axis=1)
    vertices, vertex_normals, faces = [], [], []
    count = 0
    for k in range(len(steps)):
        for end in (0, 1):
            normal = _end_normal(normals, k, k - 1 if end == 0 else k + 1)
            radius, height = profile[k + end]
            vertices.append(np.column_stack([radius * around, np.full(segments, height)]))
            vertex_normals.append(np.column_stack([normal[0] * around, np.full(segments, normal[1])]))
        low, high = count + np.arange(segments), count + segments + np.arange(segments)
        low_next, high_next = np.roll(low, -1), np.roll(high, -1)
        if profile[k, 0] > 0:
            faces.append(np.stack([low, low_next, high_next], axis=1))
        if profile[k + 1, 0] > 0:
            faces.append(np.stack([low, high_next, high], axis=1))
        elif profile[k, 0] > 0:
            faces[-1] = np.stack([low, low_next, high], axis=1)
        count += 2 * segments
    mesh = trimesh.Trimesh(np.vstack(vertices), np.vstack(faces), vertex_normals=np.vstack(vertex_normals), process=False)
    return _without_doubles(mesh)


def box(low_m: Sequence[float], high_m: Sequence[float]) -> trimesh.Trimesh:
    """Build a solid box between the corners `low_m` and `high_m`; every side has its own vertices."""
    low, high = np.asarray(low_m, float), np.asarray(high_m, float)
    if not (high > low).all():
        raise MeshError(f"box: the corner {high.tolist()} is not above {low.tolist()}")
    (x0, y0, z0), (x1, y1, z1) = low, high
    return flat(
        [
            [[x1, y0, z0], [x1, y1, z0], [x1, y1, z1], [x1, y0, z1]],
            [[x0, y1, z0], [x0, y0, z0], [x0, y0, z1], [x0, y1, z1]],
            [[x1, y1, z0], [x0, y1, z0], [x0, y1, z1], [x1, y1, z1]],
            [[x0, y0, z0], [x1, y0, z0], [x1, y0, z1], [x0, y0, z1]],
            [[x0, y0, z1], [x1, y0, z1], [x1, y1, z1], [x0, y1, z1]],
            [[x0, y1, z0], [x1, y1, z0], [x1, y0, z0], [x0, y0, z0]],
        ]
    )


def joined(meshes: Sequence[trimesh.Trimesh]) -> trimesh.Trimesh:
    """Join several meshes into a single mesh, without changing their vertices and normals."""
    vertices, faces = trimesh.util.append_faces([m.vertices for m in meshes], [m.faces for m in meshes])
    return trimesh.Trimesh(vertices, faces, vertex_normals=np.vstack([m.vertex_normals for m in meshes]), process=False)


def flat(polygons: Sequence[Sequence[np.ndarray | Sequence[float]] | np.ndarray]) -> trimesh.Trimesh:
    """Build a mesh from convex planar polygons, whose corners are counter-clockwise seen from the front.

    Each polygon has its own vertices and its own normal.
    """
    vertices, faces, normals = [], [], []
    for polygon in polygons:
        corners = np.asarray(polygon, dtype=np.float64)
        base = sum(len(v) for v in vertices)
        faces += [[base, base + k, base + k + 1] for k in range(1, len(corners) - 1)]
        normal = np.cross(corners[1] - corners[0], corners[2] - corners[0])
        normals.append(np.tile(normal / np.linalg.norm(normal), (len(corners), 1)))
        vertices.append(corners)
    return trimesh.Trimesh(np.vstack(vertices), np.array(faces), vertex_normals=np.vstack(normals), process=False)


def _end_normal(normals: np.ndarray, band: int, neighbour: int) -> np.ndarray:
    """Return the profile normal at an end of a band, averaged with that of the neighbour band if the profile is smooth at this end."""
    normal = normals[band]
    if 0 <= neighbour < len(normals) and normal @ normals[neighbour] > np.cos(SMOOTH_RAD):
        normal = normal + normals[neighbour]
        normal = normal / np.linalg.norm(normal)
    return normal


def _without_doubles(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """Merge vertices that have equal positions and equal normals; at a sharp rim, two vertices with different normals remain."""
    key = np.round(np.hstack([mesh.vertices, mesh.vertex_normals]), 9)
    _, first, inverse = np.unique(key, axis=0, return_index=True, return_inverse=True)
    faces = inverse.reshape(-1)[mesh.faces]
    referenced, faces = np.unique(faces, return_inverse=True)
    keep = first[referenced]
    return trimesh.Trimesh(mesh.vertices[keep], faces.reshape(-1, 3), vertex_normals=mesh.vertex_normals[keep], process=False)


def _positive(**lengths: float) -> None:
    for name, value in lengths.items():
        if not (np.isfinite(value) and value > 0):
            raise MeshError(f"{name} is {value}; give a positive length in metres")
