"""Build the objects that a layout can name: catalogue objects, two canonical radar targets, and meshes from files."""

from __future__ import annotations

import difflib
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from radartwin.errors import LayoutError, MeshError
from radartwin.materials import Layered
from radartwin.scene import objects
from radartwin.scene.layouts.anchor import words
from radartwin.scene.mesh_checks import check_mesh
from radartwin.scene.mesh_file import METRES, TO_Z_UP, read_meshes
from radartwin.scene.surface import Surface

CANONICAL = {"plate": lambda: objects.plate(0.1, 0.1), "sphere": lambda: objects.sphere(0.05)}
SMALLEST_M, LARGEST_M = 0.01, 1.0  # limits for the size of an object from a mesh file


def names() -> list[str]:
    """Return the names of all objects that `stock` can build."""
    return [*objects.catalogue(), *CANONICAL]


def identifier(name: str) -> str:
    """Return the identifier of the object that `name` means.

    `name` is an identifier, an everyday name, or words that occur in the names of a single object only.

    >>> identifier("the Corner reflector")
    'corner_reflector'

    Raises:
        LayoutError: no object or several objects match `name`; the message lists the names of the objects.
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
    """Build the surfaces of an object in the object's own frame: z up, origin on the object's vertical axis, front towards +x."""
    name = identifier(name)
    return [Surface(CANONICAL[name](), "metal", name, role="object")] if name in CANONICAL else objects.make(name)


def from_mesh(path: str | Path, material: str | Layered, unit: str = "m", up: str = "z") -> tuple[Surface, ...]:
    """Read a mesh file as an object: in metres, with z up, standing on z = 0, and centred on the z axis.

    Args:
        path: .glb, .ply, .obj or .stl file, whose texture and colours are kept.
        material: material of the whole object.
        unit: length unit of the file's coordinates: m, cm, mm, in or ft.
        up: axis of the file's coordinates that points up: x, y, z, -x, -y or -z.
    Returns:
        A surface for each mesh in the file; all surfaces have the file name without suffix as their name.
    Raises:
        MissingError: the file does not exist.
        MeshError: the mesh is unreadable, empty, or not between 1 cm and 1 m long.
    """
    meshes = list(read_meshes(path).values())
    if not meshes:
        raise MeshError(f"{path} holds no triangles; give a mesh, not a point cloud")
    transform = np.eye(4)
    transform[:3, :3] = METRES[unit] * TO_Z_UP[up]
    moved = [mesh.copy().apply_transform(transform) for mesh in meshes]
    low = np.min([mesh.bounds[0] for mesh in moved], axis=0)
    high = np.max([mesh.bounds[1] for mesh in moved], axis=0)
    extent = float((high - low).max())
    if np.isfinite(extent) and not SMALLEST_M <= extent <= LARGEST_M:
        raise MeshError(
            f"{path} is {extent:.4g} m long in unit={unit}; an object must be 1 cm to 1 m long; {_unit_hint(extent / METRES[unit])}"
        )
    for mesh in moved:
        check_mesh(mesh, str(path))
    shift = -np.append((low + high)[:2] / 2, low[2])
    provenance = {"source": "given", "confidence": None, "stand_in": False, "minc": None, "file": Path(path).name}
    return tuple(Surface(mesh.apply_translation(shift), material, Path(path).stem, 0.0, "object", provenance) for mesh in moved)


def _unit_hint(length: float) -> str:
    """Return a question for an error message that suggests the length units in which the object would be 5 to 35 cm long."""
    fits = [unit for unit, scale in METRES.items() if 0.05 <= length * scale <= 0.35]
    return f"give unit={' or unit='.join(fits)}" if fits else "give another unit or mesh"
