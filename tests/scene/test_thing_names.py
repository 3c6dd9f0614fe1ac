"""The things of a scanned room have names from their geometry and their material labels, and sentences can place objects on them."""

from typing import Any

import numpy as np
import pytest
import trimesh

from radartwin.scene import objects
from radartwin.scene.layouts.grammar import parse
from radartwin.scene.layouts.place import furnish
from radartwin.scene.scene import Scene, Surface
from radartwin.scene.thing_names import things
from radartwin.scene.viewer.colouring import surface_label
from radartwin.scene.viewer.page import describe


def sheet(origin, *sides):
    corners = np.array(origin, float) + np.array([np.zeros(3), sides[0], np.add(*sides), sides[1]])
    return trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], process=False)


def scanned(name: str, mesh: trimesh.Trimesh, minc: str | None, role: Any = "object", **label) -> Surface:
    return Surface(mesh, "wood", name, role=role, provenance={"segment": 0, "minc": minc, **label})


@pytest.fixture(scope="module")
def room() -> Scene:
    """A room of 4 x 4 x 2.5 m as a scan: the sofa stands at the wall x = 0, the cabinet at y = 4, the table in the middle."""
    sofa = objects.joined([objects.box([0.1, 1, 0.1], [0.9, 2.6, 0.4]), objects.box([0.1, 1, 0.4], [0.25, 2.6, 0.9])])
    return Scene(
        [
            scanned("floor", sheet([0, 0, 0], [4, 0, 0], [0, 4, 0]), "wood", "room"),
            scanned("ceiling", sheet([0, 0, 2.5], [0, 4, 0], [4, 0, 0]), "painted", "room"),
            scanned("wall_1", sheet([0, 0, 0], [0, 4, 0], [0, 0, 2.5]), "painted", "room"),
            scanned("wall_2", sheet([0, 4, 0], [4, 0, 0], [0, 0, 2.5]), "paper", "room", stand_in=True),
            scanned("wall_3", sheet([4, 0, 0], [0, 4, 0], [0, 0, 2.5]), None, "room"),
            scanned("plane_1", sheet([1, 0, 1], [1, 0, 0], [0, 0, 1]), "glass", "room"),
            scanned("level_1", sheet([1.5, 1, 0.01], [1.5, 0, 0], [0, 1.5, 0]), "carpet", "room"),
            scanned("plane_2", sofa, "fabric"),
            scanned("plane_3", objects.box([1.8, 1.4, 0.7], [2.8, 2.1, 0.74]), "wood"),
            scanned("plane_4", objects.box([1.5, 3.6, 0], [2.5, 3.95, 1.9]), "wood"),
            scanned("part_1", objects.box([2.0, 1.6, 0.745], [2.1, 1.7, 0.85]), "plastic"),
            scanned("part_2", objects.box([2.2, 2, 2.2], [2.5, 2.3, 2.5]), "plastic"),
        ]
    )


def test_surfaces_of_a_scan_are_named_by_what_and_where_they_are(room):
    assert dict(zip(room.names, map(str, things(room)), strict=True)) == {
        "floor": "floor", "ceiling": "ceiling", "wall_1": "wall behind the sofa", "wall_2": "paper wall behind the cabinet",
        "wall_3": "wall", "plane_1": "window", "level_1": "rug under the table", "plane_2": "sofa", "plane_3": "table",
        "plane_4": "cabinet", "part_1": "small plastic object on the table", "part_2": "lamp",
    }  # fmt: skip
    drawn = Scene([Surface(objects.plate(1, 1), "metal", "table_top")])
    assert [str(thing) for thing in things(drawn)] == ["table_top"], "no scan made this surface"


def test_a_sentence_can_place_an_object_on_a_thing_of_a_scan(room):
    placed = furnish(room, parse("a corner reflector on the table"))
    assert placed.surfaces[-1].provenance["layout"] == "corner reflector on plane_3"
    assert str(things(placed)[-1]) == "corner reflector on the table"
    assert placed.surfaces[-1].mesh.bounds[0, 2] == pytest.approx(0.74, abs=0.01)


def test_the_view_shows_things_and_names_a_substitute_beside_its_category(room):
    surfaces = {dict(entry["facts"]).get("segment", entry["name"]): entry for entry in describe(room)[0]["surfaces"]}
    assert surfaces["wall_2"]["name"] == "paper wall behind the cabinet"
    assert surfaces["wall_2"]["material"] == "paper (simulated as wood)"
    carpet = Surface(room.surfaces[0].mesh, "carpet_tile", provenance={"minc": "carpet", "stand_in": True})
    assert surface_label(carpet) == "carpet (simulated as wood)", "at 77 GHz, wood replaces the carpet tile of P.2040"
