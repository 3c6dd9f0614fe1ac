"""Every command of the README runs on small input; overrides shorten the slow ones."""

import json
import os
import shlex
import subprocess
import sys
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import markdown_blocks
import numpy as np
import pytest
import trimesh

from radartwin.cli import main
from radartwin.scene import rooms

SMALL = {
    "run": [
        "experiment.distances_m=[1.0]", "profile.campaign.frames_per_turn=2", "profile.campaign.turns=1",
        "profile.campaign.reflector_repeats=1", "measured.gap.solver=0", "measured.gap.clutter=0", "measured.gap.geometry=0",
    ],
    "simulate": ["trajectory.frames=2", "simulator.rays=20000"],
}  # fmt: skip
AUTO = ["simulator.parts=none", "trajectory.period_s=4"]  # simulator=auto needs a whole revolution
ROOT = Path(__file__).resolve().parents[2]
VIEWS = ["--views", "1"]
INSIDE = {"doctor", "import", "label", "process", "reconstruct", "view"}
# Tested in test_dashboard.py, test_classify.py and tests/experiments.
ELSEWHERE = {"dashboard", "classify", "tables"}
CLUSTER = "hydra/launcher=slurm"  # composed in test_documents.py; make test-slurm starts a cluster of one node
CAMPAIGN = [
    "profile.campaign.turntable_objects=[corner_reflector]", "profile.campaign.reflector_distances_m=[1.0]",
    "profile.campaign.rail_objects=[]", "profile.campaign.rover_rooms=[]",
]  # fmt: skip


def blocks(language):
    """Texts of the code blocks in a language; "" selects plain blocks."""
    return [block.text for block in markdown_blocks.blocks(ROOT / "README.md") if block.language == language]


def commands():
    return markdown_blocks.commands(ROOT / "README.md")


@pytest.fixture(scope="module")
def folder(tmp_path_factory, shared_data):
    """A folder with the inputs of the commands: a room, a radar configuration, a real capture and a real cube."""
    folder = tmp_path_factory.mktemp("readme")
    room = rooms.lab(detail="shell")
    trimesh.util.concatenate([s.mesh for s in room]).export(folder / "room.glb")
    (folder / "profile.cfg").write_text(
        "channelCfg 15 5 0\nprofileCfg 0 77 7 6 57 0 0 70 1 256 5209 0 0 30\nchirpCfg 0 0 0 0 0 0 0 1\nchirpCfg 1 1 0 0 0 0 0 4\n"
        "frameCfg 0 1 16 0 100 1 0\n"
    )
    capture = shared_data / "radar" / "iwr6843_static_room"
    (folder / "layout.yaml").write_text(blocks("yaml")[0])
    (folder / "frames").symlink_to(shared_data / "scans" / "arkit_lidar_chair_scan")
    (folder / "capture_adc_data.bin").symlink_to(capture / "iwr6843_frame_adc_data.bin")
    (folder / "capture_adc_data.mmwave.json").symlink_to(capture / "iwr6843_mmwaveDevice.mmwave.json")
    (folder / "cube.npy").symlink_to(shared_data / "radar" / "openradar_77ghz_frame" / "doppler_example_1.npy")
    return folder


@pytest.fixture
def model():
    """URL of a chat server that labels every surface as wood."""

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self):
            body = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
            words = json.dumps(wooden_answer("object" if "contents" in json.dumps(body["response_format"]) else "surface"))
            reply = json.dumps({"choices": [{"message": {"content": words}}]}).encode()
            self.send_response(200)
            self.send_header("Content-Length", str(len(reply)))
            self.end_headers()
            self.wfile.write(reply)

        def log_message(self, *_): ...

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True).start()
        yield f"http://127.0.0.1:{server.server_address[1]}/v1"
        server.shutdown()


def wooden_answer(kind):
    answer = {"material": "wood", "confidence": 0.8, "reason": "grain"}
    return answer | ({"wall_thickness_mm": 1.0, "contents": "solid"} if kind == "object" else {})


def extra(words, folder, model):
    """Overrides that make a command small, the server address, and the file of answers to exported questions."""
    if "simulator=auto" in words:
        return AUTO
    if words[0] != "label":
        return SMALL.get(words[0], []) + (CAMPAIGN if "experiment=campaign" in words else [])
    if "--import" in words:
        asked = [json.loads(line) for line in (folder / "questions" / "questions.jsonl").read_text().splitlines()]
        lines = [json.dumps({"id": question["id"], **wooden_answer(question["kind"])}) for question in asked]
        (folder / "answers.jsonl").write_text("\n".join(lines))
    return [*VIEWS, *(["--url", model] if "server" in words else [])]


def test_the_readme_prints_commands():
    assert len(commands()) >= 9
    text = (ROOT / "README.md").read_text()
    assert "make tables" in text
    assert "make test" in text


@pytest.mark.parametrize("line", [line for line in commands() if line.split()[1] not in ELSEWHERE and CLUSTER not in line])
def test_command_runs_as_printed(line, folder, model, monkeypatch, capsys):
    words = shlex.split(line)[1:]
    words += extra(words, folder, model)
    if words[0] in INSIDE:  # without a new process, which would import everything again
        monkeypatch.chdir(folder)
        assert main(words) == 0, capsys.readouterr().err[-2000:]
        return
    command = [sys.executable, "-m", "radartwin", *words]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr[-2000:]


def test_the_python_example_runs(folder):
    assert (folder / "room").is_dir(), "the commands above make the room"
    for block in blocks("python"):
        subprocess.run([sys.executable, "-c", block], cwd=folder, check=True, timeout=300, env=dict(os.environ))
    assert np.fromfile(folder / "outputs" / "recordings" / "room.bin", "<i2").any()
