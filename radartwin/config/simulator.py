"""Configuration of the simulator."""

from __future__ import annotations

from dataclasses import dataclass

from radartwin.config.checks import one_of, positive, unkeyed
from radartwin.errors import ConfigError

PARTS = ("none", "large", "whole")
CHOSEN = ("parts", "max_bounces", "rays_per_wavelength2", "coupling", "diffuse")  # by simulator=auto, where they are null
# What each simulator reads besides backend, variant and elements; and the choices of what is chosen by name.
SIMULATOR_FIELDS: dict[str, dict[str, tuple[str, ...]]] = {
    "mitsuba": {
        "max_bounces": (), "rays": (), "rays_per_wavelength2": (), "room": ("auto", "panels", "tubes"), "coupling": (), "diffuse": (),
        "parts": PARTS,
    },
    "auto": {"tolerance": (), "parts": PARTS, "max_bounces": (), "rays_per_wavelength2": (), "coupling": (), "diffuse": ()},
    "rfgenesis": {"version": ("shipped", "columns", "corrected"), "grid": (), "fov_deg": ()},
    "points": {
        "cross_section": ("table", "sphere"), "points": ("centre", "box"), "room": ("images", "void"), "step_deg": (),
        "rays_per_wavelength2": (),
    },
    "sionna": {"max_bounces": (), "rays": (), "diffuse": (), "separation_m": ()},
}  # fmt: skip


@dataclass
class SimulatorConfig:
    """How paths are found. The variant is where the same rays are traced, so it is not part of a run's key.

    A field that the chosen simulator does not read is null; `elements` belongs to the signal and is read with all of them.
    """

    backend: str = "mitsuba"  # mitsuba | auto: mitsuba with no more modelled than the features need | rfgenesis | points | sionna
    variant: str = unkeyed("auto")  # auto | llvm | cuda
    elements: str = "exact"  # exact | planar | auto: distances over each antenna element, or a plane wave across the array
    tolerance: float | None = None  # auto: how far a feature may move, in limits of its repeatability (radartwin/adaptive/limits.py)
    room: str | None = "auto"  # mitsuba: panels by images, tubes, or auto (panels where the room is flat); points: images | void
    # mitsuba; null with simulator=auto, which chooses what is null
    parts: str | None = "whole"  # of the room: none, large (without small things) or whole
    max_bounces: int | None = 4  # sionna: too
    rays: int | None = None  # per frame; null: by the width rule; sionna: its samples
    rays_per_wavelength2: float | None = 1.0  # on objects; points: of its table
    coupling: bool | None = True  # paths between objects and room, by mirrored sensors
    diffuse: bool | None = True  # scatter of rough surfaces, by a cloud fixed in the world; sionna: its own, which adds coherently
    # rfgenesis
    version: str | None = None  # shipped | columns | corrected (radartwin/simulation/backends/rfgenesis.py)
    grid: int | None = None  # pixels along each side
    fov_deg: float | None = None
    # points
    cross_section: str | None = None  # table: far field by aspect | sphere: one of the object's size
    points: str | None = None  # centre | box: of the bounding box, or of its faces
    step_deg: float | None = None  # of the table
    # sionna
    separation_m: float | None = None  # of the receiver while paths are looked for, so that corners are seen into

    def __post_init__(self) -> None:
        one_of("simulator.backend", self.backend, tuple(SIMULATOR_FIELDS))
        one_of("simulator.variant", self.variant, ("auto", "llvm", "cuda"))
        one_of("simulator.elements", self.elements, ("exact", "planar", "auto"))
        for name in ("max_bounces", "rays", "rays_per_wavelength2", "grid", "fov_deg", "step_deg", "tolerance"):
            positive(f"simulator.{name}", getattr(self, name))
        read = SIMULATOR_FIELDS[self.backend]
        for other in SIMULATOR_FIELDS:
            for name in SIMULATOR_FIELDS[other]:
                value = getattr(self, name)
                if name not in read and value is not None:
                    unread = f"simulator.{name}={value} is not read by simulator={self.backend}"
                    raise ConfigError(f"{unread}; choose simulator={other}, or leave it out")
                if name in read and value is None and name != "rays" and not (self.backend == "auto" and name in CHOSEN):
                    raise ConfigError(f"simulator.{name}=null: simulator={self.backend} needs a value; leave it out for the default")
        for name, options in read.items():
            if options and getattr(self, name) is not None:
                one_of(f"simulator.{name}", str(getattr(self, name)), options)
        if self.fov_deg is not None and not self.fov_deg < 180:
            raise ConfigError(f"simulator.fov_deg={self.fov_deg:g} must be below 180")
        if self.separation_m is not None and not 0 <= self.separation_m <= 1:
            raise ConfigError(f"simulator.separation_m={self.separation_m:g} must be from 0 to 1")
        if self.step_deg is not None and self.step_deg > 90:
            raise ConfigError(f"simulator.step_deg={self.step_deg:g} must be at most 90")
