"""Configuration of the simulator: one dataclass for each option of the group `simulator`."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

from radartwin.config.checked_fields import Checked, choice, number, positive, share, unkeyed


@dataclass
class SimulatorConfig(Checked):
    """Settings that every simulator reads."""

    KEY, SELECTOR = "simulator", "backend"
    backend: str = ""
    variant: str = unkeyed(choice("auto", "llvm", "cuda"))  # processor (llvm) or GPU (cuda); both trace the same rays
    elements: str = choice("exact", "planar")  # exact: distance to each antenna element | planar: plane wave over the array

    def settings(self) -> dict[str, Any]:
        """Return the fields of this dataclass as the settings of the simulator backend."""
        common = {f.name for f in fields(SimulatorConfig)}
        return {f.name: getattr(self, f.name) for f in fields(self) if f.name not in common}


@dataclass
class MitsubaSimulator(SimulatorConfig):
    """The simulator with flat faces and edges, polygons, and ray tubes on Mitsuba 3."""

    backend: str = "mitsuba"
    room: str = choice("auto", "panels", "tubes")  # panels: flat faces with edges | tubes: ray tubes | auto: panels if it is flat
    parts: str = choice("whole", "large", "none")  # simulated surfaces of the room: all | all but small objects | none
    max_bounces: int = positive(4)
    rays: int | None = positive(None)  # number of rays per frame; null: computed from the width of the ray tubes
    rays_per_wavelength2: float = positive(1.0)  # number of rays per squared wavelength on the surface of objects
    diffractions: int = number(2, lambda most: most in (1, 2), "1 or 2")  # largest number of edge diffractions of a path in a flat room
    # paths of a flat room below this share of the strongest path of their pose are left out
    prune: float = number(1e-3, lambda level: 0 < level <= 0.1, "at most 0.1 and above 0")
    coupling: bool = True  # whether to compute paths that reflect at objects and at flat faces of the room
    diffuse: bool = True  # whether to compute the scatter of rough surfaces, from random points that stay fixed in the room

    def settings(self) -> dict[str, Any]:
        """Return the settings of the Mitsuba backend: all fields except `parts`, which selects surfaces of the scene."""
        return {name: value for name, value in super().settings().items() if name != "parts"}


@dataclass
class AutoSimulator(SimulatorConfig):
    """Mitsuba with the cheapest settings that keep the signal features accurate. Settings that are null are chosen automatically."""

    backend: str = "auto"
    elements: str = choice("auto", "exact", "planar")
    tolerance: float = positive(1.0)  # allowed error of a feature relative to its repeatability limit (radartwin/adaptive/limits.py)
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
    """Baseline simulator: the ray tracer of RF-Genesis (radartwin/simulation/backends/rfgenesis.py)."""

    backend: str = "rfgenesis"
    version: str = choice("shipped", "corrected")
    grid: int = positive(128)  # number of rays along each side of the square ray grid
    fov_deg: float = number(60.0, lambda deg: 0 < deg < 180, "below 180 and above 0")


@dataclass
class PointsSimulator(SimulatorConfig):
    """Baseline simulator: each object is one point scatterer with a far-field radar cross-section."""

    backend: str = "points"
    cross_section: str = choice("table", "sphere")  # table: far-field RCS by aspect angle | sphere: RCS of a sphere of the object's size
    room: str = choice("images", "void")  # images: first-order mirror images at the walls | void: no echoes of the room
    step_deg: float = number(1.0, lambda deg: 0 < deg <= 90, "at most 90 and above 0")  # angular step of the RCS table, degrees
    rays_per_wavelength2: float = positive(1.0)  # number of rays per squared wavelength in the computation of the RCS table


@dataclass
class SionnaSimulator(SimulatorConfig):
    """Simulator for comparison: Sionna RT, which runs in a separate process."""

    backend: str = "sionna"
    max_bounces: int = positive(4)
    rays: int | None = positive(None)  # number of rays that Sionna samples; null takes Sionna's default
    diffraction: bool = False  # whether Sionna computes one diffraction at an edge, and refraction
    # distance between transmitter and receiver in Sionna's path search; with a value above 0, Sionna finds the paths in corners
    separation_m: float = share(0.0)
