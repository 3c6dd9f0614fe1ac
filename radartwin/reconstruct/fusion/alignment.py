"""Drift taken out of a scan: all poses at once, so that the surfaces of overlapping views coincide.

Every view's samples are compared with every other view that sees the same place: r = n . (q - x), x a sample with its normal n, q the other
view's surface where x projects to (Chen and Medioni 1992, point to plane; all pairs at once as in Pulli 1999, Multiview registration for
large data sets). The phone's own motion is kept as a prior between neighbours, gravity as a prior on roll and pitch. Outliers weigh
little (Geman and McClure), by a scale that shrinks from the drift to the noise. Where the whole is, the beginning of the walk says.

Symbols: delta_i -> a turn and a shift of view i about `middle`, in the world.
"""

from __future__ import annotations

import dataclasses
import warnings
from collections.abc import Iterable, Sequence

import numpy as np

from radartwin.compiled import compiled, shared_out
from radartwin.reconstruct.fusion.views import Views
from radartwin.reconstruct.fusion.volume import View

SAMPLES_ACROSS = 28  # a view: some 550 of a phone's map, about as many as it has laser spots
NORMALS_ACROSS = 43  # a view's width over the pixels to either side of a sample that give its normal: 6 of a phone's map
OVERLAP = 0.15  # share of a view's samples another must see for the two to be compared
SCALES_M = (0.12, 0.12, 0.08, 0.05, 0.04, 0.03, 0.02, 0.02, 0.015, 0.015)  # of the outliers, one per iteration
NOISE_M = 0.05  # of one residual; neighbours hang together, so it is several times a pixel's
# Prior of the phone's motion: standard deviation after a metre, and of a standing phone. The shift is ARKit's (Kim et al. 2022, Sensors
# 22:9873: 0.02 m in three axes per second of walking); the turn, which they do not give, moves what is 3 m away by as much.
SHIFT_M, REST_M = 0.012, 0.002
TURN_RAD, REST_RAD = np.radians(0.2), np.radians(0.05)
LEVEL_RAD = np.radians(0.2)  # gravity, as phones know it
ANCHOR_M = 0.6  # of the walk's beginning, which says where the whole is


@dataclasses.dataclass(frozen=True)
class AlignmentReport:
    """What alignment changed; metres.

    Attributes:
        pairs: of views compared.
        before_m, after_m: median distance between the surfaces of overlapping views.
        largest_shift_m, largest_turn_deg: how far a pose moved.
    """

    pairs: int
    before_m: float
    after_m: float
    largest_shift_m: float
    largest_turn_deg: float


def align(views: Views) -> AlignmentReport:
    """Move the views' poses, in place."""
    from scipy.spatial.transform import Rotation

    count = len(views)
    depths, lenses = [views[i].depth for i in range(count)], np.array([_lens(views[i]) for i in range(count)])
    samples = [_samples(views[i]) for i in range(count)]
    start = views.poses.copy()
    poses = start.copy()
    middle = poses[:, :3, 3].mean(axis=0)
    pairs = _pairs(poses, samples, depths, lenses)
    if not len(pairs):
        return AlignmentReport(0, float("nan"), float("nan"), 0.0, 0.0)
    before = after = float("nan")
    for step, scale in enumerate(SCALES_M):
        blocks, median = _compared(poses, samples, depths, lenses, pairs, middle, scale)
        before = median if step == 0 else before
        matrix, right = _assembled(blocks, pairs, count)
        _add_prior(matrix, right, start, poses, middle)
        free = matrix[6:, 6:]
        delta = np.concatenate([np.zeros(6), np.linalg.solve(free + 1e-9 * np.eye(len(free)), right[6:])]).reshape(-1, 6)
        turns = Rotation.from_rotvec(delta[:, :3]).as_matrix()
        poses[:, :3, 3] = np.einsum("nij,nj->ni", turns, poses[:, :3, 3] - middle) + middle + delta[:, 3:]
        poses[:, :3, :3] = turns @ poses[:, :3, :3]
    _, after = _compared(poses, samples, depths, lenses, pairs, middle, SCALES_M[-1])
    poses = _anchored(start, poses)
    views.poses[:] = poses
    turned = Rotation.from_matrix(poses[:, :3, :3] @ np.swapaxes(start[:, :3, :3], 1, 2)).magnitude()
    shift = np.linalg.norm(poses[:, :3, 3] - start[:, :3, 3], axis=1)
    return AlignmentReport(len(pairs), before, after, float(shift.max()), float(np.degrees(turned.max())))


