"""Written files are complete or absent, and file locks work between processes and between threads."""

from __future__ import annotations

import threading
import time
from pathlib import Path

import pytest

from radartwin.errors import MissingError, OutputError
from radartwin.io import files


def test_a_file_is_written_completely_or_not_at_all(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = files.write_atomically(tmp_path / "deep" / "table.csv", "a,b\n")
    assert path.read_text() == "a,b\n"
    (tmp_path / "folder").mkdir()
    with pytest.raises(OutputError, match="folder"):
        files.write_atomically(tmp_path / "folder", "text")

    def write() -> None:
        with files.replacing(tmp_path / "a") as stream:
            stream.write(b"half")
            raise MissingError("source is missing")

    with pytest.raises(MissingError, match=r"^source is missing$"):
        write()
    assert sorted(p.name for p in tmp_path.iterdir()) == ["deep", "folder"]
    monkeypatch.setattr(files.os, "access", lambda *_: False)  # root may write into every folder
    with pytest.raises(OutputError, match="cannot be written"):
        files.check_folder(tmp_path / "absent")


def test_files_replaced_together_are_all_old_or_all_new(tmp_path: Path) -> None:
    paths = [tmp_path / name for name in ("a.bin", "b.png", "a.json")]
    for text in ("old", "new"):
        with files.replacing_together(paths) as temporary:
            temporary[paths[0]].write_text("of a killed process with the same number")
            for path in paths:
                temporary[path].write_text(text)
        assert [path.read_text() for path in paths] == [text] * 3

    def fill_the_disk() -> None:
        with files.replacing_together(paths) as temporary:
            temporary[paths[0]].write_text("partial")
            raise OSError(28, "No space left on device")

    with pytest.raises(OutputError) as caught:
        fill_the_disk()
    assert str(caught.value) == f"{tmp_path}: cannot write (No space left on device); free some space or choose another folder"
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {path.name: "new" for path in paths}


@pytest.mark.parametrize("renamed", range(3))
def test_after_a_kill_between_two_renames_the_last_file_is_absent(renamed: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    paths = [tmp_path / name for name in ("a.bin", "b.png", "a.json")]
    for path in paths:
        path.write_text("old")
    rename, moved = Path.replace, []

    def until_killed(source: Path, target: Path) -> Path:
        if len(moved) == renamed:
            raise KeyboardInterrupt
        moved.append(target)
        return rename(source, target)

    def write() -> None:
        with files.replacing_together(paths) as temporary:
            for path in paths:
                temporary[path].write_text("new")

    monkeypatch.setattr(Path, "replace", until_killed)
    with pytest.raises(KeyboardInterrupt):
        write()
    found = {path.name: path.read_text() for path in tmp_path.iterdir()}
    assert found == {path.name: "new" if number < renamed else "old" for number, path in enumerate(paths[:-1])}


def test_a_lock_waits_for_its_holder_and_says_so_once(tmp_path: Path) -> None:
    lock, order = tmp_path / "work" / "lock", []

    def second() -> None:
        with files.lock(lock, lambda: order.append("waiting")):
            order.append("second")

    thread = threading.Thread(target=second)
    with files.lock(lock, lambda: order.append("not expected")):
        thread.start()
        time.sleep(0.3)
        order.append("first")
    thread.join(10)
    assert order == ["waiting", "first", "second"]
    assert not lock.exists()
    with files.lock(lock):
        files.drop_stale(lock)
        assert lock.exists()
    lock.write_text("")
    files.drop_stale(lock)
    assert not lock.exists()
