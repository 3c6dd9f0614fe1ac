"""Simulate scenes with the ray tracer Sionna RT, which finds exact mirror reflections at mesh facets, in a worker process.

Sionna treats every facet that contains a mirror reflection point as an infinite mirror, and it ignores all other facets. Sionna's echoes of
walls are therefore exact, but its echoes of objects are not. A plate of any size has the echo of an infinite mirror, a trihedral or a
sphere has no echo, and diffuse paths add coherently. `sionna_limits` warns the user about these errors. If transmitter and receiver are at
one point, the reflection point in a corner lies exactly on an edge, and rounding decides whether Sionna finds the path. The setting
`separation_m` therefore moves the receiver aside while Sionna searches for paths.

The reflection coefficients are those of the scene's layered materials (`sionna_material`). The simulator does not use Sionna's phases,
which have single precision. The simulator computes length, angles and mirror matrix of each path again from the path's facets, in double
precision. The simulator connects the hits of a path by a line and moves each hit with its surface. The rate of change of the length of this
line is the rate of the path.
"""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

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

# Default number of rays per pose. A test shows that this number finds every path of the furnished rooms down to 40 dB below the strongest.
RAYS = 200_000
ASIDE = np.array([0.74, 0.53, 0.41])  # direction in the sensor frame in which separation_m moves the receiver; parallel to no wall
ASIDE /= np.linalg.norm(ASIDE)
COSINES = 4096  # least number of cosines of incidence in a reflection table, for errors below 3e-3 up to 89.7 degrees on stud walls
MAX_RAYS = 50_000_000  # largest number of rays per pose


@dataclass(frozen=True)
class SionnaSettings:
    """Set how Sionna searches paths.

    Attributes:
        max_bounces: largest number of reflections per path, 1 to 32.
        rays: number of rays per pose in all directions; None takes RAYS.
        diffuse: whether to add diffuse reflection. Its power is the power that roughness removes from the mirror reflection at normal
            incidence.
        diffraction: whether to add paths with one diffraction at an edge (uniform theory of diffraction), also at free edges, and to let
            Sionna refract. Sionna treats the faces at an edge as metal. The material that RadarTwin gives to Sionna only reflects, so
            refraction finds no further paths. At the reflection boundary of a free edge, the diffracted wave of sionna-rt 2.2.0 has the
            wrong sign. The paths keep this sign.
        separation_m: distance of the receiver from the transmitter while Sionna searches for paths, 0 to 1 m. The simulator computes
            lengths and angles of the paths for receiver and transmitter at one point.
        variant: Mitsuba variant: "llvm" (CPU), "cuda" (GPU), or "auto" (GPU if the computer has one).
    """

    max_bounces: int = 4
    rays: int | None = None
    diffuse: bool = False
    diffraction: bool = False
    separation_m: float = 0.0
    variant: str = "auto"

    def __post_init__(self) -> None:
        check_whole("sionna: max_bounces", self.max_bounces, 1, 32)
        if self.rays is not None:
            check_whole("sionna: rays", self.rays, 1, MAX_RAYS)
        check_flag("sionna: diffuse", self.diffuse)
        check_flag("sionna: diffraction", self.diffraction)
        if not 0 <= self.separation_m <= 1:
            raise InputError(f"sionna: separation_m must be from 0 to 1 m, not {self.separation_m!r}")


@dataclass(frozen=True)
class SionnaBackend:
    """Simulate scenes with Sionna RT."""

    settings: SionnaSettings = SionnaSettings()
    name = "sionna"

    def paths(
        self,
        scene: Scene,
        radar: Radar,
        sensor_poses: np.ndarray,
        motion: Mapping[str, np.ndarray] | None = None,
        track: np.ndarray | None = None,
    ) -> list[Paths]:
        """Return one `Paths` object with mirror reflections and one with diffuse and diffracted paths. The arguments are those of
        `backend.Backend.paths`.

        If neither sensor nor surfaces move, the paths have a single pose.

        Warns:
            UserWarning: Sionna cannot compute the echo of a surface of this scene correctly.
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
        sets = (usable & found["mirrored"], usable & ~found["mirrored"])
        chosen = [{name: values[keep] if name != "frequencies_hz" else values for name, values in found.items()} for keep in sets]
        rates = [_rate(one, mesh, sensor_poses, self._offset, radar.frame_rate_hz) for one in chosen]
        parts = [_specular(chosen[0], mesh, sensor_poses, rates[0]), _scattered(chosen[1], sensor_poses, rates[1])]
        return [part for part in parts if len(part)]

    @property
    def _offset(self) -> np.ndarray:
        return self.settings.separation_m * ASIDE

    def found(self, scene: Scene, mesh: Mesh, radar: Radar, sensor_poses: np.ndarray) -> dict[str, np.ndarray]:
        """Let Sionna search the paths over the mesh of a scene.

        Returns:
            The arrays of `sionna_worker.trace`, and the array frequencies_hz (Q,) of the frequency nodes of the amplitudes, in Hz.
        """
        diffuse = self.settings.diffuse
        entries = [(s.material, 0.0 if diffuse else s.roughness_m) for s in scene.surfaces]
        te, tm, row, frequencies = reflection_tables(entries, radar)
        answer = sionna_process.ask({
            "variant": self.settings.variant, "vertices": mesh.vertices, "faces": mesh.faces, "te": te, "tm": tm,
            "row": row[mesh.surface], "frequencies_hz": frequencies,
            "scattering": (scattering(scene.surfaces, radar.center_frequency_hz) if diffuse else np.zeros(len(row)))[mesh.surface],
            "sensor": sensor_poses, "offset_m": self._offset, "max_bounces": self.settings.max_bounces,
            "samples": self.settings.rays or RAYS, "diffuse": diffuse, "diffraction": self.settings.diffraction,
        })  # fmt: skip
        return answer | {"frequencies_hz": frequencies}


def reflection_tables(
    entries: Sequence[tuple[str | Layered, float]], radar: Radar
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Tabulate the reflection coefficients of the D different pairs (material, rms roughness in metres) in `entries`.

    Returns:
        TE coefficients and TM coefficients (D, C, Q) complex64 at C cosines of incidence, the table row of each entry, and the frequency
        nodes (Q,) in Hz.
    """
    high = radar.start_frequency_hz + radar.sampled_bandwidth_hz
    distinct = list(dict.fromkeys(entries))
    table = reflection_table.build(distinct, radar.start_frequency_hz, high)
    cosines, frequencies = reflection_table.grid_of_cosines(max(COSINES, table.te.shape[1])), table.frequencies_hz
    both = [np.stack(reflection(material, cosines[:, None], frequencies, rough)) for material, rough in distinct]
    te, tm = np.swapaxes(np.array(both, np.complex64), 0, 1)
    return te, tm, np.array([distinct.index(entry) for entry in entries]), frequencies


