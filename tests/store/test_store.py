"""A stored result is complete or absent, is computed once by all processes, and again after a failure or a kill."""

from __future__ import annotations

import multiprocessing
import os
import shutil
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from radartwin.errors import OutputError
from radartwin.io import files
from radartwin.runs.doctor import examine
from radartwin.store.products import Store, counting, save_arrays, save_json

ROOTS = ["radartwin.constants"]


def write(folder: Path) -> None:
    save_arrays(folder, {"x": np.arange(4.0)})
    save_json(folder, "note", {"a": 1})


def test_a_product_is_built_once_and_read_back(tmp_path: Path) -> None:
    first = Store(tmp_path).fetch("recording", {"seed": 1}, ROOTS, write)
    store = Store(tmp_path)
    with counting() as counts:
        again = store.fetch("recording", {"seed": 1}, ROOTS, lambda folder: pytest.fail("built twice"))
    assert (first.reused, again.reused) == (False, True)
    assert again.arrays()["x"].tolist() == [0, 1, 2, 3]
    assert again.read_json("note") == {"a": 1}
    assert again.read_json("meta")["spec"] == {"seed": 1}
    assert str(counts) == "simulated 0, reused 1, scored 0"


def test_specification_kind_and_source_change_the_key(tmp_path: Path) -> None:
    store = Store(tmp_path)
    keys = {
        store.key("recording", {"seed": 1}, ROOTS),
        store.key("recording", {"seed": 2}, ROOTS),
        store.key("features", {"seed": 1}, ROOTS),
        store.key("recording", {"seed": 1}, ["radartwin.errors"]),
    }
    assert len(keys) == 4


def test_a_failed_build_leaves_no_files_and_is_repeated(tmp_path: Path) -> None:
    def fails(folder: Path) -> None:
        (folder / "half").write_text("...")
        raise RuntimeError("solver")

    store = Store(tmp_path)
    with pytest.raises(RuntimeError, match="solver"):
        store.fetch("recording", {}, ROOTS, fails)
    assert list((tmp_path / "recording").iterdir()) == []
    assert not store.fetch("recording", {}, ROOTS, write).reused
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="file is not a folder"):
        Store(tmp_path / "file" / "cache")


KILLED = """
import sys, time
from pathlib import Path
from radartwin.store.products import Store

def build(folder):
    (folder / "half").write_text("...")
    print("building", flush=True)
    time.sleep(60)

Store(Path(sys.argv[1])).fetch("recording", {}, ["radartwin.constants"], build)
"""


