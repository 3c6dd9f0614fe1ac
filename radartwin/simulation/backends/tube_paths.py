"""Trace rooms and objects by ray tubes, and return their propagation paths in the sensor's frame.

Wide tubes in all directions trace a room. Narrow tubes, about a wavelength wide, trace each cluster of small objects over the bounding box
of the cluster. A tube counts only for the cluster of objects (or the room) that it hits first, so that no path counts twice. In a scene
without a room, opaque objects of flat faces are computed by their polygons instead (`radartwin.simulation.flat.polygons`).
"""

import warnings
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.sparse.csgraph import connected_components

from radartwin.radar.chirp import Radar
from radartwin.scene.scene import Surface
from radartwin.simulation import geometry as geometry_module
from radartwin.simulation import poses as poses_module
from radartwin.simulation.backends.trace_settings import TraceSettings
from radartwin.simulation.curved import tube_grid, tubes
from radartwin.simulation.flat import polygons
from radartwin.simulation.geometry import Geometry
from radartwin.simulation.hits import Antennas, Hits, TraceOptions
from radartwin.simulation.paths import Paths
from radartwin.simulation.pruning import PRUNE, TRACED, pruned
from radartwin.simulation.reflection_table import ReflectionTable

# Ratio of tube width to sqrt(wavelength x distance) in a room. Flat walls alone would allow a ratio of 1, but furniture needs narrower
# tubes.
WIDTH_RULE = 0.3
NEAREST_M = 0.5  # lower limit, in metres, of the distance that sets the number of tubes
MAX_AROUND = 6_000_000  # largest number of tubes around a place; a body that needs more gets wider tubes and a warning
ROOM = 0  # number of the cluster that contains the large surfaces of the room
NEIGHBOUR_M = 0.05  # objects whose bounding boxes are closer than this distance in metres form a cluster


class Target(NamedTuple):
    """Hold the geometry of surfaces that move together and their reflection table."""

    geometry: Geometry
    table: ReflectionTable


def room_paths(surfaces: Sequence[Surface], target: Target, settings: TraceSettings, radar: Radar, poses: np.ndarray) -> Paths:
    """Trace the static surfaces of a scene by ray tubes.

    Args:
        surfaces: static surfaces.
        target: triangles and reflection table of the same surfaces.
        settings: settings of the tracer.
        radar: radar whose antenna pattern and frame rate apply.
        poses: (F, 4, 4) transformations from the sensor frame to the world.
    """
    objects = clusters(surfaces, np.array([i for i, surface in enumerate(surfaces) if surface.kind == "object"], int))
    cluster_of_surface = np.full(len(surfaces), ROOM)
    for label, members in enumerate(objects, ROOM + 1):
        cluster_of_surface[members] = label
    cluster = cluster_of_surface[target.geometry.surface]
    sensor, velocity = poses_module.relative(poses, None, radar.frame_rate_hz)
    every = np.arange(len(poses))
    tasks: list[tuple[int, np.ndarray, tube_grid.TubeGrid]] = []  # cluster that the tubes must hit first, poses, and grid
    alone = not (cluster == ROOM).any()
    body = polygons.of(target.geometry, target.table) if alone else None
    if body is not None:
        table = polygons.with_nodes(target.table, radar)
        place, axis = sensor[:, :3, 3], sensor[:, :3, 2]
        hits = polygons.paths(body, table, place, place, axis, axis, settings.max_bounces)
        return pruned(_in_sensor_frame(hits, table, sensor, velocity), radar, PRUNE)
    if not alone:
        faces = range(6 if radar.sees_behind else 5)
        rays = settings.rays or _room_rays(target.geometry, sensor[:, :3, 3], radar.wavelength_m)
        tasks += [(ROOM, every, grid) for grid in tube_grid.all_around(sensor[:, :3, 3], sensor[:, :3, :3], rays, faces)]
    for label in range(ROOM + 1, ROOM + 1 + len(objects)):
        part = geometry_module.subset(target.geometry, cluster == label)
        if len(part.corners):
            cell = cell_m(part, settings, sensor[:1, :3, 3], radar, alone)
            tasks += [(label, *rows_and_grid) for rows_and_grid in grids(part, sensor[:, :3, 3], sensor[:, :3, :3], cell)]
    # Weak paths are dropped separately for each cluster, because a single narrow tube of an object is far weaker than the echo of a wall,
    # although the sum of the object's tubes is not. The paths of each grid are pruned first, to save memory.
    parts: dict[int, list[Paths]] = {}
    for label, rows, grid in tasks:
        antenna = Antennas(sensor[rows, :3, 3], sensor[rows, :3, 2])
        options = TraceOptions(settings.max_bounces, cluster, label, prune=TRACED, hats=label == ROOM)
        hits = tubes.trace(target.geometry, target.table, grid, antenna, antenna, options)
        part = _in_sensor_frame(replace(hits, pose=rows[hits.pose]), target.table, sensor, velocity)
        parts.setdefault(label, []).append(pruned(part, radar, PRUNE))
    return Paths.concatenate([pruned(Paths.concatenate(group), radar, PRUNE) for group in parts.values()])


