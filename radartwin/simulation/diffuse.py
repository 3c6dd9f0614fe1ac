"""Simulate diffuse scattering of rough surfaces by a cloud of point scatterers on these surfaces.

A point of the cloud represents a surface patch of area A at the distance r from the radar. The angle between the patch's normal and the
direction to the radar is theta. Between isotropic antennas, the ratio of received to transmitted power is

    |a|^2 = A cos theta / (4 pi r^2) * D(theta) p(theta) * lambda^2 / (4 pi r^2)
    D = (1 - rho_s(theta)^2) |Gamma(0)|^2

In these formulas, rho_s is Ament's roughness factor, and Gamma(0) is the reflection coefficient of the smooth surface at normal incidence.
The function p is the lobe of Kirchhoff scattering in the direction back to the radar (`materials.scatter_lobe`); its integral over the
half-space is 1. The ray tubes and mirror images of the simulator reflect the power fraction rho_s^2 |Gamma(theta)|^2. On a metal, mirror
reflection and diffuse scattering together therefore contain all of the incident power.

Polarisation: a surface scatters a wave back from facets that face the radar, where the wave has normal incidence in both polarisations
(Kirchhoff's approximation with stationary phase; F. Ulaby, R. Moore, A. Fung, Microwave Remote Sensing II, section 12-4). These facets
preserve the polarisation. If both antennas have the same polarisation, the receiver therefore gets all of the scattered power.

Speckle: a point represents a part of the surface with many independent facets. The simulator draws the field factor of each point once,
from a complex circular Gaussian distribution of unit mean power. The points of a surface lie in the frame of the surface and move with it.
The points depend only on the mesh, roughness and name of this surface and on a seed, so that other surfaces, frames and drives do not
change them. The only exception: if surfaces that move together need more than MAX_POINTS points, each of them gets fewer points.

Density: a narrow lobe shows only a small part of a surface to the radar. The density of points therefore grows with the inverse square of
the lobe width, so that at least seven points of a flat surface at 2 m are in the lobe. The sensor sees the radius of a patch under the
angle sqrt(A/pi)/r. The simulator widens the lobe of a point by this angle, from the width w to sqrt(w^2 + A/(pi r^2)), and reduces the peak
of the lobe by the square of the ratio of the widths. The mean power of a flat surface is then also correct close to the sensor, where few
points are in the lobe. For a concrete wall, the mean power is 1.0 dB too low at a distance of 0.15 m and 0.2 dB too low at 0.5 m.

Limits: every diffuse path has one bounce. The simulator does not model paths between two points or paths with a diffuse and a mirror
reflection. Lines through panes have the transmission at the middle of the sweep and one delay, but not the ripple over the sweep. The panes
of one body hide the points of bodies that move differently. On curved bodies whose radius is not much larger than the correlation length,
the mean power is correct, but the speckle changes faster with the aspect than on a real body.
"""

import functools
import warnings
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from radartwin.compiled import compiled
from radartwin.constants import SPEED_OF_LIGHT
from radartwin.materials import Layered, reflection
from radartwin.materials.roughness import ament
from radartwin.materials.scatter_lobe import ANGLES, COS_GRAZING, backscatter_lobe, lobe_width
from radartwin.radar.chirp import Radar
from radartwin.scene.scene import Surface
from radartwin.simulation import poses as poses_module
from radartwin.simulation import reflection_table, visibility
from radartwin.simulation.flat import crossing, obstacles
from radartwin.simulation.geometry import Geometry
from radartwin.simulation.paths import Paths, traced_once
from radartwin.simulation.pruning import DIFFUSE_POWER
from radartwin.simulation.reflection_table import ReflectionTable
from radartwin.store.digest import array_digest, spec_digest

# Number of points per square metre on a surface whose lobe has the width WIDE or more. A furnished room with 140 m^2 of surface has 8,400
# points or more.
DENSITY_PER_M2 = 60.0
WIDE = 0.1
# Number of points on a curved surface, times the width of its lobe. About a dozen points of a cylinder are then in its lobe.
CURVED_POINTS = 40.0
MAX_POINTS = 50_000  # largest number of points on surfaces that move together
LANES = 200_000  # number of pairs of a point and a sensor pose computed at once, which need about 30 MB
_SAMPLING_HZ = 77e9  # frequency at which `cloud` computes the lobe widths that set the number of points on each surface


class Body(NamedTuple):
    """Hold surfaces that move together."""

    surfaces: Sequence[Surface]
    geometry: Geometry  # triangles of these surfaces, in their own frame
    poses: np.ndarray  # (F, 4, 4) transformations from this frame to the world; (1, 4, 4) at rest


