"""Simulate scenes with the ray tracer Sionna RT, which finds exact mirror reflections at mesh facets, in a worker process.

Sionna treats every facet that contains a mirror reflection point as an infinite mirror, and it ignores all other facets. Sionna's echoes of
walls are therefore exact, but its echoes of objects are not. A plate of any size has the echo of an infinite mirror, a trihedral or a
sphere has no echo. `sionna_scene.limits` warns the user about these errors. If transmitter and receiver
are at one point, the reflection point in a corner lies exactly on an edge, and rounding decides whether Sionna finds the path. The setting
`separation_m` therefore moves the receiver aside while Sionna searches for paths.

The reflection coefficients are those of the scene's layered materials (`sionna_worker`). The simulator does not use Sionna's phases,
which have single precision. The simulator computes length, angles and mirror matrix of each path again from the path's facets, in double
precision. The simulator connects the hits of a path by a line and moves each hit with its surface. The rate of change of the length of this
line is the rate of the path.

Sionna needs a different Mitsuba variant than the package's own tracer, and a process can have only one. It therefore runs in a worker
process, which imports `sionna_worker`.
"""

import functools
import os
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from radartwin.errors import BackendError, InputError
from radartwin.io.process_pool import BrokenProcessPool, ProcessPool
from radartwin.radar.chirp import Radar
from radartwin.scene.scene import Scene
from radartwin.simulation import poses as poses_module
from radartwin.simulation import variant
from radartwin.simulation.argument_checks import check_flag, check_whole
from radartwin.simulation.backends.sionna_scene import SionnaScene, convert, limits
from radartwin.simulation.paths import Paths
from radartwin.simulation.poses import ObjectPoses

# Default number of rays per pose. A test shows that this number finds every path of the furnished rooms down to 40 dB below the strongest.
RAYS = 200_000
ASIDE = np.array([0.74, 0.53, 0.41])  # direction in the sensor frame in which separation_m moves the receiver; parallel to no wall
ASIDE /= np.linalg.norm(ASIDE)
MAX_RAYS = 50_000_000  # largest number of rays per pose


