"""Compute the distance of a reconstructed mesh from the true scene, and the share of the seen true surface that the mesh contains."""

from dataclasses import dataclass

import numpy as np
import trimesh

from experiments.scans.true_surfaces import Sighted
from radartwin.benchmark.signal_error import compare
from radartwin.radar.chirp import Radar
from radartwin.reconstruct.build import distinct_views
from radartwin.reconstruct.frames.frames import Frames
from radartwin.reconstruct.mesh_distance import Nearest, covered
from radartwin.scene.scene import Scene
from radartwin.scene.trajectories.trajectory import look_at
from radartwin.simulation.backends.mitsuba import MitsubaBackend, TraceSettings
from radartwin.simulation.simulate import simulate
from radartwin.testbed.scanner.scan import ScanTruth

SAMPLE_M = 0.04  # distance between compared points
COVERED_M = 0.05  # a true point is covered if the mesh is within this distance
SAME_M, SAME = 0.01, 0.01  # absolute and relative tolerance between a point's depth and that of the pixel that saw it
GRAZING = 0.02  # a surface is edge-on, and not seen, if the cosine between ray and normal is smaller
PLACES = 9  # number of radar positions from which range profiles are compared
ALIGN_STEPS, ALIGN_GATE_M = 15, 0.15
FIT_POINTS, COMPARED_POINTS = 10_000, 100_000  # numbers of random samples of the mesh


@dataclass(frozen=True)
class Accuracy:
    """Distances in metres from a reconstructed mesh to the true surfaces, and shares of the true surface, after the best-fitting rigid
    motion of the mesh, because the coordinate frame of a scan is arbitrary.
    """

    median_m: float
    p95_m: float  # 95 % quantile
    coverage: float  # share of the true area seen by the sensor that is within COVERED_M of the mesh
    seen: float  # share of the true area that the sensor saw
    move: np.ndarray  # (4, 4) the rigid motion


def accuracy(mesh: trimesh.Trimesh, scene: Scene, truth: ScanTruth, frames: Frames) -> Accuracy:
    """Compare a mesh that was fused from the depth `frames` of a simulated phone scan with the true scene, camera poses and pixels."""
    nearest = Nearest([s.mesh for s in scene], SAMPLE_M)
    points = _subset(covered(np.asarray(mesh.triangles), SAMPLE_M)[0], COMPARED_POINTS)
    move = fitted(points, nearest)
    moved = points @ move[:3, :3].T + move[:3, 3]
    distance, _ = nearest(moved)

    true_points, face = covered(np.asarray(nearest.triangles), SAMPLE_M)
    corners = nearest.triangles
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = 0.5 * np.linalg.norm(across, axis=1)
    area = (areas / np.bincount(face, minlength=len(areas)))[face]
    normals = (across / np.maximum(np.linalg.norm(across, axis=1), 1e-15)[:, None])[face]
    seen = sighted(truth, frames)(true_points, normals, nearest.mesh_of[face])
    back = np.linalg.inv(move)
    recovered = Nearest([mesh], SAMPLE_M)(true_points[seen] @ back[:3, :3].T + back[:3, 3])[0] < COVERED_M
    index = nearest.mesh_of[face[seen]]
    # Areas are summed by surface first, because another order of summation would change the last digits.
    have = np.bincount(index, weights=area[seen], minlength=len(scene))
    show = np.bincount(index, weights=area[seen] * recovered, minlength=len(scene))
    return Accuracy(
        median_m=float(np.median(distance)),
        p95_m=float(np.quantile(distance, 0.95)),
        coverage=float(show.sum() / max(have.sum(), 1e-12)),
        seen=float(have.sum() / area.sum()),
        move=move,
    )


def profile_error_db(scene: Scene, truth: Scene, move: np.ndarray, cameras: np.ndarray) -> float:
    """Return the rms difference in dB between the range profiles of a reconstructed and of the true room, at most with one diffraction.

    All surfaces are metal, so that geometry alone makes the difference. `move` (4, 4) leads from the reconstruction to the true room. The
    radar looks from PLACES of the camera poses (N, 4, 4) in the direction of the camera. A quarter of the usual ray tubes changes the
    result by 0.02 dB (laboratory), and needs 2 instead of 9 GB of memory.
    """
    radar = Radar.iwr1843()
    poses = [look_at(cameras[k, :3, 3], cameras[k, :3, 3] + cameras[k, :3, 2]) for k in distinct_views(cameras, PLACES)]
    rooms, tracer = (_bare(scene, move), _bare(truth, np.eye(4))), MitsubaBackend(TraceSettings(diffractions=1, rays_per_wavelength2=0.25))
    made, right = ([simulate(room, radar, pose[None], simulator=tracer).iq for pose in poses] for room in rooms)
    return compare(list(zip(made, right, strict=True)), radar).profile_db


