"""`radartwin clean` measures and deletes the cache of an output folder, and deletes nothing else."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from radartwin.runs.doctor import examine
from radartwin.store.clean import cache_bytes, clean
from radartwin.store.products import Store, save_arrays


@pytest.fixture
def output(tmp_path: Path) -> Path:
    store = Store(tmp_path / "out" / "cache")
    for kind, count in (("clean", 100_000), ("scan", 10)):
        store.fetch(kind, {}, ["radartwin.constants"], lambda folder, n=count: save_arrays(folder, {"x": np.zeros(n)}))
    (tmp_path / "out" / "tables").mkdir()
    (tmp_path / "out" / "tables" / "gaps.csv").write_text("metric\n")
    return tmp_path / "out"


def test_sizes_are_reported_by_kind_and_nothing_is_deleted_without_the_option(output: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert clean(output, cache=False) == 0
    assert list(cache_bytes(output)) == ["clean", "scan"]
    assert cache_bytes(output)["clean"] > 800_000
    assert "clean                      0.8 MB" in capsys.readouterr().out


def test_cache_is_deleted_and_tables_stay(output: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert clean(output, cache=True) == 0
    assert cache_bytes(output) == {}
    assert (output / "tables" / "gaps.csv").exists()
    assert "clean: deleted 0.8 MB" in capsys.readouterr().out


def test_doctor_says_how_large_the_cache_is(output: Path) -> None:
    (finding,) = [finding for finding in examine(output) if finding.topic == "cache"]
    assert finding.text.startswith(f"1 MB in {output / 'cache'}; radartwin clean --cache deletes it")


def test_an_output_folder_without_a_cache_is_fine(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert clean(tmp_path / "none", cache=True) == 0
    assert "0.0 MB" in capsys.readouterr().out
