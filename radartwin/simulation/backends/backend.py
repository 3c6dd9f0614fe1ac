"""What finds paths, behind one interface, and the choice of it by name.

A new simulator is a module with a settings dataclass and a class that keeps the Protocol, and a line in `_kinds`; the contract tests
(tests/contract/test_simulators.py) take it from there. Modules are imported by statement, so that their source is part of every run key.
"""

from collections.abc import Mapping
from dataclasses import fields
from typing import Any, ClassVar, Protocol

import numpy as np

from radartwin.errors import InputError
from radartwin.radar.chirp import Radar
from radartwin.scene.scene import Scene
from radartwin.simulation.backends.mitsuba import MitsubaBackend, TraceSettings
from radartwin.simulation.paths import Paths

SIMULATORS = ("mitsuba", "rfgenesis", "points", "sionna")


class Backend(Protocol):
    """Anything that finds paths.

    Attributes:
        name: as in SIMULATORS; recordings name it.
        settings: a dataclass; recordings keep its fields.
    """

    name: ClassVar[str]

    @property
    def settings(self) -> Any: ...

    def paths(self, scene: Scene, radar: Radar, sensor_poses: np.ndarray, motion: Mapping[str, np.ndarray] | None = None) -> list[Paths]:
        """Paths of every static part and moving group.

        Args:
            scene: surfaces; those named in `motion` in their own frames.
            radar: waveform, frame rate, and element pattern, which the synthesis applies.
            sensor_poses: (F, 4, 4) sensor to world, checked.
            motion: (F, 4, 4) object-to-world poses by surface name, checked.
        Returns:
            Parts to be added up, each of F poses, or of one pose that holds for all frames; none for an empty scene.
        """
        ...


def backend(name: str, **settings: Any) -> Backend:
    """A simulator by name.

    Args:
        name: one of SIMULATORS.
        settings: fields of its settings dataclass; those left out take its defaults.
    Raises:
        InputError: an unknown name or setting, or a value the simulator refuses.

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


def resolve(simulator: str | Backend, tubes: TraceSettings) -> Backend:
    """The simulator of a call that also carries settings of the tubes.

    Raises:
        InputError: not a simulator, an unknown name, or settings of the tubes beside another simulator, which would not read them.
    """
    if simulator == MitsubaBackend.name:
        return MitsubaBackend(tubes)
    if tubes != TraceSettings():
        changed = [f.name for f in fields(tubes) if getattr(tubes, f.name) != f.default]
        raise InputError(f"{changed[0]} is read by simulator mitsuba alone; configure others by backend(name, ...) and pass the result")
    if isinstance(simulator, str):
        return backend(simulator)
    if not callable(getattr(simulator, "paths", None)):
        raise InputError(f"simulator must be one of {', '.join(SIMULATORS)} or a backend, not {simulator!r}")
    return simulator


def settings_of(name: str) -> frozenset[str]:
    """Names of a simulator's settings."""
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
