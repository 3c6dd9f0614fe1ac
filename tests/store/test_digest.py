"""The key of a stored result changes with every input that can change the result, and with no other input."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from radartwin import source_files
from radartwin.config.compose import Composer, compose
from radartwin.errors import ConfigError, MissingError
from radartwin.store import digest


def test_settings_that_change_no_result_keep_the_key() -> None:
    composer = Composer()
    base = digest.spec_digest(composer.compose([]))
    for same in (["output=elsewhere"], ["tracking=off"], ["tracking.uri=http://h:1"], ["simulator.variant=llvm"]):
        assert digest.spec_digest(composer.compose(same)) == base
    for other in (["seed=1"], ["scene=empty"], ["measured.gap.clutter=0.5"], ["profile=paper"], ["radar.num_chirps=8"]):
        assert digest.spec_digest(composer.compose(other)) != base


def test_content_of_a_file_counts_and_its_name_does_not(tmp_path: Path) -> None:
    def key(name: str, content: str) -> str:
        (tmp_path / name).write_text(content)
        return digest.spec_digest(compose(["scene=scan", f"scene.path={tmp_path / name}"]))

    assert key("one.ply", "ply") == key("two.ply", "ply")
    assert key("one.ply", "ply") != key("one.ply", "other")
    with pytest.raises(MissingError, match=r"absent\.ply"):
        digest.spec_digest(compose(["scene=scan", "scene.path=absent.ply"]))


def test_relative_names_and_content_of_a_folder_count(tmp_path: Path) -> None:
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "manifest.json").write_text("{}")
    assert digest.path_digest(tmp_path / "a") == digest.path_digest(tmp_path / "b")
    (tmp_path / "b" / "more").write_text("")
    assert digest.path_digest(tmp_path / "a") != digest.path_digest(tmp_path / "b")


def test_array_and_list_of_the_same_values_have_the_same_digest() -> None:
    assert digest.spec_digest({"a": np.arange(3), "b": np.float64(2)}) == digest.spec_digest({"b": 2.0, "a": [0, 1, 2]})
    with pytest.raises(TypeError, match="object"):
        digest.spec_digest({"a": object()})


def test_array_digest_covers_type_shape_and_values() -> None:
    grid = np.arange(6.0)
    arrays = [grid, grid.reshape(2, 3), grid.reshape(3, 2), grid.astype(np.float32), grid[::-1]]
    assert len({digest.array_digest(array) for array in arrays}) == len(arrays)
    assert digest.array_digest(grid.reshape(2, 3).T) == digest.array_digest(grid.reshape(2, 3).T.copy())


SOURCES = {
    "__init__": "",
    "top": "def run():\n    from study_x.near.middle import leaf\n    return leaf\n",
    "near/__init__": "",
    "near/middle": "from . import leaf\nfrom typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import study_x.far.stranger\n",
    "near/leaf": '"""Doc."""\nVALUE = 1  # why\n\n\ndef f(x):\n    raise ValueError(f"no {x}", 1)\n',
    "near/neighbour": "VALUE = 2\n",
    "far/stranger": "VALUE = 3\n",
}


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Write a package study_x. The module study_x.top imports near.middle inside a function, near.middle imports near.leaf, and no module
    imports far.stranger.
    """
    folder = tmp_path / "study_x"
    for name, source in SOURCES.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / f"{name}.py").write_text(source)
    monkeypatch.syspath_prepend(str(tmp_path))
    digest.include("study_x")
    digest.forget()
    return folder


def source_digest(*entries: str) -> str:
    """Return the digest of the source code of these modules as a new process computes it."""
    digest.forget()
    return digest.source_digest(entries)


def test_closure_follows_imports_in_functions_and_relative_ones_but_not_those_for_type_checkers(package: Path) -> None:
    reached = source_files.closure(("study_x.top",))
    assert reached == {"study_x", "study_x.top", "study_x.near", "study_x.near.middle", "study_x.near.leaf"}


@pytest.mark.parametrize(
    ("file", "content", "changes"),
    [
        # docstrings, comment and formatting change
        ("near/leaf", '"""Text."""\n\n# a comment\nVALUE   =   1\ndef f(x):\n    """X."""\n    raise ValueError(f"no {x}", 1)\n', False),
        ("near/leaf", "VALUE = 2\n", True),
        ("near/neighbour", "VALUE = 4\n", True),  # this module is not imported, but a module of its package is
        ("near/added", "", True),
        ("far/stranger", "VALUE = 4\n", False),
        ("near/middle", "from . import leaf\nfrom typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import study_x.other\n", False),
    ],
)
def test_code_of_whole_packages_counts(package: Path, file: str, content: str, changes: bool) -> None:
    before = source_digest("study_x.top")
    (package / f"{file}.py").write_text(content)
    assert (source_digest("study_x.top") != before) == changes


@pytest.mark.parametrize(
    ("file", "changes"), [("near/limits.json", True), ("near/deep/levels.csv", True), ("near/notes.txt", False), ("far/a.csv", False)]
)
def test_data_files_of_reached_packages_count(package: Path, file: str, changes: bool) -> None:
    (package / file).parent.mkdir(exist_ok=True)
    (package / file).write_text("1")
    before = source_digest("study_x.top")
    (package / file).write_text("2")
    assert (source_digest("study_x.top") != before) == changes


def test_a_package_as_entry_stands_for_all_its_modules(package: Path) -> None:
    assert source_digest("study_x.near") == source_digest("study_x.near.leaf")
    (package / "near" / "neighbour.py").write_text("import study_x.far.stranger\n")
    assert source_digest("study_x.near") != source_digest("study_x.near.leaf")


def test_a_name_that_radartwin_loads_on_first_use_counts_with_its_module(package: Path) -> None:
    def reached(statement: str) -> frozenset[str]:
        (package / "top.py").write_text(statement)
        digest.forget()
        return source_files.closure(("study_x.top",))

    everything = reached("import radartwin as rt\n")
    assert {"radartwin.radar.chirp", "radartwin.simulation.simulate"} <= everything
    radar = reached("from radartwin import Radar\n")
    assert "radartwin.radar.chirp" in radar
    assert "radartwin.simulation.simulate" not in radar
    assert "radartwin.radar.chirp" not in reached("from radartwin import __version__\n")


def test_recordings_do_not_depend_on_code_that_learns_or_reports() -> None:
    if not (Path(digest.__file__).parents[2] / "experiments").is_dir():
        pytest.skip("the installed package has no folder experiments/ beside it; run this test in a checkout")
    for entry in ("experiments.campaign.truth", "experiments.campaign.twin", "radartwin.simulation"):
        packages = {".".join(name.split(".")[:2]) for name in source_files.closure((entry,))}
        assert "radartwin.simulation" in packages
        assert not packages & {"experiments.recognition", "experiments.gaps", "radartwin.recognize", "radartwin.runs", "radartwin.plotting"}


def test_an_unknown_module_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"radartwin\.nowhere"):
        digest.source_digest(["radartwin.nowhere"])


def test_versions_of_numerical_packages_count(package: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = source_digest("study_x.top")
    versions = digest.importlib.metadata.version
    monkeypatch.setattr(digest.importlib.metadata, "version", lambda name: "0.1" if name == "scipy" else versions(name))
    assert source_digest("study_x.top") != before


def test_loading_an_experiment_of_the_project_keeps_the_digests_that_are_known():
    digest.source_digest(["experiments.campaign.truth"])
    known = digest._code_digest.cache_info().currsize
    digest.include("experiments")
    assert digest._code_digest.cache_info().currsize == known > 100
