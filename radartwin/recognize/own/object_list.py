"""Read the YAML file that lists the objects of a recogniser.

The following text is an example of such a file:

    objects:
      - name: plate                  # the class name that the recogniser returns
        mesh: meshes/plate.stl       # a .glb, .ply, .obj or .stl; the path is relative to this file's folder
        unit: mm                     # of the mesh: m (default), cm, mm, in or ft
        up: y                        # upward axis of the mesh: z (default) or y
        material: metal              # of the whole mesh: a name, or layers as for the bottle
        description: a flat square metal plate
      - name: bottle
        mesh: meshes/bottle.obj
        material: {layers: [[pet, 0.0005]], backing: water}   # wall of 0.5 mm, filled with water; filled with air if backing is absent
        description: a plastic bottle of water
      - name: cup
        catalogue: mug               # an object of the catalogue, which defines its mesh and material
        description: a white ceramic mug

Either every object has a description, or no object has one. An object of the catalogue without a description has the catalogue's
description if other objects have one. Each object stands on its lowest point. The middle of its bounding box is on the axis of the
turntable.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import InputError, MissingError, UserError
from radartwin.radar.description_files import read_yaml
from radartwin.scene import objects as catalogue_objects
from radartwin.scene.layouts.layout import STACK, json_object, schema_problem
from radartwin.scene.layouts.stock import from_mesh
from radartwin.scene.mesh_file import METRES, TO_Z_UP
from radartwin.scene.storage import material_from_json
from radartwin.scene.surface import Surface
from radartwin.scene.viewer.colouring import material_label

FEWEST = 2  # a recogniser distinguishes at least two objects
NAME = re.compile(r"\w[\w .+-]{0,59}")
OF_MESH = ("material", "unit", "up")  # keys that an object of the catalogue does not have
_REMEDY = "write a list of objects under the key objects (docs/own-objects.md has an example)"
_TEXT = {"type": "string", "minLength": 1}
_ITEM = json_object(
    ["name"],
    name=_TEXT,
    mesh=_TEXT,
    catalogue=_TEXT,
    unit={"enum": list(METRES)},
    up={"enum": list(TO_Z_UP)},
    material=STACK | {"type": ["string", "object"]},
    description=_TEXT,
)
SCHEMA = json_object(["objects"], objects={"type": "array", "items": _ITEM})


@dataclass(frozen=True, eq=False)
class OwnObject:
    """An object that a recogniser learns.

    Attributes:
        name: name of the object's class.
        surfaces: surfaces in the object's own frame, in metres: z up, standing on z = 0, turning about the z axis, front towards +x.
        aim_m: height above the object's base at which a level radar aims.
        origin: file name of the mesh, or the object's name in the catalogue.
        description: description of the object in words; "" if the file gives no descriptions.
    """

    name: str
    surfaces: tuple[Surface, ...]
    aim_m: float
    origin: str
    description: str = ""

    @property
    def material(self) -> str:
        """Return the materials of the object's surfaces as text."""
        return ", ".join(dict.fromkeys(material_label(surface.material) for surface in self.surfaces))

    @property
    def size_m(self) -> NDArray[np.float64]:
        """Return the extents (3,) of the object along x, y and z, in metres."""
        return self._corners()[1] - self._corners()[0]

    @property
    def radius_m(self) -> float:
        """Return the largest distance of the object's vertices from the axis of the turntable, in metres."""
        return max(float(np.linalg.norm(np.asarray(s.mesh.vertices)[:, :2], axis=1).max()) for s in self.surfaces)

    def _corners(self) -> NDArray[np.float64]:
        bounds = np.array([surface.mesh.bounds for surface in self.surfaces])
        return np.stack([bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)])


