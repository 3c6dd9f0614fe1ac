"""The naive tracer: one ray per pixel of a camera at the radar, each hit a diffuse scatterer with one coherent phase.

Re-implemented from X. Chen, X. Zhang, RF Genesis: Zero-Shot Generalization of mmWave Sensing through Simulation-Based Data
Synthesis and Generative Diffusion Models, SenSys 2023 (doi 10.1145/3625687.3625798) and from what its published program computes. A
baseline: it is right in range and direction only.

`shipped`: rays through the corners of 128 x 128 pixels over 60 degrees; surfaces of albedo 0.8 lit by a spot of intensity 1000 (full to
30 degrees off axis, none at 40) beside the camera; hits nearer than 0.1 m or darker than 0.1 are dropped. The signal's amplitude is the
free-space POWER loss (lambda/(4 pi L))^2 over the whole path L, times what its signal generator takes for the rendered intensity and is
the distance, for the two columns are exchanged. Between two frames each pixel's hit moves on a straight line, and a pixel that misses
keeps the hit of the frame before, or takes that of the next. The chirps of a frame are spread over the whole time to the next one, all
transmitters at once.
`columns`: the same with distance and intensity in their places.
`corrected`: what can be put right within the method. Each ray returns the power of the Lambert patch it stands for,
rho cos(t) dOmega lambda^2/(16 pi^3 r^2) with rho the material's mean power reflection, and its square root is the amplitude; rays
through pixel centres; exact radial speed of the rigid surface; chirp times as the radar has them; an isotropic source, so that the
radar's own pattern counts.
What stays wrong in all: no mirror direction, hence no flash of plates and no bounce in corners; one phase for a patch of many
wavelengths, so that levels grow with the number of rays wherever patches add in phase; nothing outside the field of view; no
polarisation.

Departures from the published program: meshes are two-sided here; the rendered intensity is that of the ray's own hit, not a mean of 32
jittered samples; the camera stands at the radar, which the default scene of the program leaves to the user; a pixel whose hit moves over
`JUMP_M` within a frame has met another surface and is held instead of sweeping through the air. Where its paths go through
`radartwin.simulation.signal.synthesis`, transmitters fire in turn, half a stretched loop apart; `rfgenesis_signal` has the original timing.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from radartwin.constants import SPEED_OF_LIGHT
from radartwin.errors import InputError
from radartwin.radar.chirp import Radar
from radartwin.scene.scene import Scene, Surface
from radartwin.simulation import geometry as geometry_module
from radartwin.simulation import poses as poses_module
from radartwin.simulation import reflection_table, variant
from radartwin.simulation.paths import Paths

VERSIONS = ("shipped", "columns", "corrected")
ALBEDO, SPOT_INTENSITY = 0.8, 1000.0
SPOT_FULL_DEG, SPOT_END_DEG = 30.0, 40.0
LEAST = 0.1  # metres, and of the rendered intensity
LOSS_WAVELENGTH_M = 3e8 / 77e9  # its loss knows one frequency and a round speed of light
JUMP_M = 0.1
SLOW_MPS = 0.02  # apart from faster paths, whose synthesis costs more
MAX_GRID = 4096
MAX_RAYS = 50_000_000  # some gigabytes of paths
RAYS_PER_BLOCK = 2_000_000
AT_REST = 1e-12


@dataclass(frozen=True)
class RFGenesisSettings:
    """What the camera sees and how its hits become signal.

    Attributes:
        version: "shipped", "columns" or "corrected"; see the module.
        grid: pixels along each side of the camera.
        fov_deg: full field of view, in azimuth and elevation.
        variant: "auto", "llvm" or "cuda".
    Raises:
        InputError: an unknown version, a grid or field of view out of range.
    """

    version: str = "shipped"
    grid: int = 128
    fov_deg: float = 60.0
    variant: str = "auto"

    def __post_init__(self) -> None:
        if self.version not in VERSIONS:
            raise InputError(f"rfgenesis: version {self.version!r} is not one of {', '.join(VERSIONS)}")
        if isinstance(self.grid, bool) or not isinstance(self.grid, int) or not 1 <= self.grid <= MAX_GRID:
            raise InputError(f"rfgenesis: grid must be a whole number from 1 to {MAX_GRID}, not {self.grid!r}")
        if not 0 < self.fov_deg < 180:
            raise InputError(f"rfgenesis: fov_deg must lie between 0 and 180 degrees, not {self.fov_deg!r}")


@dataclass(frozen=True)
class Hits:
    """What P rays of F poses meet.

    Attributes:
        directions: (P, 3) unit, in the sensor frame.
        distance: (F, P) metres along the ray, 0 where it meets nothing.
        cosine: (F, P) of the angle from the surface's normal.
        surface: (F, P) index of the surface in the scene, -1 where it meets nothing.
        speed: (F, P) rate of the distance at the ray's hit by rigid motion, m/s.
    """

    directions: np.ndarray
    distance: np.ndarray
    cosine: np.ndarray
    surface: np.ndarray
    speed: np.ndarray


@dataclass(frozen=True)
class RFGenesisBackend:
    """Paths of the naive tracer."""

    settings: RFGenesisSettings = RFGenesisSettings()
    name: ClassVar[str] = "rfgenesis"

    def paths(self, scene: Scene, radar: Radar, sensor_poses: np.ndarray, motion: Mapping[str, np.ndarray] | None = None) -> list[Paths]:
        """One path per ray that hits, in every frame; of one pose where nothing moves.

        Args and returns as in `radartwin.simulation.backends.backend.Backend`.
        Raises:
            InputError: more rays than memory holds; BackendError: no usable LLVM.
        """
        if not len(scene):
            return []
        hits = trace(scene, radar, sensor_poses, motion or {}, self.settings)
        if self.settings.version == "corrected":
            frequency = radar.center_frequency_hz
            return [_paths(hits, _lambert(hits, scene, frequency, self.settings), 2 * hits.speed, hits.surface >= 0, frequency)]
        hits, moved = _between_frames(hits)
        intensity = _rendered(hits)
        weight = hits.distance if self.settings.version == "shipped" else intensity
        seen = (hits.distance > LEAST) & (intensity > LEAST)
        loss = power_loss(2 * np.maximum(hits.distance, LEAST))
        # a loop of our timing stands for a share of the whole frame of theirs
        spread = 1 / (radar.num_chirps * radar.loop_interval_s)
        classes = (moved == 0, np.abs(moved) * radar.frame_rate_hz <= SLOW_MPS, np.full(moved.shape, True))
        parts, left = [], seen
        for chosen in classes:
            if (left & chosen).any():
                parts.append(_paths(hits, weight * loss, 2 * moved * spread, left & chosen, radar.center_frequency_hz))
            left = left & ~chosen
        return parts


def power_loss(length_m: np.ndarray) -> np.ndarray:
    """(lambda/(4 pi L))^2 of the whole path, which the method takes for an amplitude."""
    return (LOSS_WAVELENGTH_M / (4 * np.pi * length_m)) ** 2


def pixel_directions(settings: RFGenesisSettings) -> np.ndarray:
    """(P, 3) unit vectors in the sensor frame, rows from the top, each row from the left."""
    offset = 0.5 if settings.version == "corrected" else 0.0
    across = (1 - 2 * (np.arange(settings.grid) + offset) / settings.grid) * np.tan(np.radians(settings.fov_deg) / 2)
    up, left = np.meshgrid(across, across, indexing="ij")
    ahead = np.stack([np.ones(left.size), left.ravel(), up.ravel()], axis=1)
    return ahead / np.linalg.norm(ahead, axis=1, keepdims=True)


def trace(scene: Scene, radar: Radar, sensor_poses: np.ndarray, motion: Mapping[str, np.ndarray], settings: RFGenesisSettings) -> Hits:
    """First hits of all rays and poses; of one pose where neither sensor nor surfaces move.

    Raises:
        InputError: more than MAX_RAYS.
    """
    variant.activate(settings.variant)
    if all(float(np.abs(poses - poses[:1]).max()) < AT_REST for poses in (sensor_poses, *motion.values())):
        sensor_poses, motion = sensor_poses[:1], {name: poses[:1] for name, poses in motion.items()}
    directions = pixel_directions(settings)
    frames, rays = len(sensor_poses), len(directions)
    if frames * rays > MAX_RAYS:
        raise InputError(f"rfgenesis: {frames} frames of {rays} rays are over {MAX_RAYS:_}; take fewer frames or a smaller grid")
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
            origins = np.broadcast_to(sensor[block, None, :3, 3], turned.shape)
            found, cos, face = first_hits(built, origins.reshape(-1, 3), turned.reshape(-1, 3))
            found, cos, face = (values.reshape(turned.shape[:2]) for values in (found, cos, face))
            nearer = found < distance[block]
            radial = -np.einsum("fpi,fi->fp", turned, velocity[block])
            distance[block][nearer], cosine[block][nearer] = found[nearer], cos[nearer]
            speed[block][nearer] = radial[nearer]
            surface[block][nearer] = np.asarray(indices)[built.surface[face[nearer]]]
    return Hits(directions, np.where(np.isfinite(distance), distance, 0.0), cosine, surface, speed)


def first_hits(built: geometry_module.Geometry, origins: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Distance (inf for a miss), cosine of incidence and face of the first triangle along rays (N, 3); distances in float64."""
    import mitsuba as mi

    ray = mi.Ray3f(mi.Point3f(*origins.T.astype(np.float32)), mi.Vector3f(*directions.T.astype(np.float32)))
    hit = built.scene().ray_intersect_preliminary(ray, coherent=True)
    valid, face, rough = np.array(hit.is_valid()), np.array(hit.prim_index).astype(np.int64), np.array(hit.t).astype(float)
    face = np.where(valid, face, 0)
    normals = np.cross(built.corners[:, 1] - built.corners[:, 0], built.corners[:, 2] - built.corners[:, 0])
    normals = (normals / np.linalg.norm(normals, axis=1, keepdims=True))[face]
    slope = np.einsum("ni,ni->n", directions, normals)
    height = np.einsum("ni,ni->n", built.corners[face, 0] - origins, normals)
    steep = np.abs(slope) > 1e-4  # at grazing incidence the float32 distance is the better one
    exact = np.where(steep, height / np.where(steep, slope, 1.0), rough)
    return np.where(valid, exact, np.inf), np.abs(slope), face


