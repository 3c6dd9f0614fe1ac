"""Who says what a surface is made of. Every source is one callable, scene in, labelled scene out.

A source relabels what a scan cannot know, the surfaces of kind "room". The target under test keeps its material: in
every experiment it is known, and the question is what the room does. Each relabelled surface says in its provenance
who labelled it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import ClassVar, Protocol

from radartwin.errors import ConfigError, MissingError, SceneError
from radartwin.materials import Layered, check_name
from radartwin.scene.scene import Scene, Surface


class MaterialSource(Protocol):
    """Scene in, scene with every surface labelled out; the geometry that stays is the same mesh object."""

    name: ClassVar[str]

    def __call__(self, scene: Scene) -> Scene: ...


@dataclass(frozen=True)
class Uniform:
    """Every room surface is one and the same, smooth material; the paper's ablation takes plasterboard."""

    name: ClassVar[str] = "uniform"
    material: str | Layered = "plasterboard"

    def __post_init__(self) -> None:
        if isinstance(self.material, str):
            check_name(self.material)

    def __call__(self, scene: Scene) -> Scene:
        return _relabelled(scene, lambda surface: (self.material, 0.0), self.name)


@dataclass(frozen=True)
class Void:
    """No room: what is left are the object and its stand."""

    name: ClassVar[str] = "void"

    def __call__(self, scene: Scene) -> Scene:
        kept = scene.only("object")
        return Scene(kept, {**scene.provenance, "materials": self.name})


@dataclass(frozen=True)
class Truth:
    """What the surfaces really are, where somebody knows: a procedural room, or `truth` by surface name.

    Raises:
        SceneError: a room surface nobody knows the material of.
    """

    name: ClassVar[str] = "true"
    truth: Mapping[str, str | Layered] = field(default_factory=dict)

    def __call__(self, scene: Scene) -> Scene:
        def known(surface: Surface) -> tuple[str | Layered, float]:
            if surface.name in self.truth:
                return self.truth[surface.name], surface.roughness_m
            if surface.provenance.get("source") == self.name:
                return surface.material, surface.roughness_m
            raise SceneError(
                f"nobody knows the true material of surface '{surface.name}'; "
                "materials=true needs a procedural room: use materials=uniform for a scan"
            )

        return _relabelled(scene, known, self.name)


@dataclass(frozen=True)
class Vlm:
    """A vision-language model's answers, recorded with the scene: surface name to material.

    Raises:
        MissingError: the scene has no recorded answers.
        SceneError: a room surface the answers leave out.
    """

    name: ClassVar[str] = "vlm"
    answers: Mapping[str, str | Layered] | None = None

    def __call__(self, scene: Scene) -> Scene:
        if self.answers is None:
            room = scene.provenance.get("room", scene.provenance.get("source", "this scene"))
            raise MissingError(f"materials=vlm has no recorded answers for {room}; use materials=uniform, void or true")
        answers = self.answers

        def answered(surface: Surface) -> tuple[str | Layered, float]:
            if surface.name not in answers:
                raise SceneError(f"the recorded answers of materials=vlm leave out surface '{surface.name}'; record them again")
            return answers[surface.name], surface.roughness_m

        return _relabelled(scene, answered, self.name)


SOURCES: dict[str, Callable[..., MaterialSource]] = {cls.name: cls for cls in (Uniform, Void, Truth, Vlm)}


def material_source(name: str, **options: object) -> MaterialSource:
    """The source of a configuration's name, e.g. `material_source("uniform", material="concrete")`.

    Raises:
        ConfigError: no such source, or an option it does not take.
    """
    if name not in SOURCES:
        raise ConfigError(f"materials={name} is not a material source; choose {', '.join(SOURCES)}")
    try:
        return SOURCES[name](**options)
    except TypeError as error:
        raise ConfigError(f"materials={name} does not take {', '.join(options)}") from error


def _relabelled(scene: Scene, rule: Callable[[Surface], tuple[str | Layered, float]], source: str) -> Scene:
    surfaces = []
    for surface in scene:
        if surface.kind == "room":
            material, roughness = rule(surface)
            surface = surface.replaced(material=material, roughness_m=roughness, provenance={"source": source})
        surfaces.append(surface)
    return Scene(surfaces, {**scene.provenance, "materials": source})
