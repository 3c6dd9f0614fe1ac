"""Define the object layout, a list of objects with their positions in a room, and the format of layout files.

The following text is an example of an object layout file, in YAML:

    objects:
      - object: mug                  # a name of the catalogue
        name: my_mug                 # name of its surfaces in the scene; by default the object's name, with a number if it is taken
        position_m: [3.2, 0.4, 0.74] # centre of its base: x, y and height in the world
        yaw_deg: 30                  # rotation to the left about the vertical
      - object: can_355
        on: table_left_top           # a surface of the scene, or an earlier object
        position_m: [4.3, 1.2]       # x and y only: the height is that of the surface
      - object: mug
        on: table
        relations:                   # the position on the table; anchors are surfaces, earlier objects, or the sensor
          - {relation: in front of, anchor: door, distance_m: 1.5}
      - object: corner_reflector
        position_m: [3.0, 0.0, 1.0]
        held: true                   # the support is not modelled, so the object may float
      - object: meshes/bottle.obj    # a .glb, .ply, .obj or .stl, relative to the layout file; the mesh stands on its lowest point
        material: hdpe               # of the whole mesh: a name, or {layers: [[hdpe, 0.001]], backing: water}
        unit: mm                     # of the mesh: m (default), cm, mm, in or ft
        up: y                        # its upward axis: z (default) or y
        on: table

An object is placed relative to an anchor, which is a surface, a thing of a scan such as "sofa" (`radartwin.scene.thing_names`), an earlier
object, or the sensor. Relations describe directions in the plane
of the floor. *In front of* means from the front side of the anchor into the room. The front of furniture is the side towards the middle of
the room, and the front of the sensor is its boresight. *Behind* is the direction opposite to *in front of*. *Left* and *right* are as seen
by a person who looks at the front of the anchor; if the anchor is the sensor, they are the sensor's own left and right. *Beside* is left or
right of the anchor, whichever is free. *Under* is below the middle of the anchor. The distance is measured from the anchor's front (for the
sensor, from its origin) to the centre of the object. Without a distance, the object stands about 5 cm from the anchor. Sideways, the object
stays within the anchor's width. If `on` is not given and the anchor is an object, the new object stands on the surface below the anchor. If
`on` is not given and the anchor is not an object, the new object stands on the floor.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from radartwin.errors import LayoutError, MaterialError, MissingError, SceneError
from radartwin.io import untrusted_yaml
from radartwin.materials import Layered
from radartwin.scene.mesh_file import MESH_SUFFIXES, METRES, TO_Z_UP
from radartwin.scene.storage import material_from_json

if TYPE_CHECKING:
    import yaml

RELATIONS = ("in front of", "behind", "left of", "right of", "beside", "under")
SENSOR_NAMES = ("sensor", "radar")

_NUMBER = {"type": "number", "minimum": -100, "maximum": 100}


def json_object(required: list[str], **properties: Any) -> dict[str, Any]:
    """Return the JSON schema of an object that has only the given properties."""
    return {"type": "object", "additionalProperties": False, "required": required, "properties": properties}


_RELATION = json_object(
    ["relation", "anchor"],
    relation={"enum": list(RELATIONS)},
    anchor={"type": "string", "minLength": 1},
    distance_m={"type": ["number", "null"], "minimum": 0, "maximum": 100},
)
STACK = json_object(
    ["layers"], layers={"type": "array", "items": {"type": "array", "minItems": 2, "maxItems": 2}}, backing={"type": "string"}
)
_ITEM = json_object(
    ["object"],
    object={"type": "string", "minLength": 1},
    name={"type": ["string", "null"]},
    on={"type": ["string", "null"]},
    position_m={"type": ["array", "null"], "items": _NUMBER, "minItems": 2, "maxItems": 3},
    relations={"type": ["array", "null"], "items": _RELATION},
    yaw_deg={"type": ["number", "null"]},
    held={"type": ["boolean", "null"]},
    material=STACK | {"type": ["string", "null", "object"]},
    unit={"enum": [*METRES, None]},
    up={"enum": [*TO_Z_UP, None]},
)
SCHEMA = json_object(["objects"], objects={"type": "array", "minItems": 1, "items": _ITEM})


def schema_problem(value: Any, schema: Mapping[str, Any]) -> str:
    """Return the place and the message of the most relevant violation of a JSON schema in one line, or "" if there is none."""
    from jsonschema import Draft202012Validator
    from jsonschema.exceptions import best_match

    error = best_match(Draft202012Validator(schema).iter_errors(value))
    if error is None:
        return ""
    return f"{error.json_path.removeprefix('$').removeprefix('.') or 'the document'}: {' '.join(error.message.split())[:200]}"


@dataclass(frozen=True)
class Relation:
    """Describe the position of an object relative to an anchor (furniture, wall, earlier object or sensor)."""

    relation: str
    anchor: str
    distance_m: float | None = None


@dataclass(frozen=True)
class Item:
    """Describe an object of a layout and where it stands: by coordinates, by the surface below it, or by relations to anchors.

    Attributes:
        object: name of a catalogue object, or path of a mesh file.
        material: material of an object from a mesh file; None for a catalogue object.
        unit: length unit of a mesh file: m, cm, mm, in or ft.
        up: axis of a mesh file that points up: z or y.
    """

    object: str
    name: str = ""
    on: str | None = None
    position_m: tuple[float, ...] | None = None
    relations: tuple[Relation, ...] = ()
    yaw_deg: float = 0.0
    held: bool = False
    material: str | Layered | None = None
    unit: str = "m"
    up: str = "z"

    @property
    def is_mesh(self) -> bool:
        return self.object.lower().endswith(MESH_SUFFIXES)


@dataclass(frozen=True)
class Layout:
    """Hold the objects of a layout in the order in which they are placed. A later object may stand on or beside an earlier object."""

    items: tuple[Item, ...]

    @classmethod
    def from_dict(cls, value: Any, source: str = "layout") -> Layout:
        """Build an object layout from a parsed YAML file.

        Raises:
            LayoutError: the document is not a layout; the message has a single line and names the wrong entry of the document.
        """
        if problem := schema_problem(value, SCHEMA):
            raise LayoutError(f"{source}: {problem}")
        items = tuple(_item(entry, f"{source}: objects[{index}]") for index, entry in enumerate(value["objects"]))
        check_places(items, source)
        return cls(items)

    @classmethod
    def load(cls, path: str | Path) -> Layout:
        """Read an object layout file. Paths of mesh files are relative to the folder of the layout file.

        Raises:
            MissingError: the file does not exist.
            LayoutError: the file is not YAML or not a layout.
        """
        import yaml

        path = Path(path)
        if not path.is_file():
            raise MissingError(f"layout {path} is not there; give a YAML file with a list of objects")
        try:
            value = untrusted_yaml.load(path.read_text(encoding="utf-8"), _loader())
        except (yaml.YAMLError, ValueError) as error:
            raise LayoutError(f"{path} is not YAML ({' '.join(str(error).split())[:160]}); write valid YAML") from error
        layout = cls.from_dict(value, str(path))
        return cls(tuple(replace(item, object=str(path.parent / item.object)) if item.is_mesh else item for item in layout.items))


def _loader() -> type[yaml.SafeLoader]:
    """Return a YAML loader in which only true and false are booleans, so that `on`, `off`, `yes` and `no` are text."""
    import yaml

    class Loader(untrusted_yaml.loader()):
        yaml_implicit_resolvers: ClassVar = {
            first: [(tag, pattern) for tag, pattern in pairs if tag != "tag:yaml.org,2002:bool"]
            for first, pairs in yaml.SafeLoader.yaml_implicit_resolvers.items()
        }

    Loader.add_implicit_resolver("tag:yaml.org,2002:bool", re.compile(r"^(?:true|True|false|False)$"), list("tTfF"))
    return Loader


def check_places(items: Sequence[Item], source: str) -> None:
    """Raise an error for an object without a position, with contradictory positions, or with mesh settings on a catalogue object."""
    for index, item in enumerate(items):
        where = f"{source}: objects[{index}] ({item.object})"
        at = item.position_m
        if at is None and item.on is None and not item.relations:
            raise LayoutError(f"{where} has no place; give position_m, on, or relations")
        if at is not None and item.relations:
            raise LayoutError(f"{where} has both position_m and relations; give one of them")
        if at is not None and len(at) == 3 and item.on is not None:
            raise LayoutError(f"{where} has a height in position_m and on={item.on}; leave the height or on out")
        if item.held and (at is None or len(at) != 3):
            raise LayoutError(f"{where} is held, so its height must be given: position_m: [x, y, z]")
        if item.is_mesh and item.material is None:
            raise LayoutError(f"{where} is a mesh, which has no material; give material: NAME")
        if not item.is_mesh and (item.material, item.unit, item.up) != (None, "m", "z"):
            raise LayoutError(f"{where} is of the catalogue, which defines its material, unit and up; leave them out")


def _item(entry: Mapping[str, Any], where: str) -> Item:
    given = {k: v for k, v in entry.items() if v is not None}
    if "position_m" in given:
        given["position_m"] = tuple(float(v) for v in given["position_m"])
    if "relations" in given:
        given["relations"] = tuple(Relation(**relation) for relation in given["relations"])
    if "material" in given:
        try:
            given["material"] = material_from_json(given["material"])
        except (SceneError, MaterialError) as error:
            raise LayoutError(f"{where}.material: {' '.join(str(error).split())[:200]}") from error
    return Item(**given)
