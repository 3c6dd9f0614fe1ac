"""Simulate objects as one isotropic point scatterer each, and each wall of a room as a single mirror reflection.

This simulator is the simplest one of the package. The simulator models no near field, no paths between object and room, and no occlusion.
The shape of an object enters only through a table of its far-field radar cross-section sigma. By the radar equation, a point at distance R
has the amplitude a = sqrt(sigma lambda^2 / ((4 pi)^3 R^4)). A wall at the perpendicular distance d reflects the radar signal like a mirror,
with the amplitude a = Gamma(0) lambda/(4 pi 2d), where Gamma(0) is the wall's reflection coefficient at normal incidence.
"""

import functools
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import trimesh
from trimesh.triangles import points_to_barycentric

from radartwin.constants import SPEED_OF_LIGHT
from radartwin.errors import InputError
from radartwin.materials import Layered
from radartwin.radar.chirp import Radar
from radartwin.scene.scene import Scene, Surface
from radartwin.simulation import geometry, reflection_table
from radartwin.simulation import poses as poses_module
from radartwin.simulation.argument_checks import check_option, check_positive
from radartwin.simulation.paths import Paths
from radartwin.simulation.poses import ObjectPoses
from radartwin.simulation.rcs import rcs
from radartwin.store.digest import array_digest

CROSS_SECTIONS = ("table", "sphere")
ROOMS = ("images", "void")
NEAREST_M = 1e-3  # shortest distance of a point scatterer, in metres; walls that are nearer are ignored
EDGE = 1e-9  # tolerance of barycentric coordinates, so that a point on the diagonal of a rectangular wall lies on both triangles
TABLE_ENTRIES = 100_000  # largest number of cross-sections in memory


@dataclass(frozen=True)
class PointSettings:
    """Set how the point-scatterer simulator models objects and the room.

    Attributes:
        cross_section: "table" uses the object's far-field radar cross-section at the current viewing angle. "sphere" uses the
            cross-section of a ball of the same material, whose radius is half the mean side length of the object's bounding box.
        room: "images" simulates one mirror reflection per wall; "void" ignores the room.
        step_deg: step of the cross-section table in azimuth and in elevation, in degrees. The simulator computes a table entry when it
            first needs this entry.
        rays_per_wavelength2: number of ray tubes per square wavelength with which the simulator computes the cross-sections.
    """

    cross_section: str = "table"
    room: str = "images"
    step_deg: float = 1.0
    rays_per_wavelength2: float = 1.0

    def __post_init__(self) -> None:
        for name, options in (("cross_section", CROSS_SECTIONS), ("room", ROOMS)):
            check_option(f"points: {name}", getattr(self, name), options)
        if not 0 < self.step_deg <= 90:
            raise InputError(f"points: step_deg must be above 0 and at most 90 degrees, not {self.step_deg!r}")
        check_positive("points: rays_per_wavelength2", self.rays_per_wavelength2)


@dataclass(frozen=True)
class PointBackend:
    """Simulate objects as point scatterers and rooms as single mirror reflections at their walls."""

    settings: PointSettings = PointSettings()
    name = "points"

    def paths(
        self, scene: Scene, radar: Radar, sensor_poses: np.ndarray, motion: ObjectPoses | None = None, track: np.ndarray | None = None
    ) -> list[Paths]:
        """Return one `Paths` object per scene object and one for the room. The arguments are those of `backend.Backend.paths`.

        A `Paths` object has a single pose if its surfaces do not move relative to the sensor.
        """
        motion = motion or {}
        parts = []
        walls = [s for s in scene.surfaces if s.name not in motion and s.kind == "room"]
        for surface in scene.surfaces:
            if surface.name in motion or surface.kind == "object":
                sensor, velocity = _relative(sensor_poses, motion.get(surface.name), radar.frame_rate_hz)
                parts.append(self._object(surface, radar, sensor, velocity))
        if walls and self.settings.room == "images":
            sensor, velocity = _relative(sensor_poses, None, radar.frame_rate_hz)
            parts.append(_images(walls, radar, sensor, velocity))
        return [part for part in parts if len(part)]

    def _object(self, surface: Surface, radar: Radar, sensor: np.ndarray, velocity: np.ndarray) -> Paths:
        """Return the paths to the centre of an object's bounding box, for the poses (F, 4, 4) and velocities (F, 3) of the sensor."""
        low, high = surface.mesh.bounds
        away = (low + high) / 2 - sensor[:, :3, 3]
        distance = np.maximum(np.linalg.norm(away, axis=1), NEAREST_M)
        wavelength, frequency = SPEED_OF_LIGHT / radar.center_frequency_hz, radar.center_frequency_hz
        section = self._cross_section(surface, frequency, -away, float((high - low).mean()) / 2)
        level = np.sqrt(section * wavelength**2 / (4 * np.pi) ** 3) / distance**2
        pose = np.arange(len(sensor))
        return _paths(sensor, velocity, pose, level[:, None], np.array([frequency]), away / distance[:, None], distance)

    def _cross_section(self, surface: Surface, frequency_hz: float, towards: np.ndarray, radius_m: float) -> np.ndarray:
        """Return the radar cross-sections (F,) of an object in m^2.

        Args:
            surface: the object.
            frequency_hz: frequency in Hz.
            towards: (F, 3) vectors from the object to the sensor, in the object's frame.
            radius_m: radius in metres of the ball that replaces the object if the setting `cross_section` is "sphere".
        """
        if self.settings.cross_section == "sphere":
            table = reflection_table.build([(surface.material, surface.roughness_m)], frequency_hz)
            return np.full(len(towards), np.pi * radius_m**2 * abs(table.te[0, -1, 0]) ** 2)
        step = self.settings.step_deg
        azimuth = np.rint(np.degrees(np.arctan2(towards[:, 1], towards[:, 0])) / step).astype(int)
        elevation = np.rint(np.degrees(np.arctan2(towards[:, 2], np.hypot(towards[:, 0], towards[:, 1]))) / step).astype(int)
        steps = round(360 / step)
        mesh = _MeshKey(array_digest(np.asarray(surface.mesh.vertices)) + array_digest(np.asarray(surface.mesh.faces)), surface.mesh)
        return np.array([
            _entry(mesh, surface.material, frequency_hz, self.settings.rays_per_wavelength2, step, int(a) % steps, int(e))
            for a, e in zip(azimuth, elevation, strict=True)
        ])  # fmt: skip


