"""Every material source keeps the same promises: geometry and target untouched, every surface labelled and told by whom."""

import numpy as np
import pytest

from radartwin.errors import ConfigError, MaterialError, MissingError, SceneError
from radartwin.label.sources import SOURCES, MaterialSource, material_source
from radartwin.materials import Layered
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
    }


@pytest.mark.parametrize("name", ["uniform", "uniform layered", "void", "true", "vlm"])
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
    assert {s.name for s in labelled.only("object")} == {"turntable", "stand", "reflector"}
    assert labelled.provenance["materials"] == source.name
    assert labelled.provenance["room"] == "lab"
    assert before == [(s.name, s.material, s.provenance) for s in scene]  # the input is not changed
    again = source(labelled)
    assert [(s.name, s.material) for s in again] == [(s.name, s.material) for s in labelled]


def test_every_source_is_under_contract(scene):
    assert {name.split()[0] for name in sources(scene)} == set(SOURCES)


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
    with pytest.raises(MissingError, match="no recorded answers for lab; use materials=uniform"):
        material_source("vlm")(scene)
    with pytest.raises(SceneError, match="leave out surface 'floor'"):
        material_source("vlm", answers={})(scene)


def test_unknown_sources_materials_and_options_are_named():
    with pytest.raises(ConfigError, match="materials=psychic is not a material source; choose uniform"):
        material_source("psychic")
    with pytest.raises(MaterialError, match="granite"):
        material_source("uniform", material="granite")
    with pytest.raises(ConfigError, match="void does not take material"):
        material_source("void", material="wood")
