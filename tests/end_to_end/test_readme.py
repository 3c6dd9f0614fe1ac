"""Every command the README prints is run here, on small input; what takes minutes gets overrides that make it small."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh

from radartwin.scene import rooms

SMALL = {
    "run": ["profile.frames=2", "profile.repeats=1", "experiment.distances_m=[1.0]", "simulator.rays=20000", "measured.gap.solver=0"],
    "simulate": ["trajectory.frames=2", "simulator.rays=20000"],
}
ROOT = Path(__file__).resolve().parents[2]
ELSEWHERE = {"dashboard"}  # serves until it is stopped; tests/end_to_end/test_dashboard.py


def blocks(language):
    """Fenced blocks of a language, "" for the plain ones."""
    fences = re.split(r"^```(\w*)\n", (ROOT / "README.md").read_text(), flags=re.M)
    opened = list(zip(fences[1::2], fences[2::2], strict=True))[::2]  # every other fence closes
    return [text for name, text in opened if name == language]


def commands():
    lines = [re.sub(r"\s{2,}#.*", "", line) for block in blocks("") for line in block.replace("\\\n", " ").splitlines()]
    return [line for line in lines if line.startswith("radartwin ")]


@pytest.fixture(scope="module")
def folder(tmp_path_factory, shared_data):
    """What the commands read: a room, a radar's configuration, a real capture and a real cube."""
    folder = tmp_path_factory.mktemp("readme")
    room = rooms.lab(detail="shell")
    trimesh.util.concatenate([s.mesh for s in room]).export(folder / "room.glb")
    (folder / "profile.cfg").write_text(
        "channelCfg 15 5 0\nprofileCfg 0 77 7 6 57 0 0 70 1 256 5209 0 0 30\nchirpCfg 0 0 0 0 0 0 0 1\nchirpCfg 1 1 0 0 0 0 0 4\n"
        "frameCfg 0 1 16 0 100 1 0\n"
    )
    capture = shared_data / "radar" / "iwr6843_static_room"
    (folder / "capture_adc_data.bin").symlink_to(capture / "iwr6843_frame_adc_data.bin")
    (folder / "capture_adc_data.mmwave.json").symlink_to(capture / "iwr6843_mmwaveDevice.mmwave.json")
    (folder / "cube.npy").symlink_to(shared_data / "radar" / "openradar_77ghz_frame" / "doppler_example_1.npy")
    return folder


def test_the_readme_prints_commands():
    assert len(commands()) >= 9
    text = (ROOT / "README.md").read_text()
    assert "make tables" in text
    assert "make test" in text


@pytest.mark.parametrize("line", [line for line in commands() if line.split()[1] not in ELSEWHERE])
def test_command_runs_as_printed(line, folder):
    words = shlex.split(line)[1:]
    done = subprocess.run(
        [sys.executable, "-m", "radartwin", *words, *SMALL.get(words[0], [])],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]


def test_the_python_example_runs(folder):
    assert (folder / "room").is_dir(), "the commands above make the room"
    for block in blocks("python"):
        subprocess.run([sys.executable, "-c", block], cwd=folder, check=True, timeout=300, env=dict(os.environ))
    assert np.fromfile(folder / "outputs" / "recordings" / "room.bin", "<i2").any()