def disagreement(views: Sequence[View], readings: Iterable[np.ndarray], scale_m: float = SCALES_M[0]) -> list[tuple[int, float]]:
    """How far overlapping views lie apart, for each of several sets of poses (N, 4, 4): pairs that overlap, and the median in metres."""
    depths, lenses, samples = [v.depth for v in views], np.array([_lens(v) for v in views]), [_samples(v) for v in views]
    found = []
    for poses in readings:
        pairs = _pairs(poses, samples, depths, lenses)
        apart = float("nan")
        if len(pairs):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", RuntimeWarning)  # of pairs that share places, but no side of a surface
                apart = _compared(poses, samples, depths, lenses, pairs, np.zeros(3), scale_m)[1]
        found.append((len(pairs) if np.isfinite(apart) else 0, apart))
    return found


def _anchored(start: np.ndarray, poses: np.ndarray) -> np.ndarray:
    """The whole turned and shifted, rigidly, to where the walk began, and to the level of all views.

    Nothing else says where a scan is. Of the first view alone, its own noise would turn the whole.
    """
    from scipy.spatial.transform import Rotation

    path = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(start[:, :3, 3], axis=0), axis=1))])
    early = np.exp(-path / ANCHOR_M)
    early /= early.sum()
    turns = Rotation.from_matrix(poses[:, :3, :3] @ np.swapaxes(start[:, :3, :3], 1, 2)).as_rotvec()
    back = Rotation.from_rotvec(-np.append(turns[:, :2].mean(axis=0), early @ turns[:, 2])).as_matrix()
    out = poses.copy()
    out[:, :3, :3] = back @ poses[:, :3, :3]
    out[:, :3, 3] = poses[:, :3, 3] @ back.T
    out[:, :3, 3] += early @ (start[:, :3, 3] - out[:, :3, 3])
    return out


def _lens(view: View) -> tuple[float, float, float, float]:
    k = view.intrinsics
    return float(k[0, 0]), float(k[1, 1]), float(k[0, 2]), float(k[1, 2])


def _samples(view: View) -> np.ndarray:
    """Points and normals in the camera's frame, and weights: (S, 7)."""
    h, w = view.depth.shape
    step, reach = max(round(w / SAMPLES_ACROSS), 1), max(round(w / NORMALS_ACROSS), 1)
    v, u = (n.ravel() for n in np.mgrid[reach : h - reach : step, reach : w - reach : step])
    fx, fy, cx, cy = _lens(view)

    def at(dv: int, du: int) -> tuple[np.ndarray, np.ndarray]:
        depth = view.depth[v + dv, u + du].astype(np.float64)
        return np.stack([(u + du - cx) / fx * depth, (v + dv - cy) / fy * depth, depth], axis=1), view.weight[v + dv, u + du] > 0

    point, sure = at(0, 0)
    (a, sa), (b, sb), (c, sc), (d, sd) = at(0, -reach), at(0, reach), at(-reach, 0), at(reach, 0)
    normal = np.cross(b - a, d - c)
    length = np.linalg.norm(normal, axis=1)
    # On a plane the middle of two neighbours is the sample itself; at an edge it is not.
    flat = (np.abs(a + b - 2 * point)[:, 2] < 0.02 * point[:, 2]) & (np.abs(c + d - 2 * point)[:, 2] < 0.02 * point[:, 2])
    good = sure & sa & sb & sc & sd & flat & (length > 0)
    return np.column_stack([point[good], (normal[good].T / length[good]).T, view.weight[v, u][good]])


def _pairs(poses: np.ndarray, samples: list[np.ndarray], depths: list[np.ndarray], lenses: np.ndarray) -> np.ndarray:
    """Which views (P, 2) see the same places: first the one whose samples are taken."""
    found = []
    for i, own in enumerate(samples):
        some = own[::7]
        if len(some) < 8:
            continue
        world = some[:, :3] @ poses[i, :3, :3].T + poses[i, :3, 3]
        for j in range(len(samples)):
            if i != j and len(samples[j]) and _shared(world, poses[j], depths[j], lenses[j]) > OVERLAP * len(some):
                found.append((i, j))
    return np.array(found, dtype=np.int64).reshape(-1, 2)


def _compared(poses, samples, depths, lenses, pairs, middle, scale):
    """Per pair the normal equations (21 of the upper triangle, 6 of the right side), and the median residual."""
    blocks, residuals = np.zeros((len(pairs), 27)), np.full(len(pairs), np.nan)
    worlds = [
        np.column_stack([s[:, :3] @ p[:3, :3].T + p[:3, 3], s[:, 3:6] @ p[:3, :3].T, s[:, 6]]) for s, p in zip(samples, poses, strict=True)
    ]

    def some(first: int, last: int) -> None:
        for k in range(first, last):
            i, j = pairs[k]
            residuals[k] = _accumulate(worlds[i], poses[j], depths[j], lenses[j], middle, scale, blocks[k])

    shared_out(some, len(pairs))
    return blocks, float(np.nanmedian(residuals))


