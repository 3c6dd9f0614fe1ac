"""Define the sources of material labels. A material source is a callable that takes a scene and returns it with labelled surfaces.

A material source labels the surfaces of kind "room" and all surfaces of a scan. The radar target keeps its material, because every
experiment knows the target's material and measures only the effect of the room.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, is_dataclass
from typing import Protocol

import numpy as np

from radartwin import plugins
from radartwin.errors import ConfigError, SceneError
from radartwin.label.journal import Record
from radartwin.label.recorded import Recorded, records_for
from radartwin.label.surface_labels import LABEL_KEYS, VLM, Label, belongs_to_room, labelled, relabelled
from radartwin.label.surface_match import matches, place_of
from radartwin.materials import Layered, check_name
from radartwin.materials.distance import in_range
from radartwin.materials.minc import CATEGORIES, names_in, row
from radartwin.scene.scene import Scene, Surface

TRUTH_SPACING_M = 0.1


class MaterialSource(Protocol):
    """A callable that returns the scene with a material label on every surface of the room.

    The returned scene shares the mesh objects of the input scene.
    """

    @property
    def name(self) -> str: ...

    def __call__(self, scene: Scene) -> Scene: ...


@dataclass(frozen=True)
class SceneLabels:
    """A material source that keeps the labels that the scene's manifest already holds."""

    name = "scene"

    def __call__(self, scene: Scene) -> Scene:
        return scene


@dataclass(frozen=True)
class Uniform:
    """A material source that gives the same smooth material to every room surface. The paper's ablation uses plasterboard."""

    name = "uniform"
    material: str | Layered = "plasterboard"

    def __post_init__(self) -> None:
        if isinstance(self.material, str):
            check_name(self.material)

    def __call__(self, scene: Scene) -> Scene:
        return relabelled(scene, lambda index, surface: self.label(), self.name)

    def label(self) -> Label:
        provenance = {"source": self.name, "confidence": None, "stand_in": _stand_in(self.material), "minc": None}
        return Label(self.material, 0.0, provenance)


@dataclass(frozen=True)
class Void:
    """A material source that removes the room, so that only the target and its stand remain in the scene."""

    name = "void"

    def __call__(self, scene: Scene) -> Scene:
        remaining = (surface for surface in scene if not belongs_to_room(surface))
        return Scene(remaining, {**scene.provenance, "materials": self.name})


@dataclass(frozen=True)
class Truth:
    """A material source that gives the true materials, known for a procedural room or from a true scene.

    Args:
        scene: scene with the true materials, in the coordinate frame of the scan to evaluate. Each scanned surface takes the material of
            the true surface that most of its area lies on. None takes the materials that the procedural room was built with.
    Raises:
        SceneError: the true material of a room surface is unknown.
    """

    name = "true"
    scene: Scene | None = None

    def __call__(self, scene: Scene) -> Scene:
        matches = true_surfaces(scene, self.scene) if self.scene is not None else [None] * len(scene)

        def true_label(index: int, surface: Surface) -> Label:
            match = matches[index]
            if match is None and surface.provenance.get("source") == self.name:
                match = surface
            if match is None:
                raise SceneError(
                    f"the true material of surface '{surface.name}' is unknown, because only procedural rooms have true materials; "
                    "use materials=uniform for a scan"
                )
            provenance = {"confidence": 1.0, "stand_in": _stand_in(match.material), "minc": match.provenance.get("minc")}
            return Label(match.material, match.roughness_m, {"source": self.name, **provenance}, match.correlation_m)

        return relabelled(scene, true_label, self.name)


@dataclass(frozen=True)
class Random:
    """A material source that replaces each true material label by a wrong label with probability p.

    A wrong label is drawn uniformly from the MINC categories of the room that differ from the true category, and has the material of the
    drawn category. A right label keeps the true material. The random numbers do not depend on p, so a surface that gets a wrong label at a
    probability p also gets a wrong label at every larger p.

    Args:
        p: probability that a surface gets a wrong material label, 0 to 1.
        seed: seed of the random numbers, used together with name and index of the surface.
    Raises:
        ConfigError: p is outside 0 to 1.
        SceneError: a surface has no true MINC category, or the room has only one category to draw from.
    """

    name = "random"
    p: float = 0.5
    seed: int = 0

    def __post_init__(self) -> None:
        if not 0 <= self.p <= 1:
            raise ConfigError(f"materials=random: p is {self.p!r}; give the share of wrong labels, 0 to 1")

    def __call__(self, scene: Scene) -> Scene:
        true = Truth()(scene)
        categories = {s.name: s.provenance.get("minc") for s in true if belongs_to_room(s)}
        unknown = [name for name, minc in categories.items() if minc is None]
        if unknown:
            raise SceneError(f"materials=random needs the true category of surface '{unknown[0]}'; give it as minc in its provenance")
        present = [c for c in CATEGORIES if c in categories.values()]
        if self.p > 0 and len(present) < 2 and categories:
            raise SceneError("materials=random: the room has one category, so no label can be wrong; use another room")

        def drawn(index: int, surface: Surface) -> Label:
            stream = np.random.default_rng(np.random.SeedSequence([self.seed, *b"random", index, *surface.name.encode()]))
            chance, choice = stream.random(2)
            truth = str(surface.provenance["minc"])
            if chance >= self.p:
                labels = {key: surface.provenance[key] for key in LABEL_KEYS if key in surface.provenance}
                provenance = {**labels, "source": self.name, "wrong": False}
                return Label(surface.material, surface.roughness_m, provenance, surface.correlation_m)
            others = [category for category in present if category != truth]
            wrong = others[min(int(choice * len(others)), len(others) - 1)]
            entry = row(wrong)
            provenance = {"source": self.name, "confidence": None, "stand_in": entry.stand_in(), "minc": wrong, "wrong": True}
            return Label(entry.material, entry.roughness_m, provenance, entry.correlation_m)

        return relabelled(true, drawn, self.name)