def scattering(surfaces: tuple[Surface, ...], frequency_hz: float) -> np.ndarray:
    """Return Sionna's scattering coefficient of each surface, (S,).

    Its square is the fraction of the reflected power that roughness removes from the mirror reflection at normal incidence.
    """
    wavenumber = 2 * np.pi * frequency_hz / SPEED_OF_LIGHT
    kept = np.array([float(ament(s.roughness_m, np.array(1.0), wavenumber)) if s.roughness_m else 1.0 for s in surfaces])
    return np.sqrt(1 - kept**2)


def _specular(found: dict[str, np.ndarray], mesh: Mesh, sensor_poses: np.ndarray, rate: np.ndarray) -> Paths:
    """Build paths of mirror reflections from the facets that Sionna found, by mirroring the sensor in one facet after another."""
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
    # Sionna has the time convention exp(+j omega t), but paths have the phase factor exp(+j k L), so conjugate the amplitudes.
    amplitude = found["amplitude"].conj() * (found["length_m"] / length)[:, None]
    local = np.swapaxes(rotation, 1, 2) @ mirror @ rotation
    bounces = (found["face"] >= 0).sum(axis=1)
    made = Paths(
        len(sensor_poses), pose, bounces, amplitude, found["frequencies_hz"], length / 2, length / 2, departure, arrival, rate, local
    )
    return made.where(there)


def _scattered(found: dict[str, np.ndarray], sensor_poses: np.ndarray, rate: np.ndarray) -> Paths:
    """Build paths that contain a diffuse hit or a diffraction. Each path is the line from the sensor through the hits that Sionna found,
    and back to the sensor.
    """
    pose, bounces = found["pose"], (found["face"] >= 0).sum(axis=1)
    rotation, legs = sensor_poses[pose, :3, :3], _legs(found, found["vertex"], sensor_poses, np.zeros(3))
    length = np.linalg.norm(legs, axis=2)
    out = length[np.arange(len(pose)), bounces]
    first, last = legs[:, 0], -legs[np.arange(len(pose)), bounces]
    departure, arrival = (np.einsum("nji,nj->ni", rotation, line / np.linalg.norm(line, axis=1, keepdims=True)) for line in (first, last))
    amplitude = found["amplitude"].conj()
    return Paths(
        len(sensor_poses), pose, bounces, amplitude, found["frequencies_hz"], length.sum(axis=1) - out, out, departure, arrival, rate
    )


def _legs(found: dict[str, np.ndarray], vertex: np.ndarray, sensor_poses: np.ndarray, offset: np.ndarray) -> np.ndarray:
    """Return the straight sections of N paths as vectors (N, D + 1, 3) in metres, from the transmitter through the hits to the receiver.

    D is the largest number of hits; paths with fewer hits have zero vectors after their last section.
    """
    pose, bounces = found["pose"], (found["face"] >= 0).sum(axis=1)
    stops = np.concatenate([sensor_poses[pose, None, :3, 3], vertex, vertex[:, :1]], axis=1)
    end = sensor_poses[pose, :3, 3] + np.einsum("nij,j->ni", sensor_poses[pose, :3, :3], offset)
    after = np.arange(stops.shape[1]) > bounces[:, None]
    return np.diff(np.where(after[..., None], end[:, None], stops), axis=1)


def _rate(found: dict[str, np.ndarray], mesh: Mesh, sensor_poses: np.ndarray, offset: np.ndarray, frame_rate_hz: float) -> np.ndarray:
    """Return the rate of change (N,) of the length of the line through each path's hits in m/s, while sensor and surfaces move."""
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