def read_objects(path: str | Path, contents: str = "filled") -> tuple[OwnObject, ...]:
    """Read the objects of a YAML file, sorted by name. Paths of meshes are relative to the folder of the file.

    Args:
        contents: "filled" simulates objects of the catalogue with their contents, and "unknown" simulates only their outermost material
            (see `radartwin.scene.objects.Entry.surfaces`).
    Raises:
        MissingError: the file or a mesh does not exist.
        InputError: the file is not YAML or not such a list, or an object cannot be used. The message names the object.
    """
    path = Path(path)
    entries = _entries(path)
    names = [entry["name"] for entry in entries]
    if len(names) < FEWEST:
        raise InputError(f"{path}: objects has {len(names)} entry; a recogniser needs at least {FEWEST} objects")
    objects = []
    for index, entry in enumerate(entries):
        if not NAME.fullmatch(entry["name"]):
            rule = "a name begins with a letter or digit and has at most 60 letters, digits, spaces and _ . + -; change the name"
            raise InputError(f"{path}: objects[{index}]: {entry['name'][:60]!r} is no name: {rule}")
        where = f"{path}: objects[{index}] ({entry['name']})"
        if entry["name"] in names[:index]:
            raise InputError(f"{where}: two objects have this name; give each object its own name")
        try:
            objects.append(_made(entry, path.parent, contents))
        except MissingError as error:
            raise MissingError(f"{where}: {error}") from error
        except UserError as error:
            raise InputError(f"{where}: {error}") from error
    return tuple(sorted(_described(objects, entries, path), key=lambda own_object: own_object.name))


def anchors(objects: Sequence[OwnObject]) -> dict[str, NDArray[np.float32]]:
    """Return a unit vector for each object's name. The training moves the radar embeddings of an object towards its vector.

    With descriptions, the vectors are the text embeddings of the descriptions. Without descriptions, the K objects have K orthonormal
    vectors, for which no text model is needed.

    Raises:
        InputError: two objects have the same description.
        MissingError: the embedding of a description does not ship with the package, and the pip extra `text` is not installed.
    """
    from radartwin.recognize.text import embed

    texts = [own_object.description for own_object in objects]
    if not any(texts):
        return {own_object.name: row for own_object, row in zip(objects, np.eye(len(objects), dtype=np.float32), strict=True)}
    for number, text in enumerate(texts):
        if text in texts[:number]:
            names = f"{objects[texts.index(text)].name} and {objects[number].name}"
            raise InputError(f"the objects {names} have the same description; describe how they differ, or leave all descriptions out")
    return dict(zip([own_object.name for own_object in objects], embed(texts), strict=True))


def _entries(path: Path) -> list[dict[str, Any]]:
    if not path.is_file():
        raise MissingError(f"{path}: no such file; {_REMEDY}")
    value = read_yaml(path, "a list under the key objects")
    if problem := schema_problem(value, SCHEMA):
        raise InputError(f"{path}: {problem}; {_REMEDY}")
    return value["objects"]


def _made(entry: Mapping[str, Any], folder: Path, contents: str) -> OwnObject:
    if ("mesh" in entry) == ("catalogue" in entry):
        raise InputError("an object has either the key mesh or the key catalogue; give one of them")
    if "catalogue" in entry:
        if given := [key for key in OF_MESH if key in entry]:
            raise InputError(f"the catalogue defines the {given[0]} of its objects; leave {given[0]} out")
        known = catalogue_objects.entry(entry["catalogue"])
        return OwnObject(entry["name"], known.surfaces(contents=contents), known.aim_m, known.name)
    if "material" not in entry:
        raise InputError("a mesh has no material; give material: NAME, such as metal, or layers")
    material = material_from_json(entry["material"])
    surfaces = from_mesh(folder / entry["mesh"], material, entry.get("unit", "m"), entry.get("up", "z"))
    height = max(float(surface.mesh.bounds[1, 2]) for surface in surfaces)
    return OwnObject(entry["name"], surfaces, height / 2, Path(entry["mesh"]).name)


def _described(objects: Sequence[OwnObject], entries: Sequence[Mapping[str, Any]], path: Path) -> list[OwnObject]:
    """Return the objects with their descriptions, which all objects have or none has."""
    if not any("description" in entry for entry in entries):
        return list(objects)
    out, known = [], catalogue_objects.catalogue()
    for index, (own_object, entry) in enumerate(zip(objects, entries, strict=True)):
        text = entry.get("description") or (known[own_object.origin].description if "catalogue" in entry else "")
        if not text.strip():
            where = f"{path}: objects[{index}] ({own_object.name})"
            raise InputError(f"{where} has no description, but other objects have one; describe every object or none")
        out.append(replace(own_object, description=text))
    return out
