"""Configuration of the room's materials: one dataclass for each material source. A source names the material of every surface."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from radartwin.config.checks import check_fields, check_selector, choice, positive, share, unkeyed, url


@dataclass
class MaterialsConfig:
    """Settings that every material source reads."""

    source: str = ""

    def __post_init__(self) -> None:
        check_selector("materials.source", self.source, type(self).source)
        check_fields(self, "materials")

    def arguments(self, seed: int) -> dict[str, Any]:
        """Return the arguments of `radartwin.label.sources.material_source` besides the source's name."""
        return {}


@dataclass
class UniformMaterials(MaterialsConfig):
    """One material for every surface of the room."""

    source: str = "uniform"
    material: str = "plasterboard"

    def arguments(self, seed: int) -> dict[str, Any]:
        return {"material": self.material}


@dataclass
class VlmMaterials(MaterialsConfig):
    """Recorded answers of a vision-language model. The unkeyed fields are defaults of `radartwin label`, which requests new answers."""

    source: str = "vlm"
    missing: str | None = None  # material of surfaces without an answer; null: such surfaces are an error
    model: str | None = None  # use only this model's answers; null: any recorded answer, and the server's default model
    provider: str = unkeyed(choice("recorded", "server", "local"))
    url: str = unkeyed(url("set RADARTWIN_VLM_KEY instead", "http://127.0.0.1:8000/v1"))  # address of an OpenAI-compatible server
    timeout_s: float = unkeyed(positive(120.0))  # time limit of one request to the server
    concurrency: int = unkeyed(positive(4))  # simultaneous requests to the server
    views: int = unkeyed(positive(3))  # number of pictures of each surface

    def arguments(self, seed: int) -> dict[str, Any]:
        return {"missing": self.missing, "model": self.model}


@dataclass
class RandomMaterials(MaterialsConfig):
    """The true materials, with a share of the labels replaced by wrong labels."""

    source: str = "random"
    p: float = share(0.5)  # share of wrong labels
    among: str = choice("room", "all")  # wrong labels are drawn from: categories of the room | all categories

    def arguments(self, seed: int) -> dict[str, Any]:
        return {"p": self.p, "among": self.among, "seed": seed}


@dataclass
class TrueMaterials(MaterialsConfig):
    """The materials that a procedural room is built of."""

    source: str = "true"


@dataclass
class VoidMaterials(MaterialsConfig):
    """No room: only the target and its stand."""

    source: str = "void"


@dataclass
class SceneMaterials(MaterialsConfig):
    """The labels in the manifest of a scanned scene."""

    source: str = "scene"


def default_materials(source: str) -> MaterialsConfig:
    """Return a source's dataclass with its default values, e.g. default_materials("uniform").material == "plasterboard"."""
    return next(schema for schema in MaterialsConfig.__subclasses__() if schema.source == source)()
