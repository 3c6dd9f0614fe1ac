"""Paths of rooms and objects by ray tubes, in the sensor's frame.

A room is traced by wide tubes over the sphere, and each cluster of small objects in it by tubes of about a wavelength over its bounding
box. A tube belongs to the cluster of its first hit, so that no path counts twice.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.sparse.csgraph import connected_components

from radartwin.radar.chirp import Radar
from radartwin.scene.scene import Surface
from radartwin.simulation import geometry as geometry_module
from radartwin.simulation import poses as poses_module
from radartwin.simulation.backends.trace_settings import TraceSettings
from radartwin.simulation.curved import tube_grid, tubes
from radartwin.simulation.curved.hits import Antennas, Occluder, TraceOptions
from radartwin.simulation.geometry import Geometry
from radartwin.simulation.paths import Paths
from radartwin.simulation.pruning import Pruner
from radartwin.simulation.reflection_table import ReflectionTable

WIDTH_RULE = 0.3  # width of a room's tubes over sqrt(wavelength x distance); flat walls would allow 1, furniture does not
FARTHEST_M = 12.0  # beyond the unambiguous range, a finer grid has no effect
NEAREST_M = 0.5
MAX_AROUND = 6_000_000  # tubes over the sphere
PRUNE = 1e-3  # of the strongest path of a pose, antenna gains included; changes the signal of the furnished lab by 0.2 %
TRACE_PRUNE = 2e-4  # during tracing, before the antenna gains are known
ROOM = 0  # cluster of the large surfaces
NEIGHBOUR_M = 0.05  # objects closer than this form a cluster


class Target(NamedTuple):
    """Surfaces that keep their relative positions, with their reflection."""

    geometry: Geometry
    table: ReflectionTable


def room_paths(surfaces: Sequence[Surface], target: Target, settings: TraceSettings, radar: Radar, poses: np.ndarray) -> Paths:
    """Paths of static surfaces (`target` holds the same surfaces) seen from sensor poses (F, 4, 4)."""
    objects = clusters(surfaces, np.array([i for i, surface in enumerate(surfaces) if surface.kind == "object"], int))
    cluster_of_surface = np.full(len(surfaces), ROOM)
    for label, members in enumerate(objects, ROOM + 1):
        cluster_of_surface[members] = label
    cluster = cluster_of_surface[target.geometry.surface]
    sensor, velocity = poses_module.relative(poses, None, radar.frame_rate_hz)
    grids: list[tuple[tube_grid.TubeGrid, int]] = []
    alone = not (cluster == ROOM).any()
    if not alone:
        faces = 5 if radar.element != "isotropic" else 6
        rays = settings.rays or _room_rays(target.geometry, sensor[:, :3, 3], radar.wavelength_m)
        grids += [(grid, ROOM) for grid in tube_grid.all_around(sensor[:, :3, 3], sensor[:, :3, :3], rays, faces)]
    for label in range(ROOM + 1, ROOM + 1 + len(objects)):
        part = geometry_module.subset(target.geometry, cluster == label)
        if len(part.corners):
            grids += [(grid, label) for grid in _object_grids(part, settings, sensor, radar, alone)]
    return _collect(target, settings, grids, sensor, velocity, radar, cluster)


def object_paths(
    target: Target,
    settings: TraceSettings,
    sensor_poses: np.ndarray,
    object_poses: np.ndarray,
    radar: Radar,
    occluder: Geometry | None,
    alone: bool,
) -> Paths:
    """Direct paths of an object in its own frame; `alone`: there is no room. `occluder` is in the world's frame."""
    sensor, velocity = poses_module.relative(sensor_poses, object_poses, radar.frame_rate_hz)
    hidden = None if occluder is None else Occluder(occluder, object_poses[:, :3, :3], object_poses[:, :3, 3])
    grids = [(grid, ROOM + 1) for grid in _object_grids(target.geometry, settings, sensor, radar, alone)]
    return _collect(target, settings, grids, sensor, velocity, radar, None, hidden)


