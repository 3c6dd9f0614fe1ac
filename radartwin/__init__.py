"""RadarTwin simulates a 60 or 77 GHz FMCW radar in a scanned room, from the room's mesh and materials to raw ADC data.

Python imports the module behind a public name when the name is first used, so that `import radartwin` is fast.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from radartwin.constants import __version__ as __version__

if TYPE_CHECKING:
    from radartwin.materials import MATERIAL_THICKNESS, Layered
    from radartwin.radar.chirp import Radar
    from radartwin.radar.recording import Recording
    from radartwin.scene.scene import Scene, Surface
    from radartwin.simulation.rcs import rcs
    from radartwin.simulation.simulate import simulate

_HOMES = {
    "MATERIAL_THICKNESS": "radartwin.materials",
    "Layered": "radartwin.materials",
    "Radar": "radartwin.radar.chirp",
    "Recording": "radartwin.radar.recording",
    "Scene": "radartwin.scene.scene",
    "Surface": "radartwin.scene.scene",
    "rcs": "radartwin.simulation.rcs",
    "simulate": "radartwin.simulation.simulate",
}

__all__ = ["MATERIAL_THICKNESS", "Layered", "Radar", "Recording", "Scene", "Surface", "rcs", "simulate"]


def __getattr__(name: str) -> Any:
    if name not in _HOMES:
        raise AttributeError(f"module 'radartwin' has no attribute {name!r}")
    value = getattr(import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOMES])
