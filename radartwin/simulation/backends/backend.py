"""Define the interface (Protocol) that all simulators implement, and functions that choose a simulator by name.

To add a simulator, write a settings dataclass and a class that implements the Protocol, and name the class in the entry-point group
`radartwin.simulators` of your package (docs/extending.md). A built-in simulator has a line in `_kind` instead, and
tests/contract/test_simulators.py tests it.
"""

from dataclasses import dataclass, fields, is_dataclass
from typing import Any, Protocol

import numpy as np

from radartwin import plugins
from radartwin.errors import InputError
from radartwin.radar.chirp import Radar
from radartwin.scene.scene import Scene
from radartwin.simulation.backends.mitsuba import MitsubaBackend
from radartwin.simulation.backends.trace_settings import TraceSettings
from radartwin.simulation.paths import Paths
from radartwin.simulation.poses import ObjectPoses

SIMULATORS = ("mitsuba", "rfgenesis", "points", "sionna")


class Backend(Protocol):
    """Find the propagation paths of a scene.

    Attributes:
        name: name of the simulator. Recordings store this name.
        settings: dataclass instance with the simulator's settings. Recordings store these settings.
    """

    @property
    def name(self) -> str: ...

    @property
    def settings(self) -> Any: ...

    def paths(
        self, scene: Scene, radar: Radar, sensor_poses: np.ndarray, motion: ObjectPoses | None = None, track: np.ndarray | None = None
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
            `Paths` objects whose signals add up. Each object has F poses, or one pose that is valid for all frames. The list is empty for a
            scene without surfaces.
        """
        ...


def paths_of_frames(
    tracer: Backend, scene: Scene, radar: Radar, sensor_poses: np.ndarray, motion: ObjectPoses, start: int, stop: int
) -> list[Paths]:
    """Return the paths of the frames `start` to `stop` - 1 of a recording; the other arguments are those of `Backend.paths` for the whole
    recording.

    The function also traces the frame after these frames, because velocities are differences of poses. If the only frame is the last one of
    the recording, the function also traces the frame before it.
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
        name: one of SIMULATORS, or the name of a plug-in.
        settings: values for fields of the simulator's settings dataclass; all other fields have their defaults.
    Raises:
        InputError: the name or a setting is unknown, or a value is invalid. The message names the wrong argument.

    >>> backend("rfgenesis", version="corrected").settings.grid
    128
    """
    plugin = plugins.find(plugins.SIMULATORS, name, SIMULATORS)
    kind, describe = _kind(name)
    known = [f.name for f in fields(describe)]
    if unknown := sorted(set(settings) - set(known)):
        raise InputError(f"simulator {name} has no setting {unknown[0]!r}; it has {', '.join(known)}")
    if plugin is None:
        return kind(describe(**settings))
    with plugins.calling(plugin, f"{plugin.value}(...)"):
        return _PluggedIn(kind(describe(**settings)), plugin)


@dataclass(frozen=True)
class _PluggedIn:
    """Hold a plug-in's simulator. An exception in its code becomes an error message of one line that names the package."""

    inner: Any
    plugin: plugins.Plugin

    @property
    def name(self) -> str:
        return self.plugin.name

    @property
    def settings(self) -> Any:
        return self.inner.settings

    def paths(self, *arguments: Any, **options: Any) -> list[Paths]:
        with plugins.calling(self.plugin, "paths"):
            parts = list(self.inner.paths(*arguments, **options))
        if not all(isinstance(part, Paths) for part in parts):
            raise plugins.refusal(self.plugin, "paths returned something else than a list of radartwin.simulation.paths.Paths")
        return parts


def resolve(simulator: str | Backend, settings: TraceSettings) -> Backend:
    """Return the simulator for a call that passes both a simulator and settings of the Mitsuba tracer.

    Raises:
        InputError: `simulator` is neither a simulator nor a known name, or a setting of the Mitsuba tracer differs from its default
            although another simulator is chosen, which ignores this setting.
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


def names(built_in: bool = True) -> list[str]:
    """Return the names of all simulators: the built-in ones, if `built_in` is true, and those of plug-ins."""
    return [*(SIMULATORS if built_in else ()), *plugins.names(plugins.SIMULATORS)]


def settings_of(name: str) -> frozenset[str]:
    """Return the names of a simulator's settings."""
    return frozenset(f.name for f in fields(_kind(name)[1]))


def plugged_in(plugin: plugins.Plugin) -> tuple[Any, Any]:
    """Return the class of a plug-in's simulator and the class of its settings.

    Raises:
        PluginError: the plug-in cannot be imported, or its object is no class of a simulator.
    """
    kind = plugins.load(plugin)
    if not (isinstance(kind, type) and callable(getattr(kind, "paths", None))):
        raise plugins.refusal(plugin, f"{plugin.value} is no class with a method paths(scene, radar, sensor_poses, motion, track)")
    with plugins.calling(plugin, f"{plugin.value}()"):
        settings = kind().settings
    if not is_dataclass(settings) or getattr(kind, "name", None) != plugin.name:
        raise plugins.refusal(plugin, f"{plugin.value} needs name = '{plugin.name}' and a dataclass in settings")
    return kind, type(settings)


def _kind(name: str) -> tuple[Any, Any]:
    """Return the class of a simulator and the class of its settings. Raises InputError for an unknown name."""
    from radartwin.simulation.backends.rfgenesis import RFGenesisBackend, RFGenesisSettings
    from radartwin.simulation.backends.scatterers import PointBackend, PointSettings
    from radartwin.simulation.backends.sionna import SionnaBackend, SionnaSettings

    kinds = {
        "mitsuba": (MitsubaBackend, TraceSettings),
        "rfgenesis": (RFGenesisBackend, RFGenesisSettings),
        "points": (PointBackend, PointSettings),
        "sionna": (SionnaBackend, SionnaSettings),
    }
    plugin = plugins.find(plugins.SIMULATORS, name, SIMULATORS)
    if plugin is not None:
        return plugged_in(plugin)
    if name not in kinds:
        raise InputError(f"simulator {name!r} is not known; choose one of {', '.join(names())}")
    return kinds[name]
