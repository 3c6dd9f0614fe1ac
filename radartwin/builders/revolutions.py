"""Simulate a turntable revolution of each of the user's objects at each distance, and compute feature rows of randomised copies of it.

The radar is level with the aim height of the object (`OwnObject.aim_m`), and the axis of the turntable is on the boresight.
"""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from radartwin.adaptive.limits import Limits
from radartwin.builders.radar import build_radar
from radartwin.builders.recording import Setup, simulate_setup
from radartwin.builders.scene import TARGET, add_layout, build_room, describe_room
from radartwin.builders.simulator import fixed_simulator, simulator_options
from radartwin.builders.trajectory import build_course, check_course
from radartwin.config.config import Config
from radartwin.config.simulator import AutoSimulator
from radartwin.config.trajectory import TurntableTrajectory
from radartwin.errors import ConfigError, InputError, SceneError
from radartwin.features.envelope import HARMONICS
from radartwin.features.log import Nominal
from radartwin.features.processed import Processed, process
from radartwin.features.profile import FAR_M, NEAR_M
from radartwin.recognize.own.copied_rows import feature_rows
from radartwin.recognize.own.object_list import OwnObject
from radartwin.recognize.randomise import Randomisation, echoes_alone
from radartwin.recognize.samples import SIMULATED, Part
from radartwin.scene import objects, rooms
from radartwin.scene.collision import first_crossing, overlap_m
from radartwin.scene.scene import Scene
from radartwin.scene.storage import material_to_json
from radartwin.scene.trajectories.trajectory import pose
from radartwin.store import array_cache
from radartwin.store.digest import array_digest
from radartwin.store.products import Store, save_arrays

REVOLUTION, COPIES = "revolution", "revolution_copies"  # kinds of stored results
ROOTS = ["radartwin.builders.recording", "radartwin.features.processed"]
COPIES_ROOTS = ["radartwin.recognize.own.copied_rows", "radartwin.builders.revolutions"]
ROOM_BYTES = 4_000_000_000  # disk space for the paths of the rooms, which the revolutions of all objects at one distance share
FEWEST_FRAMES = 2 * HARMONICS + 1  # the highest harmonic of a revolution needs more than two frames per cycle


@dataclass(frozen=True, eq=False)
class Revolution:
    """One revolution of an object at one distance, before its simulation."""

    label: str  # name of the object
    distance_m: float
    setup: Setup
    config: Config  # of which only the simulator, the features, the seed and the number of copies are read
    root: Path  # folder of the store

    @property
    def frames(self) -> int:
        return len(self.setup.course.target_poses)

    @property
    def log(self) -> Nominal:
        angle_rad = self.setup.course.angle_rad
        assert angle_rad is not None
        return Nominal(self.setup.radar.frame_rate_hz, np.full(len(angle_rad), self.distance_m), angle_rad)

    @cached_property
    def spec(self) -> dict[str, Any]:
        """Return the specification that decides the store key of the revolution, without the object's name."""
        course, simulator = self.setup.course, self.config.simulator
        spec: dict[str, Any] = {
            "room": _identity(self.setup.room), "object": _identity(self.setup.target), "radar": self.setup.radar.to_dict(),
            "sensor": array_digest(np.round(course.sensor_poses, 9)), "poses": array_digest(np.round(course.target_poses, 9)),
            "simulator": simulator,
        }  # fmt: skip
        if isinstance(simulator, AutoSimulator):
            spec |= {"features": self.config.features, "limits": Limits.shipped(self.setup.measured_motion, self.label).of}
        return spec

    def is_stored(self, store: Store) -> bool:
        key = store.key(REVOLUTION, self.spec, ROOTS)
        return store.holds(REVOLUTION, self.spec, ROOTS) and store.holds(COPIES, self._copies_spec(key), COPIES_ROOTS)

    def part(self, store: Store) -> tuple[str, tuple[str, ...], Part]:
        """Return the store key of the copies, and the names and rows of their features, which are computed if they are missing."""
        product = store.fetch(REVOLUTION, self.spec, ROOTS, self._simulate)
        key = product.key

        def build(folder: Path) -> None:
            supervision, seed = self.config.supervision, [self.config.seed, int(key[:8], 16)]
            strengths = Randomisation(**asdict(supervision.randomise))
            echoes = self._echoes(strengths, seed) if strengths.moves_target else []
            names, values = feature_rows(Processed.load(product.path), self.log, echoes, supervision.copies, strengths, seed)
            save_arrays(folder, {"names": np.array(names), "values": values})

        copied = store.fetch(COPIES, self._copies_spec(key), COPIES_ROOTS, build)
        stored = copied.arrays()
        stratum = f"{self.distance_m:g} m"
        part = Part(f"{self.label} {stratum}", self.label, SIMULATED, stored["values"], stratum)
        return copied.key, tuple(map(str, stored["names"])), part

    def _copies_spec(self, key: str) -> dict[str, Any]:
        log = self.log
        return {
            "of": key, "count": self.config.supervision.copies, "seed": self.config.seed,
            "distance_m": log.distance_m, "angle_rad": log.angle_rad, "variants": self.config.supervision.variants,
            "randomise": asdict(self.config.supervision.randomise),
        }  # fmt: skip

    def _echoes(self, strengths: Randomisation, seed: Sequence[int]) -> Sequence[np.ndarray]:
        """Return the signals of the nominal object alone in free space, and of each randomly changed object (`echoes_alone`)."""
        course, supervision = self.setup.course, self.config.supervision
        surfaces = [surface for surface in self.setup.target if surface.name == TARGET]
        count, options = min(supervision.variants, supervision.copies), simulator_options(fixed_simulator(self.config.simulator))
        return list(echoes_alone(surfaces, self.setup.radar, course.sensor_poses, course.target_poses, strengths, count, seed, **options))

    def _simulate(self, folder: Path) -> dict[str, int]:
        with array_cache.in_folder(self.root / "paths", ROOM_BYTES) if len(self.setup.room) else contextlib.nullcontext():
            recording = simulate_setup(self.setup, self.config, self.label, store=Store(self.root))
        process(recording, doppler=False).save(folder)
        return {"frames": recording.num_frames}