def _rigid_parts(surfaces: tuple[Surface, ...], motion: Mapping[str, np.ndarray]) -> list[tuple[list[int], np.ndarray | None]]:
    """Indices of the surfaces that keep their place to one another, with their poses; None for the static ones."""
    parts: list[tuple[list[int], np.ndarray | None]] = [([i for i, s in enumerate(surfaces) if s.name not in motion], None)]
    for index, surface in enumerate(surfaces):
        if surface.name in motion:
            poses = motion[surface.name]
            for indices, known in parts[1:]:
                if known is not None and np.array_equal(known, poses):
                    indices.append(index)
                    break
            else:
                parts.append(([index], poses))
    return [part for part in parts if part[0]]


def _rendered(hits: Hits) -> np.ndarray:
    """(F, P) radiance of a Lambert surface lit by a spot beside the camera."""
    off_axis = np.degrees(np.arccos(np.clip(hits.directions[:, 0], -1, 1)))
    spot = SPOT_INTENSITY * np.clip((SPOT_END_DEG - off_axis) / (SPOT_END_DEG - SPOT_FULL_DEG), 0, 1)
    return np.where(hits.surface >= 0, ALBEDO / np.pi * spot * hits.cosine / np.maximum(hits.distance, 1e-3) ** 2, 0.0)


