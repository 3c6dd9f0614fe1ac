"""Correct the drift of a scan: adjust all poses together so that the surfaces of overlapping views coincide.

The surface samples of each view are compared with every other view that sees the same surface. The residual is r = n . (q - x), where x is
a sample with normal n, and q is the other view's surface point at the projection of x (point-to-plane distance, Chen and Medioni 1992). One
system of equations contains all pairs of views, as in Pulli 1999, Multiview registration for large data sets. Two priors limit the
corrections of the poses: the phone's own estimate of its motion between neighbouring views, and the direction of gravity for roll and
pitch. A Geman-McClure kernel reduces the weight of outliers. The scale of the outlier kernel starts at the size of the drift and shrinks to
the size of the depth noise over the iterations. The residuals do not determine the position of the whole scan, so the first part of the
camera path keeps its position. The solver and the assembly of its equations stay in one file, which is therefore over 300 lines long.

Symbols: delta_i -> correction of view i in world coordinates: a rotation vector, for a rotation about `centre`, and a shift.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from radartwin.compiled import compiled, inner, shared_out
from radartwin.reconstruct.fusion.views import Views
from radartwin.reconstruct.fusion.volume import View

# samples along the width of a view; a phone's depth map, which has 576 laser spots, then has about 550 samples
SAMPLES_ACROSS = 28
# width of a view / distance from a sample to the neighbours that define its normal; this distance is 6 pixels for a phone's depth map
NORMALS_ACROSS = 43
OVERLAP = 0.15  # two views are compared if the second view sees at least this fraction of the first view's samples
SCALES_M = (0.12, 0.12, 0.08, 0.05, 0.04, 0.03, 0.02, 0.02, 0.015, 0.015)  # scale of the outlier kernel, one per iteration
NOISE_M = 0.05  # standard deviation of a residual; several times the depth noise of a pixel, because neighbouring residuals are correlated
# Standard deviation of the phone's motion estimate between views: after one metre of path (the variance grows with the path), and at rest.
# The error of the shift is that of ARKit (Kim et al. 2022, Sensors 22:9873: 0.02 m in three axes per second of walking). Kim et al. give no
# error of the rotation. A rotation by the value below moves a point 3 m away as far as the error of the shift.
SHIFT_M, REST_M = 0.012, 0.002
TURN_RAD, REST_RAD = np.radians(0.2), np.radians(0.05)
LEVEL_RAD = np.radians(0.2)  # error of the gravity direction on phones
ANCHOR_M = 0.6  # length of the first part of the camera path, which defines the position of the whole scan


@dataclasses.dataclass(frozen=True)
class AlignmentReport:
    """The result of the drift correction.

    The report gives the number of compared view pairs, the median distance in metres between the surfaces of two views before and after the
    correction, and the largest shift and rotation of a pose.
    """

    pairs: int
    before_m: float
    after_m: float
    largest_shift_m: float
    largest_turn_deg: float


def align(views: Views) -> AlignmentReport:
    """Correct the drift in the poses of `views`, in place, and return a report of the correction."""
    fixed = [views[i] for i in range(len(views))]
    samples = [_samples(view) for view in fixed]
    start = views.poses.copy()
    poses = start.copy()
    centre = poses[:, :3, 3].mean(axis=0)
    pairs = _pairs(poses, fixed, samples)
    if not len(pairs):
        return AlignmentReport(0, float("nan"), float("nan"), 0.0, 0.0)
    before = float("nan")
    for step, scale in enumerate(SCALES_M):
        blocks, median = _normal_equations(poses, fixed, samples, pairs, centre, scale)
        before = median if step == 0 else before
        matrix, right = _assembled(blocks, pairs, start, poses, centre)
        free = matrix[6:, 6:]
        delta = np.concatenate([np.zeros(6), np.linalg.solve(free + 1e-9 * np.eye(len(free)), right[6:])]).reshape(-1, 6)
        rotations = Rotation.from_rotvec(delta[:, :3]).as_matrix()
        poses[:, :3, 3] = np.einsum("nij,nj->ni", rotations, poses[:, :3, 3] - centre) + centre + delta[:, 3:]
        poses[:, :3, :3] = rotations @ poses[:, :3, :3]
    _, after = _normal_equations(poses, fixed, samples, pairs, centre, SCALES_M[-1])
    poses = _anchored(start, poses)
    views.poses[:] = poses
    angle = _rotation_between(start, poses).magnitude()
    shift = np.linalg.norm(poses[:, :3, 3] - start[:, :3, 3], axis=1)
    return AlignmentReport(len(pairs), before, after, float(shift.max()), float(np.degrees(angle.max())))


def disagreement(views: Sequence[View], pose_sets: Iterable[np.ndarray]) -> list[tuple[int, float]]:
    """Return the number of overlapping view pairs and the median distance in metres between their surfaces.

    The list has an entry for each array of poses (N, 4, 4) in `pose_sets`.
    """
    samples, disagreements = [_samples(view) for view in views], []
    for poses in pose_sets:
        pairs = _pairs(poses, views, samples)
        apart = _normal_equations(poses, views, samples, pairs, np.zeros(3), SCALES_M[0])[1]
        disagreements.append((len(pairs) if np.isfinite(apart) else 0, apart))
    return disagreements


def _rotation_between(start: np.ndarray, poses: np.ndarray) -> Rotation:
    return Rotation.from_matrix(poses[:, :3, :3] @ np.swapaxes(start[:, :3, :3], 1, 2))


def _anchored(start: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """Move all poses by one rigid motion, so that heading and position fit the first views, and roll and pitch fit all views."""
    # a weighted mean over the first views, because the noise of a single view would move the whole scan
    path = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(start[:, :3, 3], axis=0), axis=1))])
    weight = np.exp(-path / ANCHOR_M)
    weight /= weight.sum()
    vectors = _rotation_between(start, poses).as_rotvec()
    back = Rotation.from_rotvec(-np.append(vectors[:, :2].mean(axis=0), weight @ vectors[:, 2])).as_matrix()
    out = poses.copy()
    out[:, :3, :3] = back @ poses[:, :3, :3]
    out[:, :3, 3] = poses[:, :3, 3] @ back.T
    out[:, :3, 3] += weight @ (start[:, :3, 3] - out[:, :3, 3])
    return out


def _samples(view: View) -> np.ndarray:
    """Return the surface samples (S, 7) of a view: points and normals in camera coordinates, and weights."""
    h, w = view.depth.shape
    step, reach = max(round(w / SAMPLES_ACROSS), 1), max(round(w / NORMALS_ACROSS), 1)
    v, u = (n.ravel() for n in np.mgrid[reach : h - reach : step, reach : w - reach : step])
    fx, fy, cx, cy = view.lens

    def at(dv: int, du: int) -> tuple[np.ndarray, np.ndarray]:
        depth = view.depth[v + dv, u + du].astype(np.float64)
        return np.stack([(u + du - cx) / fx * depth, (v + dv - cy) / fy * depth, depth], axis=1), view.weight[v + dv, u + du] > 0

    point, valid = at(0, 0)
    (a, valid_a), (b, valid_b), (c, valid_c), (d, valid_d) = at(0, -reach), at(0, reach), at(-reach, 0), at(reach, 0)
    normal = np.cross(b - a, d - c)
    length = np.linalg.norm(normal, axis=1)
    # On a plane the mean of two opposite neighbour points equals the sample point. At an edge this mean differs from the sample point.
    flat = (np.abs(a + b - 2 * point)[:, 2] < 0.02 * point[:, 2]) & (np.abs(c + d - 2 * point)[:, 2] < 0.02 * point[:, 2])
    good = valid & valid_a & valid_b & valid_c & valid_d & flat & (length > 0)
    return np.column_stack([point[good], (normal[good].T / length[good]).T, view.weight[v, u][good]])


def _pairs(poses: np.ndarray, views: Sequence[View], samples: Sequence[np.ndarray]) -> np.ndarray:
    """Return the index pairs (P, 2) of views that see the same surfaces. The first view of a pair provides the samples."""
    pairs = []
    for i, points in enumerate(samples):
        thinned = points[::7]
        if len(thinned) < 8:
            continue
        world = thinned[:, :3] @ poses[i, :3, :3].T + poses[i, :3, 3]
        for j, view in enumerate(views):
            if i != j and len(samples[j]) and _shared(world, poses[j], view.depth, view.lens) > OVERLAP * len(thinned):
                pairs.append((i, j))
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


def _normal_equations(
    poses: np.ndarray, views: Sequence[View], samples: Sequence[np.ndarray], pairs: np.ndarray, centre: np.ndarray, scale_m: float
) -> tuple[np.ndarray, float]:
    """Return the normal equations (P, 27) of P view pairs, 21 of the upper triangle and 6 of the right side, and the median residual."""
    blocks, residuals = np.zeros((len(pairs), 27)), np.full(len(pairs), np.nan)
    worlds = [
        np.column_stack([s[:, :3] @ p[:3, :3].T + p[:3, 3], s[:, 3:6] @ p[:3, :3].T, s[:, 6]]) for s, p in zip(samples, poses, strict=True)
    ]

    def accumulate(first: int, last: int) -> None:
        for k in range(first, last):
            i, j = pairs[k]
            residuals[k] = _accumulate(worlds[i], poses[j], views[j].depth, views[j].lens, centre, scale_m, blocks[k])

    shared_out(accumulate, len(pairs))
    known = residuals[np.isfinite(residuals)]  # views of opposite sides of a surface have no residuals
    return blocks, float(np.median(known)) if len(known) else float("nan")


def _assembled(
    blocks: np.ndarray, pairs: np.ndarray, start: np.ndarray, poses: np.ndarray, centre: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Assemble the matrix (6V, 6V) and right side (6V,) for V views from the blocks of all view pairs, the priors of motion and gravity."""
    count, upper = len(poses), np.triu_indices(6)
    pair_weights = np.zeros((len(blocks), 6, 6))
    pair_weights[:, upper[0], upper[1]] = blocks[:, :21]
    pair_weights[:, upper[1], upper[0]] = blocks[:, :21]
    rotation = _rotation_between(start, poses).as_rotvec()
    weights, pulls = _motion_prior(rotation, start, poses, centre)
    matrix, right = np.zeros((count, 6, count, 6)), np.zeros((count, 6))
    consecutive = np.stack([np.arange(count - 1), np.arange(1, count)], axis=1)
    terms = (np.concatenate([pairs, consecutive]), np.concatenate([pair_weights, weights]), np.concatenate([blocks[:, 21:], pulls]))
    for (a, b), weight, pull in zip(*terms, strict=True):
        matrix[a, :, a] += weight
        matrix[b, :, b] += weight
        matrix[a, :, b] -= weight
        matrix[b, :, a] -= weight
        right[a] += pull
        right[b] -= pull
    for axis in (0, 1):  # gravity
        matrix[range(count), axis, range(count), axis] += 1 / LEVEL_RAD**2
        right[:, axis] -= rotation[:, axis] / LEVEL_RAD**2
    return matrix.reshape(6 * count, 6 * count), right.ravel()