def compute(revolution: Revolution) -> None:
    """Simulate a revolution and compute its copies, unless the store holds them. Worker processes call this function."""
    revolution.part(Store(revolution.root))


def plan(
    config: Config, own_objects: Sequence[OwnObject], distances_m: Sequence[float], frames: int | None, root: Path
) -> tuple[list[Revolution], dict[str, Any]]:
    """Return the revolutions of all objects at all distances, and a description of the room. Raises UserError.

    frames: number of frames per revolution; None computes it from the frame rate of the configured radar. root: folder of the store.
    """
    trajectory = config.trajectory
    if not isinstance(trajectory, TurntableTrajectory):
        raise ConfigError(f"trajectory={trajectory.kind} has no turntable; leave it out, because train reads trajectory=turntable only")
    radar = build_radar(config.radar)
    frames = round(trajectory.period_s * radar.frame_rate_hz) if frames is None else frames
    if frames < FEWEST_FRAMES:
        raise InputError(f"{frames} frames per revolution are too few for the features; give at least --frames {FEWEST_FRAMES}")
    check_distances(distances_m)
    try:
        radar = replace(radar, frame_rate_hz=frames / trajectory.period_s)
    except InputError as error:  # the chirps of a frame take longer than a frame
        raise InputError(f"--frames {frames} in {trajectory.period_s:g} s need too high a frame rate ({error}); lower --frames") from error
    room = build_room(config.scene, config.materials, config.seed)
    described = describe_room(room, config.scene, config.materials)
    revolutions: list[Revolution] = []
    for distance_m in distances_m:
        course = build_course(replace(trajectory, distance_m=distance_m), radar, room)
        if not revolutions:
            room = add_layout(config.scene, room, course.sensor_poses[0])
            check_course(room, radar, course)
        for own_object in own_objects:
            facing = pose([0.0, 0.0, -own_object.aim_m], np.diag([-1.0, -1.0, 1.0]))  # in the first frame, the front faces the radar
            target = Scene(surface.moved(facing).replaced(name=TARGET) for surface in own_object.surfaces)
            axis = course.target_poses[0, :3, 3]
            _check_place(room, own_object, course.sensor_poses[0, :3, 3], axis, distance_m)
            placed = rooms.support(axis - [0, 0, own_object.aim_m + rooms.GAP]) + target if config.scene.stand else target
            setup = Setup(room, placed, radar, course, {TARGET: course.target_poses}, described)
            revolutions.append(Revolution(own_object.name, distance_m, setup, config, root))
    return revolutions, described


def check_distances(distances_m: Sequence[float]) -> None:
    """Raise InputError for distances that are outside the range of the features, that occur twice, or that are missing."""
    if not distances_m:
        raise InputError("no distance is given; give --distances in metres, such as 0.5,1,1.5,2")
    for number, distance_m in enumerate(distances_m):
        if not NEAR_M <= distance_m <= FAR_M:
            raise InputError(
                f"--distances: {distance_m:g} m is not between {NEAR_M} and {FAR_M} m, the range of the features; give other distances"
            )
        if distance_m in distances_m[:number]:
            raise InputError(f"--distances: {distance_m:g} m is given twice; leave one out")


def _check_place(room: Scene, own_object: OwnObject, sensor: np.ndarray, axis: np.ndarray, distance_m: float) -> None:
    """Raise SceneError if the turning object would touch the radar or a surface of the room, or if a surface hides it from the radar."""
    where = f"{own_object.name} at {distance_m:g} m"
    remedy = "move the radar (trajectory.position_m, trajectory.heading_deg) or change --distances"
    if own_object.radius_m >= distance_m:
        raise SceneError(f"{where} reaches {own_object.radius_m:.2f} m from its axis and touches the radar; use a larger distance")
    height = float(own_object.size_m[2])
    swept = objects.cylinder(own_object.radius_m, height, 24).apply_transform(pose(axis + np.array([0, 0, height / 2 - own_object.aim_m])))
    for surface in room:
        if first_crossing(sensor[None], axis[None], surface.mesh) is not None:
            raise SceneError(f"{where} is hidden from the radar by surface '{surface.name}'; {remedy}")
        if (depth := overlap_m(swept, surface.mesh)) > 0:
            raise SceneError(f"{where} overlaps surface '{surface.name}' by {100 * depth:.0f} cm while it turns; {remedy}")


def _identity(scene: Scene) -> list[dict[str, Any]]:
    """Return the values that determine the echo of each surface, such as mesh, material and roughness, for a store key."""
    return [
        {
            "vertices": array_digest(np.asarray(surface.mesh.vertices, dtype=np.float64)),
            "faces": array_digest(np.asarray(surface.mesh.faces, dtype=np.int64)),
            "material": material_to_json(surface.material),
            "roughness_m": surface.roughness_m,
            "correlation_m": surface.correlation_m,
            "role": surface.kind,
            "moves": surface.name == TARGET,
        }
        for surface in scene
    ]
