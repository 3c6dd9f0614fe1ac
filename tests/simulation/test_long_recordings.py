"""Long recordings are simulated in blocks of frames: the samples do not depend on where they are kept, and memory does not grow."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import trimesh

import radartwin as rt
from radartwin.errors import OutputError
from radartwin.radar import recording as recording_module
from radartwin.simulation import simulate as simulate_module
from radartwin.simulation.signal.synthesis import thermal_noise

RADAR = replace(rt.Radar.iwr1843(), num_chirps=2, num_samples=64)
FRAMES = 30


def scene() -> rt.Scene:
    """Return a floor and a wall, with a can that stands before the wall."""
    sizes = {"floor": (4, 4, 0.1), "wall": (0.1, 4, 3)}
    floor, wall = (rt.Surface(trimesh.creation.box(size), "concrete", name) for name, size in sizes.items())
    floor.mesh.apply_translation([2, 0, -0.55])
    wall.mesh.apply_translation([3, 0, 1])
    can = rt.Surface(trimesh.creation.cylinder(0.05, 0.2), "metal", "can")
    can.mesh.apply_translation([1.5, 0, 0])
    return rt.Scene([floor, wall, can])


def drive(frames: int = FRAMES) -> np.ndarray:
    """Return poses of a sensor that drives sideways and rests in the second half of the recording."""
    poses = np.tile(np.eye(4), (frames, 1, 1))
    poses[:, 1, 3] = 0.2 * np.minimum(np.arange(frames) / frames, 0.5)
    return poses


def in_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make `simulate` trace blocks of four frames."""
    for name in ("FIRST_FRAMES", "FEWEST_FRAMES", "MOST_FRAMES"):
        monkeypatch.setattr(simulate_module, name, 4)


@pytest.fixture
def blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    in_blocks(monkeypatch)


@pytest.mark.parametrize("noise", [False, True])
def test_samples_on_disk_are_those_in_memory(blocks: None, tmp_path: Path, noise: bool) -> None:
    kept = rt.simulate(scene(), RADAR, drive(), noise=noise, max_bounces=2)
    streamed = rt.simulate(scene(), RADAR, drive(), noise=noise, max_bounces=2, out=tmp_path / "streamed")
    assert np.array_equal(streamed.iq, kept.iq)
    assert streamed.iq.flags.writeable
    kept.save(tmp_path / "kept")
    for suffix in (".bin", ".json"):
        assert (tmp_path / f"streamed{suffix}").read_bytes() == (tmp_path / f"kept{suffix}").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["kept.bin", "kept.json", "streamed.bin", "streamed.json"]


@pytest.mark.parametrize(("settings", "limit"), [({"max_bounces": 2}, 1e-3), ({"simulator": "points"}, 1e-5)])
def test_blocks_have_the_signal_of_one_call(monkeypatch: pytest.MonkeyPatch, settings: dict[str, Any], limit: float) -> None:
    """The sensor stops during the recording, which must not change the kind of its paths. The weakest paths of a block may differ."""
    whole = rt.simulate(scene(), RADAR, drive(), **settings).iq
    in_blocks(monkeypatch)
    parts = rt.simulate(scene(), RADAR, drive(), **settings).iq
    power = (np.abs(whole) ** 2).sum(axis=(1, 2, 3, 4))
    assert ((np.abs(parts - whole) ** 2).sum(axis=(1, 2, 3, 4)) < limit**2 * power).all()


def test_noise_does_not_depend_on_the_blocks(blocks: None) -> None:
    empty = rt.Scene([])
    found = rt.simulate(empty, RADAR, drive(), noise=True, seed=5).iq
    rng = np.random.default_rng(np.random.SeedSequence([5, *b"receiver noise"]))
    assert np.array_equal(found, thermal_noise(found.shape, RADAR, rng))


