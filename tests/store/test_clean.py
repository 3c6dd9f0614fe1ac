"""`radartwin clean` measures and deletes the cache of an output folder, and deletes nothing else."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from radartwin.io import files
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


def test_an_output_folder_without_a_cache_is_fine(tmp_path: Path, inside) -> None:
    (tmp_path / "out").mkdir()
    assert inside("clean", "--cache", "--output", "out").stdout == f"clean: deleted 0.0 MB in {Path('out') / 'cache'}\n"


def test_only_stored_results_are_deleted(output: Path) -> None:
    cache = output / "cache"
    foreign = ["photos/a.jpg", "clean/notes.txt", f"clean/{'a' * 32}/a.txt", "clean/sub/meta.json", "paths/a.npz", f"paths/{'b' * 32}"]
    mine = [f"clean/{'c' * 32}.tmp/lock", f"clean/.{'c' * 32}.radartwin-here-1.tmp/half", f"paths/{'d' * 64}.npz"]
    for name in (*foreign, *mine):
        (cache / name).parent.mkdir(parents=True, exist_ok=True)
        (cache / name).write_text("x")
    (cache / "clean" / ("e" * 32)).symlink_to(output / "tables")
    assert list(cache_bytes(output)) == ["clean", "scan", "paths"]
    assert clean(output, cache=True) == 0
    left = sorted(path.relative_to(cache).as_posix() for path in cache.rglob("*") if path.is_file())
    assert left == sorted(foreign)
    assert (output / "tables" / "gaps.csv").exists()


def test_nothing_is_deleted_while_a_process_computes_a_result(output: Path, inside) -> None:
    lock = output / "cache" / "scan" / f".{'a' * 32}.lock"
    with files.lock(lock):
        before = sorted(output.rglob("*"))
        done = inside("clean", "--cache", "--output", output)
        assert done.returncode == 2
        assert done.stderr == f"radartwin: {lock}: a running process computes this result; end the process, then try again\n"
        assert sorted(output.rglob("*")) == before
