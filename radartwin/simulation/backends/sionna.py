"""Sionna RT as a simulator: exact specular paths over facets, in a process of its own.

A peer, not this project's tracer: every facet is an infinite mirror where the mirror point falls on it, and nothing where it does not.
So walls come out exactly, and objects do not: a plate of any size returns a mirror's level, a trihedral or a sphere nothing, and diffuse
paths add coherently. `sionna_limits` says so where it happens. Seen from the one place of transmitter and receiver, the mirror point in a
corner lies on an edge, where Sionna finds it or not by rounding; `separation_m` moves the receiver aside while paths are looked for.

Materials are those of the scene, layer by layer (radartwin/simulation/backends/sionna_material.py). Delays are not normalised, and the
carrier's phase is not Sionna's single-precision one: of each path the facets are kept, and its length, angles and mirror follow from them
in double precision. A path's rate is that of the line through its hits as they move with their surfaces.
"""

import importlib.metadata
import numbers
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from radartwin.constants import SPEED_OF_LIGHT
from radartwin.errors import BackendError, InputError
from radartwin.materials import Layered, reflection
from radartwin.materials.roughness import ament
from radartwin.radar.chirp import Radar
from radartwin.scene.scene import Scene, Surface
from radartwin.simulation import poses as poses_module
from radartwin.simulation import reflection_table
from radartwin.simulation.backends import sionna_limits, sionna_process
from radartwin.simulation.paths import Paths

RAYS = 200_000  # per pose; what finds every path of the furnished rooms within 40 dB of the strongest (tested)
ASIDE = np.array([0.74, 0.53, 0.41]) / np.linalg.norm([0.74, 0.53, 0.41])  # of the receiver, in the sensor frame: along no wall
COSINES = 4096  # of the tables; a stud wall's two leaves need more than a tracer's own interpolation
LEAST_AREA_M2 = 1e-14
AT_REST = 1e-12
MOST_RAYS = 50_000_000


@dataclass(frozen=True)
class SionnaSettings:
    """How Sionna looks for paths.

    Attributes:
        max_bounces: reflections per path.
        rays: Sionna's samples per pose, over the sphere; None: RAYS.
        diffuse: its diffuse reflection too, with the share of power that roughness takes from the mirror's at normal incidence.
        separation_m: of the receiver from the transmitter while paths are looked for; lengths and angles are those of one place.
        variant: "auto", "llvm" or "cuda".
        seed: of its sampler, which scatters diffuse rays.
    Raises:
        InputError: a value out of range.
    """

    max_bounces: int = 4
    rays: int | None = None
    diffuse: bool = False
    separation_m: float = 0.0
    variant: str = "auto"
    seed: int = 0

    def __post_init__(self) -> None:
        for name, least, most in (("max_bounces", 1, 32), ("rays", 1, MOST_RAYS), ("seed", 0, 2**32 - 1)):
            value = getattr(self, name)
            whole = isinstance(value, numbers.Integral) and not isinstance(value, bool)
            if not (whole and least <= int(value) <= most) and not (name == "rays" and value is None):
                raise InputError(f"sionna: {name} must be a whole number from {least} to {most}, not {value!r}")
        if not isinstance(self.diffuse, bool):
            raise InputError(f"sionna: diffuse must be True or False, not {self.diffuse!r}")
        if not 0 <= self.separation_m <= 1:
            raise InputError(f"sionna: separation_m must be from 0 to 1 m, not {self.separation_m!r}")


