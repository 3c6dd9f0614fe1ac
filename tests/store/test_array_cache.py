"""The array cache returns arrays unchanged from memory and from disk, and never returns a damaged entry."""

import os
import subprocess
import sys

import numpy as np
import pytest

from radartwin.errors import OutputError
from radartwin.store import array_cache
from radartwin.store.array_cache import ArrayCache


def arrays(count=50, seed=0):
    rng = np.random.default_rng(seed)
    return {"pose": rng.integers(0, 3, count), "amplitude": rng.normal(size=(count, 2)) * (1 + 1j), "parts": np.array(2)}


SIZE = sum(array.nbytes for array in arrays().values())


def same(stored, expected):
    assert stored is not None
    assert sorted(stored) == sorted(expected)
    for name, array in stored.items():
        assert np.array_equal(array, expected[name])
        assert array.dtype == expected[name].dtype


def test_arrays_come_back_from_memory_and_from_a_folder_without_the_files_of_a_killed_process(tmp_path):
    (tmp_path / ".k.npz.radartwin-999999999.tmp").write_bytes(b"half")
    cache, kept = ArrayCache(tmp_path), arrays()
    assert cache.get("k", dict) is None
    cache.put("k", kept)
    same(cache.get("k", dict), kept)
    same(ArrayCache(tmp_path).get("k", dict), kept)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["k.npz"]
    before = array_cache.shared()
    assert before.folder is None
    with array_cache.in_folder(tmp_path) as cache:
        assert (cache.folder, array_cache.shared() is cache) == (tmp_path, True)
    assert array_cache.shared() is before


def test_memory_loses_the_least_recently_used_entry():
    cache = ArrayCache(in_memory_bytes=int(2.5 * SIZE))
    for name in ("a", "a", "b"):  # an entry that is stored again counts once
        cache.put(name, arrays())
    assert cache.get("a", dict) is not None
    cache.put("c", arrays())
    assert cache.get("b", dict) is None
    assert cache.get("a", dict) is not None
    assert cache.get("c", dict) is not None
    cache.put("huge", arrays(5000))
    assert cache.get("huge", dict) is None


@pytest.mark.parametrize("damage", ["cut", "emptied", "flipped", "foreign", "refused"])
def test_a_damaged_entry_is_removed_with_a_warning_and_can_be_written_again(tmp_path, damage):
    def refuse(found):
        raise ValueError("arrays do not fit together")

    ArrayCache(tmp_path).put("k", arrays())
    file = tmp_path / "k.npz"
    content = bytearray(file.read_bytes())
    if damage == "flipped":
        content[len(content) // 2] ^= 1
    file.write_bytes({"cut": bytes(content[:-100]), "emptied": b"", "foreign": b"hello"}.get(damage, bytes(content)))
    cache = ArrayCache(tmp_path)
    with pytest.warns(UserWarning, match="damaged"):
        assert cache.get("k", refuse if damage == "refused" else dict) is None
    assert not file.exists()
    cache.put("k", arrays())
    same(ArrayCache(tmp_path).get("k", dict), arrays())


def test_the_folder_stays_within_its_limit_and_loses_the_least_recently_used_entry(tmp_path):
    ArrayCache(tmp_path).put("size", arrays())
    size = (tmp_path / "size.npz").stat().st_size
    (tmp_path / "size.npz").unlink()
    cache = ArrayCache(tmp_path, in_memory_bytes=0, max_bytes=int(3.5 * size))
    for age, name in enumerate("abc"):
        cache.put(name, arrays())
        os.utime(tmp_path / f"{name}.npz", (1000 + age, 1000 + age))
    assert cache.get("a", dict) is not None
    cache.put("d", arrays())
    assert {p.stem for p in tmp_path.iterdir()} == {"a", "c", "d"}
    cache.put("huge", arrays(5000))
    assert not (tmp_path / "huge.npz").exists()


SHARES = """
import sys, warnings
import numpy as np
sys.path.insert(0, sys.argv[2])
from test_array_cache import ArrayCache, arrays, same
warnings.simplefilter("error")
rng = np.random.default_rng(int(sys.argv[3]))
cache = ArrayCache(sys.argv[1], in_memory_bytes=0, max_bytes=10_000)
for _ in range(60):
    seed = int(rng.integers(6))
    stored = cache.get(str(seed), dict)
    if stored is None:
        cache.put(str(seed), arrays(seed=seed))
    else:
        same(stored, arrays(seed=seed))
"""


def test_processes_share_a_folder_while_they_evict_entries_of_one_another(tmp_path):
    here = os.path.dirname(__file__)
    running = [subprocess.Popen([sys.executable, "-c", SHARES, str(tmp_path), here, str(i)]) for i in range(2)]
    assert [process.wait() for process in running] == [0, 0]
    assert all(p.suffix == ".npz" for p in tmp_path.iterdir())
    assert sum(p.stat().st_size for p in tmp_path.iterdir()) <= 10_000 + 2 * 3_500


def test_a_full_disk_costs_a_warning(tmp_path, monkeypatch):
    def full(path, content):
        raise OutputError(f"{path}: cannot write (No space left on device)")

    monkeypatch.setattr(array_cache.files, "write_atomically", full)
    cache = ArrayCache(tmp_path / "cache")
    with pytest.warns(UserWarning, match="No space left"):
        cache.put("k", arrays())
    assert cache.get("k", dict) is not None
