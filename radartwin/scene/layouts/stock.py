"""The objects a layout can name: the catalogue, the canonical targets, and meshes from files."""

from __future__ import annotations

import difflib
from collections.abc import Sequence

from radartwin.errors import LayoutError
from radartwin.scene import objects
from radartwin.scene.layouts.anchor import words
from radartwin.scene.layouts.layout import Item
from radartwin.scene.scene import Surface

TARGETS = {"plate": lambda: objects.plate(0.1, 0.1), "sphere": lambda: objects.sphere(0.05)}


def names() -> list[str]:
    """What `stock` makes."""
    return [*objects.catalogue(), *TARGETS]


def known(name: str) -> str:
    """The identifier that a name stands for: itself, what the catalogue labels so, or the only one with all its words.

    >>> known("the Corner reflector")
    'corner_reflector'

    Raises:
        LayoutError: none, or several, with those there are.
    """
    asked = words(name)
    said = {n: [words(n)] for n in names()} | {n: [words(n), words(e.label)] for n, e in objects.catalogue().items()}
    same = [n for n, ways in said.items() if asked in ways]
    matching = same or [n for n, ways in said.items() if asked and any(set(asked) <= set(way) for way in ways)]
    if len(matching) == 1:
        return matching[0]
    if matching:
        raise LayoutError(f"'{name}' may be {', '.join(matching)}; name one of them")
    near = difflib.get_close_matches("_".join(asked), said, 2)
    hint = f"did you mean {' or '.join(near)}? " if near else ""
    raise LayoutError(f"no object is called '{name}'; {hint}there are {', '.join(said)}")


def stock(name: str) -> Sequence[Surface]:
    """Surfaces of an object in its own frame: z up, the origin on its axis, +x its front.

    Raises:
        LayoutError: an unknown name.
    """
    name = known(name)
    return [Surface(TARGETS[name](), "metal", name, role="object")] if name in TARGETS else objects.make(name)


def from_file(item: Item) -> Sequence[Surface]:
    """Surfaces of a layout's mesh in its own frame, as those of `stock`.

    Raises:
        MissingError, MeshError: no such file, unreadable, or of a size that no object has in the unit given.
        MaterialError, SceneError: its material.
    """
    from radartwin.scene.storage import material_from_json

    return objects.from_mesh(item.object, material_from_json(item.material), unit=item.unit, up=item.up)