def cell_m(geometry: Geometry, settings: TraceSettings, source: np.ndarray, radar: Radar, alone: bool) -> float:
    """Return the width in metres of a ray tube at an object that is seen from the position `source` (1, 3).

    If the scene has no room (`alone`), `settings.rays` sets the number of tubes and thereby their width.
    """
    cell = radar.wavelength_m / np.sqrt(settings.rays_per_wavelength2)
    if alone and settings.rays:
        grid = tube_grid.towards(geometry.hull_points(), source, geometry.centre, cell, geometry.grid_shift)
        if grid is not None:
            cell *= np.sqrt(grid.per_pose / settings.rays)
    return float(cell)


def clusters(surfaces: Sequence[Surface], indices: np.ndarray) -> list[list[int]]:
    """Group the surfaces with these `indices` into clusters that are traced together.

    Surfaces whose bounding boxes are closer than NEIGHBOUR_M belong to one cluster.
    """
    if len(indices) < 2:
        return [[i] for i in indices.tolist()]
    box = np.array([surfaces[i].mesh.bounds for i in indices])
    gap = np.maximum(box[:, None, 0] - box[None, :, 1], box[None, :, 0] - box[:, None, 1]).max(axis=2)
    number, label = connected_components(gap < NEIGHBOUR_M, directed=False)
    return [indices[label == k].tolist() for k in range(number)]


def grids(geometry: Geometry, place: np.ndarray, rotation: np.ndarray, cell_m: float) -> Iterator[tuple[np.ndarray, tube_grid.TubeGrid]]:
    """Yield grids of tubes over a small object, each with the indices of its places.

    All places (F, 3) that are far enough share one grid. A place that is too close for a planar grid has a grid for each face of a cube
    with the object behind it; the cube is turned by `rotation` (F, 3, 3).
    """
    points = geometry.hull_points()
    close = tube_grid.near(points, place, geometry.centre)
    if not close.all():
        grid = tube_grid.towards(points, place[~close], geometry.centre, cell_m, geometry.grid_shift)
        assert grid is not None
        yield np.flatnonzero(~close), grid
    rows = np.flatnonzero(close)
    reach = np.array([np.linalg.norm(points - place[row], axis=1).max() for row in rows])
    per_face = (2 * np.maximum(reach, NEAREST_M) / cell_m) ** 2
    faces = [tube_grid.cube_faces(points, place[row], rotation[row]) for row in rows]
    most = _limited(int(max((n * len(seen) for n, seen in zip(per_face, faces, strict=True)), default=0)))  # one warning for all places
    for row, cells, seen in zip(rows, per_face, faces, strict=True):
        for grid in tube_grid.all_around(place[[row]], rotation[[row]], int(6 * min(cells, most / max(len(seen), 1))), seen):
            yield np.array([row]), grid


def _in_sensor_frame(hits: Hits, table: ReflectionTable, sensor: np.ndarray, velocity: np.ndarray) -> Paths:
    """Convert hits at F poses to paths in the sensor's frame.

    Args:
        table: reflection table with the frequency nodes of the hits.
        sensor: (F, 4, 4) sensor poses and velocity: (F, 3) sensor velocities in m/s, both in the frame of the hits.
    """
    rotation = sensor[hits.pose, :3, :3]
    departure, arrival = (np.einsum("nij,ni->nj", rotation, d) for d in (hits.departure, hits.arrival))
    rate = -np.einsum("ni,ni->n", hits.departure + hits.arrival, velocity[hits.pose])
    return Paths(
        len(sensor), hits.pose, hits.bounce, hits.amplitude, table.frequencies_hz, hits.length_in_m, hits.length_out_m,
        departure, arrival, rate,
    )  # fmt: skip


def _room_rays(geometry: Geometry, positions: np.ndarray, wavelength_m: float) -> int:
    """Return the number of tubes in all directions together for which the tube width at the farthest surface agrees with WIDTH_RULE."""
    corners = geometry.corners.reshape(-1, 3)
    low, high = corners.min(0), corners.max(0)
    away = np.maximum(np.abs(positions - low), np.abs(positions - high))
    distance = max(NEAREST_M, float(np.linalg.norm(away, axis=1).max()))
    return _limited(int(6 * (2 / (WIDTH_RULE * np.sqrt(wavelength_m / distance))) ** 2))


def _limited(wanted: int) -> int:
    """Return the number of tubes around a place, at most MAX_AROUND. The function warns if the limit makes the tubes too wide."""
    if wanted > MAX_AROUND:
        warnings.warn(
            f"surfaces around the radar need {wanted:,} tubes, over the limit MAX_AROUND of {MAX_AROUND:,}, so that the tubes are "
            f"{np.sqrt(wanted / MAX_AROUND):.1f} times too wide; lower rays_per_wavelength2 or move the radar away from large objects",
            stacklevel=2,
        )
    return min(wanted, MAX_AROUND)
