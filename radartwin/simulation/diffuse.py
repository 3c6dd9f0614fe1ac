"""Diffuse scattering from a cloud of points on rough surfaces, with the power that roughness removes from mirror reflections.

A patch of area A at distance r_i from the transmitter (power P_t, incidence theta_i) and r_s from the receiver (theta_s) returns, between
isotropic antennas,

    |a|^2 = A cos theta_i / (4 pi r_i^2) * D(theta_i) cos theta_s / pi * lambda^2 / (4 pi r_s^2)
    D = (1 - rho_s^2) (|E_s|^2 |Gamma_TE|^2 + |E_p|^2 |Gamma_TM|^2)

rho_s is Ament's factor. Tubes and images apply it, so that their rho_s^2 |Gamma|^2 and D add up to |Gamma|^2. The lobe is Lambertian; its
integral over the half-space is D times the incident power. This is the effective-roughness model of V. Degli-Esposti, F. Fuschini,
E. Vitucci, G. Falciasecca, IEEE Trans. AP 55 (2007) 143, with S^2 = 1 - rho_s^2 from physics instead of a fit.

Polarisation: a slightly rough surface scatters once, from a facet that faces the radar, and preserves the polarisation (first-order
perturbation theory and Kirchhoff's approximation agree). Antennas of equal polarisation therefore receive all of the power.

Speckle: a point represents a cell of hundreds of square wavelengths, the sum of many independent facets. Its field is a complex circular
Gaussian of unit mean power, drawn once. Every resolution cell then has the statistics of full speckle with any number of points; unit
phasors would need a dozen points per cell.

Near field: close to the sensor, r^-4 of a point would exceed the return of its cell. The power is multiplied by q = (1 + x/2)/(1 + x)^2,
x = A/(pi r_i r_s), the exact ratio for a disc at normal incidence. At the default density, the mean power of a wall is accurate to 0.1 dB
beyond 1 m, 0.2 dB low at 0.5 m and 1 dB low at 0.15 m.

Limits: the Lambertian lobe has no correlation length. A surface that undulates over more than a wavelength scatters about the mirror
direction instead, so the return of oblique walls is an upper limit here, with the correct total power. Points depend only on the surfaces
and a seed. There is one bounce; paths between points or with mirror reflections, and shadows of moving objects, are not modelled.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from radartwin.compiled import compiled
from radartwin.constants import SPEED_OF_LIGHT
from radartwin.errors import InputError
from radartwin.materials import Layered, reflection
from radartwin.materials.roughness import ament
from radartwin.radar.antenna import element_gain
from radartwin.radar.chirp import Radar
from radartwin.scene.scene import Surface
from radartwin.simulation.geometry import Geometry
from radartwin.simulation.paths import Paths

DENSITY_PER_M2 = 60.0  # 8,400 points in a furnished room of 140 m^2, about fifty per range bin of a wall at 3 m
MIN_POINTS, MAX_POINTS = 200, 50_000
PRUNED_POWER = 1e-4  # largest share of a pose's diffuse power in dropped points: 1 % of its signal
COS_GRAZING = 0.02  # at smaller cosines of incidence, a patch returns under 1e-3 of its power at normal incidence
COSINES = 1024
LANES = 200_000  # pairs of point and pose in memory, about 30 MB
_SAMPLING_HZ = 77e9  # frequency of the scattered shares by which points are distributed over surfaces


@dataclass(frozen=True)
class Cloud:
    """Scatterers on the rough surfaces of a scene.

    Attributes:
        points: (P, 3) metres, world. normals: (P, 3) unit, on either side.
        area: (P,) square metres per point.
        field: (P,) complex, circular Gaussian of unit mean power.
        surface: (P,) index of the surface.
    """

    points: np.ndarray
    normals: np.ndarray
    area: np.ndarray
    field: np.ndarray
    surface: np.ndarray

    def __len__(self) -> int:
        return len(self.points)


@dataclass(frozen=True)
class Strengths:
    """Scattered share D of the incident power, by surface and cosine of incidence.

    Attributes:
        te, tm: (S, COSINES), averaged over the sweep; column c is the cosine c/(COSINES - 1).
        frequency_hz: middle of the sweep.
    """

    te: np.ndarray
    tm: np.ndarray
    frequency_hz: float


def cloud(surfaces: Sequence[Surface], count: int | None = None, seed: int = 0) -> Cloud:
    """Scatterers on the rough surfaces; an empty cloud if all surfaces are smooth.

    The number of points on a triangle is proportional to its area times its scattered share at 77 GHz and normal incidence, so that all
    points have about the same power. Points on a triangle follow a low-discrepancy sequence (M. Roberts' R2), which keeps the mean power of
    sparse clouds close to the integral.

    Args:
        surfaces: static surfaces in the world.
        count: total number of points; None: DENSITY_PER_M2, from MIN_POINTS to MAX_POINTS.
        seed: of positions and fields; it belongs to the scene, not to a run or a frame.
    Raises:
        InputError: a count below one.
    """
    if count is not None and count < 1:
        raise InputError(f"count must be at least one scatterer, not {count!r}")
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
    # systematic sampling: each triangle has its expected number of points, rounded up or down
    upto = np.cumsum(weight)
    face = np.searchsorted(upto, (np.arange(count) + rng.random()) * (upto[-1] / count), side="right").clip(0, len(upto) - 1)
    u, v = np.mod(rng.random(2)[:, None] + np.outer((0.7548776662466927, 0.5698402909980532), np.arange(count)), 1.0)
    u, v = np.where(u + v > 1, 1 - u, u), np.where(u + v > 1, 1 - v, v)
    points = corner[face, 0] + u[:, None] * (corner[face, 1] - corner[face, 0]) + v[:, None] * (corner[face, 2] - corner[face, 0])
    area = upto[-1] / count / 2 / scattered[owner[face]]
    field = (rng.standard_normal(count) + 1j * rng.standard_normal(count)) / np.sqrt(2)
    return Cloud(points, across[face] / twice[face, None], area, field, owner[face])


def strengths(surfaces: Sequence[Surface], radar: Radar) -> Strengths:
    """Scattered shares of the surfaces in the radar's sweep; zero for smooth surfaces."""
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
    """(2, C) D for TE and TM at C cosines, averaged over frequencies: smooth minus rough power reflection."""
    coherent = ament(roughness_m, cosine[:, None], 2 * np.pi * frequency_hz / SPEED_OF_LIGHT)
    return np.stack([((1 - coherent**2) * np.abs(c) ** 2).mean(axis=1) for c in reflection(material, cosine[:, None], frequency_hz)])


@compiled
def scattered_power(area, strength, cos_in, cos_out, distance_in, distance_out, wavelength_m):
    """Received over transmitted power of patches between isotropic antennas, over both polarisations. All arguments broadcast.

    Args:
        area: square metres. strength: D. cos_in, cos_out: from the normal on the lit side; zero power if not positive. distances: metres.
    """
    product = distance_in * distance_out
    x = area / (np.pi * product)
    limited = (1 + x / 2) / (1 + x) ** 2
    facing = np.maximum(cos_in, 0.0) * np.maximum(cos_out, 0.0)
    return area * strength * facing * limited * (wavelength_m / product) ** 2 / (16 * np.pi**3)


def paths(
    scatterers: Cloud, strength: Strengths, geometry: Geometry, radar: Radar, poses: np.ndarray, velocity: np.ndarray | None = None
) -> Paths:
    """Single-bounce paths over the cloud, for all poses. A Mitsuba variant must be active.

    Args:
        scatterers: the cloud. strength: of the same surfaces.
        geometry: blocking surfaces in the world.
        radar: element pattern, used only to drop weak points; amplitudes exclude its gain.
        poses: (F, 4, 4) sensor to world. velocity: (F, 3) of the sensor, m/s, world; None: at rest.
    Returns:
        Paths of F poses at one frequency node. Points are dropped if their power (with the pattern) is below PRUNED_POWER of the pose's
        power divided by the number of points, so that at most PRUNED_POWER is lost.
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
    """Pose, amplitude, distance, direction in the sensor frame, and rate of the paths of some poses."""
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
    """The arrays of a Cloud for the compiled kernel."""

    points: Any
    normals: Any
    area: Any
    surface: Any


@compiled
def _returns(cloud, te, tm, poses, wavelength_m, forward, lift):
    """Pairs of pose and point with positive power, without occlusion.

    Returns:
        pose, point, distance (N,); direction (3, N) from the sensor; power (N,); start (3, N) float32, `lift` above the lit side.
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
            # share of the field (the sensor's z projected across the ray) that is perpendicular to the plane of incidence
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
    """Height in metres at which float32 rays start clear of a surface."""
    return max(2e-6 * geometry.extent_m, 1e-7)


def _visible(geometry: Geometry, start: np.ndarray, direction: np.ndarray, distance: np.ndarray) -> np.ndarray:
    """(N,) whether the lines from `start` (3, N) against `direction` (3, N) to the sensor are free."""
    import mitsuba as mi

    if not len(distance):
        return np.zeros(0, bool)

    def lanes(values: np.ndarray) -> Any:
        return mi.Float(np.ascontiguousarray(values, np.float32))

    ray: Any = mi.Ray3f(mi.Point3f(*(lanes(axis) for axis in start)), mi.Vector3f(*(lanes(-axis) for axis in direction)))
    ray.maxt = lanes(distance * (1 - 1e-4))
    return ~geometry.scene().ray_test(ray).numpy()