def _motion_prior(rotation: np.ndarray, start: np.ndarray, poses: np.ndarray, centre: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return weights (V-1, 6, 6) and pulls (V-1, 6) of the phone's motion estimate between consecutive views, at the current poses."""
    # A correction moves a point p to p + rotation x (p - centre) + shift, where the symbol x in the middle is the cross product. The next
    # line computes the shift that moves the camera to its current position.
    shift = poses[:, :3, 3] - start[:, :3, 3] - np.cross(rotation, start[:, :3, 3] - centre)
    gap = np.linalg.norm(np.diff(start[:, :3, 3], axis=0), axis=1)
    weights, pulls = np.zeros((len(gap), 6, 6)), np.zeros((len(gap), 6))
    for i in range(len(gap)):
        # Shifts are compared at the positions of the cameras. A rotation about `centre` also moves these positions.
        arm = (start[i, :3, 3] + start[i + 1, :3, 3]) / 2 - centre
        lever = np.eye(6)
        lever[3:, :3] = -np.array([[0, -arm[2], arm[1]], [arm[2], 0, -arm[0]], [-arm[1], arm[0], 0]])
        precision = np.repeat([1 / (TURN_RAD**2 * gap[i] + REST_RAD**2), 1 / (SHIFT_M**2 * gap[i] + REST_M**2)], 3)
        weights[i] = lever.T @ (precision[:, None] * lever)
        pulls[i] = weights[i] @ np.concatenate([rotation[i + 1] - rotation[i], shift[i + 1] - shift[i]])
    return weights, pulls


@inner
def _projected(x, y, z, pose, depth, lens):
    """Return row and column of a world point in a view (-1 outside the view), and the depth of the point in the view."""
    a, b, c = x - pose[0, 3], y - pose[1, 3], z - pose[2, 3]
    d = pose[0, 2] * a + pose[1, 2] * b + pose[2, 2] * c
    if d < 0.1:
        return -1, -1, d
    u = lens[0] * (pose[0, 0] * a + pose[1, 0] * b + pose[2, 0] * c) / d + lens[2]
    v = lens[1] * (pose[0, 1] * a + pose[1, 1] * b + pose[2, 1] * c) / d + lens[3]
    m, n = int(np.floor(v + 0.5)), int(np.floor(u + 0.5))
    if m < 0 or n < 0 or m >= depth.shape[0] or n >= depth.shape[1] or depth[m, n] <= 0:
        return -1, -1, d
    return m, n, d


@compiled
def _shared(world, pose, depth, lens):
    """Return how many of the world points (N, 3) lie inside the image of a view, with a depth within 0.3 m of the measured depth."""
    count = 0
    for k in range(len(world)):
        m, n, d = _projected(world[k, 0], world[k, 1], world[k, 2], pose, depth, lens)
        if m >= 0 and abs(depth[m, n] - d) < 0.3:
            count += 1
    return count


@compiled
def _accumulate(world, pose, depth, lens, centre, scale, block):
    """Add the normal equations of a view pair to `block` (27,). Return the pair's median residual; NaN if the views share no surface."""
    row = np.empty(6)
    residuals = np.empty(len(world))
    count = 0
    for k in range(len(world)):
        x, y, z, nx, ny, nz = world[k, 0], world[k, 1], world[k, 2], world[k, 3], world[k, 4], world[k, 5]
        m, n, d = _projected(x, y, z, pose, depth, lens)
        if m < 0 or abs(depth[m, n] - d) > 4 * scale:
            continue
        q = depth[m, n]
        a, b = (n - lens[2]) / lens[0] * q, (m - lens[3]) / lens[1] * q
        rx, ry, rz = (
            pose[0, 0] * a + pose[0, 1] * b + pose[0, 2] * q,
            pose[1, 0] * a + pose[1, 1] * b + pose[1, 2] * q,
            pose[2, 0] * a + pose[2, 1] * b + pose[2, 2] * q,
        )
        # Use only samples on the side of the surface that the second view sees, at a usable angle of incidence. Normals point into the
        # surface, in the direction of the camera rays.
        if rx * nx + ry * ny + rz * nz < 0.2 * np.sqrt(rx * rx + ry * ry + rz * rz):
            continue
        qx, qy, qz = rx + pose[0, 3], ry + pose[1, 3], rz + pose[2, 3]
        r = nx * (qx - x) + ny * (qy - y) + nz * (qz - z)
        robust = 1 / (1 + (r / scale) ** 2)
        weight = robust * robust * world[k, 6] / (NOISE_M * NOISE_M)
        px, py, pz = x - centre[0], y - centre[1], z - centre[2]
        row[0], row[1], row[2] = py * nz - pz * ny, pz * nx - px * nz, px * ny - py * nx
        row[3], row[4], row[5] = nx, ny, nz
        at = 0
        for i in range(6):
            for j in range(i, 6):
                block[at] += weight * row[i] * row[j]
                at += 1
        for i in range(6):
            block[21 + i] += weight * r * row[i]
        residuals[count] = abs(r)
        count += 1
    return np.median(residuals[:count]) if count else np.nan