@dataclass(frozen=True)
class Vlm:
    """A material source that gives the recorded answers of a vision-language model, matched to surfaces by overlap.

    If the scene's manifest already holds such a label for a surface, the surface keeps this label.

    Args:
        missing: material of surfaces without a recorded answer; None makes a surface without an answer an error.
        model: name of the vision-language model whose answers are used; None accepts the answers of every model.
    Raises:
        MissingError: the scene has no recorded answers.
        LabelError: some surfaces of the scene have no recorded answer.
    """

    name = VLM
    missing: str | Layered | None = None
    model: str | None = None

    def __call__(self, scene: Scene) -> Scene:
        indices = [i for i, s in enumerate(scene) if belongs_to_room(s) and s.provenance.get("source") != self.name]
        missing = None if self.missing is None else Uniform(self.missing).label()
        return labelled(scene, self._recorded(scene, indices), indices, missing, transferred=lambda index: True)

    def _recorded(self, scene: Scene, indices: Sequence[int]) -> dict[int, Record]:
        if not indices:
            return {}
        provider = Recorded(records_for(scene, None), self.model)
        places = [place_of(scene.surfaces[i].mesh) for i in indices]
        return {i: record for i, record in zip(indices, provider.by_place(places), strict=True) if record is not None}


def true_surfaces(scene: Scene, truth: Scene) -> list[Surface | None]:
    """Return for each surface of `scene` the surface of `truth` that most of its area lies on; None for a surface without such a match."""
    places = [place_of(surface.mesh, TRUTH_SPACING_M) for surface in truth]
    best_matches = matches([place_of(surface.mesh) for surface in scene], places)
    return [None if match is None else truth.surfaces[match[0]] for match in best_matches]


def without_fragments(scene: Scene, truth: Scene) -> Scene:
    """Remove the scanned room surfaces that lie on no surface of `truth` and therefore have no true material."""
    pairs = zip(scene, true_surfaces(scene, truth), strict=True)
    return Scene([surface for surface, match in pairs if match is not None or not belongs_to_room(surface)], scene.provenance)


SOURCES: dict[str, Callable[..., MaterialSource]] = {cls.name: cls for cls in (Uniform, Void, Truth, Vlm, Random, SceneLabels)}


def material_source(name: str, **options: object) -> MaterialSource:
    """Make a material source from its name in the configuration, e.g. `material_source("uniform", material="concrete")`.

    Raises:
        ConfigError: the name or an option is unknown. PluginError: a plug-in of this name cannot be used.
    """
    plugin = plugins.find(plugins.MATERIALS, name, SOURCES)
    kind = SOURCES.get(name) if plugin is None else plugged_in(plugin)
    if kind is None:
        raise ConfigError(f"materials={name} is not a material source; choose {', '.join([*SOURCES, *plugins.names(plugins.MATERIALS)])}")
    try:
        source = kind(**options)
    except TypeError as error:
        raise ConfigError(f"materials={name} refuses the options {', '.join(options)} ({error}); correct them") from error
    return source if plugin is None else _PluggedIn(source, plugin)


@dataclass(frozen=True)
class _PluggedIn:
    """A plug-in's material source. An exception of its code becomes a PluginError of one line that names the package."""

    inner: MaterialSource
    plugin: plugins.Plugin

    @property
    def name(self) -> str:
        return self.plugin.name

    def __call__(self, scene: Scene) -> Scene:
        with plugins.calling(self.plugin, "the call"):
            labelled_scene = self.inner(scene)
        if not isinstance(labelled_scene, Scene):
            raise plugins.refusal(self.plugin, "the call returned something else than a radartwin.Scene")
        return labelled_scene


def plugged_in(plugin: plugins.Plugin) -> type:
    """Return the class of a plug-in's material source.

    Raises:
        PluginError: the plug-in cannot be imported, or its object is no dataclass of a material source.
    """
    kind = plugins.load(plugin)
    if not (isinstance(kind, type) and is_dataclass(kind) and "__call__" in vars(kind)) or getattr(kind, "name", None) != plugin.name:
        raise plugins.refusal(plugin, f"{plugin.value} is no dataclass with name = '{plugin.name}' and a method __call__(scene)")
    return kind


def _stand_in(material: str | Layered) -> bool:
    return not all(in_range(name) for name in names_in(material))
