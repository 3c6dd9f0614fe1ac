"""Simulate diffuse scattering of rough surfaces by a cloud of point scatterers on these surfaces.

The total scattered power of a surface is the power that its roughness removes from its mirror reflection. A point of the cloud represents a
surface patch of area A. The distance from patch to transmitter is r_i, and the angle between the patch's normal and the direction to the
transmitter is theta_i. The distance from patch to receiver is r_s, and the angle between the patch's normal and the direction to the
receiver is theta_s. Between isotropic antennas, the ratio of received to transmitted power is

    |a|^2 = A cos theta_i / (4 pi r_i^2) * D(theta_i) cos theta_s / pi * lambda^2 / (4 pi r_s^2)
    D = (1 - rho_s^2) (|E_s|^2 |Gamma_TE|^2 + |E_p|^2 |Gamma_TM|^2)

In these formulas, rho_s is Ament's roughness factor, and Gamma_TE and Gamma_TM are the reflection coefficients of the smooth surface. E_s
and E_p are the components of the incident unit field perpendicular and parallel to the plane of incidence. The ray tubes and mirror images
of the simulator reflect the power fraction rho_s^2 |Gamma|^2, so that mirror reflection and diffuse scattering together have the power
fraction |Gamma|^2. The scattering lobe is Lambertian; its integral over the half-space is D times the incident power. This is the
effective-roughness model of V. Degli-Esposti, F. Fuschini, E. Vitucci, G. Falciasecca, IEEE Trans. AP 55 (2007) 143. That paper fits the
scattering parameter S^2 to measurements, while this module computes it as S^2 = 1 - rho_s^2.

Polarisation: a slightly rough surface scatters a wave once, from a facet that faces the radar, and preserves the polarisation. First-order
perturbation theory and Kirchhoff's approximation agree on this result. If both antennas have the same polarisation, the receiver therefore
gets all of the scattered power.

Speckle: a point represents hundreds of square wavelengths of surface with many independent facets. The simulator draws the field factor of
each point once, from a complex circular Gaussian distribution of unit mean power. Every resolution cell of the radar then has fully
developed speckle, whatever the number of points in the cell. If the field factors were phasors of unit magnitude, a resolution cell would
need a dozen points. The file is over 300 lines long because of this derivation.

Near field: close to the sensor, the factor r^-4 would make the echo of a point stronger than the echo of the area that the point
represents. The simulator therefore multiplies the power by (1 + x/2)/(1 + x)^2 with x = A/(pi r_i r_s), which is the exact ratio for a disc
at normal incidence. With the default density of points, the error of the mean power scattered by a wall is at most 0.1 dB at distances
beyond 1 m. The power is 0.2 dB too low at a distance of 0.5 m and 1 dB too low at 0.15 m.

Limits: the Lambertian lobe does not depend on the correlation length of the surface. A real surface with undulations longer than a
wavelength scatters around the mirror direction instead. The simulated diffuse echo of an oblique wall is therefore an upper limit, although
the total scattered power is correct. The points depend only on the surfaces and a seed. Every diffuse path has one bounce. The simulator
does not model paths between two points, paths with a diffuse and a mirror reflection, and shadows of moving objects on the points.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from radartwin.compiled import compiled
from radartwin.constants import SPEED_OF_LIGHT
from radartwin.materials import Layered, reflection
from radartwin.materials.roughness import ament
from radartwin.radar.antenna import element_gain
from radartwin.radar.chirp import Radar
from radartwin.scene.scene import Surface
from radartwin.simulation.geometry import Geometry
from radartwin.simulation.paths import Paths

# Number of points per square metre of rough surface. It gives 8,400 points in a furnished room with 140 m^2 of surface, and about fifty
# points per range bin on a wall at 3 m.
DENSITY_PER_M2 = 60.0
MIN_POINTS, MAX_POINTS = 200, 50_000  # limits of the number of points of a scene
# Largest fraction of the diffuse power at a sensor pose that the simulator may drop. The resulting error is 1 % of the diffuse amplitude.
PRUNED_POWER = 1e-4
# The simulator ignores surface patches with a smaller cosine of incidence, because they return less than 1e-3 of the power that they return
# at normal incidence.
COS_GRAZING = 0.02
COSINES = 1024  # number of cosines of incidence in the table of scattered power fractions
LANES = 200_000  # number of pairs of a point and a sensor pose computed at once, which need about 30 MB
_SAMPLING_HZ = 77e9  # frequency at which `cloud` computes the scattered power fractions that set the number of points on each surface


@dataclass(frozen=True)
class Cloud:
    """Hold P point scatterers on the rough surfaces of a scene."""

    points: np.ndarray  # (P, 3) positions of the points in the world, in metres
    normals: np.ndarray  # (P, 3) unit normals of the surface at each point, on either side of the surface
    area: np.ndarray  # (P,) surface area that each point represents, in square metres
    field: np.ndarray  # (P,) complex factor of each point's scattered field, from a circular Gaussian distribution of unit mean power
    surface: np.ndarray  # (P,) index of the scene surface on which each point lies

    def __len__(self) -> int:
        return len(self.points)


@dataclass(frozen=True)
class Strengths:
    """Hold the fraction D of the incident power that each of S surfaces scatters, averaged over the radar's frequency sweep."""

    te: np.ndarray  # (S, COSINES) scattered power fraction for a TE field; column c is for the cosine of incidence c/(COSINES - 1)
    tm: np.ndarray  # (S, COSINES) scattered power fraction for a TM field, with the same columns as `te`
    frequency_hz: float  # middle of the frequency sweep in Hz


