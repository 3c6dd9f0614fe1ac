"""Simulate a scene like the program RF Genesis: one ray per camera pixel, and each hit is a point scatterer with a single phase.

This module calls that method the naive tracer. The module implements the method anew from X. Chen, X. Zhang, RF Genesis: Zero-Shot
Generalization of mmWave Sensing through Simulation-Based Data Synthesis and Generative Diffusion Models, SenSys 2023 (doi
10.1145/3625687.3625798), and from the behaviour of the program that the authors of RF-Genesis released (the original program). The naive
tracer serves as a baseline for comparison. The naive tracer is correct only in range and direction. It has two versions:

- The version `shipped` computes the same as the original RF-Genesis program. Rays pass through the corners of 128 x 128 camera pixels over
  a field of view of 60 degrees. Surfaces have the albedo 0.8. A spotlight of intensity 1000 beside the camera illuminates them; its
  intensity is full up to 30 degrees off axis and zero beyond 40 degrees. The tracer drops hits nearer than 0.1 m and hits with a rendered
  light intensity below 0.1. The signal amplitude of a hit is the free-space POWER loss (lambda/(4 pi L))^2 over the whole path length L,
  times a weight. The weight should be the rendered intensity, but it is the distance, because the original RF-Genesis program exchanges
  the columns of intensity and distance. Between two frames, the hit of each pixel moves on a straight line. A pixel without a hit uses its
  hit in the previous frame, or else in the next frame. The chirps of a frame are spread over the whole frame period, and all transmitters
  transmit at the same time.
- The version `corrected` is as correct as the method allows. A pixel sees a Lambert patch, whose received over transmitted power is rho
  cos(t) dOmega lambda^2/(16 pi^3 r^2). Here rho is the mean power reflection of the material, t the angle of incidence, dOmega the solid
  angle of the pixel and r the distance. The signal amplitude is the square root of this power. Rays pass through pixel centres, the radial
  speed of rigid surfaces is exact, chirps have the radar's timing, and the radar's own antenna pattern applies.

Both versions have the following errors of the method. There is no mirror reflection, so plates have no specular echo and corners have no
multiple bounces. A surface patch of many wavelengths has a single phase, so the echo grows with the number of rays where patches add in
phase. Surfaces outside the field of view return no power. There is no polarisation.

This module differs from the original RF-Genesis program in these points. Meshes reflect on both sides. The rendered intensity is that of
the ray's own hit, while the program averages 32 randomly displaced samples. The camera is at the radar. A hit that would move more than
`JUMP_M` within a frame stays fixed, because the pixel sees another surface in the next frame. In the paths for
`radartwin.simulation.signal.synthesis`, the transmitters transmit one after another, at equal intervals within the stretched chirp loop.
The module `rfgenesis_signal` has the original timing.
"""

from dataclasses import dataclass

import numpy as np

from radartwin.constants import SPEED_OF_LIGHT
from radartwin.errors import InputError
from radartwin.radar.chirp import Radar
from radartwin.scene.scene import Scene, Surface
from radartwin.simulation import geometry as geometry_module
from radartwin.simulation import poses as poses_module
from radartwin.simulation import reflection_table, variant
from radartwin.simulation.argument_checks import check_option, check_whole
from radartwin.simulation.paths import Paths
from radartwin.simulation.poses import ObjectPoses

VERSIONS = ("shipped", "corrected")
ALBEDO, SPOT_INTENSITY = 0.8, 1000.0
SPOT_FULL_DEG, SPOT_END_DEG = 30.0, 40.0
MIN_VISIBLE = 0.1  # hits at a smaller distance (in metres) or with a smaller rendered intensity are dropped
LOSS_WAVELENGTH_M = 3e8 / 77e9  # wavelength in metres with which the published program computes the free-space loss
JUMP_M = 0.1  # a hit that would move more metres than this within a frame stays fixed
# Speed limit in m/s. Paths that are slower form a separate `Paths` object, because the synthesis of faster paths takes longer.
SLOW_MPS = 0.02
MAX_GRID = 4096  # largest number of camera pixels along each side
MAX_RAYS = 50_000_000  # largest number of rays of all frames together; the paths of this number of rays need some gigabytes
RAYS_PER_BLOCK = 2_000_000