def cell_m(geometry: Geometry, settings: TraceSettings, source: np.ndarray, radar: Radar, alone: bool) -> float:
    """Width of a tube on an object seen from `source` (1, 3); `settings.rays` decides if the object is alone."""
    cell = radar.wavelength_m / np.sqrt(settings.rays_per_wavelength2)
    if alone and settings.rays:
        grid = tube_grid.towards(geometry.hull_points(), source, geometry.centre, cell, geometry.grid_shift)
        if grid is not None:
            cell *= np.sqrt(grid.per_pose / settings.rays)
    return float(cell)


def clusters(surfaces: Sequence[Surface], chosen: np.ndarray) -> list[list[int]]:
    """The chosen surface indices in clusters whose bounding boxes are closer than NEIGHBOUR_M. A cluster is traced together."""
    if not len(chosen):
        return []
    box = np.array([surfaces[i].mesh.bounds for i in chosen])
    gap = np.maximum(box[:, None, 0] - box[None, :, 1], box[None, :, 0] - box[:, None, 1]).max(axis=2)
    number, label = connected_components(gap < NEIGHBOUR_M, directed=False)
    return [chosen[label == k].tolist() for k in range(number)]


def _object_grids(geometry: Geometry, settings: TraceSettings, sensor: np.ndarray, radar: Radar, alone: bool) -> list[tube_grid.TubeGrid]:
    """Tubes over a compact object; over the sphere if the object is too close for a planar grid."""
    source = sensor[:, :3, 3]
    cell = cell_m(geometry, settings, source[:1], radar, alone)
    grid = tube_grid.towards(geometry.hull_points(), source, geometry.centre, cell, geometry.grid_shift)
    if grid is not None:
        return [grid]
    reach = max(NEAREST_M, float(np.linalg.norm(geometry.hull_points() - source.mean(0), axis=1).max()))
    return tube_grid.all_around(source, sensor[:, :3, :3], min(MAX_AROUND, int(6 * (2 * reach / cell) ** 2)))


def _collect(
    target: Target,
    settings: TraceSettings,
    grids: Sequence[tuple[tube_grid.TubeGrid, int]],
    sensor: np.ndarray,
    velocity: np.ndarray,
    radar: Radar,
    cluster: np.ndarray | None = None,
    occluder: Occluder | None = None,
) -> Paths:
    """Trace the grids, each with the cluster that its tubes must hit first, and express the hits in the sensor's frame."""
    antenna = Antennas(sensor[:, :3, 3], sensor[:, :3, 2])
    # Each cluster is pruned separately: each small tube of an object is far weaker than a wall's flash, but their sum is not.
    pruners: dict[int, Pruner] = {}
    parts: dict[int, list[Paths]] = {}
    for grid, label in grids:
        options = TraceOptions(settings.max_bounces, cluster, label, occluder=occluder, prune=TRACE_PRUNE, hats=label == ROOM)
        hits = tubes.trace(target.geometry, target.table, grid, antenna, antenna, options)
        turn = sensor[hits.pose, :3, :3]
        departure, arrival = (np.einsum("nij,ni->nj", turn, d) for d in (hits.departure, hits.arrival))
        rate = -np.einsum("ni,ni->n", hits.departure + hits.arrival, velocity[hits.pose])
        part = Paths(
            len(sensor), hits.pose, hits.bounce, hits.amplitude, target.table.frequencies_hz, hits.length_in_m, hits.length_out_m,
            departure, arrival, rate,
        )  # fmt: skip
        parts.setdefault(label, []).append(pruners.setdefault(label, Pruner(radar, PRUNE, len(sensor))).add(part))
    pruned = [pruners[label].add(Paths.concatenate(group)) for label, group in parts.items()]
    return pruned[0] if len(pruned) == 1 else Paths.concatenate(pruned)


def _room_rays(geometry: Geometry, positions: np.ndarray, wavelength_m: float) -> int:
    """Tubes over the sphere by the width rule at the farthest surface."""
    corners = geometry.corners.reshape(-1, 3)
    low, high = corners.min(0), corners.max(0)
    away = np.maximum(np.abs(positions - low), np.abs(positions - high))
    distance = float(np.clip(np.linalg.norm(away, axis=1).max(), NEAREST_M, FARTHEST_M))
    return min(MAX_AROUND, int(6 * (2 / (WIDTH_RULE * np.sqrt(wavelength_m / distance))) ** 2))