def cloud(surfaces: Sequence[Surface], count: int | None = None, seed: int = 0) -> Cloud:
    """Place point scatterers on the rough surfaces of a scene. The cloud is empty if all surfaces are smooth.

    The number of points on a triangle is proportional to its area times the power fraction that it scatters at 77 GHz and normal
    incidence, so that all points scatter about the same power. The positions on a triangle follow a low-discrepancy sequence (M. Roberts'
    R2), which keeps the mean power of a cloud with few points close to the mean power of the surface.

    Args:
        surfaces: static surfaces in the world.
        count: total number of points. None takes DENSITY_PER_M2 times the rough area, but at least MIN_POINTS and at most MAX_POINTS.
        seed: random seed of the positions and field factors. All runs and frames use the same seed, because the points belong to the scene.
    """
    rough = [index for index, surface in enumerate(surfaces) if surface.roughness_m > 0]
    if not rough:
        return Cloud(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), np.zeros(0, complex), np.zeros(0, int))
    corners = [np.asarray(surfaces[index].mesh.triangles, float) for index in rough]
    owner = np.repeat(rough, [len(part) for part in corners])
    corner = np.concatenate(corners)
    across = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    twice = np.linalg.norm(across, axis=1)
    wavenumber = 2 * np.pi * _SAMPLING_HZ / SPEED_OF_LIGHT
    scattered = np.array([1 - float(ament(surface.roughness_m, np.array(1.0), wavenumber)) ** 2 for surface in surfaces])
    weight = twice * scattered[owner]
    if count is None:
        count = int(np.clip(DENSITY_PER_M2 * twice.sum() / 2, MIN_POINTS, MAX_POINTS))
    rng = np.random.default_rng(np.random.SeedSequence([seed, *b"diffuse cloud"]))
    # Systematic sampling gives each triangle its expected number of points, rounded up or down.
    upto = np.cumsum(weight)
    face = np.searchsorted(upto, (np.arange(count) + rng.random()) * (upto[-1] / count), side="right").clip(0, len(upto) - 1)
    u, v = np.mod(rng.random(2)[:, None] + np.outer((0.7548776662466927, 0.5698402909980532), np.arange(count)), 1.0)
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    points = corner[face, 0] + u[:, None] * (corner[face, 1] - corner[face, 0]) + v[:, None] * (corner[face, 2] - corner[face, 0])
    area = upto[-1] / count / 2 / scattered[owner[face]]
    field = (rng.standard_normal(count) + 1j * rng.standard_normal(count)) / np.sqrt(2)
    return Cloud(points, across[face] / twice[face, None], area, field, owner[face])


def strengths(surfaces: Sequence[Surface], radar: Radar) -> Strengths:
    """Compute the fraction of the incident power that each surface scatters in the radar's frequency sweep; smooth surfaces have zero."""
    frequency = radar.start_frequency_hz + radar.sampled_bandwidth_hz * np.linspace(0, 1, 5)
    cosine = np.linspace(0, 1, COSINES)
    cosine[0] = 1e-6
    out = np.zeros((2, len(surfaces), COSINES))
    known: dict[object, np.ndarray] = {}
    for index, surface in enumerate(surfaces):
        if surface.roughness_m > 0:
            key = (surface.material, surface.roughness_m)
            if key not in known:
                known[key] = scattered_share(surface.material, surface.roughness_m, cosine, frequency)
            out[:, index] = known[key]
    return Strengths(out[0], out[1], float(frequency.mean()))