@dataclass(frozen=True)
class RFGenesisSettings:
    """Settings of the naive tracer's camera and signal model.

    Attributes:
        version: "shipped" or "corrected"; the module's docstring describes these versions.
        grid: number of camera pixels along each side of the image.
        fov_deg: full field of view of the camera in azimuth and in elevation, in degrees.
        variant: Mitsuba variant that traces the rays: "llvm" (CPU), "cuda" (GPU), or "auto" (GPU if the computer has one).
    """

    version: str = "shipped"
    grid: int = 128
    fov_deg: float = 60.0
    variant: str = "auto"

    def __post_init__(self) -> None:
        check_option("rfgenesis: version", self.version, VERSIONS)
        check_whole("rfgenesis: grid", self.grid, 1, MAX_GRID)
        if not 0 < self.fov_deg < 180:
            raise InputError(f"rfgenesis: fov_deg must lie between 0 and 180 degrees, not {self.fov_deg!r}")


@dataclass(frozen=True)
class Hits:
    """Hold the first hit of each of P rays at each of F sensor poses."""

    directions: np.ndarray  # (P, 3) unit directions of the rays in the sensor frame
    distance: np.ndarray  # (F, P) distance from the sensor to the hit in metres; 0 if the ray hits nothing
    cosine: np.ndarray  # (F, P) cosine of the angle between ray and surface normal
    surface: np.ndarray  # (F, P) index of the scene surface that the ray hits; -1 if the ray hits nothing
    speed: np.ndarray  # (F, P) rate of change of the distance by the rigid motion of sensor and surface, in m/s


@dataclass(frozen=True)
class RFGenesisBackend:
    """Simulate scenes with the naive tracer, which this module's docstring describes."""

    settings: RFGenesisSettings = RFGenesisSettings()
    name = "rfgenesis"

    def paths(
        self, scene: Scene, radar: Radar, sensor_poses: np.ndarray, motion: ObjectPoses | None = None, track: np.ndarray | None = None
    ) -> list[Paths]:
        """Return one path per hit and frame. If neither sensor nor surfaces move, the paths have a single pose.

        The arguments are those of `backend.Backend.paths`, and the errors are those of `trace`.
        """
        if not len(scene):
            return []
        hits = trace(scene, radar, sensor_poses, motion or {}, self.settings)
        if self.settings.version == "corrected":
            frequency = radar.center_frequency_hz
            return [_paths(hits, _lambert(hits, scene, frequency, self.settings), 2 * hits.speed, hits.surface >= 0, frequency)]
        hits, moved = _between_frames(hits)
        intensity = _rendered(hits)
        seen = (hits.distance > MIN_VISIBLE) & (intensity > MIN_VISIBLE)
        loss = power_loss(2 * np.maximum(hits.distance, MIN_VISIBLE))
        # The published program spreads the chirp loops of a frame over the whole frame period.
        spread = 1 / (radar.num_chirps * radar.loop_interval_s)
        classes = (moved == 0, np.abs(moved) * radar.frame_rate_hz <= SLOW_MPS, np.full(moved.shape, True))
        parts, left = [], seen
        for in_class in classes:
            if (left & in_class).any():
                parts.append(_paths(hits, hits.distance * loss, 2 * moved * spread, left & in_class, radar.center_frequency_hz))
            left = left & ~in_class
        return parts


def power_loss(length_m: np.ndarray) -> np.ndarray:
    """Return the free-space power loss (lambda/(4 pi L))^2 for path lengths L; the original RF-Genesis program uses it as an amplitude."""
    return (LOSS_WAVELENGTH_M / (4 * np.pi * length_m)) ** 2


