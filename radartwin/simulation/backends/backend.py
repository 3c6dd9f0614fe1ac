"""The interface (Protocol) of simulators, and functions that choose a simulator by name.

A new simulator is a module with a settings dataclass and a class that follows the Protocol, plus a line in `_kinds`. The contract tests
(tests/contract/test_simulators.py) then test the new simulator.
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
        name: one of SIMULATORS. settings: a dataclass. Recordings store both.
    """

    name: ClassVar[str]

    @property
    def settings(self) -> Any: ...

    def paths(self, scene: Scene, radar: Radar, sensor_poses: np.ndarray, motion: Mapping[str, np.ndarray] | None = None) -> list[Paths]:
        """Return the paths of all static surfaces and of every group of surfaces that move together.

        Args:
            scene: surfaces in the world, except surfaces named in `motion`, which are in their own frames.
            radar: waveform, frame rate and element pattern. Amplitudes exclude the element gain, because the synthesis applies it.
            sensor_poses: (F, 4, 4) sensor to world, already checked.
            motion: (F, 4, 4) object-to-world poses by surface name, already checked.
        Returns:
            Parts whose signals add up, each with F poses or with one pose that holds for all frames. The list is empty for an empty scene.
        """
        ...


def backend(name: str, **settings: Any) -> Backend:
    """Return the simulator of a name, with fields of its settings dataclass. Raises InputError, which names the wrong argument.

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
    """Return the simulator for a call that also passes tracer settings.

    Raises:
        InputError: `simulator` is no simulator or an unknown name, or it ignores tracer settings that differ from their defaults.
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