def scattered_share(material: str | Layered, roughness_m: float, cosine: np.ndarray, frequency_hz: np.ndarray) -> np.ndarray:
    """Return the scattered fraction D (2, C) of the incident power for TE and TM fields at C cosines, averaged over frequencies.

    D is the power reflection coefficient of the smooth surface minus that of the rough surface.
    """
    coherent = ament(roughness_m, cosine[:, None], 2 * np.pi * frequency_hz / SPEED_OF_LIGHT)
    return np.stack([((1 - coherent**2) * np.abs(c) ** 2).mean(axis=1) for c in reflection(material, cosine[:, None], frequency_hz)])


@compiled
def scattered_power(area, strength, cos_in, cos_out, distance_in, distance_out, wavelength_m):
    """Return the ratio of received to transmitted power of surface patches, between isotropic antennas. All arguments broadcast.

    Args:
        area: area of each patch in square metres.
        strength: fraction D of the incident power that the patch scatters.
        cos_in, cos_out: cosines of the angles between the patch normal and the directions to transmitter and receiver. The power is zero
            if either cosine is not positive.
        distance_in, distance_out: distances of the patch from transmitter and receiver, in metres.
        wavelength_m: wavelength in metres.
    """
    product = distance_in * distance_out
    x = area / (np.pi * product)
    limited = (1 + x / 2) / (1 + x) ** 2
    facing = np.maximum(cos_in, 0.0) * np.maximum(cos_out, 0.0)
    return area * strength * facing * limited * (wavelength_m / product) ** 2 / (16 * np.pi**3)


