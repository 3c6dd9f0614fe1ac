"""Configuration of the scene."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from radartwin.config.checks import finite, no_password, one_of, path_field, positive
from radartwin.errors import ConfigError

ROOMS = ("lab", "atrium", "squash_court")
ROOM_CHOICES = {"detail": ("shell", "furnished", "cluttered"), "back": ("solid", "glass")}
TARGETS = ("corner_reflector", "plate", "sphere", "none")


@dataclass
class SceneConfig:
    """What is in front of the radar: a procedural room, a scan or a saved scene, and the target in it."""

    name: str = "lab"  # lab | atrium | squash_court | empty | void | plate | scan
    path: str | None = path_field()  # scan: a scene folder, or a .glb/.ply/.obj mesh
    size_m: list[float] | None = None  # rooms: length, width, height; null: the room's own
    detail: str | None = None  # rooms: shell | furnished | cluttered; null: furnished
    back: str | None = None  # squash_court: solid | glass, its back wall; null: solid
    target: str = "corner_reflector"  # corner_reflector | plate | sphere | none | an object of the catalogue, such as mug
    target_size_m: float = 0.1  # reflector leg, plate edge or sphere diameter
    layout: str | None = path_field()  # YAML: objects that stand in the room (radartwin/scene/layouts/layout.py)
    sentence: str | None = None  # the same in words: "a mug on the table 1.5 m in front of the door"
    llm_url: str | None = None  # of an OpenAI-compatible server, for sentences that the built-in grammar cannot read
    llm_model: str | None = None
    target_position_m: list[float] | None = None  # of what it stands on; null: on the boresight at trajectory.distance_m
    stand: bool = False  # a turntable disc on a post under the target

    def __post_init__(self) -> None:
        one_of("scene.name", self.name, (*ROOMS, "empty", "void", "plate", "scan"))
        if self.target not in TARGETS:
            from radartwin.scene.objects.catalogue import catalogue

            one_of("scene.target", self.target, (*TARGETS, *(name for name in catalogue() if name not in TARGETS)))
            if self.target_size_m != SceneConfig.target_size_m:
                raise ConfigError(f"scene.target_size_m is not read by scene.target={self.target}, which has its own size; leave it out")
        positive("scene.target_size_m", self.target_size_m)
        positive("scene.size_m", *(self.size_m or ()))
        finite("scene.target_position_m", *(self.target_position_m or ()))
        for name, length in (("size_m", "length,width,height"), ("target_position_m", "x,y,z")):
            value = getattr(self, name)
            if value is not None and len(value) != 3:
                raise ConfigError(f"scene.{name}={value} must be [{length}] in metres")
        for name, readers in (("size_m", ROOMS), ("detail", ROOMS), ("back", ("squash_court",))):
            value = getattr(self, name)
            if value is not None and name in ROOM_CHOICES:
                one_of(f"scene.{name}", value, ROOM_CHOICES[name])
            if value is not None and self.name not in readers:
                unread = f"scene.{name}={value} is not read by scene={self.name}"
                raise ConfigError(f"{unread}; choose scene={'|'.join(readers)}, or leave it out")
        if self.target == "none" and (self.stand or self.target_position_m is not None):
            raise ConfigError("scene.target=none leaves nothing to place; choose a scene.target, or leave stand and target_position_m out")
        if self.name == "scan" and not self.path:
            raise ConfigError("scene=scan needs the scan: add scene.path=FILE_OR_FOLDER")
        if self.name != "scan" and self.path:
            raise ConfigError(f"scene.path is only read by scene=scan, and scene.name is {self.name}; add scene=scan")
        if self.layout and self.sentence:
            raise ConfigError("scene.layout and scene.sentence both say what stands where; give one of them")
        no_password("scene.llm_url", self.llm_url, "set RADARTWIN_VLM_KEY instead")
        if (self.llm_url or self.llm_model) and not (self.llm_url and self.llm_model and self.sentence):
            raise ConfigError("scene.llm_url and scene.llm_model are read together, for scene.sentence; give all three")

    def room_options(self) -> dict[str, Any]:
        """What the user set of the room's own options."""
        return {name: value for name in ("size_m", "detail", "back") if (value := getattr(self, name)) is not None}
