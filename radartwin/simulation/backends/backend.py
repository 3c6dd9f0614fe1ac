"""Define the interface (Protocol) that all simulators implement, and functions that choose a simulator by name.

To add a simulator, write a module with a settings dataclass and a class that implements the Protocol, and add a line to `_kinds`. The
contract tests (tests/contract/test_simulators.py) then also test the new simulator.
"""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any, ClassVar, Protocol

import numpy as np

from radartwin.errors import InputError
from radartwin.radar.chirp import Radar
from radartwin.scene.scene import Scene
from radartwin.simulation.backends.mitsuba import MitsubaBackend
from radartwin.simulation.backends.trace_settings import TraceSettings
from radartwin.simulation.paths import Paths

SIMULATORS = ("mitsuba", "rfgenesis", "points", "sionna")


class Backend(Protocol):
    """Find the propagation paths of a scene.

    Attributes:
        name: name of the simulator, one of SIMULATORS. Recordings store this name.
        settings: dataclass instance with the simulator's settings. Recordings store these settings.
    """

    name: ClassVar[str]

    @property
    def settings(self) -> Any: ...

    def paths(
        self,
        scene: Scene,
        radar: Radar,
        sensor_poses: np.ndarray,
        motion: Mapping[str, np.ndarray] | None = None,
        track: np.ndarray | None = None,
    ) -> list[Paths]:
        """Return the propagation paths over all static surfaces and over every group of surfaces that move together.

        Args:
            scene: surfaces in world coordinates. A surface whose name is a key of `motion` is in its own coordinate frame instead.
            radar: waveform, frame rate and element pattern. Path amplitudes exclude the element gain, because the synthesis applies it.
            sensor_poses: (F, 4, 4) transformations from the sensor frame to the world, which the caller has checked.
            motion: (F, 4, 4) transformations from a surface's own frame to the world, by surface name, which the caller has checked.
            track: (T, 4, 4) all sensor poses of a recording, of which `sensor_poses` are a part; None if they are the whole recording. A
                simulator may ignore it, or prepare once for the whole track.
        Returns:
            `Paths` objects whose signals add up. Each has F poses, or one pose that is valid for all frames. The list is empty for a scene
            without surfaces.
        """
        ...


def paths_of_frames(
    tracer: Backend, scene: Scene, radar: Radar, sensor_poses: np.ndarray, motion: Mapping[str, np.ndarray], start: int, stop: int
) -> list[Paths]:
    """Return the paths of the frames `start` to `stop` - 1 of a recording; the other arguments are those of `Backend.paths` for the whole
    recording.

    The frame after a block, or the frame before the last frame, is also traced, because velocities are differences of poses.
    """
    frames = len(sensor_poses)
    if (start, stop) == (0, frames):
        return tracer.paths(scene, radar, sensor_poses, motion)
    low, high = min(start, frames - 2), min(stop + 1, frames)
    parts = tracer.paths(scene, radar, sensor_poses[low:high], {name: poses[low:high] for name, poses in motion.items()}, sensor_poses)
    return [part if part.poses == 1 else part.frames(start - low, stop - low) for part in parts]


def backend(name: str, **settings: Any) -> Backend:
    """Return the simulator with the given name and settings.

    Args:
        name: one of SIMULATORS.
        settings: values for fields of the simulator's settings dataclass; all other fields have their defaults.
    Raises:
        InputError: the name or a setting is unknown, or a value is invalid. The message names the wrong argument.

    >>> backend("rfgenesis", version="corrected").settings.grid
    128
    """
    kinds = _kinds()
    if name not in kinds:
        raise InputError(f"simulator {name!r} is not known; choose one of {', '.join(kinds)}")
    kind, describe = kinds[name]
    known = [f.name for f in fields(describe)]
    if unknown := sorted(set(settings) - set(known)):
        raise InputError(f"simulator {name} has no setting {unknown[0]!r}; it has {', '.join(known)}")
    return kind(describe(**settings))


def resolve(simulator: str | Backend, settings: TraceSettings) -> Backend:
    """Return the simulator for a call that passes both a simulator and settings of the Mitsuba tracer.

    Raises:
        InputError: `simulator` is neither a simulator nor a known name, or a setting differs from its default but `simulator` is not the
            simulator on Mitsuba and would ignore it.
    """
    if simulator == MitsubaBackend.name:
        return MitsubaBackend(settings)
    if settings != TraceSettings():
        changed = [f.name for f in fields(settings) if getattr(settings, f.name) != f.default]
        raise InputError(
            f"{changed[0]} is read by simulator mitsuba only; configure other simulators by backend(name, ...) and pass the result"
        )
    if isinstance(simulator, str):
        return backend(simulator)
    if not callable(getattr(simulator, "paths", None)):
        raise InputError(f"simulator must be one of {', '.join(SIMULATORS)} or a backend, not {simulator!r}")
    return simulator


def settings_of(name: str) -> frozenset[str]:
    """Return the names of a simulator's settings."""
    return frozenset(f.name for f in fields(_kinds()[name][1]))


def _kinds() -> dict[str, tuple[Any, Any]]:
    from radartwin.simulation.backends.rfgenesis import RFGenesisBackend, RFGenesisSettings
    from radartwin.simulation.backends.scatterers import PointBackend, PointSettings
    from radartwin.simulation.backends.sionna import SionnaBackend, SionnaSettings

    return {
        "mitsuba": (MitsubaBackend, TraceSettings),
        "rfgenesis": (RFGenesisBackend, RFGenesisSettings),
        "points": (PointBackend, PointSettings),
        "sionna": (SionnaBackend, SionnaSettings),
    }
