"""Every material source keeps the same promises: geometry and target untouched, every surface labelled and told by whom."""

import numpy as np
import pytest
from displaced import displaced

from radartwin.errors import ConfigError, LabelError, MaterialError, MissingError, SceneError
from radartwin.label.answers import Answer
from radartwin.label.sources import SOURCES, MaterialSource, material_source
from radartwin.materials import Layered
from radartwin.materials.minc import MINC
from radartwin.scene import objects, rooms
from radartwin.scene.scene import Scene, Surface


@pytest.fixture(scope="module")
def scene() -> Scene:
    target = Surface(objects.trihedral(0.1), "metal", "reflector", role="object")
    return rooms.lab(detail="cluttered") + rooms.support(np.array([2.5, 0, 0.95])) + Scene([target])


def sources(scene: Scene) -> dict[str, MaterialSource]:
    answers = {s.name: "wood" for s in scene if s.kind == "room"}
    return {
        "uniform": material_source("uniform"),
        "uniform layered": material_source("uniform", material=Layered([("glass", 0.004)])),
        "void": material_source("void"),
        "true": material_source("true"),
        "vlm": material_source("vlm", answers=answers),
        "random": material_source("random", p=0.5, seed=1),
        "scene": material_source("scene"),
    }


@pytest.mark.parametrize("name", ["uniform", "uniform layered", "void", "true", "vlm", "random"])
def test_source_keeps_the_contract(scene, name):
    before = [(s.name, s.material, s.provenance) for s in scene]
    source = sources(scene)[name]
    labelled = source(scene)
    given = {s.name: s for s in scene}
    for surface in labelled:
        original = given[surface.name]
        assert surface.mesh is original.mesh
        assert (surface.role, surface.kind) == (original.role, original.kind)
        if surface.kind == "object":
            assert surface.material == original.material
        else:
            assert surface.provenance["source"] == source.name
            assert {"source", "confidence", "stand_in", "minc"} <= set(surface.provenance)
    assert {s.name for s in labelled.only("object")} == {"turntable", "stand", "reflector"}
    assert labelled.provenance["materials"] == source.name
    assert labelled.provenance["room"] == "lab"
    assert before == [(s.name, s.material, s.provenance) for s in scene]  # the input is not changed
    again = source(scene if name == "random" else labelled)  # of the random source's own labels nobody knows the truth
    assert [(s.name, s.material) for s in again] == [(s.name, s.material) for s in labelled]


def test_every_source_is_under_contract(scene):
    assert {name.split()[0] for name in sources(scene)} == set(SOURCES)


def test_a_scene_that_is_labelled_already_stays_as_it_is(scene):
    labelled = material_source("uniform", material="brick")(scene)
    kept = material_source("scene")(labelled)
    assert [(s.material, dict(s.provenance)) for s in kept] == [(s.material, dict(s.provenance)) for s in labelled]


def test_uniform_forces_every_room_surface_to_plasterboard(scene):
    labelled = material_source("uniform")(scene)
    assert {s.material for s in labelled.only("room")} == {"plasterboard"}
    assert len(labelled) == len(scene)
    assert all(s.roughness_m == 0 for s in labelled.only("room"))


def test_void_keeps_the_object_and_its_stand_only(scene):
    assert material_source("void")(scene).names == ("turntable", "stand", "reflector")


def test_true_gives_back_the_truth_and_refuses_to_guess(scene):
    assert [s.material for s in material_source("true")(scene)] == [s.material for s in scene]
    blurred = material_source("uniform")(scene)
    with pytest.raises(SceneError, match="true material of surface 'floor'"):
        material_source("true")(blurred)
    truth = {s.name: s.material for s in scene}
    known = material_source("true", truth=truth)(blurred)
    assert [s.material for s in known] == [s.material for s in scene]


def test_vlm_without_answers_says_what_to_do(scene):
    nowhere = Scene(scene.surfaces, {"room": "nowhere"})
    with pytest.raises(MissingError, match="no recorded answers for nowhere; use materials=uniform"):
        material_source("vlm")(nowhere)
    with pytest.raises(LabelError, match=r"20 of 20 surfaces have no answer: floor, ceiling, .*--missing uniform:plasterboard"):
        material_source("vlm", answers={})(scene)