def pixel_directions(settings: RFGenesisSettings) -> np.ndarray:
    """Return the unit ray directions (P, 3) of all camera pixels in the sensor frame, row by row from the top and from left to right."""
    offset = 0.5 if settings.version == "corrected" else 0.0
    across = (1 - 2 * (np.arange(settings.grid) + offset) / settings.grid) * np.tan(np.radians(settings.fov_deg) / 2)
    up, left = np.meshgrid(across, across, indexing="ij")
    ahead = np.stack([np.ones(left.size), left.ravel(), up.ravel()], axis=1)
    return ahead / np.linalg.norm(ahead, axis=1, keepdims=True)


def trace(scene: Scene, radar: Radar, sensor_poses: np.ndarray, motion: ObjectPoses, settings: RFGenesisSettings) -> Hits:
    """Find the first hits of all rays at all sensor poses, or at a single pose if neither sensor nor surfaces move.

    Raises:
        InputError: the number of rays of all poses together exceeds MAX_RAYS.
    """
    variant.activate(settings.variant)
    if poses_module.at_rest(sensor_poses, *motion.values()):
        sensor_poses, motion = sensor_poses[:1], {name: poses[:1] for name, poses in motion.items()}
    frames, rays = len(sensor_poses), settings.grid**2
    if frames * rays > MAX_RAYS:
        raise InputError(f"rfgenesis: {frames} frames of {rays} rays are over {MAX_RAYS:_}; use fewer frames or a smaller grid")
    directions = pixel_directions(settings)
    distance = np.full((frames, rays), np.inf)
    cosine, speed, surface = np.zeros((frames, rays)), np.zeros((frames, rays)), np.full((frames, rays), -1)
    for indices, group in _rigid_parts(scene.surfaces, motion):
        built = geometry_module.build([scene.surfaces[i].mesh for i in indices])
        if not len(built.corners):
            continue
        sensor, velocity = poses_module.relative(sensor_poses, group, radar.frame_rate_hz)
        step = max(1, RAYS_PER_BLOCK // rays)
        for start in range(0, frames, step):
            block = slice(start, start + step)
            turned = np.einsum("fij,pj->fpi", sensor[block, :3, :3], directions)
            away, cos, face = first_hits(built, np.broadcast_to(sensor[block, None, :3, 3], turned.shape), turned)
            nearer = away < distance[block]
            hit = away, cos, -np.einsum("fpi,fi->fp", turned, velocity[block]), np.asarray(indices)[built.surface[face]]
            for every, values in zip((distance, cosine, speed, surface), hit, strict=True):
                every[block][nearer] = values[nearer]
    return Hits(directions, np.where(np.isfinite(distance), distance, 0.0), cosine, surface, speed)


def first_hits(built: geometry_module.Geometry, origins: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Find the first hits of rays with start points and unit directions (..., 3).

    Returns:
        Distance (...) float64 in metres, which is infinite if the ray hits nothing, cosine of incidence (...) and face index (...).
    """
    import mitsuba as mi

    start, way = (values.reshape(-1, 3).T.astype(np.float32) for values in (origins, directions))
    ray = mi.Ray3f(mi.Point3f(*start), mi.Vector3f(*way))
    hit, shape = built.scene.ray_intersect_preliminary(ray, coherent=True), origins.shape[:-1]
    valid, face, rough = (np.array(values).reshape(shape) for values in (hit.is_valid(), hit.prim_index, hit.t))
    face = np.where(valid, face.astype(np.int64), 0)
    normals = (built.area_vectors / np.linalg.norm(built.area_vectors, axis=1, keepdims=True))[face]
    slope = np.einsum("...i,...i->...", directions, normals)
    height = np.einsum("...i,...i->...", built.corners[face, 0] - origins, normals)
    steep = np.abs(slope) > 1e-4  # at grazing incidence, Mitsuba's float32 distance is more accurate than the computed float64 distance
    exact = np.where(steep, height / np.where(steep, slope, 1.0), rough)
    return np.where(valid, exact, np.inf), np.abs(slope), face


def _rigid_parts(surfaces: tuple[Surface, ...], motion: ObjectPoses) -> list[tuple[list[int], np.ndarray | None]]:
    """Group the indices of surfaces that move together. Each group has its poses (F, 4, 4); the group of static surfaces has None."""
    moving = poses_module.rigid_groups({s.name: motion[s.name] for s in surfaces if s.name in motion})
    parts: list[tuple[list[int], np.ndarray | None]] = [([i for i, s in enumerate(surfaces) if s.name not in motion], None)]
    parts += [([i for i, s in enumerate(surfaces) if s.name in names], motion[names[0]]) for names in moving]
    return [part for part in parts if part[0]]


def _rendered(hits: Hits) -> np.ndarray:
    """Return the rendered intensity (F, P): the radiance of Lambert surfaces that the spotlight beside the camera illuminates."""
    off_axis = np.degrees(np.arccos(np.clip(hits.directions[:, 0], -1, 1)))
    spot = SPOT_INTENSITY * np.clip((SPOT_END_DEG - off_axis) / (SPOT_END_DEG - SPOT_FULL_DEG), 0, 1)
    return np.where(hits.surface >= 0, ALBEDO / np.pi * spot * hits.cosine / np.maximum(hits.distance, 1e-3) ** 2, 0.0)


def _between_frames(hits: Hits) -> tuple[Hits, np.ndarray]:
    """Give each pixel without a hit its hit in the previous or the next frame.

    Returns:
        The hits, and the change (F, P) of each hit's distance until the next frame, in metres.
    """
    distance, cosine, surface = hits.distance.copy(), hits.cosine.copy(), hits.surface.copy()
    for frame in range(len(distance) - 1):
        for into, source in ((frame, frame + 1), (frame + 1, frame)):
            missed = surface[into] < 0
            for values in (distance, cosine, surface):
                values[into][missed] = values[source][missed]
    moved = np.zeros(distance.shape)
    if len(distance) > 1:
        moved[:-1] = np.diff(distance, axis=0)
        moved[-1] = moved[-2]
        moved[np.abs(moved) > JUMP_M] = 0.0
        moved[np.abs(moved) < 1e-9] = 0.0
    return Hits(hits.directions, distance, cosine, surface, hits.speed), moved


def _lambert(hits: Hits, scene: Scene, frequency_hz: float, settings: RFGenesisSettings) -> np.ndarray:
    """Return the amplitudes (F, P) of the version `corrected`; their square is received over transmitted power for isotropic antennas."""
    table = reflection_table.build([(s.material, 0.0) for s in scene.surfaces], frequency_hz)
    power = ((np.abs(table.te) ** 2 + np.abs(table.tm) ** 2) / 2)[:, :, 0]
    angle = np.clip(np.rint(hits.cosine * (power.shape[1] - 1)).astype(int), 0, power.shape[1] - 1)
    albedo = power[np.maximum(hits.surface, 0), angle]
    pixel = (2 * np.tan(np.radians(settings.fov_deg) / 2) / settings.grid) ** 2 * hits.directions[:, 0] ** 3
    wavelength = SPEED_OF_LIGHT / frequency_hz
    returned = albedo * hits.cosine * pixel * wavelength**2 / (16 * np.pi**3 * np.maximum(hits.distance, 1e-3) ** 2)
    return np.sqrt(np.where(hits.surface >= 0, returned, 0.0))


def _paths(hits: Hits, amplitude: np.ndarray, rate_mps: np.ndarray, mask: np.ndarray, frequency_hz: float) -> Paths:
    pose, pixel = np.nonzero(mask)
    ray, length = hits.directions[pixel], hits.distance[pose, pixel]
    level = amplitude[pose, pixel].astype(complex)[:, None]
    bounces = np.ones(len(pose), int)
    return Paths(len(mask), pose, bounces, level, np.array([frequency_hz]), length, length, ray, ray, rate_mps[pose, pixel])
