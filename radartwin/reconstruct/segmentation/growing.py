"""Find the planes of a mesh by region growing, face by face.

Region growing after Rabbani, van den Heuvel and Vosselman 2006, Segmentation of point clouds using smoothness constraint. Each region
starts from a seed face, and the flattest faces are seeds first. A neighbouring face joins the region if its normal and its distance fit the
plane of the region. The plane is refitted as the region grows.
"""

from __future__ import annotations

import numpy as np

from radartwin.compiled import compiled, inner
from radartwin.reconstruct.segmentation.face_arrays import MIN_FITTED, Faces

REFIT = 1.2  # the plane of a region is refitted each time the number of faces in the region has grown by this factor


def grow(faces: Faces, angle_deg: float, distance_m: float, min_area_m2: float) -> np.ndarray:
    """Grow planes over the faces. Return the plane number (F,) of every face; -1 if the face belongs to no plane."""
    label = np.full(len(faces.area), -1)
    mesh = (faces.adjacency.indptr, faces.adjacency.indices, faces.centre, faces.normal, faces.area)
    order = np.argsort(-faces.coherence, kind="stable")
    _grow(mesh, order, np.cos(np.radians(angle_deg)), distance_m, min_area_m2, label)
    return label


def absorb(faces: Faces, label: np.ndarray, angle_deg: float, distance_m: float) -> None:
    """Add each face without a plane to a plane that the face touches, if all corners of the face lie near this plane.

    The function changes the plane number of each face in `label` (F,) in place, one ring of neighbour faces after the other.
    """
    normal, offset = faces.planes(label)
    if len(normal):
        mesh = (faces.adjacency.indptr, faces.adjacency.indices, faces.corners, faces.normal)
        _absorb(mesh, normal, offset, np.cos(np.radians(angle_deg)), distance_m, label)


@inner
def _plane(count, sums, normal):
    """Return the plane (nx, ny, nz, d) of the sums of w, w c (3), w c c (xx xy xz yy yz zz), w n (3) over areas w, centres c, normals n."""
    w, centre, spread, at = sums[0], sums[1:4] / sums[0], np.empty((3, 3)), 4
    normal[:] = sums[10:]
    if count >= MIN_FITTED:
        for i in range(3):
            for j in range(i, 3):
                spread[i, j] = spread[j, i] = sums[at] / w - centre[i] * centre[j]
                at += 1
        vectors = np.linalg.eigh(spread)[1]
        side = vectors[0, 0] * sums[10] + vectors[1, 0] * sums[11] + vectors[2, 0] * sums[12]
        sign = 1.0 if side > 0 else -1.0
        normal[:] = sign * vectors[:, 0]
    length = np.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
    normal /= max(length, 1e-300)
    return normal[0] * centre[0] + normal[1] * centre[1] + normal[2] * centre[2]


@inner
def _add(sums, w, c, n):
    """Add a face of area `w`, centre `c` and normal `n` to the sums from which `_plane` computes a plane."""
    sums[0] += w
    at = 4
    for i in range(3):
        sums[1 + i] += w * c[i]
        sums[10 + i] += w * n[i]
        for j in range(i, 3):
            sums[at] += w * c[i] * c[j]
            at += 1


@inner
def _fits(c, n, normal, offset, min_cosine, distance):
    """Return whether a face with centre `c` and unit normal `n` fits the plane within the limits of angle and distance."""
    away = normal[0] * c[0] + normal[1] * c[1] + normal[2] * c[2] - offset
    return n[0] * normal[0] + n[1] * normal[1] + n[2] * normal[2] > min_cosine and abs(away) < distance


@compiled
def _grow(mesh, order, min_cosine, distance, min_area, label):
    """Grow a plane from each face in `order`, and write the plane number to `label` (F,) if the plane has at least the area `min_area`."""
    start, neighbour, centre, normals, area = mesh  # neighbours in compressed sparse rows
    faces = len(area)
    tried = np.zeros(faces, np.bool_)
    mark = np.full(faces, -1)  # for each face, the last seed whose region contained the face
    queue = np.empty(faces, np.int64)
    normal, sums = np.empty(3), np.empty(13)
    planes = 0
    for seed in order:
        if tried[seed] or label[seed] >= 0:
            continue
        sums[:] = 0.0
        origin = centre[seed]  # sums use coordinates relative to the seed face, because squares of large coordinates lose accuracy
        _add(sums, area[seed], centre[seed] - origin, normals[seed])
        offset = _plane(1, sums, normal)
        mark[seed] = seed
        queue[0] = seed
        head, tail, fitted = 0, 1, 1
        while head < tail:
            face = queue[head]
            head += 1
            for k in range(start[face], start[face + 1]):
                other = neighbour[k]
                if mark[other] == seed or label[other] >= 0:
                    continue
                place = centre[other] - origin
                if _fits(place, normals[other], normal, offset, min_cosine, distance):
                    mark[other] = seed
                    queue[tail] = other
                    tail += 1
                    _add(sums, area[other], place, normals[other])
                    if tail > REFIT * fitted:
                        offset = _plane(tail, sums, normal)
                        fitted = tail
        offset = _plane(tail, sums, normal)
        total = 0.0
        for k in range(tail):
            face = queue[k]
            tried[face] = True
            if _fits(centre[face] - origin, normals[face], normal, offset, min_cosine, distance):
                total += area[face]
        if total >= min_area:
            for k in range(tail):
                face = queue[k]
                if _fits(centre[face] - origin, normals[face], normal, offset, min_cosine, distance):
                    label[face] = planes
                else:
                    tried[face] = False
            planes += 1


@compiled
def _absorb(mesh, normal, offset, min_cosine, distance, label):
    """Give each face without a plane the number of a neighbour's plane, `normal` (P, 3) and `offset` (P,), that fits all its corners."""
    start, neighbour, corners, normals = mesh  # neighbours in compressed sparse rows
    faces = len(label)
    queue = np.empty(faces, np.int64)
    tail = 0
    for face in range(faces):
        if label[face] >= 0:
            queue[tail] = face
            tail += 1
    head = 0
    while head < tail:
        face = queue[head]
        head += 1
        plane = label[face]
        n, d = normal[plane], offset[plane]
        for k in range(start[face], start[face + 1]):
            other = neighbour[k]
            if label[other] >= 0:
                continue
            if normals[other, 0] * n[0] + normals[other, 1] * n[1] + normals[other, 2] * n[2] <= min_cosine:
                continue
            far = 0.0
            for c in range(3):
                p = corners[other, c]
                far = max(far, abs(p[0] * n[0] + p[1] * n[1] + p[2] * n[2] - d))
            if far < distance:
                label[other] = plane
                queue[tail] = other
                tail += 1