def test_unanswered_surfaces_take_what_is_given_for_them_and_say_so(scene):
    labelled = material_source("vlm", answers={"floor": Answer("wood", 0.9, "grain")}, missing="concrete")(scene)
    floor, ceiling = labelled.surfaces[:2]
    assert (floor.material, floor.roughness_m) == (MINC["wood"].material, MINC["wood"].roughness_m)
    assert {**floor.provenance} == {
        "source": "vlm", "confidence": 0.9, "stand_in": False, "minc": "wood", "model": None, "reason": "grain",
    }  # fmt: skip
    assert (ceiling.material, ceiling.provenance["source"], ceiling.provenance["missing"]) == ("concrete", "uniform", True)


def test_facts_of_the_geometry_outlive_a_label_and_old_labels_do_not():
    told = {"source": "vlm", "minc": "wood", "reason": "grain", "segment": 4, "planar": True, "area_m2": 2.0}
    tiny = Surface(objects.plate(0.1, 0.1), "wood", "part", provenance=told)
    labelled = material_source("uniform")(Scene([tiny])).surfaces[0]
    assert dict(labelled.provenance) == {
        "segment": 4, "planar": True, "area_m2": 2.0, "source": "uniform", "confidence": None, "stand_in": False, "minc": None,
    }  # fmt: skip
    assert material_source("void")(Scene([tiny])).names == (), "what came with a scan is part of the room, however small"


def test_random_labels_err_at_the_rate_asked_for_and_grow_with_it():
    kinds = ["wood" if k % 2 else "metal" for k in range(2000)]
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
    assert wrong(1.0) == set(range(2000))
    few, many = wrong(0.2), wrong(0.5)
    assert few < many
    assert abs(len(few) - 400) < 4 * np.sqrt(2000 * 0.2 * 0.8)
    assert abs(len(many) - 1000) < 4 * np.sqrt(500)
    assert wrong(0.2) == few
    assert wrong(0.2, seed=1) != few
    anything = material_source("random", p=1.0, among="all")(room)
    drawn = [s.provenance["minc"] for s in anything]
    assert set(drawn) == set(MINC) - {"other"}
    assert all(minc != true.provenance["minc"] for minc, true in zip(drawn, walls, strict=True))
    assert max(map(drawn.count, drawn)) < 2.5 * 2000 / 21, "drawn evenly"


def test_random_needs_true_categories_and_something_to_draw(scene):
    plain = Scene([Surface(objects.plate(3, 3), "wood", "w", role="room", provenance={"source": "true"})])
    with pytest.raises(SceneError, match="true category of surface 'w'"):
        material_source("random")(plain)
    single = Scene([plain.surfaces[0].replaced(provenance={"source": "true", "minc": "wood"})])
    with pytest.raises(SceneError, match="the room has one category"):
        material_source("random")(single)
    with pytest.raises(ConfigError, match=r"p is 1\.5"):
        material_source("random", p=1.5)


def test_true_materials_of_a_scan_come_from_what_it_lies_on(scene):
    scanned = displaced(scene, np.random.default_rng(0))
    blind = Scene([s.replaced(name=f"x{k}", material="concrete", provenance={"planar": True}) for k, s in enumerate(scanned)])
    known = material_source("true", scene=scene)(blind)
    for found, true in zip(known, scene, strict=True):
        assert (found.material, found.provenance["minc"]) == (true.material, true.provenance.get("minc")), true.name
        assert found.provenance["source"] == "true"
    far = blind.surfaces[0].moved(np.array([[1, 0, 0, 50.0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]))
    with pytest.raises(SceneError, match="true material of surface 'x0'"):
        material_source("true", scene=scene)(Scene([far]))


def test_unknown_sources_materials_and_options_are_named():
    with pytest.raises(ConfigError, match="materials=psychic is not a material source; choose uniform"):
        material_source("psychic")
    with pytest.raises(MaterialError, match="granite"):
        material_source("uniform", material="granite")
    with pytest.raises(ConfigError, match="void does not take material"):
        material_source("void", material="wood")
