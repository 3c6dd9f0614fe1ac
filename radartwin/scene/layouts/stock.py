"""Build the objects of layouts: catalogue objects, two canonical shapes, and meshes from files."""

from __future__ import annotations

import difflib
from collections.abc import Sequence

from radartwin.errors import LayoutError
from radartwin.scene import objects
from radartwin.scene.layouts.anchor import words
from radartwin.scene.layouts.layout import Item
from radartwin.scene.storage import material_from_json
from radartwin.scene.surface import Surface

CANONICAL = {"plate": lambda: objects.plate(0.1, 0.1), "sphere": lambda: objects.sphere(0.05)}


def names() -> list[str]:
    """Return the names of all objects that `stock` can build."""
    return [*objects.catalogue(), *CANONICAL]


def identifier(name: str) -> str:
    """Return the identifier of the object that `name` means: an identifier, a label, or words that occur in one of these only.

    >>> identifier("the Corner reflector")
    'corner_reflector'

    Raises:
        LayoutError: no object or several objects match; the message lists the names.
    """
    wanted = words(name)
    spellings = {n: [words(n)] for n in names()} | {n: [words(n), words(e.label)] for n, e in objects.catalogue().items()}
    same = [n for n, known in spellings.items() if wanted in known]
    matching = same or [n for n, known in spellings.items() if wanted and any(set(wanted) <= set(spelling) for spelling in known)]
    if len(matching) == 1:
        return matching[0]
    if matching:
        raise LayoutError(f"'{name}' may be {', '.join(matching)}; name one of them")
    near = difflib.get_close_matches("_".join(wanted), spellings, 2)
    hint = f"did you mean {' or '.join(near)}? " if near else ""
    raise LayoutError(f"no object is called '{name}'; {hint}choose from {', '.join(spellings)}")


def stock(name: str) -> Sequence[Surface]:
    """Build the surfaces of an object in its own frame: z up, origin on its axis, front towards +x.

    Raises:
        LayoutError: the name is unknown.
    """
    name = identifier(name)
    return [Surface(CANONICAL[name](), "metal", name, role="object")] if name in CANONICAL else objects.make(name)


def from_file(item: Item) -> Sequence[Surface]:
    """Build the surfaces of a mesh file, in the frame that `stock` uses.

    Raises:
        MissingError, MeshError: the file does not exist, is unreadable, or has an implausible size in the given unit.
        MaterialError, SceneError: the material is invalid.
    """
    return objects.from_mesh(item.object, material_from_json(item.material), unit=item.unit, up=item.up)
