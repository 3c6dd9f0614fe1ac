"""Who says what a surface is made of. Every source is one callable, scene in, labelled scene out.

A source relabels what a scan cannot know: the surfaces of kind "room", and what came with a scan whatever its size. The target under test
keeps its material: in every experiment it is known, and the question is what the room does. What a label says is in `labels`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal, Protocol

import numpy as np

from radartwin.errors import ConfigError, SceneError
from radartwin.label.answers import Answer
from radartwin.label.journal import Record
from radartwin.label.labels import LABEL_KEYS, VLM, Label, belongs_to_room, labelled, relabelled
from radartwin.label.place import matches, place_of
from radartwin.label.recorded import Recorded, records_for
from radartwin.materials import Layered, check_name
from radartwin.materials.distance import in_range
from radartwin.materials.minc import CATEGORIES, names_in, row
from radartwin.scene.scene import Scene, Surface

TRUTH_SPACING_M = 0.1


class MaterialSource(Protocol):
    """Scene in, scene with every surface labelled out; the geometry that stays is the same mesh object."""

    name: ClassVar[str]

    def __call__(self, scene: Scene) -> Scene: ...


@dataclass(frozen=True)
class Kept:
    """What the scene says itself: the labels of its manifest stay as they are."""

    name: ClassVar[str] = "scene"

    def __call__(self, scene: Scene) -> Scene:
        return scene


@dataclass(frozen=True)
class Uniform:
    """Every room surface is one and the same, smooth material; the paper's ablation takes plasterboard."""

    name: ClassVar[str] = "uniform"
    material: str | Layered = "plasterboard"

    def __post_init__(self) -> None:
        if isinstance(self.material, str):
            check_name(self.material)

    def __call__(self, scene: Scene) -> Scene:
        return relabelled(scene, lambda index, surface: self.label(), self.name)

    def label(self) -> Label:
        """The one label."""
        stand_in = not all(in_range(name) for name in names_in(self.material))
        return Label(self.material, 0.0, {"source": self.name, "confidence": None, "stand_in": stand_in, "minc": None})


@dataclass(frozen=True)
class Void:
    """No room: what is left are the object and its stand."""

    name: ClassVar[str] = "void"

    def __call__(self, scene: Scene) -> Scene:
        kept = (surface for surface in scene if not belongs_to_room(surface))
        return Scene(kept, {**scene.provenance, "materials": self.name})


@dataclass(frozen=True)
class Truth:
    """What the surfaces really are, where somebody knows.

    Args:
        truth: material by surface name.
        scene: the true scene in the same frame: each surface takes what most of it lies on. For scoring a scan, never for labelling it.
    Raises:
        SceneError: a room surface nobody knows the material of.
    """

    name: ClassVar[str] = "true"
    truth: Mapping[str, str | Layered] = field(default_factory=dict)
    scene: Scene | None = None

    def __call__(self, scene: Scene) -> Scene:
        beneath = true_surfaces(scene, self.scene) if self.scene is not None else [None] * len(scene)

        def known(index: int, surface: Surface) -> Label:
            below = beneath[index]
            if surface.name in self.truth:
                minc = surface.provenance.get("minc") if surface.provenance.get("source") == self.name else None
                return _true_label(self.truth[surface.name], surface.roughness_m, minc)
            if below is not None:
                return _true_label(below.material, below.roughness_m, below.provenance.get("minc"))
            if surface.provenance.get("source") == self.name:
                return _true_label(surface.material, surface.roughness_m, surface.provenance.get("minc"))
            raise SceneError(
                f"nobody knows the true material of surface '{surface.name}'; "
                "materials=true needs a procedural room: use materials=uniform for a scan"
            )

        return relabelled(scene, known, self.name)


