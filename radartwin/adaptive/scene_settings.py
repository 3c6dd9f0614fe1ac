"""Model of a scene: the simulation settings that the search may lower, such as the parts of the room and the number of bounces."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from radartwin.errors import InputError
from radartwin.materials import half_space
from radartwin.radar.chirp import Radar
from radartwin.radar.recording import Recording
from radartwin.scene.scene import Scene
from radartwin.simulation.backends.backend import backend
from radartwin.simulation.simulate import simulate

NONE, LARGE, WHOLE = "none", "large", "whole"
LARGE_M = 1.0  # smallest extent of a large surface: walls, tables and cupboards, but not boxes, bins and bags


@dataclass(frozen=True)
class Model:
    """Describe the settings with which the mitsuba simulator models a scene.

    Attributes:
        parts: simulated parts of the room: "none", "large" (surfaces with an extent of at least LARGE_M) or "whole".
        max_bounces, coupling, diffuse, rays_per_wavelength2: the options of the same names in `TraceSettings`.
        elements: "planar" or "exact", the option of the same name in `simulate`.
        layered: whether walls and objects have layers. If `layered` is False, each surface is a half-space of its outermost material. The
            search always simulates the layers, because layers take no additional time.
    """

    parts: str = WHOLE
    max_bounces: int = 4
    coupling: bool = True
    diffuse: bool = True
    rays_per_wavelength2: float = 1.0
    elements: str = "exact"
    layered: bool = True

    def __post_init__(self) -> None:
        if self.parts not in (NONE, LARGE, WHOLE):
            raise InputError(f"parts must be {NONE}, {LARGE} or {WHOLE}, not {self.parts!r}")

    @property
    def told(self) -> str:
        """Return a short description of the model, such as "no room, 2 bounces, 0.25 tubes, planar"."""
        words = {NONE: "no room", LARGE: "large surfaces", WHOLE: "whole room"}[self.parts]
        bounces = f"{self.max_bounces} bounce{'s' * (self.max_bounces > 1)}"
        coupled = "" if self.coupling or self.parts == NONE or self.max_bounces == 1 else ", uncoupled"
        cloud = "" if self.diffuse else ", no cloud"
        layers = "" if self.layered else ", no layers"
        return f"{words}, {bounces}{coupled}{cloud}, {self.rays_per_wavelength2:g} tubes, {self.elements}{layers}"

    def settings(self) -> dict[str, Any]:
        return {name: value for name, value in asdict(self).items() if name not in ("parts", "elements", "layered")}

    def recording(
        self, room: Scene, kept: Scene, radar: Radar, sensor_poses: np.ndarray, motion: dict[str, np.ndarray], variant: str = "auto"
    ) -> Recording:
        """Simulate a recording, including thermal noise, with the settings of this model.

        Args:
            kept: surfaces that every model includes: the object under test and its stand.
        """
        scene = reduced(room, self.parts) + kept
        if not self.layered:
            scene = Scene((s.replaced(material=half_space(s.material)) for s in scene), scene.provenance)
        return simulate(
            scene, radar, sensor_poses, motion=motion or None, noise=True, elements=self.elements,
            simulator=backend("mitsuba", variant=variant, place_spacing_m=0, **self.settings()),
        )  # fmt: skip


# Dimensions in the order of the search, with values from cheap to expensive. The tube density comes first, because a lower density makes
# all later trials cheaper.
LADDER: dict[str, tuple[Any, ...]] = {
    "rays_per_wavelength2": (0.25, 1.0, 4.0),
    "parts": (NONE, LARGE, WHOLE),
    "max_bounces": (1, 2, 3, 4, 5),
    "coupling": (False, True),
    "elements": ("planar", "exact"),
    "diffuse": (False, True),
}
FINEST = Model(**{name: values[-1] for name, values in LADDER.items()})
DEFAULT = Model()


def cheaper(model: Model, dimension: str) -> list[Model]:
    """Return copies of the model with each lower value of one setting, cheapest value first; empty if the setting has no effect."""
    if dimension == "coupling" and model.parts == NONE:
        return []
    values = LADDER[dimension]
    return [replace(model, **{dimension: value}) for value in values[: values.index(getattr(model, dimension))]]


def reduced(room: Scene, parts: str) -> Scene:
    """Return the room without surfaces, with its large surfaces only, or with all surfaces, as `parts` says (see `Model.parts`)."""
    if parts == NONE:
        return Scene((), room.provenance)
    if parts == WHOLE:
        return room
    return Scene((s for s in room if np.ptp(s.mesh.bounds, axis=0).max() >= LARGE_M), room.provenance)