class DiffuseWarning(UserWarning):
    """Warn that rough surfaces have fewer scattering points than their lobes need."""


@dataclass(frozen=True)
class Cloud:
    """Hold P point scatterers on rough surfaces that move together."""

    points: np.ndarray  # (P, 3) positions of the points in the frame of the surfaces, in metres
    normals: np.ndarray  # (P, 3) unit normals of the surface at each point, on either side of the surface
    area: np.ndarray  # (P,) surface area that each point represents, in square metres
    field: np.ndarray  # (P,) complex factor of each point's scattered field, from a circular Gaussian distribution of unit mean power
    surface: np.ndarray  # (P,) index of the surface on which each point lies

    def __len__(self) -> int:
        return len(self.points)


@dataclass(frozen=True)
class Strengths:
    """Hold the fraction D p of the incident power that each of S surfaces scatters back per steradian.

    The tables hold ANGLES angles of incidence, equally spaced from 0 to 90 degrees.
    """

    back: np.ndarray  # (S, ANGLES) scattered power fraction per steradian, averaged over the radar's frequency sweep
    width: np.ndarray  # (S,) sine of the angle of incidence at which the lobe falls to about 1/e
    frequency_hz: float  # middle of the frequency sweep in Hz
    table: ReflectionTable  # table of the same surfaces, with their transmission

    @functools.cached_property
    def digest(self) -> str:
        """Return the digest of all tables, as part of the key of cached paths."""
        return spec_digest([array_digest(values) for values in (self.back, self.table.through_te, self.table.through_tm)])


def cloud(surfaces: Sequence[Surface], geometry: Geometry, count: int | None = None, seed: int = 0) -> Cloud:
    """Place point scatterers on the rough surfaces of a body. The cloud is empty if all surfaces are smooth.

    The positions on a surface follow a low-discrepancy sequence (M. Roberts' R2), which keeps the mean power of a cloud with few points
    close to the mean power of the surface.

    Args:
        surfaces: surfaces that move together.
        geometry: triangles and vertex normals of the same surfaces.
        count: approximate number of points on all surfaces. None takes the density that the width of the lobes requires, but at most
            MAX_POINTS points.
        seed: random seed of the positions and field factors. All runs and frames use the same seed, because the points belong to the
            surfaces.
    """
    wavenumber = 2 * np.pi * _SAMPLING_HZ / SPEED_OF_LIGHT
    twice = np.linalg.norm(geometry.area_vectors, axis=1)
    areas = np.bincount(geometry.surface, twice / 2, minlength=len(surfaces))
    bent = np.bincount(geometry.surface, np.ptp(geometry.normals, axis=1).max(axis=1, initial=0.0), minlength=len(surfaces)) > 1e-6
    wanted = np.zeros(len(surfaces))
    for index, surface in enumerate(surfaces):
        if surface.roughness_m > 0 and areas[index] > 0:
            width = lobe_width(surface.roughness_m, surface.correlation_m, wavenumber)
            wanted[index] = max(DENSITY_PER_M2 * areas[index] * max(1.0, WIDE / width) ** 2, CURVED_POINTS / width if bent[index] else 1.0)
    total = wanted.sum()
    if total > MAX_POINTS and count is None:
        warnings.warn(
            f"rough surfaces need {total:,.0f} scattering points, over MAX_POINTS = {MAX_POINTS:,}; with fewer points, the diffuse echo "
            "of small surfaces varies more about its mean", DiffuseWarning, stacklevel=2,
        )  # fmt: skip
    if total > 0:
        wanted *= min(1.0, MAX_POINTS / total) if count is None else count / total
    numbers = np.where(wanted > 0, np.maximum(np.round(wanted), 1), 0).astype(int)
    seen: Counter[str] = Counter()  # surfaces of the same name have different random numbers
    parts = [(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros(0, complex))]
    for index, surface in enumerate(surfaces):
        rng = np.random.default_rng(np.random.SeedSequence([seed, seen[surface.name], *b"diffuse cloud", *surface.name.encode()]))
        seen[surface.name] += 1
        faces = geometry.surface == index
        if numbers[index]:
            parts.append(_on_faces(geometry.corners[faces], geometry.normals[faces], twice[faces], int(numbers[index]), rng))
    points, normals, area, field = (np.concatenate(column) for column in zip(*parts, strict=True))
    return Cloud(points, normals, area, field, np.repeat(np.arange(len(surfaces)), numbers))