@dataclass(frozen=True)
class SionnaBackend:
    """Paths of Sionna RT."""

    settings: SionnaSettings = SionnaSettings()
    name: ClassVar[str] = "sionna"

    def paths(self, scene: Scene, radar: Radar, sensor_poses: np.ndarray, motion: Mapping[str, np.ndarray] | None = None) -> list[Paths]:
        """Specular paths in one part, diffuse ones in another; of one pose where nothing moves.

        Args and returns as in `radartwin.simulation.backends.backend.Backend`.
        Raises:
            BackendError: sionna-rt is not installed, or its process ended.
        Warns:
            UserWarning: what of this scene Sionna cannot return.
        """
        motion = motion or {}
        if all(float(np.abs(poses - poses[:1]).max()) < AT_REST for poses in (sensor_poses, *motion.values())):
            sensor_poses, motion = sensor_poses[:1], {name: poses[:1] for name, poses in motion.items()}
        mesh = merged(scene.surfaces, motion)
        if not len(mesh.faces):
            return []
        found = self.found(scene, mesh, radar, sensor_poses)
        for text in sionna_limits.met(scene.surfaces, mesh, found, radar.wavelength_m, self.settings.diffuse):
            warnings.warn(text, stacklevel=2)
        usable = np.isfinite(found["amplitude"]).all(axis=1) & (found["face"][:, 0] >= 0)
        sets = (usable & ~found["scattered"], usable & found["scattered"])
        chosen = [{name: values[keep] if name != "frequencies_hz" else values for name, values in found.items()} for keep in sets]
        rates = [_rate(one, mesh, sensor_poses, self._offset, radar.frame_rate_hz) for one in chosen]
        parts = [_specular(chosen[0], mesh, sensor_poses, rates[0]), _scattered(chosen[1], sensor_poses, self._offset, rates[1])]
        return [part for part in parts if len(part)]

    @property
    def _offset(self) -> np.ndarray:
        return self.settings.separation_m * ASIDE

    def found(self, scene: Scene, mesh: "Mesh", radar: Radar, sensor_poses: np.ndarray) -> dict[str, np.ndarray]:
        """What Sionna itself answers for one mesh of a scene: see `sionna_worker.trace`; with frequencies_hz (Q,), what it is for.

        Raises:
            BackendError: sionna-rt is not installed, or its process ended.
        """
        check_installed()
        diffuse = self.settings.diffuse
        entries = [(s.material, 0.0 if diffuse else s.roughness_m) for s in scene.surfaces]
        te, tm, row, frequencies = _table(entries, radar)
        answer = sionna_process.ask({
            "variant": self.settings.variant, "vertices": mesh.vertices, "faces": mesh.faces, "te": te, "tm": tm,
            "row": row[mesh.surface], "frequencies_hz": frequencies,
            "scattering": (scattering(scene.surfaces, radar.center_frequency_hz) if diffuse else np.zeros(len(row)))[mesh.surface],
            "sensor": sensor_poses, "offset_m": self._offset, "max_bounces": self.settings.max_bounces,
            "samples": self.settings.rays or RAYS, "diffuse": diffuse, "seed": self.settings.seed,
        })  # fmt: skip
        return answer | {"frequencies_hz": frequencies}


@dataclass(frozen=True)
class Mesh:
    """All surfaces as one.

    Attributes:
        vertices: (F, V, 3) in the world, or (1, V, 3) where no surface moves. faces: (T, 3). surface: (T,) index.
        point_surface: (V,) index. poses: (F, 4, 4) of each surface that moves, by index.
    """

    vertices: np.ndarray
    faces: np.ndarray
    surface: np.ndarray
    point_surface: np.ndarray
    poses: Mapping[int, np.ndarray]


def is_installed() -> bool:
    """Whether the package is here; even to look for its module would import it, and set its Mitsuba variant in this process."""
    try:
        importlib.metadata.version("sionna-rt")
    except importlib.metadata.PackageNotFoundError:
        return False
    return True


def check_installed() -> None:
    if not is_installed():
        raise BackendError("simulator sionna needs the package sionna-rt: pip install 'radartwin[sionna]'")


def merged(surfaces: tuple[Surface, ...], motion: Mapping[str, np.ndarray]) -> Mesh:
    """One mesh of all surfaces; faces without area are left out."""
    moving = {i: motion[s.name] for i, s in enumerate(surfaces) if s.name in motion}
    frames = max((len(poses) for poses in moving.values()), default=1)
    vertices, faces, surface, count = [np.zeros((frames, 0, 3))], [np.zeros((0, 3), int)], [np.zeros(0, int)], [0]
    for i, one in enumerate(surfaces):
        kept = np.asarray(one.mesh.faces)[one.mesh.area_faces > LEAST_AREA_M2]
        points = np.asarray(one.mesh.vertices, float)
        turned = np.einsum("fij,vj->fvi", moving[i][:, :3, :3], points) + moving[i][:, None, :3, 3] if i in moving else points[None]
        vertices.append(np.broadcast_to(turned, (frames, len(points), 3)))
        faces.append(kept + sum(count))
        surface.append(np.full(len(kept), i))
        count.append(len(points))
    point_surface = np.repeat(np.arange(len(surfaces)), count[1:])
    return Mesh(np.concatenate(vertices, axis=1), np.concatenate(faces), np.concatenate(surface), point_surface, moving)


def _table(entries: Sequence[tuple[str | Layered, float]], radar: Radar) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """te, tm (D, COSINES, Q) complex64 of the distinct (material, roughness_m), the row of each entry, and the frequencies (Q,)."""
    high = radar.start_frequency_hz + radar.sampled_bandwidth_hz
    frequencies = reflection_table.build(entries, radar.start_frequency_hz, high).frequencies_hz
    distinct = list(dict.fromkeys(entries))
    cosines = np.linspace(0, 1, COSINES)
    cosines[0] = 1e-6  # grazing limit, where TM turns over
    both = [np.stack(reflection(material, cosines[:, None], frequencies, rough)) for material, rough in distinct]
    te, tm = np.swapaxes(np.array(both, np.complex64), 0, 1)
    return te, tm, np.array([distinct.index(entry) for entry in entries]), frequencies


def scattering(surfaces: tuple[Surface, ...], frequency_hz: float) -> np.ndarray:
    """(S,) Sionna's coefficient: what roughness takes from the mirror's power at normal incidence, as an amplitude."""
    wavenumber = 2 * np.pi * frequency_hz / SPEED_OF_LIGHT
    kept = np.array([float(ament(s.roughness_m, np.array(1.0), wavenumber)) if s.roughness_m else 1.0 for s in surfaces])
    return np.sqrt(1 - kept**2)