@dataclass(frozen=True)
class _MeshKey:
    """Wrap a mesh as a key of a cache. Two keys are equal if the vertices and faces of their meshes are equal."""

    digest: str
    mesh: trimesh.Trimesh = field(compare=False)


@functools.lru_cache(maxsize=TABLE_ENTRIES)
def _entry(
    mesh: _MeshKey, material: str | Layered, frequency_hz: float, density: float, step_deg: float, azimuth: int, elevation: int
) -> float:
    """Compute one table entry: the far-field radar cross-section in m^2 at one azimuth and elevation (both in steps of `step_deg`)."""
    a, e = np.radians(azimuth * step_deg), np.radians(elevation * step_deg)
    direction = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    return rcs(mesh.mesh, direction, frequency=frequency_hz, material=material, rays_per_wavelength2=density)


def _images(walls: Sequence[Surface], radar: Radar, sensor: np.ndarray, velocity: np.ndarray) -> Paths:
    """Return the paths from the sensor straight to a wall and back, for those walls that contain the foot of the perpendicular."""
    high = radar.start_frequency_hz + radar.sampled_bandwidth_hz
    table = reflection_table.build([(s.material, s.roughness_m) for s in walls], radar.start_frequency_hz, high)
    built = geometry.build([s.mesh for s in walls])
    normals = built.area_vectors / np.linalg.norm(built.area_vectors, axis=1, keepdims=True)
    height = np.einsum("fti,ti->ft", sensor[:, None, :3, 3] - built.corners[:, 0], normals)
    foot = sensor[:, None, :3, 3] - height[:, :, None] * normals
    shares = points_to_barycentric(np.tile(built.corners, (len(sensor), 1, 1)), foot.reshape(-1, 3)).reshape(*height.shape, 3)
    on = (shares >= -EDGE).all(axis=2) & (np.abs(height) > NEAREST_M)
    pose, face = _once_per_plane(on, height, normals, built.surface)
    away = -height[pose, face, None] * normals[face]
    distance = np.abs(height[pose, face])
    # Reflection coefficients have the time convention exp(+j omega t), but paths have the phase factor exp(+j k L), so conjugate.
    gamma = np.conj(table.te[built.surface[face], -1])
    level = gamma * (SPEED_OF_LIGHT / table.frequencies_hz) / (8 * np.pi * distance[:, None])
    return _paths(sensor, velocity, pose, level, table.frequencies_hz, away / distance[:, None], distance)


def _once_per_plane(on: np.ndarray, height: np.ndarray, normals: np.ndarray, surface: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the pose indices and face indices of the wall reflections, so that each wall counts only once per pose.

    The foot of the perpendicular may lie on the common edge of two triangles of a wall; only one of these triangles is returned.
    """
    pose, face = np.nonzero(on)
    foot = np.rint(height[pose, face, None] * normals[face] * 1e6).astype(np.int64)
    _, first = np.unique(np.column_stack([pose, surface[face], foot]), axis=0, return_index=True)
    first = np.sort(first)
    return pose[first], face[first]


def _relative(sensor_poses: np.ndarray, group: np.ndarray | None, frame_rate_hz: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the sensor's poses and velocities in the coordinate frame of a surface; only one pose if the poses do not change."""
    sensor, velocity = poses_module.relative(sensor_poses, group, frame_rate_hz)
    return (sensor[:1], velocity[:1]) if poses_module.at_rest(sensor) else (sensor, velocity)


def _paths(
    sensor: np.ndarray, velocity: np.ndarray, pose: np.ndarray, level: np.ndarray, frequencies_hz: np.ndarray, ray: np.ndarray,
    distance: np.ndarray,
) -> Paths:  # fmt: skip
    """Build N paths that go from the sensor along the unit vectors `ray` (N, 3), given in the surface's frame, and back the same way."""
    local = np.einsum("nij,ni->nj", sensor[pose, :3, :3], ray)
    rate = -2 * np.einsum("ni,ni->n", ray, velocity[pose])
    bounces = np.ones(len(pose), int)
    return Paths(len(sensor), pose, bounces, level.astype(complex), frequencies_hz, distance, distance, local, local, rate)