def _on_faces(
    corners: np.ndarray, normals: np.ndarray, weight: np.ndarray, count: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return the positions, normals, areas and field factors of `count` points on the faces of a surface.

    Args:
        corners, normals: (K, 3, 3) corners of the faces and normals at these corners.
        weight: (K,) twice the area of each face.
    """
    # Systematic sampling gives each triangle its expected number of points, rounded up or down.
    upto = np.cumsum(weight)
    face = np.searchsorted(upto, (np.arange(count) + rng.random()) * (upto[-1] / count), side="right").clip(0, len(upto) - 1)
    u, v = np.mod(rng.random(2)[:, None] + np.outer((0.7548776662466927, 0.5698402909980532), np.arange(count)), 1.0)
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    share = np.stack([1 - u - v, u, v], axis=1)
    points, across = (np.einsum("ni,nij->nj", share, values[face]) for values in (corners, normals))
    field = (rng.standard_normal(count) + 1j * rng.standard_normal(count)) / np.sqrt(2)
    return points, across / np.linalg.norm(across, axis=1, keepdims=True), np.full(count, upto[-1] / count / 2), field


def strengths(surfaces: Sequence[Surface], radar: Radar) -> Strengths:
    """Compute the fraction of the incident power that each surface scatters back per steradian; smooth surfaces have zero.

    The last results stay in memory. Do not write to the arrays.
    """
    entries = tuple((surface.material, surface.roughness_m, surface.correlation_m) for surface in surfaces)
    return _strengths(entries, radar.start_frequency_hz, radar.sampled_bandwidth_hz)


@functools.lru_cache(maxsize=reflection_table.TABLES_IN_MEMORY)
def _strengths(entries: tuple[tuple[str | Layered, float, float], ...], start_hz: float, bandwidth_hz: float) -> Strengths:
    """Return the strengths of surfaces, given by (material, roughness in metres, correlation length in metres), for one sweep."""
    frequency = start_hz + bandwidth_hz * np.linspace(0, 1, 5)
    wavenumber = float(2 * np.pi * frequency.mean() / SPEED_OF_LIGHT)
    cosine = np.maximum(np.cos(np.linspace(0, np.pi / 2, ANGLES)), 1e-6)
    out = np.zeros((len(entries), ANGLES))
    width = np.ones(len(entries))
    for index, (material, height, length) in enumerate(entries):
        if height > 0:
            out[index] = scattered_share(material, height, cosine, frequency) * backscatter_lobe(height, length, wavenumber)
            width[index] = lobe_width(height, length, wavenumber)
    table = reflection_table.build([entry[:2] for entry in entries], float(frequency[0]), float(frequency[-1]))
    return Strengths(out, width, float(frequency.mean()), table)


def scattered_share(material: str | Layered, roughness_m: float, cosine: np.ndarray, frequency_hz: np.ndarray) -> np.ndarray:
    """Return the fraction D (C,) of the incident power that is scattered back at C cosines, averaged over frequencies."""
    coherent = ament(roughness_m, cosine[:, None], 2 * np.pi * frequency_hz / SPEED_OF_LIGHT)
    facing = reflection(material, np.ones((1, 1)), frequency_hz)[0]
    return ((1 - coherent**2) * np.abs(facing) ** 2).mean(axis=1)


def of_scene(static: Body | None, movers: Sequence[Body], radar: Radar, sensor_poses: np.ndarray) -> list[Paths]:
    """Return the diffuse paths of all bodies of a scene. A Mitsuba variant must be active.

    Each body hides the points of all bodies behind it. The paths of the static surfaces do not depend on the moving bodies and come from
    the array cache. A static point that a moving body hides from the radar in a frame has a second path of opposite amplitude in this
    frame.

    Args:
        static: static surfaces; None if all surfaces move.
        movers: moving bodies.
        radar: radar whose element pattern, frequency sweep and frame rate apply.
        sensor_poses: (F, 4, 4) transformations from the sensor frame to the world.
    Returns:
        `Paths` objects of F sensor poses, or of one pose that is valid for all frames.
    """
    parts = []
    if static is not None:
        still = static_paths(static, radar, sensor_poses)
        parts.append(still)
        if movers:
            frames = slice(1) if still.poses == 1 and poses_module.at_rest(*(mover.poses for mover in movers)) else slice(None)
            obstacles = [_obstacle(mover, np.eye(4)[None], frames) for mover in movers]
            parts.append(visibility.negated(still, sensor_poses[frames], obstacles))
    bodies = [*movers] if static is None else [static, *movers]
    for mover in movers:
        parts.append(mover_paths(mover, [body for body in bodies if body is not mover], radar, sensor_poses))
    return [part for part in parts if len(part)]


def static_paths(static: Body, radar: Radar, sensor_poses: np.ndarray) -> Paths:
    """Return the diffuse paths of static surfaces for F sensor poses (F, 4, 4), or for one pose if the sensor rests. The array cache keeps
    them.
    """
    sensor_poses = sensor_poses[:1] if poses_module.at_rest(sensor_poses) else sensor_poses
    scatterers, strength = cloud(static.surfaces, static.geometry), strengths(static.surfaces, radar)
    velocity = poses_module.relative(sensor_poses, None, radar.frame_rate_hz)[1]
    spec = {"diffuse": DIFFUSE_POWER, "element": radar.pattern, "frequency_hz": strength.frequency_hz, "strength": strength.digest}
    arrays = {name: getattr(scatterers, name) for name in ("points", "normals", "area", "field", "surface")}
    arrays |= {"corners": static.geometry.corners, "owner": static.geometry.surface, "poses": sensor_poses, "velocity": velocity}
    return traced_once(spec, arrays, lambda: [paths(scatterers, strength, static.geometry, radar, sensor_poses, velocity)])[0]


def mover_paths(mover: Body, others: Sequence[Body], radar: Radar, sensor_poses: np.ndarray) -> Paths:
    """Return the diffuse paths of a moving body that is partly hidden by other bodies, for F sensor poses (F, 4, 4)."""
    frames = slice(1) if poses_module.at_rest(sensor_poses, mover.poses, *(body.poses for body in others)) else slice(None)
    sensor, velocity = poses_module.relative(sensor_poses[frames], mover.poses[frames], radar.frame_rate_hz)
    obstacles = [_obstacle(body, mover.poses, frames) for body in others]
    scattered = paths(cloud(mover.surfaces, mover.geometry), strengths(mover.surfaces, radar), mover.geometry, radar, sensor, velocity)
    return scattered.where(~visibility.hidden(scattered, sensor, obstacles))


def _obstacle(body: Body, poses: np.ndarray, frames: slice) -> visibility.Occluder:
    """Describe a body as an obstacle for points in the frame with the transformations `poses` (F, 4, 4) to the world."""
    change = poses_module.inverse(body.poses[frames]) @ poses[frames]
    return visibility.Occluder(body.geometry, change[:, :3, :3], change[:, :3, 3])


def paths(
    scatterers: Cloud, strength: Strengths, geometry: Geometry, radar: Radar, poses: np.ndarray, velocity: np.ndarray | None = None
) -> Paths:
    """Return the single-bounce paths from the sensor to the points of a cloud and back. A Mitsuba variant must be active.

    Args:
        scatterers: cloud of points on the rough surfaces.
        strength: fractions of the incident power that the same surfaces scatter back.
        geometry: triangles in the frame of the cloud that block the line between sensor and point.
        radar: radar whose element pattern the function uses only to find weak points. The returned amplitudes exclude the element gain.
        poses: (F, 4, 4) transformations from the sensor frame to the frame of the cloud.
        velocity: (F, 3) velocity of the sensor in the frame of the cloud in m/s; None if the sensor is at rest.
    Returns:
        Paths of F poses at one frequency node. The function drops a point at a pose if its received power, including the element gain, is
        below DIFFUSE_POWER times the mean power of all points at this pose. At most the fraction DIFFUSE_POWER of the power is lost.
    """
    frames, step = len(poses), max(1, LANES // max(len(scatterers), 1))
    velocity = np.zeros((frames, 3)) if velocity is None else velocity
    tree = None if strength.table.opaque.all() else obstacles.build(geometry.corners, geometry.surface)
    blocks = [
        _block(scatterers, strength, geometry, tree, radar, poses, velocity, np.arange(frames)[i : i + step])
        for i in range(0, frames, step)
    ]
    return Paths.concatenate(blocks)


def _block(
    scatterers: Cloud,
    strength: Strengths,
    geometry: Geometry,
    tree: obstacles.Hierarchy | None,
    radar: Radar,
    poses: np.ndarray,
    velocity: np.ndarray,
    frames: np.ndarray,
) -> Paths:
    """Compute the diffuse paths of the sensor poses with the indices `frames`.

    If a line crosses panes (triangles of `tree`), the amplitude includes their transmission there and back, and the distance includes the
    delay of the layers.
    """
    wavelength = SPEED_OF_LIGHT / strength.frequency_hz
    pose, point, distance, towards, power, above = _returns(
        scatterers.points, scatterers.normals, scatterers.area, scatterers.surface, strength.back, strength.width,
        np.ascontiguousarray(poses, float), frames, wavelength, not radar.sees_behind,
    )  # fmt: skip
    share = DIFFUSE_POWER / max(len(scatterers), 1)
    weight = power * radar.gain(towards) ** 4
    passed, extra = np.zeros(len(pose), complex), np.zeros(len(pose))
    examined = np.zeros(len(pose), bool)
    # The total power without obstacles is an upper limit of the received power. The strong points that are examined first give a lower
    # limit of this power. Points below `share` times the lower limit cannot be kept.
    received = weight
    for _ in range(2):
        total = np.bincount(pose, received, minlength=len(poses))
        rows = np.flatnonzero(~examined & (weight > share * total[pose]))
        examined[rows] = True
        sensor, direction = poses[pose[rows], :3], np.einsum("nij,nj->ni", poses[pose[rows], :3, :3], towards[rows])
        start = scatterers.points[point[rows]] + (geometry.lift_m * above[rows])[:, None] * scatterers.normals[point[rows]]
        free = visibility.visible(geometry, start, -direction, distance[rows])
        passed[rows[free]] = 1
        if tree is not None:
            axis, way, rows = sensor[~free, :, 2], direction[~free], rows[~free]
            across = axis - np.einsum("ni,ni->n", axis, way)[:, None] * way
            across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-9)
            panes, factor = crossing.factors(tree, strength.table, sensor[~free, :, 3], scatterers.points[point[rows]], across, 2)
            through = panes >= 0
            rows = rows[through]
            passed[rows], extra[rows] = crossing.delayed(factor[through], strength.table.frequencies_hz, strength.frequency_hz)
        received = weight * np.abs(passed) ** 2
    kept = np.flatnonzero(received > share * np.bincount(pose, received, minlength=len(poses))[pose])
    pose, point, towards, distance = pose[kept], point[kept], towards[kept], distance[kept] + extra[kept] / 2
    amplitude = (np.sqrt(power[kept]) * scatterers.field[point] * passed[kept].conj())[:, None]
    rate = -2 * np.einsum("nij,nj,ni->n", poses[pose, :3, :3], towards, velocity[pose])
    node, bounces = np.array([strength.frequency_hz]), np.ones(len(pose), int)
    return Paths(len(poses), pose, bounces, amplitude, node, distance, distance, towards, towards, rate)


@compiled
def _returns(points, normals, area, surface, back, width, poses, frames, wavelength_m, forward):
    """List the N pairs of a sensor pose with an index in `frames` and a point that have positive echo power.

    The arguments are those of a `Cloud`, of `Strengths` and of `_block`. The function does not test whether the line is blocked.

    Returns:
        Index of the pose (N,), index of the point (N,), distance in metres (N,), direction from the sensor to the point in the sensor frame
        (N, 3), ratio of received to transmitted power (N,), and 1 or -1 (N,) if the normal points to or away from the sensor's side.
    """
    most = len(frames) * len(points)
    pose, point = np.empty(most, np.int64), np.empty(most, np.int64)
    distance, power, above = np.empty(most), np.empty(most), np.empty(most)
    towards = np.empty((most, 3))
    last = back.shape[1] - 1
    n = 0
    for f in frames:
        rotation = poses[f]
        for p in range(len(points)):
            x, y, z = points[p, 0] - rotation[0, 3], points[p, 1] - rotation[1, 3], points[p, 2] - rotation[2, 3]
            if forward and x * rotation[0, 0] + y * rotation[1, 0] + z * rotation[2, 0] <= 0:
                continue
            away = np.sqrt(x * x + y * y + z * z)
            if away < 1e-9:
                continue
            x, y, z = x / away, y / away, z / away
            nx, ny, nz = normals[p, 0], normals[p, 1], normals[p, 2]
            facing = -(x * nx + y * ny + z * nz)
            cosine = min(abs(facing), 1.0)
            if cosine < COS_GRAZING:
                continue
            # The angle under which the sensor sees the radius of a disc of the patch's area widens the lobe.
            s = surface[p]
            narrow = width[s] ** 2
            narrow /= narrow + area[p] / (np.pi * away * away)
            place = np.arcsin(np.sqrt((1 - cosine * cosine) * narrow)) * (2 / np.pi * last)
            entry = min(int(place), last - 1)
            part = place - entry
            low, high = back[s, entry], back[s, entry + 1]
            value = area[p] * cosine * (narrow * (low + part * (high - low))) * (wavelength_m / (4 * np.pi * away * away)) ** 2
            if value <= 0:
                continue
            pose[n], point[n], distance[n], power[n], above[n] = f, p, away, value, 1.0 if facing > 0 else -1.0
            for i in range(3):
                towards[n, i] = x * rotation[0, i] + y * rotation[1, i] + z * rotation[2, i]
            n += 1
    return pose[:n], point[:n], distance[:n], towards[:n], power[:n], above[:n]
