"""Configuration of the simulator: one dataclass for each option of the group `simulator`."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

from radartwin.config.checks import check_fields, check_selector, choice, number, positive, share, unkeyed


@dataclass
class SimulatorConfig:
    """Settings that every simulator reads."""

    backend: str = ""
    variant: str = unkeyed(choice("auto", "llvm", "cuda"))  # the device; every device traces the same rays
    elements: str = choice("exact", "planar", "auto")  # exact: distance to each antenna element | planar: plane wave over the array

    def __post_init__(self) -> None:
        check_selector("simulator.backend", self.backend, type(self).backend)
        check_fields(self, "simulator")

    def settings(self) -> dict[str, Any]:
        """Return the fields of this option, which are the settings of its backend."""
        common = {f.name for f in fields(SimulatorConfig)}
        return {f.name: getattr(self, f.name) for f in fields(self) if f.name not in common}


@dataclass
class MitsubaSimulator(SimulatorConfig):
    """Physical optics on Mitsuba 3."""

    backend: str = "mitsuba"
    room: str = choice("auto", "panels", "tubes")  # panels: mirror images at flat panels | tubes: ray tubes | auto: panels where flat
    parts: str = choice("whole", "large", "none")  # parts of the room that are simulated; large: without small objects
    max_bounces: int = positive(4)
    rays: int | None = positive(None)  # rays per frame; null: from the tube width
    rays_per_wavelength2: float = positive(1.0)  # ray density on objects
    coupling: bool = True  # whether to compute paths between objects and room, by mirrored sensors
    diffuse: bool = True  # whether to compute the scatter of rough surfaces, by a point cloud fixed in the world

    def settings(self) -> dict[str, Any]:
        """Return the backend's settings: all fields except `parts`, which selects surfaces of the scene."""
        return {name: value for name, value in super().settings().items() if name != "parts"}


@dataclass
class AutoSimulator(SimulatorConfig):
    """Mitsuba with the cheapest settings that keep the features accurate. Null settings are chosen automatically, others are fixed."""

    backend: str = "auto"
    elements: str = choice("auto", "exact", "planar")
    tolerance: float = positive(1.0)  # allowed change of a feature, relative to its repeatability limit (radartwin/adaptive/limits.py)
    parts: str | None = choice(None, "none", "large", "whole")
    max_bounces: int | None = positive(None)
    rays_per_wavelength2: float | None = positive(None)
    coupling: bool | None = None
    diffuse: bool | None = None

    def fixed(self) -> dict[str, Any]:
        names = ("parts", "max_bounces", "rays_per_wavelength2", "coupling", "diffuse")
        fixed = {name: value for name in names if (value := getattr(self, name)) is not None}
        return fixed if self.elements == "auto" else {**fixed, "elements": self.elements}


@dataclass
class RFGenesisSimulator(SimulatorConfig):
    """Baseline: the tracer of RF-Genesis (radartwin/simulation/backends/rfgenesis.py)."""

    backend: str = "rfgenesis"
    version: str = choice("shipped", "columns", "corrected")
    grid: int = positive(128)  # pixels along each side of the ray grid
    fov_deg: float = number(60.0, lambda deg: 0 < deg < 180, "below 180 and above 0")


@dataclass
class PointsSimulator(SimulatorConfig):
    """Baseline: point scatterers with a far-field cross-section."""

    backend: str = "points"
    cross_section: str = choice("table", "sphere")  # table: far-field RCS by aspect angle | sphere: RCS of a sphere of the object's size
    points: str = choice("centre", "box")  # centre: of the bounding box | box: centres of its faces
    room: str = choice("images", "void")  # images: first-order mirror images at the walls | void: no room
    step_deg: float = number(1.0, lambda deg: 0 < deg <= 90, "at most 90 and above 0")  # angular step of the RCS table
    rays_per_wavelength2: float = positive(1.0)  # ray density for the RCS table


@dataclass
class SionnaSimulator(SimulatorConfig):
    """Peer simulator: Sionna RT, in a separate process."""

    backend: str = "sionna"
    max_bounces: int = positive(4)
    rays: int | None = positive(None)  # Sionna's number of ray samples; null: Sionna's default
    diffuse: bool = False  # whether Sionna adds diffuse scattering, which it adds coherently
    separation_m: float = share(0.0)  # distance from transmitter to receiver during the path search; above 0, corners return paths
