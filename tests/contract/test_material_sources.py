"""The contract of every material source: geometry and target stay, and every surface gets a label with its source."""

import numpy as np
import pytest
from displaced import displaced

from radartwin.errors import ConfigError, LabelError, MaterialError, SceneError
from radartwin.label.material_sources import SOURCES, MaterialSource, material_source
from radartwin.materials import Layered
from radartwin.scene import objects, rooms
from radartwin.scene.scene import Scene, Surface


@pytest.fixture(scope="module")
def scene() -> Scene:
    target = Surface(objects.trihedral(0.1), "metal", "reflector", role="object")
    return rooms.lab(detail="cluttered") + rooms.support(np.array([2.5, 0, 0.95])) + Scene([target])


def sources() -> dict[str, MaterialSource]:
    return {
        "uniform": material_source("uniform"),
        "uniform layered": material_source("uniform", material=Layered([("glass", 0.004)])),
        "void": material_source("void"),
        "true": material_source("true"),
        "vlm": material_source("vlm", missing="plasterboard"),
        "random": material_source("random", p=0.5, seed=1),
        "scene": material_source("scene"),
    }


@pytest.mark.parametrize("name", ["uniform", "uniform layered", "void", "true", "vlm", "random"])
def test_source_keeps_the_contract(scene, name):
    before = [(s.name, s.material, s.provenance) for s in scene]
    source = sources()[name]
    labelled = source(scene)
    given = {s.name: s for s in scene}
    for surface in labelled:
        original = given[surface.name]
        assert surface.mesh is original.mesh
        assert (surface.role, surface.kind) == (original.role, original.kind)
        if surface.kind == "object":
            assert surface.material == original.material
        else:
            assert surface.provenance["source"] == source.name or (name, surface.name) == ("vlm", "table_left_legs")  # not in the scan
            assert {"source", "confidence", "stand_in", "minc"} <= set(surface.provenance)
    assert {s.name for s in labelled.only("object")} == {"turntable", "stand", "reflector"}
    assert labelled.provenance["materials"] == source.name
    assert labelled.provenance["room"] == "lab"
    assert before == [(s.name, s.material, s.provenance) for s in scene]  # the material source does not change its input scene
    again = source(scene if name == "random" else labelled)  # the random source needs true labels
    assert [(s.name, s.material) for s in again] == [(s.name, s.material) for s in labelled]


def test_every_source_is_tested():
    assert {name.split()[0] for name in sources()} == set(SOURCES)


def test_the_scene_source_keeps_existing_labels(scene):
    labelled = material_source("uniform", material="brick")(scene)
    kept = material_source("scene")(labelled)
    assert [(s.material, dict(s.provenance)) for s in kept] == [(s.material, dict(s.provenance)) for s in labelled]


def test_uniform_labels_the_room_as_plasterboard_and_void_keeps_only_the_object_and_its_stand(scene):
    labelled = material_source("uniform")(scene)
    assert {(s.material, s.roughness_m) for s in labelled.only("room")} == {("plasterboard", 0)}
    assert len(labelled) == len(scene)
    assert material_source("void")(scene).names == ("turntable", "stand", "reflector")


def test_true_returns_the_truth_or_refuses(scene):
    assert [s.material for s in material_source("true")(scene)] == [s.material for s in scene]
    blurred = material_source("uniform")(scene)
    with pytest.raises(SceneError, match="true material of surface 'floor'"):
        material_source("true")(blurred)


def test_surfaces_without_an_answer_are_refused_or_get_the_given_material_and_are_marked(scene):
    with pytest.raises(LabelError, match=r"20 of 20 surfaces have no answer: floor, ceiling, .*--missing uniform:plasterboard"):
        material_source("vlm", model="nobody")(scene)
    floor = material_source("vlm", model="nobody", missing="concrete")(scene).surfaces[0]
    assert (floor.material, floor.provenance["source"], floor.provenance["missing"]) == ("concrete", "uniform", True)


