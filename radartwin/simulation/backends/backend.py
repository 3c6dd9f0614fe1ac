"""The Protocol of simulators, and the choice of a simulator by name.

A new simulator is a module with a settings dataclass and a class that follows the Protocol, plus a line in `_kinds`. The contract tests
(tests/contract/test_simulators.py) then include it.
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
    """A simulator that finds propagation paths.

    Attributes:
        name: as in SIMULATORS. settings: a dataclass. Recordings store both.
    """

    name: ClassVar[str]

    @property
    def settings(self) -> Any: ...

    def paths(self, scene: Scene, radar: Radar, sensor_poses: np.ndarray, motion: Mapping[str, np.ndarray] | None = None) -> list[Paths]:
        """Paths of every static part and moving group.

        Args:
            scene: surfaces; surfaces named in `motion` in their own frames.
            radar: waveform, frame rate and element pattern. The synthesis applies the pattern, so amplitudes exclude it.
            sensor_poses: (F, 4, 4) sensor to world, checked.
            motion: (F, 4, 4) object-to-world poses by surface name, checked.
        Returns:
            Parts to add up, each of F poses, or of one pose that holds for all frames; none for an empty scene.
        """
        ...


def backend(name: str, **settings: Any) -> Backend:
    """A simulator by name.

    Args:
        name: one of SIMULATORS.
        settings: fields of its settings dataclass; missing fields have their defaults.
    Raises:
        InputError: unknown name or setting, or a wrong value.

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
    """The simulator of a call that also has tracer settings.

    Raises:
        InputError: not a simulator, an unknown name, or changed tracer settings for a simulator that does not read them.
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
    """Names of the settings of a simulator."""
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
