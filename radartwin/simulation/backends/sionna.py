"""Sionna RT as a simulator: exact specular paths that reflect at facets, computed in a worker process.

Sionna treats every facet that contains the mirror point as an infinite mirror and ignores other facets. Echoes of walls are therefore
exact, but those of objects are not: a plate of any size has the echo of an infinite mirror, a trihedral or a sphere has none, and diffuse
paths add coherently. `sionna_limits` warns about these cases. If transmitter and receiver are at one point, the mirror point of a corner
lies on an edge, and rounding decides whether Sionna finds its path. `separation_m` therefore moves the receiver aside during the search for
paths.

Reflection follows the scene's materials, layer by layer (`sionna_material`). Sionna's single-precision phases are not used. Length, angles
and mirror of each path are recomputed from its facets in double precision. The rate of change of a path's length is computed for the line
through its hits, which move with their surfaces.
"""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from radartwin.constants import SPEED_OF_LIGHT
from radartwin.errors import InputError
from radartwin.materials import Layered, reflection
from radartwin.materials.roughness import ament
from radartwin.radar.chirp import Radar
from radartwin.scene.scene import Scene, Surface
from radartwin.simulation import poses as poses_module
from radartwin.simulation import reflection_table
from radartwin.simulation.backends import sionna_limits, sionna_process
from radartwin.simulation.backends.sionna_mesh import Mesh, merged
from radartwin.simulation.checks import check_flag, check_whole
from radartwin.simulation.paths import Paths

RAYS = 200_000  # rays per pose; enough to find every path of the furnished rooms down to 40 dB below the strongest (tested)
ASIDE = np.array([0.74, 0.53, 0.41])  # direction of separation_m in the sensor frame, parallel to no wall
ASIDE /= np.linalg.norm(ASIDE)
COSINES = 4096  # entries per reflection table; the two boards of a stud wall need more than the tracer's tables have
MAX_RAYS = 50_000_000


@dataclass(frozen=True)
class SionnaSettings:
    """Set how Sionna searches paths.

    Attributes:
        max_bounces: largest number of reflections per path, 1 to 32.
        rays: number of rays per pose over the sphere. None: RAYS.
        diffuse: whether to add diffuse reflection, with the power that roughness removes from the mirror reflection at normal incidence.
        separation_m: distance of the receiver from the transmitter during the search, 0 to 1 m. Lengths and angles of paths are computed
            for receiver and transmitter at one point.
        variant: "auto", "llvm" or "cuda".
        seed: random seed of Sionna's diffuse rays.
    """

    max_bounces: int = 4
    rays: int | None = None
    diffuse: bool = False
    separation_m: float = 0.0
    variant: str = "auto"
    seed: int = 0

    def __post_init__(self) -> None:
        check_whole("sionna: max_bounces", self.max_bounces, 1, 32)
        if self.rays is not None:
            check_whole("sionna: rays", self.rays, 1, MAX_RAYS)
        check_whole("sionna: seed", self.seed, 0, 2**32 - 1)
        check_flag("sionna: diffuse", self.diffuse)
        if not 0 <= self.separation_m <= 1:
            raise InputError(f"sionna: separation_m must be from 0 to 1 m, not {self.separation_m!r}")


