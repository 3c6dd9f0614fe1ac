"""Define the settings of the ray tracer on Mitsuba 3."""

from dataclasses import dataclass

from radartwin.errors import InputError
from radartwin.simulation.argument_checks import check_flag, check_option, check_positive, check_whole
from radartwin.simulation.pruning import PRUNE

MAX_RAYS = 200_000_000  # largest number of ray tubes per sensor pose; tracing this number of tubes takes some minutes
MAX_DENSITY = 10_000  # largest number of ray tubes per square wavelength; this density gives seven million tubes on a 10 cm plate
SPACING_M = 0.04  # distance between places of a moving radar; paths are moved by half of it at most
MOST_SPACING_M = 0.1  # with places 0.5 m apart, the error of the moved paths is 0.4 of the signal (a can beside a wall)


@dataclass(frozen=True)
class TraceSettings:
    """Set the accuracy and extent of the tracing.

    Attributes:
        max_bounces: largest number of reflections per path.
        rays: number of ray tubes per pose in all directions for a room, or over the objects if the scene has no room. None lets
            `tube_paths.WIDTH_RULE` set the number of tubes for a room.
        rays_per_wavelength2: number of ray tubes per square wavelength on objects. Opaque objects of flat faces need no tubes.
        variant: Mitsuba variant that traces the tubes: "llvm" (CPU), "cuda" (GPU), or "auto" (GPU if the computer has one).
        room: "panels" computes reflections and edge diffractions at the flat faces of the room (`flat.room`). "tubes" traces the room by
            ray tubes. "auto" chooses "panels" if the room consists of flat faces and `rays` is None, and "tubes" otherwise.
        coupling: whether to trace paths that reflect at an object and at the flat faces of the room.
        diffuse: whether rough surfaces scatter diffusely.
        coupled_rays_per_wavelength2: number of ray tubes per square wavelength on objects, for paths that reflect at object and room. Such
            paths are numerous, so a lower density saves time. None takes `rays_per_wavelength2`; for the paths that `place_spacing_m`
            describes, half of it (`track_paths.OVER_ROOM`).
        diffractions: largest number of edge diffractions of a path in a room of flat faces, 1 or 2.
        prune: paths of such a room below this share of the strongest one of their pose are left out.
        place_spacing_m: a moving radar traces the paths between resting objects and room only at some of its poses (`track_paths`). Every
            other position is at most half of this distance from such a place, whose paths are moved to it. Paths of these objects that the
            radar cannot resolve are merged. 0 traces these paths at every position, with all tubes, and merges none.
    """

    max_bounces: int = 4
    rays: int | None = None
    rays_per_wavelength2: float = 1.0
    variant: str = "auto"
    room: str = "auto"
    coupling: bool = True
    diffuse: bool = True
    coupled_rays_per_wavelength2: float | None = None
    diffractions: int = 2
    prune: float = PRUNE
    place_spacing_m: float = SPACING_M

    def __post_init__(self) -> None:
        check_whole("max_bounces", self.max_bounces, 1)
        if self.rays is not None:
            check_whole("rays", self.rays, 1, MAX_RAYS)
        check_positive("rays_per_wavelength2", self.rays_per_wavelength2, MAX_DENSITY)
        check_option("room", self.room, ("auto", "panels", "tubes"))
        check_flag("coupling", self.coupling)
        check_flag("diffuse", self.diffuse)
        check_whole("diffractions", self.diffractions, 1, 2)
        check_positive("prune", self.prune, 0.1)
        if self.place_spacing_m != 0:
            check_positive("place_spacing_m", self.place_spacing_m, MOST_SPACING_M)
        if self.room == "panels" and self.rays is not None:
            raise InputError(f"rays={self.rays!r} sets the number of tubes, but room='panels' uses no tubes; remove rays or room='panels'")
