"""Configuration of the scene: the room around the radar, and the target in the room."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from radartwin.config.checked_fields import Checked, choice, path_name, positive, triple
from radartwin.errors import ConfigError

ROOMS = ("lab", "atrium", "squash_court")
SHAPES = ("corner_reflector", "plate", "sphere", "none")


@dataclass
class SceneConfig(Checked):
    """Settings that every scene reads. A scene without a room has only these settings."""

    KEY, SELECTOR = "scene", "name"
    NAMES: ClassVar[tuple[str, ...]] = ("empty", "void", "plate", *ROOMS)
    name: str = "empty"
    target: str = "corner_reflector"  # corner_reflector | plate | sphere | none | a name in the object catalogue, such as mug
    target_size_m: float = positive(0.1)  # edge at a corner reflector's apex, edge of a plate, or diameter of a sphere, in metres
    target_position_m: list[float] | None = triple("[x,y,z] in metres")  # target's foot; null: target on boresight at trajectory.distance_m
    stand: bool = False  # whether a turntable disc on a post stands under the target
    layout: str | None = path_name()  # furniture layout file (YAML): objects placed in the room (radartwin/scene/layouts/layout.py)
    sentence: str | None = None  # objects in the room in words: "a mug on the table 1.5 m in front of the door"

    def __post_init__(self) -> None:
        super().__post_init__()
        self._check_target()
        if self.layout and self.sentence:
            raise ConfigError("scene.layout and scene.sentence both place objects; give one of them")

    def _check_target(self) -> None:
        if self.target not in SHAPES:
            from radartwin.scene.objects.catalogue import catalogue

            if self.target not in (objects := list(catalogue())):
                options = ", ".join(dict.fromkeys([*SHAPES, *objects]))
                raise ConfigError(f"scene.target={self.target} is not known; options: {options}")
            if self.target_size_m != SceneConfig.target_size_m:
                raise ConfigError(f"scene.target_size_m is not read by scene.target={self.target}, which has its own size; leave it out")
        if self.target == "none" and (self.stand or self.target_position_m is not None):
            raise ConfigError("scene.target=none leaves nothing to place; choose a scene.target, or leave stand and target_position_m out")

    def room_options(self) -> dict[str, Any]:
        """Return those options of `radartwin.scene.rooms.room` that this configuration sets."""
        return {name: value for name in ("size_m", "detail", "back") if (value := getattr(self, name, None)) is not None}


@dataclass
class RoomScene(SceneConfig):
    """A procedural room. If size_m is null, the room has its default size. If detail is null, the room is furnished."""

    NAMES: ClassVar[tuple[str, ...]] = ROOMS
    name: str = "lab"
    size_m: list[float] | None = triple("[length,width,height] in metres")
    detail: str | None = choice(None, "shell", "furnished", "cluttered")

    def __post_init__(self) -> None:
        super().__post_init__()
        if min(self.size_m or [1.0]) <= 0:
            raise ConfigError(f"scene.size_m={self.size_m} must be above zero")


@dataclass
class SquashCourtScene(RoomScene):
    """The procedural squash court. Its back wall may be of glass; if `back` is null, the back wall is solid."""

    NAMES: ClassVar[tuple[str, ...]] = ("squash_court",)
    name: str = "squash_court"
    back: str | None = choice(None, "solid", "glass")


@dataclass
class ScanScene(SceneConfig):
    """A scanned room, given as a scene folder or as a mesh file (.glb, .ply or .obj)."""

    NAMES: ClassVar[tuple[str, ...]] = ("scan",)
    name: str = "scan"
    path: str = path_name("scene=scan needs the scan: add scene.path=FILE_OR_FOLDER")
    target: str = "none"
