"""Every mistake in a configuration is one line that names it, and what would have been right."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from radartwin.build.radar import build_radar
from radartwin.config import compose as composer
from radartwin.config.compose import combinations, compose
from radartwin.config.config import Config
from radartwin.config.study import GapConfig
from radartwin.errors import ConfigError, MissingError
from radartwin.radar.chirp import Radar
from radartwin.runs.experiment import load

MISTAKES = {
    "a key that does not exist": (["scene.nme=x"], ("scene.nme", "did you mean name", "target_size_m")),
    "a key added with a plus": (["+scene.colour=red"], ("scene.colour", "target_size_m")),
    "a group that does not exist": (["sene=lab"], ("sene", "did you mean scene", "materials")),
    "an option that does not exist": (["scene=labb"], ("scene=labb", "did you mean lab", "empty", "plate", "scan")),
    "an experiment that does not exist": (["experiment=enviroment"], ("enviroment", "did you mean environment")),
    "a word for a whole number": (["radar.num_samples=many"], ("radar.num_samples", "many", "Integer")),
    "a word in a list of numbers": (["experiment.distances_m=[near]"], ("experiment.distances_m[0]", "near")),
    "null for an option": (["scene=null"], ("scene=null", "lab")),
    "null where a value is needed": (["output=null"], ("output", "not Optional")),
    "a value outside its range": (["simulator.max_bounces=0"], ("simulator.max_bounces=0", "above zero")),
    "a value that is not a choice": (["simulator.variant=gpu"], ("simulator.variant=gpu", "auto", "llvm", "cuda")),
    "a negative gap": (["measured.gap.clutter=-1"], ("measured.gap.clutter=-1", "zero")),
    "an unreadable override": (["scene=["], ("scene=[",)),
    "a sweep without -m": (["scene=lab,empty"], ("scene=lab,empty", "-m")),
    "an interpolation to nowhere": (["scene.path=${nowhere}"], ("scene.path", "nowhere")),
    "scan without path": (["scene=scan"], ("scene=scan", "scene.path")),
    "path without scan": (["scene.path=room.glb"], ("scene.path", "scene=scan")),
    "radar file without file": (["radar=file"], ("radar=file", "radar.file")),
    "a radar file and a field of it": (
        ["radar=file", "radar.file=r.cfg", "radar.num_samples=64"],
        ("radar.num_samples", "r.cfg"),
    ),
    "a radar file and false": (["radar=file", "radar.file=r.cfg", "radar.real_sampling=false"], ("radar.real_sampling", "r.cfg")),
    "rays without end": (["simulator.rays_per_wavelength2=inf"], ("simulator.rays_per_wavelength2=inf", "finite")),
    "a heading that is no number": (["trajectory.heading_deg=nan"], ("trajectory.heading_deg=nan", "finite")),
    "a position that is no number": (["trajectory.position_m=[0,nan,1]"], ("trajectory.position_m=nan", "finite")),
    "a distance that is no number": (["trajectory.distance_m=nan"], ("trajectory.distance_m=nan", "finite")),
    "an endless gap": (["measured.gap.clutter=inf"], ("measured.gap.clutter=inf", "finite")),
    "recordings without folder": (["measured=recordings"], ("measured=recordings", "measured.folder")),
    "true materials of a scan": (["scene=scan", "scene.path=x.glb", "materials=true"], ("materials=true", "scan")),
    "nothing to simulate": (["materials=void", "scene.target=none"], ("materials=void", "scene.target")),
    "a field of another source": (
        ["materials=void", "materials.material=wood"],
        ("materials.material=wood", "materials=void", "materials=uniform"),
    ),
    "labels of a procedural room": (["scene=lab", "materials=scene"], ("materials=scene", "scene=scan")),
    "a share above one": (["materials=random", "materials.p=1.5"], ("materials.p=1.5", "0 to 1")),
    "a provider that does not exist": (["materials=vlm", "materials.provider=oracle"], ("oracle", "recorded", "server", "local")),
    "shots without few_shot": (["supervision.shots=3"], ("supervision.shots=3", "few_shot")),
    "few_shot without shots": (["supervision=few_shot", "supervision.shots=0"], ("supervision.shots", "at least 1")),
    "server without tracking": (["tracking=off", "tracking.uri=http://localhost:5000"], ("tracking=off", "mlflow")),
    "a sweep through the target": (["trajectory=depth", "trajectory.distance_m=0.5"], ("trajectory.length_m", "0.5")),
}


@pytest.mark.parametrize(("overrides", "words"), MISTAKES.values(), ids=MISTAKES)
def test_a_mistake_is_one_line_that_names_it(overrides: list[str], words: tuple[str, ...]) -> None:
    with pytest.raises(ConfigError) as caught:
        compose(overrides)
    message = str(caught.value)
    assert "\n" not in message
    for word in words:
        assert word in message


def test_a_radar_file_says_everything_but_the_element_may_be_chosen(tmp_path: Path) -> None:
    written = replace(Radar.iwr1843(), num_samples=64)
    (tmp_path / "r.json").write_text(json.dumps(written.to_dict()))
    given = ["radar=file", f"radar.file={tmp_path / 'r.json'}"]
    assert build_radar(compose(given).radar) == written
    assert build_radar(compose([*given, "radar.element=isotropic"]).radar) == replace(written, element="isotropic")


def test_a_board_has_its_pattern_unless_told_otherwise() -> None:
    assert build_radar(compose().radar) == Radar.iwr1843()
    assert build_radar(compose(["radar.element=isotropic"]).radar).element == "isotropic"
    assert build_radar(compose(["radar=openradar_77ghz"]).radar).element == "iwr1843"


@pytest.mark.parametrize("key", ["name=../x", "name=a b", "name=.x", "module=.x", "module=a..b", "module=../x"])
def test_an_experiment_by_what_is_no_name_is_refused(key: str) -> None:
    with pytest.raises(ConfigError, match="is not the name of a module"):
        load(compose([f"experiment.{key}"]).experiment)


def test_every_shipped_option_composes_or_says_what_it_needs() -> None:
    needs = {"scene=scan", "materials=scene", "radar=file", "trajectory=file", "measured=recordings"}
    for group, options in composer.groups().items():
        for option in options:
            override = f"{group}={option}"
            if override in needs:
                with pytest.raises(ConfigError, match="needs"):
                    compose([override])
            else:
                compose([override])


def test_the_option_named_true_is_an_option_and_not_a_boolean() -> None:
    assert compose(["materials=true"]).materials.source == "true"
    assert composer.quoted(["materials=vlm,true", "radar.real_sampling=true"]) == [
        "materials=vlm,'true'",
        "radar.real_sampling=true",
    ]


def test_defaults_of_the_dataclasses_and_of_the_files_agree() -> None:
    composed, built = compose(), Config()
    assert composed.simulator == built.simulator
    assert composed.profile == built.profile
    assert composed.measured.gap == GapConfig()


def test_a_scan_keeps_its_labels_unless_a_source_is_named() -> None:
    assert compose(["scene=scan", "scene.path=x"]).materials.source == "scene"
    assert compose(["scene=scan", "scene.path=x", "materials=uniform"]).materials.source == "uniform"
    assert compose(["materials=vlm", "scene=scan", "scene.path=x"]).materials.source == "vlm"


def test_an_experiment_file_sets_other_groups_and_yields_to_the_command_line() -> None:
    assert compose(["experiment=environment"]).experiment.distances_m == [0.5, 1.0, 1.5, 2.0]
    assert compose(["experiment=environment", "experiment.distances_m=[3]"]).experiment.distances_m == [3.0]
    assert compose(["experiment=environment", "scene=empty"]).scene.name == "empty"


def test_a_users_folder_adds_options(tmp_path: Path) -> None:
    folder = tmp_path / "my conf" / "scene"
    folder.mkdir(parents=True)
    (folder / "mine.yaml").write_text("name: lab\ntarget: sphere\n")
    assert compose(["scene=mine"], [folder.parent]).scene.target == "sphere"
    with pytest.raises(MissingError, match="no_such_folder"):
        compose([], [tmp_path / "no_such_folder"])


@pytest.mark.parametrize("name", ["a b, 'c' = {d}", "[x],y=z", "\\a\\\\b", "end\\", "${a}", "\\${a:b}\\'", "\\\\${a", "#?%20$"])
def test_a_path_survives_whatever_signs_it_has(name: str, tmp_path: Path) -> None:
    overrides = [composer.path_override("output", tmp_path / name)]
    assert compose(overrides).output == str(tmp_path / name)
    assert compose(combinations(overrides)[0]).output == str(tmp_path / name), "as a job of a sweep"


@pytest.mark.parametrize("name", ["a b, 'c' = {d}", "[x],y=z"])
def test_a_users_folder_may_have_any_name(name: str, tmp_path: Path) -> None:
    (tmp_path / name / "scene").mkdir(parents=True)
    (tmp_path / name / "scene" / "mine.yaml").write_text("name: lab\ntarget: sphere\n")
    assert compose(["scene=mine"], [tmp_path / name]).scene.target == "sphere"