def paths(
    scatterers: Cloud, strength: Strengths, geometry: Geometry, radar: Radar, poses: np.ndarray, velocity: np.ndarray | None = None
) -> Paths:
    """Return the single-bounce paths from the sensor to the points of a cloud and back. A Mitsuba variant must be active.

    Args:
        scatterers: cloud of points on the rough surfaces.
        strength: fractions of the incident power that the same surfaces scatter.
        geometry: surfaces in the world that block the line between sensor and point.
        radar: radar whose element pattern the function uses only to find weak points. The returned amplitudes exclude the element gain.
        poses: (F, 4, 4) transformations from the sensor frame to the world.
        velocity: (F, 3) velocity of the sensor in the world in m/s; None if the sensor is at rest.
    Returns:
        Paths of F poses at one frequency node. The function drops a point at a pose if its received power, including the element gain, is
        below PRUNED_POWER times the mean power of all points at this pose. At most the fraction PRUNED_POWER of the power is lost.
    """
    frames = len(poses)
    velocity = np.zeros((frames, 3)) if velocity is None else velocity
    step = max(1, LANES // max(len(scatterers), 1))
    starts = range(0, frames, step) if len(scatterers) else ()
    parts = [_block(scatterers, strength, geometry, radar, poses[i : i + step], velocity[i : i + step]) for i in starts]
    none, node = np.zeros(0), np.array([strength.frequency_hz])
    if not parts:
        parts, starts = [(none.astype(int), np.zeros((0, 1), complex), none, np.zeros((0, 3)), none)], (0,)
    pose, amplitude, distance, towards, rate = (np.concatenate(column) for column in zip(*parts, strict=True))
    pose = pose + np.repeat(starts, [len(part[0]) for part in parts])
    return Paths(frames, pose, np.ones(len(pose), int), amplitude, node, distance, distance, towards, towards, rate)


def _block(
    scatterers: Cloud, strength: Strengths, geometry: Geometry, radar: Radar, poses: np.ndarray, velocity: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Compute the diffuse paths for a block of sensor poses.

    Returns:
        For each path: index of the pose, amplitude, distance of the point in metres, direction to the point in the sensor frame, and rate
        of change of the path length in m/s.
    """
    wavelength = SPEED_OF_LIGHT / strength.frequency_hz
    pose, point, distance, direction, power, start = _returns(
        CloudArrays(scatterers.points, scatterers.normals, scatterers.area, scatterers.surface), strength.te, strength.tm,
        np.ascontiguousarray(poses, float), wavelength, radar.element != "isotropic", _lift(geometry),
    )  # fmt: skip
    seen = np.flatnonzero(_visible(geometry, start, direction, distance))
    pose, point, distance, power, direction = pose[seen], point[seen], distance[seen], power[seen], direction[:, seen].T
    towards = np.einsum("ni,nij->nj", direction, poses[pose, :3, :3])
    received = power * element_gain(radar.element, towards) ** 4
    total = np.bincount(pose, received, minlength=len(poses))
    kept = received > PRUNED_POWER / len(scatterers) * total[pose]
    pose, distance, direction = pose[kept], distance[kept], direction[kept]
    amplitude = np.sqrt(power[kept]) * scatterers.field[point[kept]]
    rate = -2 * np.einsum("ni,ni->n", direction, velocity[pose])
    return pose, amplitude[:, None], distance, towards[kept], rate


class CloudArrays(NamedTuple):
    """Hold the arrays of a Cloud that the compiled function `_returns` reads."""

    points: Any
    normals: Any
    area: Any
    surface: Any


@compiled
def _returns(cloud, te, tm, poses, wavelength_m, forward, lift):
    """List the N pairs of a sensor pose and a point that have positive echo power. The function does not test whether the line is blocked.

    Returns:
        Index of the pose (N,), index of the point (N,), distance in metres (N,), direction from the sensor to the point in the world (3,
        N), ratio of received to transmitted power (N,), and start of the line of sight (3, N) float32. The start is the point, lifted by
        `lift` metres off the surface towards the sensor.
    """
    points, normals, area, surface = cloud.points, cloud.normals, cloud.area, cloud.surface
    most = len(poses) * len(points)
    pose, point = np.empty(most, np.int64), np.empty(most, np.int64)
    distance, power = np.empty(most), np.empty(most)
    direction, start = np.empty((3, most)), np.empty((3, most), np.float32)
    last = te.shape[1] - 1
    n = 0
    for f in range(len(poses)):
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
            # `share` is the power fraction of the incident field perpendicular to the plane of incidence. The field lies along the sensor's
            # z axis, projected perpendicular to the ray.
            ux, uy, uz = rotation[0, 2], rotation[1, 2], rotation[2, 2]
            across = ux * (y * nz - z * ny) + uy * (z * nx - x * nz) + uz * (x * ny - y * nx)
            size = (1 - cosine * cosine) * (1 - (ux * x + uy * y + uz * z) ** 2)
            share = min(across * across / size, 1.0) if size > 1e-12 else 0.5
            entry = int(cosine * last + 0.5)
            strength = tm[surface[p], entry] + share * (te[surface[p], entry] - tm[surface[p], entry])
            value = scattered_power(area[p], strength, cosine, cosine, away, away, wavelength_m)
            if value <= 0:
                continue
            up = lift if facing > 0 else -lift
            pose[n], point[n], distance[n], power[n] = f, p, away, value
            direction[0, n], direction[1, n], direction[2, n] = x, y, z
            start[0, n], start[1, n], start[2, n] = points[p, 0] + up * nx, points[p, 1] + up * ny, points[p, 2] + up * nz
            n += 1
    return pose[:n], point[:n], distance[:n], direction[:, :n], power[:n], start[:, :n]


def _lift(geometry: Geometry) -> float:
    """Return a height in metres above a surface at which float32 rays can start without hitting this surface."""
    return max(2e-6 * geometry.extent_m, 1e-7)


def _visible(geometry: Geometry, start: np.ndarray, direction: np.ndarray, distance: np.ndarray) -> np.ndarray:
    """Return a mask (N,) of the lines of sight that no surface blocks.

    Args:
        geometry: blocking surfaces.
        start: (3, N) start points of the lines near the surface points.
        direction: (3, N) unit directions from the sensor to the points; the lines run in the opposite direction.
        distance: (N,) length of the lines in metres.
    """
    import mitsuba as mi

    if not len(distance):
        return np.zeros(0, bool)

    def lanes(values: np.ndarray) -> Any:
        return mi.Float(np.ascontiguousarray(values, np.float32))

    ray: Any = mi.Ray3f(mi.Point3f(*(lanes(axis) for axis in start)), mi.Vector3f(*(lanes(-axis) for axis in direction)))
    ray.maxt = lanes(distance * (1 - 1e-4))
    return ~geometry.scene().ray_test(ray).numpy()
