"""A product is whole or absent, computed once, and retried after a failure or a kill; whatever else is running."""

from __future__ import annotations

import multiprocessing
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from radartwin import files
from radartwin.errors import OutputError
from radartwin.store import Store, save_arrays, save_json

ROOTS = ["radartwin.constants"]


def one(folder: Path) -> None:
    save_arrays(folder, {"x": np.arange(4.0)})
    save_json(folder, "note", {"a": 1})


def test_a_product_is_built_once_and_read_back(tmp_path: Path) -> None:
    first = Store(tmp_path).fetch("recording", {"seed": 1}, ROOTS, one)
    store = Store(tmp_path)
    again = store.fetch("recording", {"seed": 1}, ROOTS, lambda folder: pytest.fail("built twice"))
    assert (first.reused, again.reused) == (False, True)
    assert again.arrays()["x"].tolist() == [0, 1, 2, 3]
    assert again.read_json("note") == {"a": 1}
    assert again.read_json("meta")["spec"] == {"seed": 1}
    assert (store.counts.simulated, store.counts.reused, store.counts.scored) == (0, 1, 0)


def test_another_specification_or_input_or_kind_is_another_product(tmp_path: Path) -> None:
    store = Store(tmp_path)
    keys = {
        store.key("recording", {"seed": 1}, ROOTS),
        store.key("recording", {"seed": 2}, ROOTS),
        store.key("recording", {"seed": 1}, ROOTS, {"scan": "00"}),
        store.key("features", {"seed": 1}, ROOTS),
        store.key("recording", {"seed": 1}, ["radartwin.errors"]),
    }
    assert len(keys) == 5


def test_a_failed_build_leaves_nothing_and_is_tried_again(tmp_path: Path) -> None:
    def fails(folder: Path) -> None:
        (folder / "half").write_text("...")
        raise RuntimeError("solver")

    store = Store(tmp_path)
    with pytest.raises(RuntimeError, match="solver"):
        store.fetch("recording", {}, ROOTS, fails)
    assert list((tmp_path / "recording").iterdir()) == []
    assert not store.fetch("recording", {}, ROOTS, one).reused


KILLED = """
import sys, time
from pathlib import Path
from radartwin.store import Store

def build(folder):
    (folder / "half").write_text("...")
    print("building", flush=True)
    time.sleep(60)

Store(Path(sys.argv[1])).fetch("recording", {}, ["radartwin.constants"], build)
"""


def test_what_a_killed_process_left_is_swept_and_built_again(tmp_path: Path) -> None:
    with subprocess.Popen([sys.executable, "-c", KILLED, str(tmp_path)], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "building\n"
        unfinished = list(tmp_path.rglob("*.tmp"))
        assert len(unfinished) == 1
        Store(tmp_path)
        assert unfinished[0].exists(), "a living process's work was swept"
        process.send_signal(signal.SIGKILL)
        process.wait()
    store = Store(tmp_path)
    assert list(tmp_path.rglob("*.tmp")) == []
    product = store.fetch("recording", {}, ROOTS, one)
    assert sorted(p.name for p in product.path.iterdir()) == ["arrays.npz", "meta.json", "note.json"]
    assert [p.name for p in (tmp_path / "recording").iterdir()] == [product.key]


def build_slowly(root: Path, log: Path) -> None:
    def build(folder: Path) -> None:
        with log.open("a") as stream:
            stream.write("built\n")
        time.sleep(0.5)
        one(folder)

    Store(root).fetch("recording", {}, ROOTS, build)


def test_processes_that_need_the_same_product_build_it_once(tmp_path: Path) -> None:
    log = tmp_path / "log"
    context = multiprocessing.get_context("spawn")
    processes = [context.Process(target=build_slowly, args=(tmp_path / "cache", log)) for _ in range(3)]
    for process in processes:
        process.start()
    for process in processes:
        process.join(60)
    assert [process.exitcode for process in processes] == [0, 0, 0]
    assert log.read_text() == "built\n"
    assert len(list((tmp_path / "cache" / "recording").iterdir())) == 1


def test_an_output_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="file is not a folder"):
        Store(tmp_path / "file" / "cache")


def test_a_file_is_written_whole_or_not_at_all(tmp_path: Path) -> None:
    path = files.write_atomically(tmp_path / "deep" / "table.csv", "a,b\n")
    assert path.read_text() == "a,b\n"
    (tmp_path / "folder").mkdir()
    with pytest.raises(OutputError, match="folder"):
        files.write_atomically(tmp_path / "folder", "text")
    assert [p.name for p in tmp_path.rglob("*.tmp")] == []


def test_the_sweep_takes_only_what_is_ours_and_abandoned(tmp_path: Path) -> None:
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    kept = [tmp_path / "thesis.tmp", tmp_path / f".table.csv.{os.getpid()}.tmp", tmp_path / "data.tmp" / "x"]
    gone = [tmp_path / f".table.csv.{dead.pid}.tmp"]
    kept[2].parent.mkdir()
    for path in kept + gone:
        path.write_text("")
    files.sweep(tmp_path)
    assert all(path.exists() for path in kept)
    assert not any(path.exists() for path in gone)


def test_a_lock_file_is_gone_after_use_and_a_stale_one_is_dropped(tmp_path: Path) -> None:
    lock = tmp_path / "lock"
    with files.lock(lock):
        assert files.held(lock)
        files.drop_stale(lock)
        assert lock.exists()
    assert not lock.exists()
    lock.write_text("")
    assert not files.held(lock)
    files.drop_stale(lock)
    assert not lock.exists()