def _bare(scene: Scene, move: np.ndarray) -> Scene:
    """Return a moved copy of a scene, in which every surface is metal."""
    return Scene([s.replaced(mesh=s.mesh.copy().apply_transform(move), material="metal", roughness_m=0.0) for s in scene])


def fitted(points: np.ndarray, nearest: Nearest) -> np.ndarray:
    """Return the rigid transform (4, 4) that brings points (N, 3) closest to the surfaces, by the point-to-plane distance."""
    from scipy.spatial.transform import Rotation

    sample = _subset(points, FIT_POINTS)
    corners = nearest.triangles
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1), 1e-15)[:, None]
    move = np.eye(4)
    for _ in range(ALIGN_STEPS):
        now = sample @ move[:3, :3].T + move[:3, 3]
        distance, face = nearest(now)
        good = distance < ALIGN_GATE_M
        middle, normal = now[good].mean(axis=0), normals[face[good]]
        gap = ((corners[face[good], 0] - now[good]) * normal).sum(axis=1)
        rows = np.hstack([np.cross(now[good] - middle, normal), normal])
        weight = 1 / (1 + (gap / 0.03) ** 2) ** 2
        step = np.linalg.solve((rows * weight[:, None]).T @ rows + 1e-6 * np.eye(6), (rows * weight[:, None]).T @ gap)
        rotation = Rotation.from_rotvec(step[:3]).as_matrix()
        change = np.eye(4)
        change[:3, :3], change[:3, 3] = rotation, middle + step[3:] - rotation @ middle
        move = change @ move
        if np.abs(step).max() < 1e-6:
            break
    return move


def _subset(points: np.ndarray, count: int) -> np.ndarray:
    return points[np.random.default_rng(0).permutation(len(points))[:count]]


def sighted(truth: ScanTruth, frames: Frames) -> Sighted:
    """Return a function that decides which points a scan saw: their surface faces the camera, a pixel hits it, and the true depth of this
    pixel is where its ray crosses the plane of the surface at the point.
    """
    lenses = [frame.intrinsics for frame in frames]
    height, width = truth.depth_m.shape[1:]

    def saw(points: np.ndarray, normals: np.ndarray, surface: np.ndarray) -> np.ndarray:
        seen = np.zeros(len(points), dtype=bool)
        for i, (pose, k) in enumerate(zip(truth.poses, lenses, strict=True)):
            left = np.flatnonzero(~seen)
            offset = points[left] - pose[:3, 3]
            ahead = (offset @ pose[:3, 2] > 0.1) & (np.einsum("nk,nk->n", offset, normals[left]) < 0)
            left, offset = left[ahead], offset[ahead]
            local = offset @ pose[:3, :3]
            z = local[:, 2]
            u, v = np.rint(k[0, 0] * local[:, 0] / z + k[0, 2]).astype(int), np.rint(k[1, 1] * local[:, 1] / z + k[1, 2]).astype(int)
            inside = (u >= 0) & (v >= 0) & (u < width) & (v < height)
            left, u, v, local = left[inside], u[inside], v[inside], local[inside]
            facing = normals[left] @ pose[:3, :3]
            ray = np.stack([(u - k[0, 2]) / k[0, 0], (v - k[1, 2]) / k[1, 1], np.ones(len(u))], axis=1)
            slope = np.einsum("nk,nk->n", ray, facing)
            square = slope < -GRAZING * np.linalg.norm(ray, axis=1)
            depth = np.einsum("nk,nk->n", local, facing) / np.where(square, slope, -1.0)
            same = square & (np.abs(truth.depth_m[i, v, u] - depth) < SAME_M + SAME * depth) & (truth.surface[i, v, u] == surface[left])
            seen[left[same]] = True
        return seen

    return saw