def test_a_resting_scene_is_traced_once(blocks: None, monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []
    trace = simulate_module.MitsubaBackend.paths
    monkeypatch.setattr(simulate_module.MitsubaBackend, "paths", lambda *args: calls.append(len(args[3])) or trace(*args))
    found = rt.simulate(scene(), RADAR, np.repeat(drive(1), FRAMES, axis=0), max_bounces=2).iq
    assert calls == [1]
    assert (found == found[:1]).all()


def test_large_recordings_are_mapped_when_loaded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(0)
    shape = (9, 2, 2, 4, 64)
    rt.Recording((rng.standard_normal(shape) + 1j * rng.standard_normal(shape)).astype(np.complex64), RADAR).save(tmp_path / "a")
    expected = rt.Recording.load(tmp_path / "a")
    monkeypatch.setattr(recording_module, "MAPPED_BYTES", 1)
    monkeypatch.setattr(recording_module, "_SAVED_BYTES", 20_000)
    loaded = rt.Recording.load(tmp_path / "a")
    assert isinstance(loaded.iq.base, np.memmap)
    assert np.array_equal(loaded.iq, expected.iq)
    loaded.save(tmp_path / "b")
    assert (tmp_path / "a.bin").read_bytes() == (tmp_path / "b.bin").read_bytes()
    assert len(list(tmp_path.iterdir())) == 4


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match="file"):
        rt.simulate(scene(), RADAR, drive(2), out=tmp_path / "file" / "name")


def test_a_recording_that_does_not_fit_on_the_disk_is_refused_before_the_first_frame(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    needed = FRAMES * 2 * 2 * 4 * 64 * (8 + 4)  # samples in memory-mapped form and in the .bin file
    (tmp_path / "long.bin").write_bytes(b"an older recording")
    monkeypatch.setattr(simulate_module, "received", lambda *args: pytest.fail("a frame was simulated"))
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: SimpleNamespace(free=needed - 1))
    with pytest.raises(OutputError, match=r"cannot hold 0\.000369 GB of samples \(0\.000369 GB are free\); free some space"):
        rt.simulate(scene(), RADAR, drive(), max_bounces=2, out=tmp_path / "long")
    assert (tmp_path / "long.bin").read_bytes() == b"an older recording"
    monkeypatch.undo()
    monkeypatch.setattr(shutil, "disk_usage", lambda folder: SimpleNamespace(free=needed))
    rt.simulate(rt.Scene([]), RADAR, drive(), out=tmp_path / "long")


def test_a_killed_simulation_leaves_no_file(tmp_path: Path) -> None:
    code = (
        "import sys, time, numpy as np, radartwin as rt\n"
        "from radartwin.io.scratch import ScratchArray\n"
        "write = ScratchArray.write\n"
        "ScratchArray.write = lambda self, rows: (write(self, rows), print('written', flush=True), time.sleep(60))\n"
        "rt.simulate(rt.Scene([]), rt.Radar.iwr1843(), np.repeat(np.eye(4)[None], 9, axis=0), noise=True, out=sys.argv[1])\n"
    )
    running = subprocess.Popen([sys.executable, "-c", code, str(tmp_path / "half")], stdout=subprocess.PIPE, text=True)
    assert running.stdout is not None
    assert running.stdout.readline() == "written\n"
    os.kill(running.pid, signal.SIGKILL)
    running.wait()
    running.stdout.close()
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_memory_does_not_grow_with_frames(tmp_path: Path) -> None:
    """Compare the peak memory of 300 and 3,000 frames. Both recordings have blocks of the largest size."""
    code = (
        "import sys, numpy as np, radartwin as rt; from experiments.speed.machine import peak_gib\n"
        "sys.path.insert(0, sys.argv[3])\n"
        "import test_long_recordings as made\n"
        "rt.simulate(made.scene(), made.RADAR, made.drive(int(sys.argv[2])), max_bounces=2, noise=True, out=sys.argv[1])\n"
        "print(peak_gib())\n"
    )
    peaks = []
    for frames in (300, 3000):
        command = [sys.executable, "-c", code, str(tmp_path / "long"), str(frames), str(Path(__file__).parent)]
        peaks.append(float(subprocess.run(command, check=True, capture_output=True, text=True).stdout.split()[-1]))
    assert peaks[1] < 1.25 * peaks[0]