def test_the_rest_of_a_killed_process_is_removed_and_built_again(tmp_path: Path) -> None:
    with subprocess.Popen([sys.executable, "-c", KILLED, str(tmp_path)], stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "building\n"
        unfinished = list(tmp_path.rglob("*.tmp"))
        assert len(unfinished) == 1
        Store(tmp_path)
        assert unfinished[0].exists(), "the product of a living process was removed"
        process.send_signal(signal.SIGKILL)
        process.wait()
    store = Store(tmp_path)
    assert list(tmp_path.rglob("*.tmp")) == []
    product = store.fetch("recording", {}, ROOTS, write)
    assert sorted(p.name for p in product.path.iterdir()) == ["arrays.npz", "meta.json", "note.json"]
    assert [p.name for p in (tmp_path / "recording").iterdir()] == [product.key]


def build_slowly(root: Path, log: Path) -> None:
    def build(folder: Path) -> None:
        with log.open("a") as stream:
            stream.write("built\n")
        time.sleep(0.5)
        write(folder)

    Store(root).fetch("recording", {}, ROOTS, build)


def test_concurrent_processes_build_a_product_once(tmp_path: Path) -> None:
    log = tmp_path / "log"
    context = multiprocessing.get_context("spawn")
    processes = [context.Process(target=build_slowly, args=(tmp_path / "cache", log)) for _ in range(2)]
    for process in processes:
        process.start()
    for process in processes:
        process.join(60)
    assert [process.exitcode for process in processes] == [0, 0]
    assert log.read_text() == "built\n"
    assert len(list((tmp_path / "cache" / "recording").iterdir())) == 1


def test_a_start_removes_only_abandoned_files_of_radartwin_whatever_their_dates(tmp_path: Path) -> None:
    """Dates are wrong after a clock error or after a plain copy of the folder, so the store must not compare them."""
    Store(tmp_path).fetch("recording", {}, ROOTS, write)
    dead = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    others = ["thesis.tmp", f".table.csv.{dead.pid}.tmp", ".a.radartwin-99999999999999999999.tmp", "data.tmp/x", "run/empty.tmp/x"]
    others += [f".table.csv.radartwin-{os.getpid()}.tmp", f".table.csv.radartwin-another-machine-{dead.pid}.tmp"]
    abandoned = [f".table.csv.radartwin-{socket.gethostname()}-{dead.pid}.tmp", f".table.csv.radartwin-{dead.pid}.tmp"]
    half = f"recording/.{'a' * 32}"
    abandoned += [f"{half}.lock", f"{half}.radartwin-{socket.gethostname()}-{dead.pid}.tmp/arrays"]
    for name in [*others, *abandoned]:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    (tmp_path / "run/empty.tmp/x").unlink()
    for path in tmp_path.rglob("*"):
        os.utime(path, (4e9, 4e9))  # in the year 2096
    files.sweep(tmp_path)
    assert Store(tmp_path).fetch("recording", {}, ROOTS, write).reused
    assert all((tmp_path / name).exists() for name in (*others[:4], "run/empty.tmp", *others[5:]))
    assert not [name for name in abandoned if (tmp_path / name).exists()]


def test_a_damaged_product_is_reported_and_built_again(tmp_path: Path) -> None:
    product = Store(tmp_path).fetch("recording", {}, ROOTS, write)
    note = product.path / "note.json"
    same_size = lambda: note.write_text(note.read_text().replace("1", "2"))  # noqa: E731
    private = tmp_path / "private"
    private.write_text("of the user")
    link = lambda: (product.path / "stolen").symlink_to(private)  # noqa: E731
    for damage in (lambda: os.truncate(product.path / "arrays.npz", 10), note.unlink, same_size, link):
        damage()
        lines: list[str] = []
        store = Store(tmp_path, lines.append)
        assert not store.fetch("recording", {}, ROOTS, write).reused
        assert [line.partition(" (")[0] for line in lines] == [f"recording {product.key[:8]} in the cache is damaged"]
        assert store.fetch("recording", {}, ROOTS, write).arrays()["x"].tolist() == [0, 1, 2, 3]
    assert private.read_text() == "of the user"


@pytest.mark.parametrize("text", [
    "", "[" * 200_000, "[]", '{"bytes": 5}', '{"bytes": {"x.npz": 0}}', '{"bytes": {"../../x": 1}}',
    '{"bytes": {}, "sha256": {"gone.npz": "0"}}',
], ids=range(7))  # fmt: skip
def test_a_product_with_damaged_metadata_is_built_again(text: str, tmp_path: Path) -> None:
    (Store(tmp_path).fetch("recording", {}, ROOTS, write).path / "meta.json").write_text(text)
    lines: list[str] = []
    assert [Store(tmp_path, lines.append).fetch("recording", {}, ROOTS, write).reused for _ in range(2)] == [False, True]
    assert "damaged" in lines[0]


def test_a_file_folder_or_link_in_place_of_a_product_is_replaced(tmp_path: Path) -> None:
    path, elsewhere = Store(tmp_path).fetch("recording", {}, ROOTS, write).path, tmp_path / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "of the user").touch()
    for put in (path.touch, path.mkdir, lambda: path.symlink_to(elsewhere), lambda: path.symlink_to(tmp_path / "nowhere")):
        shutil.rmtree(path) if path.is_dir() and not path.is_symlink() else path.unlink()
        put()
        assert not Store(tmp_path).fetch("recording", {}, ROOTS, write).reused
        assert Store(tmp_path).fetch("recording", {}, ROOTS, write).arrays()["x"].tolist() == [0, 1, 2, 3]
    assert (elsewhere / "of the user").exists()


def test_doctor_says_how_large_the_cache_is(tmp_path: Path) -> None:
    Store(tmp_path / "cache").fetch("recording", {}, ROOTS, lambda folder: save_arrays(folder, {"x": np.zeros(100_000)}))
    (finding,) = [finding for finding in examine(tmp_path) if finding.topic == "cache"]
    assert finding.text.startswith(f"1 MB in {tmp_path / 'cache'}; ")
