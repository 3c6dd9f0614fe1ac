"""A key changes with everything that could change a number and with nothing else."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from radartwin.config.compose import compose
from radartwin.errors import ConfigError, MissingError
from radartwin.store import digest


def test_where_and_how_do_not_change_the_key_and_what_does() -> None:
    base = digest.spec_digest(compose())
    for same in (["output=elsewhere"], ["tracking=off"], ["tracking.uri=http://h:1"], ["simulator.variant=llvm"]):
        assert digest.spec_digest(compose(same)) == base
    for other in (["seed=1"], ["scene=empty"], ["measured.gap.clutter=0.5"], ["profile=paper"], ["radar.num_chirps=8"]):
        assert digest.spec_digest(compose(other)) != base


def test_a_file_counts_by_its_content_and_not_by_its_name(tmp_path: Path) -> None:
    def key(name: str, content: str) -> str:
        (tmp_path / name).write_text(content)
        return digest.spec_digest(compose(["scene=scan", f"scene.path={tmp_path / name}"]))

    assert key("one.ply", "ply") == key("two.ply", "ply")
    assert key("one.ply", "ply") != key("one.ply", "other")
    with pytest.raises(MissingError, match=r"absent\.ply"):
        digest.spec_digest(compose(["scene=scan", "scene.path=absent.ply"]))


def test_a_folder_counts_by_relative_names_and_content(tmp_path: Path) -> None:
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "manifest.json").write_text("{}")
    assert digest.path_digest(tmp_path / "a") == digest.path_digest(tmp_path / "b")
    (tmp_path / "b" / "more").write_text("")
    assert digest.path_digest(tmp_path / "a") != digest.path_digest(tmp_path / "b")


def test_arrays_and_their_lists_are_the_same_content() -> None:
    assert digest.spec_digest({"a": np.arange(3), "b": np.float64(2)}) == digest.spec_digest({"b": 2.0, "a": [0, 1, 2]})
    with pytest.raises(TypeError, match="object"):
        digest.spec_digest({"a": object()})


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A package `study_x`: top imports middle (in a function), middle imports leaf relatively; stranger stands alone."""
    folder = tmp_path / "study_x"
    folder.mkdir()
    sources = {
        "__init__": "",
        "top": "def run():\n    from study_x.middle import leaf\n    return leaf\n",
        "middle": "from . import leaf\n",
        "leaf": '"""Doc."""\nVALUE = 1  # why\n',
        "stranger": "VALUE = 2\n",
    }
    for name, source in sources.items():
        (folder / f"{name}.py").write_text(source)
    monkeypatch.syspath_prepend(str(tmp_path))
    digest.include("study_x")
    return folder


def fresh(root: str) -> str:
    """The digest as a new process would see it."""
    for function in (digest.import_closure, digest.imports, digest._tree_digest, digest._source, digest._on_demand):
        function.cache_clear()
    return digest.source_digest([root])


def test_the_closure_follows_lazy_and_relative_imports_and_nothing_else(package: Path) -> None:
    fresh("study_x.top")
    reached = {name for name in digest.import_closure(("study_x.top",)) if name.startswith("study_x.")}
    assert reached == {"study_x.top", "study_x.middle", "study_x.leaf"}


def test_code_counts_and_its_comments_docstrings_and_layout_do_not(package: Path) -> None:
    base = fresh("study_x.top")
    (package / "leaf.py").write_text('"""Another text."""\n\n# a comment\nVALUE   =   1\n')
    assert fresh("study_x.top") == base
    (package / "stranger.py").write_text("VALUE = 3\n")
    assert fresh("study_x.top") == base
    (package / "leaf.py").write_text("VALUE = 2\n")
    assert fresh("study_x.top") != base


def test_names_that_a_package_loads_on_demand_belong_to_whoever_imports_them(package: Path) -> None:
    def reached(statement: str) -> frozenset[str]:
        (package / "top.py").write_text(statement)
        fresh("study_x.top")
        return digest.import_closure(("study_x.top",))

    everything = reached("import radartwin as rt\n")
    assert {"radartwin.radar.chirp", "radartwin.simulation.simulate"} <= everything
    radar = reached("from radartwin import Radar\n")
    assert "radartwin.radar.chirp" in radar
    assert "radartwin.simulation.simulate" not in radar
    assert "radartwin.radar.chirp" not in reached("from radartwin import __version__\n")


def test_an_unknown_module_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"radartwin\.nowhere"):
        digest.source_digest(["radartwin.nowhere"])
