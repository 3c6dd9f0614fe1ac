"""Configuration of the simulator: one dataclass for each option of the group `simulator`."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

from radartwin.config.checks import check_fields, check_selector, choice, positive, share, unkeyed


@dataclass
class SimulatorConfig:
    """Settings that every simulator reads."""

    backend: str = ""
    variant: str = unkeyed(choice("auto", "llvm", "cuda"))  # the device; all of them trace the same rays
    elements: str = choice("exact", "planar", "auto")  # exact: distances to each antenna element | planar: a plane wave

    def __post_init__(self) -> None:
        check_selector("simulator.backend", self.backend, type(self).backend)
        check_fields(self, "simulator")

    def settings(self) -> dict[str, Any]:
        """The option's own fields: settings of its backend."""
        common = {f.name for f in fields(SimulatorConfig)}
        return {f.name: getattr(self, f.name) for f in fields(self) if f.name not in common}


@dataclass
class MitsubaSimulator(SimulatorConfig):
    """Physical optics on Mitsuba 3."""

    backend: str = "mitsuba"
    room: str = choice("auto", "panels", "tubes")  # panels: by images | auto: panels where the room is flat
    parts: str = choice("whole", "large", "none")  # of the room that are simulated; large: without small objects
    max_bounces: int = positive(4)
    rays: int | None = positive(None)  # per frame; null: from the tube width
    rays_per_wavelength2: float = positive(1.0)  # on objects
    coupling: bool = True  # paths between objects and room, by mirrored sensors
    diffuse: bool = True  # scatter of rough surfaces, by a point cloud fixed in the world

    def settings(self) -> dict[str, Any]:
        """Without `parts`, which selects surfaces of the scene."""
        return {name: value for name, value in super().settings().items() if name != "parts"}


@dataclass
class AutoSimulator(SimulatorConfig):
    """Mitsuba with the cheapest settings that keep the features. Null settings are chosen, others are fixed."""

    backend: str = "auto"
    elements: str = choice("auto", "exact", "planar")
    tolerance: float = positive(1.0)  # how far a feature may move, in limits of its repeatability (radartwin/adaptive/limits.py)
    parts: str | None = choice(None, "none", "large", "whole")
    max_bounces: int | None = positive(None)
    rays_per_wavelength2: float | None = positive(None)
    coupling: bool | None = None
    diffuse: bool | None = None

    def fixed(self) -> dict[str, Any]:
        """The settings that are not chosen."""
        names = ("parts", "max_bounces", "rays_per_wavelength2", "coupling", "diffuse")
        fixed = {name: value for name in names if (value := getattr(self, name)) is not None}
        return fixed if self.elements == "auto" else {**fixed, "elements": self.elements}


@dataclass
class RFGenesisSimulator(SimulatorConfig):
    """Baseline: the tracer of RF-Genesis (radartwin/simulation/backends/rfgenesis.py)."""

    backend: str = "rfgenesis"
    version: str = choice("shipped", "columns", "corrected")
    grid: int = positive(128)  # pixels along each side
    fov_deg: float = positive(60.0, below=180)


@dataclass
class PointsSimulator(SimulatorConfig):
    """Baseline: point scatterers with a far-field cross-section."""

    backend: str = "points"
    cross_section: str = choice("table", "sphere")  # table: far field by aspect | sphere: of the object's size
    points: str = choice("centre", "box")  # centre of the bounding box | box: centres of its faces
    room: str = choice("images", "void")  # images: first images of walls
    step_deg: float = positive(1.0, most=90)  # of the table
    rays_per_wavelength2: float = positive(1.0)  # of the table


@dataclass
class SionnaSimulator(SimulatorConfig):
    """Peer: Sionna RT, in a process of its own."""

    backend: str = "sionna"
    max_bounces: int = positive(4)
    rays: int | None = positive(None)  # its samples; null: its default
    diffuse: bool = False  # its diffuse scattering, which adds coherently
    separation_m: float = share(0.0)  # of the receiver from the transmitter while paths are searched, so that corners return paths
