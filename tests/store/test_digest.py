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


def test_contents_of_a_file_or_folder_count_and_its_name_does_not(tmp_path: Path) -> None:
    def key(name: str, content: str) -> str:
        (tmp_path / name).write_text(content)
        return digest.spec_digest(compose(["scene=scan", f"scene.path={tmp_path / name}"]))

    assert key("one.ply", "ply") == key("two.ply", "ply")
    assert key("one.ply", "ply") != key("one.ply", "other")
    with pytest.raises(MissingError, match=r"absent\.ply"):
        digest.spec_digest(compose(["scene=scan", "scene.path=absent.ply"]))
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "manifest.json").write_text("{}")
    assert digest.path_digest(tmp_path / "a") == digest.path_digest(tmp_path / "b")
    (tmp_path / "b" / "more").write_text("")
    assert digest.path_digest(tmp_path / "a") != digest.path_digest(tmp_path / "b")


def test_digests_cover_values_and_the_type_and_shape_of_arrays() -> None:
    assert digest.spec_digest({"a": np.arange(3), "b": np.float64(2)}) == digest.spec_digest({"b": 2.0, "a": [0, 1, 2]})
    with pytest.raises(TypeError, match="object"):
        digest.spec_digest({"a": object()})
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
    monkeypatch.setattr(digest, "KNOWN", tmp_path / "kept" / "digests")
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


CHANGES = [
    # docstrings, comment and formatting change
    ("near/leaf.py", '"""Text."""\n\n# a comment\nVALUE   =   1\ndef f(x):\n    """X."""\n    raise ValueError(f"no {x}", 1)\n', False),
    ("near/leaf.py", "VALUE = 2\n", True),
    ("near/neighbour.py", "VALUE = 4\n", True),  # this module is not imported, but a module of its package is
    ("near/added.py", "", True),
    ("far/stranger.py", "VALUE = 4\n", False),
    ("near/middle.py", "from . import leaf\nfrom typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import study_x.other\n", False),
    ("near/limits.json", "1", True), ("near/deep/levels.csv", "1", True), ("near/notes.txt", "1", False), ("far/a.csv", "1", False),
]  # fmt: skip


@pytest.mark.parametrize(("file", "content", "changes"), CHANGES)
def test_code_and_data_files_of_whole_packages_count(package: Path, file: str, content: str, changes: bool) -> None:
    (package / file).parent.mkdir(exist_ok=True)
    if not file.endswith(".py"):
        (package / file).write_text("0")
    before = source_digest("study_x.top")
    (package / file).write_text(content)
    assert (source_digest("study_x.top") != before) == changes


def test_the_file_of_digests_counts_in_no_digest() -> None:
    source_digest("radartwin.store")
    assert digest.KNOWN.exists()
    assert digest.KNOWN.name not in digest._data_digest("radartwin.store")


def test_a_file_keeps_the_digests_of_source_files_for_other_processes(package: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = source_digest("study_x.top")
    kept = digest.KNOWN.parent.rename(digest.KNOWN.parent.with_name("a"))
    digest.KNOWN.parent.touch()  # a folder that cannot be made
    assert source_digest("study_x.top") == before
    monkeypatch.setattr(digest, "KNOWN", kept / digest.KNOWN.name)
    monkeypatch.setattr(digest, "_tree_digest", None)
    assert source_digest("study_x.top") == before


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


def test_versions_of_numerical_packages_count(package: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = source_digest("study_x.top")
    versions = digest.importlib.metadata.version
    monkeypatch.setattr(digest.importlib.metadata, "version", lambda name: "0.1" if name == "scipy" else versions(name))
    assert source_digest("study_x.top") != before
    with pytest.raises(ConfigError, match=r"radartwin\.nowhere"):
        digest.source_digest(["radartwin.nowhere"])
    digest.source_digest(["experiments.campaign.truth"])
    known = digest._code_digest.cache_info().currsize
    digest.include("experiments")
    assert digest._code_digest.cache_info().currsize == known > 100, "an experiment of the project keeps the known digests"