@dataclass(frozen=True)
class Random:
    """The truth with labels wrong at random: what a labeller costs that errs at a known rate.

    A wrong label is drawn evenly from the other categories, and takes their material; a right one keeps the true material. Every surface
    draws once whatever p is, so the surfaces that are wrong at one p are wrong at every larger one.

    Args:
        p: chance of each surface to be wrong.
        seed: of the draws, with the surface's name and number.
        among: "room" draws from the categories that the room has, "all" from all of MINC but `other`.
        truth: the true source, `Truth()` unless given.
    Raises:
        ConfigError: p outside 0 to 1.
        SceneError: a surface without a true MINC category, or only one category to draw from.
    """

    name: ClassVar[str] = "random"
    p: float = 0.5
    seed: int = 0
    among: Literal["room", "all"] = "room"
    truth: Truth = field(default_factory=Truth)

    def __post_init__(self) -> None:
        if not 0 <= self.p <= 1:
            raise ConfigError(f"materials=random: p is {self.p!r}; give the share of wrong labels, 0 to 1")
        if self.among not in ("room", "all"):
            raise ConfigError(f"materials=random: among is {self.among!r}; choose room or all")

    def __call__(self, scene: Scene) -> Scene:
        true = self.truth(scene)
        categories = {s.name: s.provenance.get("minc") for s in true if belongs_to_room(s)}
        unknown = [name for name, minc in categories.items() if minc is None]
        if unknown:
            raise SceneError(f"materials=random needs the true category of surface '{unknown[0]}', which nobody gives (provenance minc)")
        present = [c for c in CATEGORIES if c in categories.values()] if self.among == "room" else [c for c in CATEGORIES if c != "other"]
        if self.p > 0 and len(present) < 2 and categories:
            raise SceneError("materials=random: the room has one category only, so no label can be wrong; use among=all")

        def drawn(index: int, surface: Surface) -> Label:
            stream = np.random.default_rng(np.random.SeedSequence([self.seed, *b"random", index, *surface.name.encode()]))
            chance, choice = stream.random(2)
            truth = str(surface.provenance["minc"])
            if chance >= self.p:
                return Label(surface.material, surface.roughness_m, {**_own(surface), "source": self.name, "wrong": False})
            others = [category for category in present if category != truth]
            wrong = others[min(int(choice * len(others)), len(others) - 1)]
            entry = row(wrong)
            told = {"source": self.name, "confidence": None, "stand_in": entry.stand_in(), "minc": wrong, "wrong": True}
            return Label(entry.material, entry.roughness_m, told)

        return relabelled(true, drawn, self.name)


@dataclass(frozen=True)
class Vlm:
    """A vision-language model's answers. A surface that was labelled by one before, in its manifest, keeps that label.

    Args:
        answers: material or answer by surface name; None takes what is recorded for the room, by place.
        missing: the uniform material of a surface that nobody answered; None refuses it.
        model: only answers of this model.
    Raises:
        MissingError: the scene has no recorded answers.
        LabelError: room surfaces the answers leave out, all of them named.
    """

    name: ClassVar[str] = VLM
    answers: Mapping[str, str | Layered | Answer | Record] | None = None
    missing: str | Layered | None = None
    model: str | None = None

    def __call__(self, scene: Scene) -> Scene:
        asked = [i for i, s in enumerate(scene) if belongs_to_room(s) and s.provenance.get("source") != self.name]
        if self.answers is None:
            found = self._recorded(scene, asked)
        else:
            found = {i: self.answers[s.name] for i, s in enumerate(scene) if i in set(asked) and s.name in self.answers}
        return labelled(
            scene, found, asked, None if self.missing is None else Uniform(self.missing).label(), transferred=self.answers is None
        )

    def _recorded(self, scene: Scene, asked: Sequence[int]) -> dict[int, Record]:
        if not asked:
            return {}
        provider = Recorded(records_for(scene, None), self.model)
        places = [place_of(scene.surfaces[i].mesh) for i in asked]
        return {i: record for i, record in zip(asked, provider.by_place(places), strict=True) if record is not None}


def true_surfaces(scene: Scene, truth: Scene) -> list[Surface | None]:
    """For each surface, the true one that most of it lies on; None where it lies on none."""
    places = [place_of(surface.mesh, TRUTH_SPACING_M) for surface in truth]
    found = matches([place_of(surface.mesh) for surface in scene], places)
    return [None if match is None else truth.surfaces[match[0]] for match in found]


def without_fragments(scene: Scene, truth: Scene) -> Scene:
    """A scan without the flying fragments that lie on no true surface, whose true material there is not."""
    found = zip(scene, true_surfaces(scene, truth), strict=True)
    return Scene([surface for surface, below in found if below is not None or not belongs_to_room(surface)], scene.provenance)


SOURCES: dict[str, Callable[..., MaterialSource]] = {cls.name: cls for cls in (Uniform, Void, Truth, Vlm, Random, Kept)}


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


def _own(surface: Surface) -> dict[str, Any]:
    return {key: surface.provenance[key] for key in LABEL_KEYS if key in surface.provenance}


def _true_label(material: str | Layered, roughness_m: float, minc: object) -> Label:
    stand_in = not all(in_range(name) for name in names_in(material))
    return Label(material, roughness_m, {"source": Truth.name, "confidence": 1.0, "stand_in": stand_in, "minc": minc})
