"""Traced paths come back as they were, from memory and from disk, and a broken entry is never taken for paths."""

import dataclasses
import os
import subprocess
import sys
import warnings

import numpy as np
import pytest

from radartwin.errors import OutputError
from radartwin.simulation import path_cache
from radartwin.simulation.path_cache import PathCache
from radartwin.simulation.paths import Paths


def paths(count=50, seed=0, poses=3):
    rng = np.random.default_rng(seed)
    unit = rng.normal(size=(2, count, 3))
    amplitude = rng.normal(size=(count, 2)) + 1j * rng.normal(size=(count, 2))
    pose, lengths = np.sort(rng.integers(0, poses, count)), rng.uniform(1, 5, (2, count))
    rest = (lengths[0], lengths[1], unit[0], unit[1], rng.normal(size=count))
    return Paths(poses, pose, np.ones(count, int), amplitude, np.array([77e9, 80e9]), *rest)


def parts(count=50, seed=0):
    """Two parts, the second of images and of one pose."""
    images = dataclasses.replace(paths(count // 2, seed + 100, poses=1), mirror=np.random.default_rng(seed).normal(size=(count // 2, 3, 3)))
    return [paths(count, seed), images]


def same(some, others):
    assert len(some) == len(others)
    for one, other in zip(some, others, strict=True):
        for field in dataclasses.fields(Paths):
            a, b = getattr(one, field.name), getattr(other, field.name)
            assert np.array_equal(a, b)
            assert np.asarray(a).dtype == np.asarray(b).dtype


def test_paths_come_back_from_memory_and_from_another_process_folder(tmp_path):
    cache, kept = PathCache(tmp_path), parts()
    assert cache.get("k") is None
    cache.put("k", kept)
    assert [id(p) for p in cache.get("k") or []] == [id(p) for p in kept]
    found = PathCache(tmp_path).get("k")
    assert found is not None
    same(found, kept)
    assert isinstance(found[0].poses, int)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["k.npz"]


def test_no_paths_and_one_pose_are_kept_too(tmp_path):
    PathCache(tmp_path).put("none", [paths(0, poses=1)])
    found = PathCache(tmp_path).get("none")
    assert found is not None
    assert (len(found[0]), found[0].poses, found[0].amplitude.shape) == (0, 1, (0, 2))
    PathCache(tmp_path).put("nothing", [])
    assert PathCache(tmp_path).get("nothing") == []


def test_without_a_folder_the_least_recently_used_go_from_memory():
    cache = PathCache(in_memory=2)
    for name in ("a", "b"):
        cache.put(name, parts())
    assert cache.get("a") is not None
    cache.put("c", parts())
    assert cache.get("b") is None
    assert cache.get("a") is not None
    assert cache.get("c") is not None


@pytest.mark.parametrize("damage", ["cut", "emptied", "flipped", "foreign", "short"])
def test_a_damaged_entry_is_dropped_with_a_warning_and_can_be_written_again(tmp_path, damage):
    PathCache(tmp_path).put("k", parts())
    file = tmp_path / "k.npz"
    content = bytearray(file.read_bytes())
    if damage == "flipped":
        content[len(content) // 2] ^= 1
    file.write_bytes({"cut": bytes(content[:-100]), "emptied": b"", "flipped": bytes(content), "foreign": b"hello", "short": b""}[damage])
    if damage == "short":
        PathCache(tmp_path).put("k", [dataclasses.replace(paths(), arrival=paths().arrival[:-1])])
    cache = PathCache(tmp_path)
    with pytest.warns(UserWarning, match="damaged"):
        assert cache.get("k") is None
    assert not file.exists()
    cache.put("k", parts())
    again = PathCache(tmp_path).get("k")
    assert again is not None
    same(again, parts())


def test_the_folder_stays_within_its_bound_and_loses_what_was_not_used_for_longest(tmp_path):
    PathCache(tmp_path).put("size", parts())
    size = (tmp_path / "size.npz").stat().st_size
    (tmp_path / "size.npz").unlink()
    cache = PathCache(tmp_path, in_memory=0, max_bytes=int(3.5 * size))
    for age, name in enumerate("abc"):
        cache.put(name, parts())
        os.utime(tmp_path / f"{name}.npz", (1000 + age, 1000 + age))
    assert cache.get("a") is not None
    cache.put("d", parts())
    assert {p.stem for p in tmp_path.iterdir()} == {"a", "c", "d"}
    cache.put("huge", parts(5000))
    assert not (tmp_path / "huge.npz").exists()


def test_keys_tell_everything_apart():
    key = PathCache.key
    grid = np.arange(6.0)
    distinct = [
        key(grid), key(grid.reshape(2, 3)), key(grid.reshape(3, 2)), key(grid.astype(np.float32)), key(grid[::-1]), key(1), key(1.0),
        key(True), key("1"), key(b"1"), key(None), key(), key([]), key([1, 2], 3),
        key([1], 2, 3), key("ab", "c"), key("a", "bc"), key({"a": 1}),
        key(paths()), key(paths(seed=1)),
    ]  # fmt: skip
    assert len(set(distinct)) == len(distinct)
    assert key(paths(), grid, {"a": (1, 2)}) == key(paths(), grid.copy(), {"a": (1, 2)})
    with pytest.raises(TypeError, match="set"):
        key({1, 2})


def test_keys_are_the_same_in_every_process():
    code = "import numpy as np; from radartwin.simulation.path_cache import PathCache; print(PathCache.key('x', np.eye(3), {'b': 2}))"
    other = subprocess.run(
        [sys.executable, "-c", code], check=True, capture_output=True, text=True, env={**os.environ, "PYTHONHASHSEED": "7"}
    )
    assert other.stdout.strip() == PathCache.key("x", np.eye(3), {"b": 2})


def test_processes_share_a_folder(tmp_path):
    """Writers of the same few keys, within a bound that makes them evict one another's, and readers in between."""
    code = (
        "import sys, numpy as np; sys.path.insert(0, sys.argv[2])\\n"
        "from test_path_cache import PathCache, parts, same\\n"
        "import warnings; warnings.simplefilter('error')\\n"
        "rng = np.random.default_rng(int(sys.argv[3]))\\n"
        "cache = PathCache(sys.argv[1], in_memory=0, max_bytes=40_000)\\n"
        "for _ in range(60):\\n"
        "    seed = int(rng.integers(6)); found = cache.get(str(seed))\\n"
        "    if found is None: cache.put(str(seed), parts(seed=seed))\\n"
        "    else: same(found, parts(seed=seed))\\n"
    ).replace("\\n", "\n")
    here = os.path.dirname(__file__)
    running = [subprocess.Popen([sys.executable, "-c", code, str(tmp_path), here, str(i)]) for i in range(3)]
    assert [one.wait() for one in running] == [0, 0, 0]
    assert all(p.suffix == ".npz" for p in tmp_path.iterdir())
    assert sum(p.stat().st_size for p in tmp_path.iterdir()) <= 40_000 + 3 * 10_000


def test_what_a_killed_process_left_is_swept(tmp_path):
    left = tmp_path / ".k.npz.radartwin-999999999.tmp"
    left.write_bytes(b"half")
    PathCache(tmp_path)
    assert not left.exists()


def test_a_place_that_cannot_be_a_folder_is_refused_and_a_full_disk_only_warned_of(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="file"):
        PathCache(tmp_path / "file")

    def full(path, content):
        raise OutputError(f"{path}: cannot write (No space left on device)")

    monkeypatch.setattr(path_cache.files, "write_atomically", full)
    cache = PathCache(tmp_path / "cache")
    with pytest.warns(UserWarning, match="No space left"):
        cache.put("k", parts())
    assert cache.get("k") is not None


def test_the_shared_cache_is_in_memory_until_a_folder_is_named(tmp_path):
    before = path_cache.shared()
    assert before.folder is None
    with path_cache.kept_in(tmp_path) as kept:
        assert kept.folder == tmp_path
        assert path_cache.shared() is kept
    assert path_cache.shared() is before
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert path_cache.shared().folder is None
