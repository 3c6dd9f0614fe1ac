"""Settings of the tracer on Mitsuba 3."""

from dataclasses import dataclass

from radartwin.errors import InputError
from radartwin.simulation.checks import check_flag, check_option


@dataclass(frozen=True)
class TraceSettings:
    """Set the accuracy and extent of the tracing.

    Attributes:
        max_bounces: largest number of reflections per path.
        rays: ray tubes per pose over the sphere for a room, or over the objects if there is no room. None: chosen by
            `tube_paths.WIDTH_RULE`.
        rays_per_wavelength2: ray tubes per square wavelength on objects.
        variant: "auto", "llvm" or "cuda".
        room: "panels" for image sources, "tubes", or "auto": panels if the room is flat and `rays` is None.
        coupling: whether to trace paths between objects and the room's panels.
        diffuse: whether rough surfaces scatter diffusely.
        coupled_rays_per_wavelength2: tube density on objects for paths between object and room. There are many such paths, so that a lower
            density saves time. None: rays_per_wavelength2.
    """

    max_bounces: int = 4
    rays: int | None = None
    rays_per_wavelength2: float = 1.0
    variant: str = "auto"
    room: str = "auto"
    coupling: bool = True
    diffuse: bool = True
    coupled_rays_per_wavelength2: float | None = None

    def __post_init__(self) -> None:
        check_option("room", self.room, ("auto", "panels", "tubes"))
        check_flag("coupling", self.coupling)
        check_flag("diffuse", self.diffuse)
        if self.room == "panels" and self.rays is not None:
            raise InputError(f"rays={self.rays!r} sets the number of tubes, but room='panels' uses no tubes; remove rays or room='panels'")