@dataclass(frozen=True)
class SionnaSettings:
    """Set how Sionna searches paths.

    Attributes:
        max_bounces: largest number of reflections per path, 1 to 32.
        rays: number of rays per pose in all directions; None takes RAYS.
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
    diffraction: bool = False
    separation_m: float = 0.0
    variant: str = "auto"

    def __post_init__(self) -> None:
        check_whole("sionna: max_bounces", self.max_bounces, 1, 32)
        if self.rays is not None:
            check_whole("sionna: rays", self.rays, 1, MAX_RAYS)
        check_flag("sionna: diffraction", self.diffraction)
        if not 0 <= self.separation_m <= 1:
            raise InputError(f"sionna: separation_m must be from 0 to 1 m, not {self.separation_m!r}")


@dataclass(frozen=True)
class SionnaBackend:
    """Simulate scenes with Sionna RT."""

    settings: SionnaSettings = SionnaSettings()
    name = "sionna"

    def paths(
        self, scene: Scene, radar: Radar, sensor_poses: np.ndarray, motion: ObjectPoses | None = None, track: np.ndarray | None = None
    ) -> list[Paths]:
        """Return one `Paths` object with mirror reflections and one with diffracted paths. The arguments are those of
        `backend.Backend.paths`.

        If neither sensor nor surfaces move, the paths have a single pose.

        Warns:
            UserWarning: Sionna cannot compute the echo of a surface of this scene correctly.
        """
        if not len(scene):
            return []
        motion = motion or {}
        if poses_module.at_rest(sensor_poses, *motion.values()):
            sensor_poses, motion = sensor_poses[:1], {name: poses[:1] for name, poses in motion.items()}
        mesh = convert(scene.surfaces, motion, radar)
        traced = self.traced(mesh, sensor_poses)
        for text in limits(scene.surfaces, mesh, traced, radar.wavelength_m):
            warnings.warn(text, stacklevel=2)
        # Sionna has the time convention exp(+j omega t), but paths have the phase factor exp(+j k L), so conjugate the amplitudes.
        traced |= {"amplitude": traced["amplitude"].conj(), "bounces": (traced["face"] >= 0).sum(axis=1)}
        traced["rate"] = _rate(traced, mesh, sensor_poses, self._offset, radar.frame_rate_hz)
        usable = np.isfinite(traced["amplitude"]).all(axis=1) & (traced["face"][:, 0] >= 0)
        mirrored, others = (
            {name: values[usable & mask] for name, values in traced.items()} for mask in (traced["mirrored"], ~traced["mirrored"])
        )
        parts = [_specular(mirrored, mesh, sensor_poses), _diffracted(others, mesh, sensor_poses)]
        return [part for part in parts if len(part)]

    @property
    def _offset(self) -> np.ndarray:
        return self.settings.separation_m * ASIDE

    def traced(self, mesh: SionnaScene, sensor_poses: np.ndarray) -> dict[str, np.ndarray]:
        """Let Sionna search the paths over the mesh of a scene, and return the arrays of `sionna_worker.trace`."""
        s = self.settings
        return ask(_trace, s.variant, mesh, sensor_poses, self._offset, s.max_bounces, s.rays or RAYS, s.diffraction)


def ask(function: Callable[..., Any], *arguments: Any) -> Any:
    """Call a module-level function in the worker process and return its result.

    The first call starts the worker process. If the worker process has died, the next call starts a new one.

    Raises:
        BackendError: the worker refused the call, or the worker process died.
    """
    try:
        return _pool(os.getpid()).submit(function, *arguments).result()
    except BrokenProcessPool:
        close()
        raise BackendError("simulator sionna: its process died, perhaps because memory ran out; run the same command again") from None
    except (BackendError, MemoryError) as error:
        raise BackendError(f"simulator sionna: {error or 'its memory ran out'}") from error
    except KeyboardInterrupt:  # the end of the program would wait for the worker
        close()
        raise


def process_ids() -> list[int]:
    """Return a list with the process id of the worker; the list is empty before the worker has handled its first call."""
    return sorted(_pool(os.getpid()).pids)


def close() -> None:
    """Stop the worker process of Sionna RT."""
    _pool(os.getpid()).end()
    _pool.cache_clear()


@functools.cache
def _pool(pid: int) -> ProcessPool:
    """Return the pool of the process `pid`, because a forked process must not use the worker of its parent process.

    The worker's standard output goes to standard error, because the standard output is reserved for the results of radartwin.
    """
    return ProcessPool(1, functools.partial(os.dup2, 2, 1), import_main=False)


def _trace(preference: str, *arguments: Any) -> dict[str, np.ndarray]:
    """Call `sionna_worker.trace` in the worker process."""
    variant.activate(preference, "mono_polarized")
    from radartwin.simulation.backends import sionna_worker

    return sionna_worker.trace(*arguments)


def _specular(traced: dict[str, np.ndarray], mesh: SionnaScene, sensor_poses: np.ndarray) -> Paths:
    """Build paths of mirror reflections from the facets that Sionna found, by mirroring the sensor in one facet after another."""
    pose = traced["pose"]
    image = np.tile(np.eye(4), (len(pose), 1, 1))  # transformation of the world by the mirrors of each path
    for face in traced["face"].T:
        hit = np.flatnonzero(face >= 0)
        corners = mesh.vertices[np.minimum(pose[hit], len(mesh.vertices) - 1)[:, None], mesh.faces[face[hit]]]
        normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        normal /= np.linalg.norm(normal, axis=1, keepdims=True)
        mirror = np.tile(np.eye(4), (len(hit), 1, 1))
        mirror[:, :3, :3] -= 2 * normal[:, :, None] * normal[:, None, :]
        mirror[:, :3, 3] = 2 * np.einsum("ni,ni->n", normal, corners[:, 0])[:, None] * normal
        image[hit] = mirror @ image[hit]
    # In the sensor frame, the images of the sensor's origin are the vectors along the first and the last section of the unfolded path.
    local = poses_module.inverse(sensor_poses)[pose] @ image @ sensor_poses[pose]
    towards, away = local[:, :3, 3], poses_module.inverse(local)[:, :3, 3]
    length = np.linalg.norm(towards, axis=1)
    there, length = length > 0, np.where(length > 0, length, 1.0)
    amplitude = traced["amplitude"] * (traced["length_m"] / length)[:, None]
    return Paths(
        len(sensor_poses), pose, traced["bounces"], amplitude, mesh.frequencies_hz, length / 2, length / 2, away / length[:, None],
        towards / length[:, None], traced["rate"], local[:, :3, :3],
    ).where(there)  # fmt: skip


def _diffracted(traced: dict[str, np.ndarray], mesh: SionnaScene, sensor_poses: np.ndarray) -> Paths:
    """Build paths that contain a diffraction. Each path is the line from the sensor through the hits that Sionna found,
    and back to the sensor.
    """
    pose, rows, bounces = traced["pose"], np.arange(len(traced["pose"])), traced["bounces"]
    sections = _sections(traced, traced["vertex"], sensor_poses, np.zeros(3))
    length = np.linalg.norm(sections, axis=2)
    out = length[rows, bounces]
    departure, arrival = (
        np.einsum("nji,nj->ni", sensor_poses[pose, :3, :3], line / np.linalg.norm(line, axis=1, keepdims=True))
        for line in (sections[:, 0], -sections[rows, bounces])
    )
    return Paths(
        len(sensor_poses), pose, bounces, traced["amplitude"], mesh.frequencies_hz, length.sum(axis=1) - out, out, departure, arrival,
        traced["rate"],
    )  # fmt: skip


def _sections(traced: dict[str, np.ndarray], vertex: np.ndarray, sensor_poses: np.ndarray, offset: np.ndarray) -> np.ndarray:
    """Return the straight sections of N paths as vectors (N, D + 1, 3) in metres, from the transmitter through the hits to the receiver.

    D is the largest number of hits; paths with fewer hits have zero vectors after their last section.
    """
    pose = traced["pose"]
    stops = np.concatenate([sensor_poses[pose, None, :3, 3], vertex, vertex[:, :1]], axis=1)
    end = sensor_poses[pose, :3, 3] + np.einsum("nij,j->ni", sensor_poses[pose, :3, :3], offset)
    after = np.arange(stops.shape[1]) > traced["bounces"][:, None]
    return np.diff(np.where(after[..., None], end[:, None], stops), axis=1)


def _rate(
    traced: dict[str, np.ndarray], mesh: SionnaScene, sensor_poses: np.ndarray, offset: np.ndarray, frame_rate_hz: float
) -> np.ndarray:
    """Return the rate of change (N,) of the length of the line through each path's hits in m/s, while sensor and surfaces move."""
    pose, face = traced["pose"], traced["face"]
    vertex = traced["vertex"].copy()
    for surface, poses in mesh.poses.items():
        (now,), (later,) = poses_module.moments(poses)
        path, hit = np.nonzero((face >= 0) & (mesh.surface[face] == surface))
        carry = (later @ poses_module.inverse(now))[np.minimum(pose[path], len(poses) - 1)]
        vertex[path, hit] = np.einsum("nij,nj->ni", carry[:, :3, :3], vertex[path, hit]) + carry[:, :3, 3]
    _, (sensor_later,) = poses_module.moments(sensor_poses)
    before, after = (
        np.linalg.norm(_sections(traced, points, poses, offset), axis=2).sum(axis=1)
        for points, poses in ((traced["vertex"], sensor_poses), (vertex, sensor_later))
    )
    return (after - before) / poses_module.MOMENT * frame_rate_hz