def _specular(found: dict[str, np.ndarray], mesh: Mesh, sensor_poses: np.ndarray, rate: np.ndarray) -> Paths:
    """Paths from their facets: images of the sensor, mirrored in each in turn."""
    pose = found["pose"]
    rotation, place = sensor_poses[pose, :3, :3], sensor_poses[pose, :3, 3]
    mirror, shift = np.tile(np.eye(3), (len(pose), 1, 1)), np.zeros((len(pose), 3))
    for face in found["face"].T:
        hit = np.flatnonzero(face >= 0)
        corners = mesh.vertices[np.minimum(pose[hit], len(mesh.vertices) - 1)[:, None], mesh.faces[face[hit]]]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        flip = np.eye(3) - 2 * normal[:, :, None] * normal[:, None, :]
        offset = np.einsum("ni,ni->n", normal, corners[:, 0])
        mirror[hit] = flip @ mirror[hit]
        shift[hit] = np.einsum("nij,nj->ni", flip, shift[hit]) + 2 * offset[:, None] * normal
    towards = np.einsum("nij,nj->ni", mirror, place) + shift - place
    length = np.linalg.norm(towards, axis=1)
    away = np.einsum("nji,nj->ni", mirror, place - shift) - place
    there = length > 0
    length = np.where(there, length, 1.0)
    departure, arrival = (np.einsum("nji,nj->ni", rotation, line / length[:, None]) for line in (away, towards))
    # Sionna is exp(+j omega t), paths are exp(+j k L)
    amplitude = found["amplitude"].conj() * (found["length_m"] / length)[:, None]
    local = np.swapaxes(rotation, 1, 2) @ mirror @ rotation
    bounces = (found["face"] >= 0).sum(axis=1)
    made = Paths(
        len(sensor_poses), pose, bounces, amplitude, found["frequencies_hz"], length / 2, length / 2, departure, arrival, rate, local
    )
    return made.where(there)


def _scattered(found: dict[str, np.ndarray], sensor_poses: np.ndarray, offset: np.ndarray, rate: np.ndarray) -> Paths:
    """Paths with a diffuse hit: the line through their hits."""
    pose, bounces = found["pose"], (found["face"] >= 0).sum(axis=1)
    rotation, legs = sensor_poses[pose, :3, :3], _legs(found, found["vertex"], sensor_poses, offset)
    length = np.linalg.norm(legs, axis=2)
    out = length[np.arange(len(pose)), bounces]
    first, last = legs[:, 0], -legs[np.arange(len(pose)), bounces]
    departure, arrival = (np.einsum("nji,nj->ni", rotation, line / np.linalg.norm(line, axis=1, keepdims=True)) for line in (first, last))
    amplitude = found["amplitude"].conj()
    return Paths(
        len(sensor_poses), pose, bounces, amplitude, found["frequencies_hz"], length.sum(axis=1) - out, out, departure, arrival, rate
    )


def _legs(found: dict[str, np.ndarray], vertex: np.ndarray, sensor_poses: np.ndarray, offset: np.ndarray) -> np.ndarray:
    """(N, D + 1, 3) from transmitter to receiver by way of the hits; zeros after the last."""
    pose, bounces = found["pose"], (found["face"] >= 0).sum(axis=1)
    stops = np.concatenate([sensor_poses[pose, None, :3, 3], vertex, vertex[:, :1]], axis=1)
    end = sensor_poses[pose, :3, 3] + np.einsum("nij,j->ni", sensor_poses[pose, :3, :3], offset)
    after = np.arange(stops.shape[1]) > bounces[:, None]
    return np.diff(np.where(after[..., None], end[:, None], stops), axis=1)


def _rate(found: dict[str, np.ndarray], mesh: Mesh, sensor_poses: np.ndarray, offset: np.ndarray, frame_rate_hz: float) -> np.ndarray:
    """(N,) growth of the line through the hits, m/s, as sensor and surfaces move on."""
    pose, face = found["pose"], found["face"]
    vertex = found["vertex"].copy()
    on = mesh.surface[face]
    for surface, poses in mesh.poses.items():
        (now,), (later,) = poses_module.moments(poses)
        path, hit = np.nonzero((face >= 0) & (on == surface))
        carry = (later @ poses_module.inverse(now))[np.minimum(pose[path], len(poses) - 1)]
        vertex[path, hit] = np.einsum("nij,nj->ni", carry[:, :3, :3], vertex[path, hit]) + carry[:, :3, 3]
    _, (sensor_later,) = poses_module.moments(sensor_poses)
    before, after = (
        np.linalg.norm(_legs(found, points, poses, offset), axis=2).sum(axis=1)
        for points, poses in ((found["vertex"], sensor_poses), (vertex, sensor_later))
    )
    return (after - before) / poses_module.MOMENT * frame_rate_hz
