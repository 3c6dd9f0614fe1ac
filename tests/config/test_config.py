"""A mistake in a configuration gives a one-line error that names the configuration key and a correct value."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
from composing import compose

from radartwin.builders.radar import build_radar
from radartwin.config import messages
from radartwin.config.compose import Composer, combinations, groups, path_override, quoted
from radartwin.errors import ConfigError, MissingError
from radartwin.radar.chirp import Radar
from radartwin.runs.experiment import load

MISTAKES = {
    "unknown key": (["scene.nme=x"], ("scene.nme", "did you mean name", "target_size_m")),
    "key added with a plus": (["+scene.colour=red"], ("scene.colour", "target_size_m")),
    "key of another option": (
        ["simulator=points", "simulator.max_bounces=3"],
        ("simulator.max_bounces is not read by simulator=points", "choose simulator=mitsuba|auto|sionna", "has backend", "step_deg"),
    ),
    "key of another option, added with a plus": (["+simulator.grid=64"], ("simulator.grid", "simulator=mitsuba", "simulator=rfgenesis")),
    "unknown group": (["sene=lab"], ("sene", "did you mean scene", "materials")),
    "unknown option": (["scene=labb"], ("scene=labb", "did you mean lab", "options: atrium, empty, lab, plate, scan, squash_court, void")),
    "unknown experiment": (["experiment=enviroment"], ("enviroment", "did you mean environment")),
    "word for a whole number": (["radar.num_samples=many"], ("radar.num_samples", "many", "Integer")),
    "word in a list of numbers": (["experiment.distances_m=[near]"], ("experiment.distances_m[0]", "near")),
    "null for an option": (["scene=null"], ("scene=null", "lab")),
    "null for a required value": (["output=null"], ("output", "not Optional")),
    "null for a setting": (["simulator.max_bounces=null"], ("simulator.max_bounces", "not Optional")),
    "zero for a positive number": (["simulator.max_bounces=0"], ("simulator.max_bounces=0", "above zero")),
    "unknown word": (["simulator.variant=gpu"], ("simulator.variant=gpu", "auto", "llvm", "cuda")),
    "negative gap": (["measured.gap.clutter=-1"], ("measured.gap.clutter=-1", "from 0 to 4")),
    "unreadable override": (["scene=["], ("scene=[",)),
    "several values without -m": (["scene=lab,empty"], ("scene=lab,empty", "-m")),
    "several options as a list": (["radar=[iwr1843,iwr6843]"], ("radar", "several values")),
    "no name": (["=3"], ("'=3'", "write group=option or key=value")),
    "deletion of a number": (["~radar=3"], ("'~radar=3'",)),
    "interpolation of an unknown key": (["scene.path=${nowhere}", "scene=scan"], ("scene.path", "nowhere")),
    "scan without path": (["scene=scan"], ("scene=scan", "scene.path")),
    "path without scan": (["scene.path=room.glb"], ("scene.path", "scene=scan")),
    "radar=file without file": (["radar=file"], ("radar=file", "radar.file")),
    "radar file and a field of it": (["radar=file", "radar.file=r.cfg", "radar.num_samples=64"], ("radar.num_samples", "r.cfg")),
    "radar file and false": (["radar=file", "radar.file=r.cfg", "radar.real_sampling=false"], ("radar.real_sampling", "r.cfg")),
    "infinite ray density": (["simulator.rays_per_wavelength2=inf"], ("simulator.rays_per_wavelength2=inf", "finite")),
    "heading that is no number": (["trajectory.heading_deg=nan"], ("trajectory.heading_deg=nan", "finite")),
    "position that is no number": (["trajectory.position_m=[0,nan,1]"], ("trajectory.position_m=nan", "finite")),
    "recordings without folder": (["measured=recordings"], ("measured=recordings", "measured.folder")),
    "folder without recordings": (["measured.folder=x"], ("measured.folder", "measured=recordings")),
    "recordings in a folder that is no set": (["measured=recordings", "measured.folder=/"], ("measured.folder=/", "no recording set")),
    "recordings in an absent folder": (["measured=recordings", "measured.folder=/nowhere"], ("measured.folder=/nowhere", "is no folder")),
    "true materials of a scan": (["scene=scan", "scene.path=x.glb", "materials=true"], ("materials=true", "scan")),
    "nothing to simulate": (["materials=void", "scene.target=none"], ("materials=void", "scene.target")),
    "field of another source": (
        ["materials=void", "materials.material=wood"],
        ("materials.material", "materials=void", "materials=uniform"),
    ),
    "another option by its selector": (["materials.source=void"], ("materials.source=void", "choose materials=void")),
    "labels of a procedural room": (["scene=lab", "materials=scene"], ("materials=scene", "scene=scan")),
    "share above one": (["materials=random", "materials.p=1.5"], ("materials.p=1.5", "0 to 1")),
    "shots without few_shot": (["supervision.shots=3"], ("supervision.shots=3", "few_shot")),
    "few_shot without shots": (["supervision=few_shot", "supervision.shots=0"], ("supervision.shots", "at least 1")),
    "server without tracking": (["tracking=off", "tracking.uri=http://localhost:5000"], ("tracking=off", "mlflow")),
    "drive through the target": (["trajectory=depth", "trajectory.distance_m=0.5"], ("trajectory.length_m", "0.5")),
}


@pytest.mark.parametrize(("overrides", "words"), MISTAKES.values(), ids=MISTAKES)
def test_mistake_is_one_line_that_names_it(overrides: list[str], words: tuple[str, ...]) -> None:
    with pytest.raises(ConfigError) as caught:
        compose(overrides)
    message = str(caught.value)
    assert "\n" not in message
    for word in words:
        assert word in message


@pytest.mark.parametrize("key", ["name=../x", "name=a b", "name=.x", "module=.x", "module=a..b", "module=../x"])
def test_experiment_name_must_be_a_module_name(key: str) -> None:
    with pytest.raises(ConfigError, match="is not the name of a module"):
        load(compose([f"experiment.{key}"]).experiment)


@pytest.mark.parametrize("option", ["distances_m=[1]", "pairs=[mug/lab/turntable/1]", "part=1", "parts=2"])
def test_option_that_the_experiment_does_not_read_is_refused(option: str) -> None:
    more = ["experiment.parts=2"] if option == "part=1" else []
    with pytest.raises(ConfigError, match=r"experiment\.part|experiment\.(distances_m|pairs) is not read by experiment=turntable_shape"):
        load(compose(["experiment=turntable_shape", f"experiment.{option}", *more]).experiment)


def test_radar_has_the_element_of_its_board_or_file_unless_one_is_given(tmp_path: Path) -> None:
    assert build_radar(compose().radar) == Radar.iwr1843()
    assert build_radar(compose(["radar.element=isotropic"]).radar).element == "isotropic"
    assert build_radar(compose(["radar=openradar_77ghz"]).radar).element == "iwr1843"
    stored = replace(Radar.iwr1843(), num_samples=64)
    (tmp_path / "r.json").write_text(json.dumps(stored.to_dict()))
    given = ["radar=file", f"radar.file={tmp_path / 'r.json'}"]
    assert build_radar(compose(given).radar) == stored
    assert build_radar(compose([*given, "radar.element=isotropic"]).radar) == replace(stored, element="isotropic")


NEEDS = {"scene=scan", "materials=scene", "radar=file", "trajectory=file", "measured=recordings"}


@pytest.mark.parametrize("group", groups())
def test_every_shipped_option_composes_or_names_what_it_needs(group: str) -> None:
    for option in groups()[group]:
        override = f"{group}={option}"
        if override in NEEDS:
            with pytest.raises(ConfigError, match="needs"):
                compose([override])
        else:
            compose([override])


def test_overrides_have_precedence_and_the_option_true_is_no_boolean() -> None:
    assert compose(["materials=true"]).materials.source == "true"
    assert quoted(["materials=vlm,true", "radar.real_sampling=true"]) == ["materials=vlm,'true'", "radar.real_sampling=true"]
    assert compose(["scene=scan", "scene.path=x"]).materials.source == "scene"
    assert compose(["scene=scan", "scene.path=x", "materials=uniform"]).materials.source == "uniform"
    assert compose(["materials=vlm", "scene=scan", "scene.path=x"]).materials.source == "vlm"
    assert compose(["experiment=environment"]).experiment.distances_m == [0.5, 1.0, 1.5, 2.0]
    assert compose(["experiment=environment", "experiment.distances_m=[3]"]).experiment.distances_m == [3.0]
    assert compose(["experiment=environment", "scene=atrium"]).scene.name == "atrium"


def test_user_folder_of_any_name_adds_options(tmp_path: Path) -> None:
    name = "a b, 'c' = {d} [x],y=z"
    files = {
        "scene/plain.yaml": "name: lab\ntarget: sphere\n",
        "scene/mine.yaml": "defaults: [schema_lab]\ntarget: sphere\ndetail: shell\n",
        "simulator/coarse.yaml": "defaults: [points]\nstep_deg: 5\n",
        "simulator/bare.yaml": "backend: points\n",
    }
    for file, text in files.items():
        (tmp_path / name / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name / file).write_text(text)
    with pytest.raises(MissingError, match="no_such_folder"):
        Composer([tmp_path / "no_such_folder"]).compose([])
    composer = Composer([tmp_path / name])
    assert composer.compose(["scene=plain"]).scene.target == "sphere"
    assert composer.compose(["scene=mine"]).scene.room_options() == {"detail": "shell"}
    assert composer.compose(["simulator=coarse"]).simulator.settings()["step_deg"] == 5.0
    for overrides in (["simulator=bare"], ["simulator=bare", "simulator.step_deg=2"]):
        with pytest.raises(ConfigError, match="names no schema"):
            composer.compose(overrides)


@pytest.mark.parametrize("name", ["a b, 'c' = {d}", "[x],y=z", "\\a\\\\b", "end\\", "${a}", "\\${a:b}\\'", "\\\\${a", "#?%20$"])
def test_path_keeps_all_its_characters(name: str, tmp_path: Path) -> None:
    overrides = [path_override("output", tmp_path / name)]
    assert compose(overrides).output == str(tmp_path / name)
    assert compose(combinations(overrides)[0]).output == str(tmp_path / name), "in a job of a sweep"


def test_errors_that_are_each_others_context_end_the_search_for_a_cause() -> None:
    first, second = ValueError("first"), ValueError("second")
    first.__context__, second.__context__ = second, first
    assert "first" in messages.explain(first)