def test_relabelling_keeps_geometric_facts_and_drops_old_labels():
    provenance = {"source": "vlm", "minc": "wood", "reason": "grain", "segment": 4, "planar": True, "area_m2": 2.0}
    tiny = Surface(objects.plate(0.1, 0.1), "wood", "part", provenance=provenance)
    labelled = material_source("uniform")(Scene([tiny])).surfaces[0]
    assert dict(labelled.provenance) == {
        "segment": 4, "planar": True, "area_m2": 2.0, "source": "uniform", "confidence": None, "stand_in": False, "minc": None,
    }  # fmt: skip
    assert material_source("void")(Scene([tiny])).names == (), "a small scanned surface is part of the room"


def test_random_labels_have_the_given_error_rate_and_are_nested():
    kinds = ["wood" if k % 2 else "metal" for k in range(500)]
    walls = [
        Surface(objects.plate(3, 3), minc, f"s{k}", role="room", provenance={"source": "true", "minc": minc})
        for k, minc in enumerate(kinds)
    ]  # fmt: skip
    room = Scene(walls)

    def wrong(p: float, seed: int = 0, **options: object) -> set[int]:
        labelled = material_source("random", p=p, seed=seed, **options)(room)
        for surface, true in zip(labelled, walls, strict=True):
            assert surface.provenance["wrong"] == (surface.provenance["minc"] != true.provenance["minc"])
            assert (surface.material == true.material) == (not surface.provenance["wrong"])
        return {k for k, surface in enumerate(labelled) if surface.provenance["wrong"]}

    assert wrong(0.0) == set()
    assert wrong(1.0) == set(range(500))
    few, many = wrong(0.2), wrong(0.5)
    assert few < many
    assert abs(len(few) - 100) < 4 * np.sqrt(500 * 0.2 * 0.8)
    assert abs(len(many) - 250) < 4 * np.sqrt(125)
    assert wrong(0.2) == few
    assert wrong(0.2, seed=1) != few
    drawn = [s.provenance["minc"] for s in material_source("random", p=1.0)(room)]
    assert set(drawn) == {true.provenance["minc"] for true in walls}
    assert all(minc != true.provenance["minc"] for minc, true in zip(drawn, walls, strict=True))


def test_random_needs_true_categories_and_at_least_two():
    plain = Scene([Surface(objects.plate(3, 3), "wood", "w", role="room", provenance={"source": "true"})])
    with pytest.raises(SceneError, match="true category of surface 'w'"):
        material_source("random")(plain)
    single = Scene([plain.surfaces[0].replaced(provenance={"source": "true", "minc": "wood"})])
    with pytest.raises(SceneError, match="the room has one category"):
        material_source("random")(single)
    with pytest.raises(ConfigError, match=r"p is 1\.5"):
        material_source("random", p=1.5)


def test_true_materials_of_a_scan_come_from_the_nearest_true_surfaces(scene):
    scanned = displaced(scene, np.random.default_rng(0))
    blind = Scene([s.replaced(name=f"x{k}", material="concrete", provenance={"planar": True}) for k, s in enumerate(scanned)])
    known = material_source("true", scene=scene)(blind)
    for surface, true in zip(known, scene, strict=True):
        assert (surface.material, surface.provenance["minc"]) == (true.material, true.provenance.get("minc")), true.name
        assert surface.provenance["source"] == "true"
    far = blind.surfaces[0].moved(np.array([[1, 0, 0, 50.0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]))
    with pytest.raises(SceneError, match="true material of surface 'x0'"):
        material_source("true", scene=scene)(Scene([far]))


def test_unknown_sources_materials_and_options_are_refused():
    with pytest.raises(ConfigError, match="materials=psychic is not a material source; choose uniform"):
        material_source("psychic")
    with pytest.raises(MaterialError, match="granite"):
        material_source("uniform", material="granite")
    with pytest.raises(ConfigError, match="materials=void refuses the options material"):
        material_source("void", material="wood")