def _between_frames(hits: Hits) -> tuple[Hits, np.ndarray]:
    """Hits with the pixels that missed filled from their neighbours in time, and the metres (F, P) each moves until the next frame."""
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
    """(F, P) amplitudes whose square is received over transmitted power between isotropic antennas."""
    table = reflection_table.build([(s.material, 0.0) for s in scene.surfaces], frequency_hz)
    power = ((np.abs(table.te) ** 2 + np.abs(table.tm) ** 2) / 2)[:, :, 0]
    angle = np.clip(np.rint(hits.cosine * (reflection_table.COSINES - 1)).astype(int), 0, reflection_table.COSINES - 1)
    albedo = power[np.maximum(hits.surface, 0), angle]
    pixel = (2 * np.tan(np.radians(settings.fov_deg) / 2) / settings.grid) ** 2 * hits.directions[:, 0] ** 3
    wavelength = SPEED_OF_LIGHT / frequency_hz
    returned = albedo * hits.cosine * pixel * wavelength**2 / (16 * np.pi**3 * np.maximum(hits.distance, 1e-3) ** 2)
    return np.sqrt(np.where(hits.surface >= 0, returned, 0.0))


def _paths(hits: Hits, amplitude: np.ndarray, rate_mps: np.ndarray, chosen: np.ndarray, frequency_hz: float) -> Paths:
    pose, pixel = np.nonzero(chosen)
    ray, length = hits.directions[pixel], hits.distance[pose, pixel]
    level = amplitude[pose, pixel].astype(complex)[:, None]
    one = np.ones(len(pose), int)
    return Paths(len(chosen), pose, one, level, np.array([frequency_hz]), length, length, ray, ray, rate_mps[pose, pixel])
