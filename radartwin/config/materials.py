"""Configuration of the room's materials: one dataclass for each source that gives every surface of the room its material."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, ClassVar

from radartwin.config.checked_fields import Checked, share


@dataclass
class MaterialsConfig(Checked):
    """Settings that every source of surface materials reads."""

    KEY, SELECTOR = "materials", "source"
    seeded: ClassVar[bool] = False  # whether the source takes the configured seed
    source: str = ""

    def arguments(self, seed: int) -> dict[str, Any]:
        """Return the arguments, except its name, with which `radartwin.label.material_sources.material_source` makes this source."""
        settings = {entry.name: getattr(self, entry.name) for entry in fields(self) if entry.name not in ("source", "code")}
        return settings | ({"seed": seed} if self.seeded else {})


@dataclass
class UniformMaterials(MaterialsConfig):
    """The source that gives one material to every surface of the room."""

    source: str = "uniform"
    material: str = "plasterboard"


@dataclass
class VlmMaterials(MaterialsConfig):
    """The source that uses recorded answers of a vision-language model to the question which material a surface has."""

    source: str = "vlm"
    missing: str | None = None  # material of surfaces without a recorded answer; null makes a surface without an answer an error
    model: str | None = None  # model whose recorded answers are used; null: all models


@dataclass
class RandomMaterials(MaterialsConfig):
    """The source that gives the true materials, but replaces a share of the material labels by wrong labels."""

    seeded = True
    source: str = "random"
    p: float = share(0.5)  # probability that a surface gets a wrong material label, 0 to 1


@dataclass
class TrueMaterials(MaterialsConfig):
    """The source that gives each surface the material that the procedural room was built with."""

    source: str = "true"


@dataclass
class VoidMaterials(MaterialsConfig):
    """The source that removes the room, so that only the target and its stand remain."""

    source: str = "void"


@dataclass
class SceneMaterials(MaterialsConfig):
    """The source that uses the materials in the manifest of a scanned scene."""

    source: str = "scene"


def default_materials(source: str) -> MaterialsConfig:
    """Return a material source's dataclass with its default values, e.g. default_materials("uniform").material == "plasterboard"."""
    return next(schema for schema in MaterialsConfig.__subclasses__() if schema.source == source)()