def _assembled(blocks: np.ndarray, pairs: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    upper = np.triu_indices(6)
    own = np.zeros((len(blocks), 6, 6))
    own[:, upper[0], upper[1]] = blocks[:, :21]
    own[:, upper[1], upper[0]] = blocks[:, :21]
    matrix, right = np.zeros((count, 6, count, 6)), np.zeros((count, 6))
    i, j = pairs.T
    for k in range(len(own)):
        a, b = i[k], j[k]
        matrix[a, :, a] += own[k]
        matrix[b, :, b] += own[k]
        matrix[a, :, b] -= own[k]
        matrix[b, :, a] -= own[k]
        right[a] += blocks[k, 21:]
        right[b] -= blocks[k, 21:]
    return matrix.reshape(6 * count, 6 * count), right.ravel()


def _add_prior(matrix: np.ndarray, right: np.ndarray, start: np.ndarray, poses: np.ndarray, middle: np.ndarray) -> None:
    """The phone's own motion between neighbours, and level, as it now stands against where it was at the start."""
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_matrix(poses[:, :3, :3] @ np.swapaxes(start[:, :3, :3], 1, 2)).as_rotvec()
    # A correction moves x to x + turn x (x - middle) + shift: the shift that takes the camera where it now is.
    shift = poses[:, :3, 3] - start[:, :3, 3] - np.cross(turn, start[:, :3, 3] - middle)
    gap = np.linalg.norm(np.diff(start[:, :3, 3], axis=0), axis=1)
    for i in range(len(poses) - 1):
        a, b = slice(6 * i, 6 * i + 6), slice(6 * i + 6, 6 * i + 12)
        # Shifts are compared at the cameras' own place, where a turn about the middle moves them too.
        arm = (start[i, :3, 3] + start[i + 1, :3, 3]) / 2 - middle
        lever = np.eye(6)
        lever[3:, :3] = -np.array([[0, -arm[2], arm[1]], [arm[2], 0, -arm[0]], [-arm[1], arm[0], 0]])
        sure = np.repeat([1 / (TURN_RAD**2 * gap[i] + REST_RAD**2), 1 / (SHIFT_M**2 * gap[i] + REST_M**2)], 3)
        weight = lever.T @ (sure[:, None] * lever)
        pull = weight @ np.concatenate([turn[i + 1] - turn[i], shift[i + 1] - shift[i]])
        matrix[a, a] += weight
        matrix[b, b] += weight
        matrix[a, b] -= weight
        matrix[b, a] -= weight
        right[a] += pull
        right[b] -= pull
    for i in range(len(poses)):
        for axis in (0, 1):
            matrix[6 * i + axis, 6 * i + axis] += 1 / LEVEL_RAD**2
            right[6 * i + axis] -= turn[i, axis] / LEVEL_RAD**2


@compiled
def _projected(x, y, z, pose, depth, lens):
    """Row and column of a world point in a view, or -1, and its depth there."""
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
    count = 0
    for k in range(len(world)):
        m, n, d = _projected(world[k, 0], world[k, 1], world[k, 2], pose, depth, lens)
        if m >= 0 and abs(depth[m, n] - d) < 0.3:
            count += 1
    return count


@compiled
def _accumulate(world, pose, depth, lens, middle, scale, block):
    """Add a pair's normal equations to `block` (27,); its median residual, NaN if the two share nothing."""
    row = np.empty(6)
    kept = np.empty(len(world))
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
        # The side of the surface that the other view sees, at a usable angle; normals point into the surface, as rays do.
        if rx * nx + ry * ny + rz * nz < 0.2 * np.sqrt(rx * rx + ry * ry + rz * rz):
            continue
        qx, qy, qz = rx + pose[0, 3], ry + pose[1, 3], rz + pose[2, 3]
        r = nx * (qx - x) + ny * (qy - y) + nz * (qz - z)
        robust = 1 / (1 + (r / scale) ** 2)
        weight = robust * robust * world[k, 6] / (NOISE_M * NOISE_M)
        px, py, pz = x - middle[0], y - middle[1], z - middle[2]
        row[0], row[1], row[2] = py * nz - pz * ny, pz * nx - px * nz, px * ny - py * nx
        row[3], row[4], row[5] = nx, ny, nz
        at = 0
        for i in range(6):
            for j in range(i, 6):
                block[at] += weight * row[i] * row[j]
                at += 1
        for i in range(6):
            block[21 + i] += weight * r * row[i]
        kept[count] = abs(r)
        count += 1
    return np.median(kept[:count]) if count else np.nan