@dataclass(frozen=True)
class SionnaBackend:
    """Simulate scenes with Sionna RT."""

    settings: SionnaSettings = SionnaSettings()
    name: ClassVar[str] = "sionna"

    def paths(self, scene: Scene, radar: Radar, sensor_poses: np.ndarray, motion: Mapping[str, np.ndarray] | None = None) -> list[Paths]:
        """Return specular paths in one part and diffuse paths in another, as in `backend.Backend`; a single pose if nothing moves.

        Warns:
            UserWarning: Sionna cannot return a part of this scene correctly.
        """
        motion = motion or {}
        if poses_module.at_rest(sensor_poses, *motion.values()):
            sensor_poses, motion = sensor_poses[:1], {name: poses[:1] for name, poses in motion.items()}
        mesh = merged(scene.surfaces, motion)
        if not len(mesh.faces):
            return []
        found = self.found(scene, mesh, radar, sensor_poses)
        for text in sionna_limits.warnings_for(scene.surfaces, mesh, found, radar.wavelength_m, self.settings.diffuse):
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

    def found(self, scene: Scene, mesh: Mesh, radar: Radar, sensor_poses: np.ndarray) -> dict[str, np.ndarray]:
        """Search the paths for the mesh of a scene. Returns the arrays of `sionna_worker.trace` and their frequencies_hz (Q,)."""
        diffuse = self.settings.diffuse
        entries = [(s.material, 0.0 if diffuse else s.roughness_m) for s in scene.surfaces]
        te, tm, row, frequencies = reflection_tables(entries, radar)
        answer = sionna_process.ask({
            "variant": self.settings.variant, "vertices": mesh.vertices, "faces": mesh.faces, "te": te, "tm": tm,
            "row": row[mesh.surface], "frequencies_hz": frequencies,
            "scattering": (scattering(scene.surfaces, radar.center_frequency_hz) if diffuse else np.zeros(len(row)))[mesh.surface],
            "sensor": sensor_poses, "offset_m": self._offset, "max_bounces": self.settings.max_bounces,
            "samples": self.settings.rays or RAYS, "diffuse": diffuse, "seed": self.settings.seed,
        })  # fmt: skip
        return answer | {"frequencies_hz": frequencies}


def reflection_tables(
    entries: Sequence[tuple[str | Layered, float]], radar: Radar
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Tabulate the D distinct entries: te, tm (D, COSINES, Q) complex64, the table row of each entry, and the frequencies (Q,)."""
    high = radar.start_frequency_hz + radar.sampled_bandwidth_hz
    frequencies = reflection_table.build(entries, radar.start_frequency_hz, high).frequencies_hz
    distinct = list(dict.fromkeys(entries))
    cosines = np.linspace(0, 1, COSINES)
    cosines[0] = 1e-6  # grazing limit, where TM reflection changes sign
    both = [np.stack(reflection(material, cosines[:, None], frequencies, rough)) for material, rough in distinct]
    te, tm = np.swapaxes(np.array(both, np.complex64), 0, 1)
    return te, tm, np.array([distinct.index(entry) for entry in entries]), frequencies


def scattering(surfaces: tuple[Surface, ...], frequency_hz: float) -> np.ndarray:
    """Return Sionna's scattering coefficients (S,): square roots of the power that roughness removes at normal incidence."""
    wavenumber = 2 * np.pi * frequency_hz / SPEED_OF_LIGHT
    kept = np.array([float(ament(s.roughness_m, np.array(1.0), wavenumber)) if s.roughness_m else 1.0 for s in surfaces])
    return np.sqrt(1 - kept**2)


def _specular(found: dict[str, np.ndarray], mesh: Mesh, sensor_poses: np.ndarray, rate: np.ndarray) -> Paths:
    """Build specular paths from their facets, by mirroring the sensor in one facet after another."""
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
    # Sionna uses exp(+j omega t), paths use exp(+j k L)
    amplitude = found["amplitude"].conj() * (found["length_m"] / length)[:, None]
    local = np.swapaxes(rotation, 1, 2) @ mirror @ rotation
    bounces = (found["face"] >= 0).sum(axis=1)
    made = Paths(
        len(sensor_poses), pose, bounces, amplitude, found["frequencies_hz"], length / 2, length / 2, departure, arrival, rate, local
    )
    return made.where(there)


def _scattered(found: dict[str, np.ndarray], sensor_poses: np.ndarray, offset: np.ndarray, rate: np.ndarray) -> Paths:
    """Build paths with a diffuse hit, along the line through their hits."""
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
    """Return the legs (N, D + 1, 3) from the transmitter through the hits to the receiver; zeros after the last leg."""
    pose, bounces = found["pose"], (found["face"] >= 0).sum(axis=1)
    stops = np.concatenate([sensor_poses[pose, None, :3, 3], vertex, vertex[:, :1]], axis=1)
    end = sensor_poses[pose, :3, 3] + np.einsum("nij,j->ni", sensor_poses[pose, :3, :3], offset)
    after = np.arange(stops.shape[1]) > bounces[:, None]
    return np.diff(np.where(after[..., None], end[:, None], stops), axis=1)


def _rate(found: dict[str, np.ndarray], mesh: Mesh, sensor_poses: np.ndarray, offset: np.ndarray, frame_rate_hz: float) -> np.ndarray:
    """Return the rate of change (N,) of the length of the line through the hits, m/s, as sensor and surfaces move."""
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
