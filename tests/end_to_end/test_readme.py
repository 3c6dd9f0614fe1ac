"""The commands and examples of the README, of docs/your-room.md, and of the first block of two other pages run in their order on small
input, except those in ELSEWHERE. Added overrides shorten them.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import trimesh
from chat_server import ChatServer, completion
from markdown_blocks import DOCS, ROOT, Block, blocks, follow

from radartwin.scene import rooms

# SQLAlchemy warns about a loader that mlflow uses.
pytestmark = pytest.mark.filterwarnings("ignore:The .*noload.* loader strategy")

SMALL = {
    "run": [
        "profile.campaign.frames_per_turn=2", "profile.campaign.turns=1", "profile.campaign.draws=1",
        "profile.campaign.reflector_repeats=1", "measured.gap.solver=0", "measured.gap.clutter=0", "measured.gap.geometry=0",
    ],
    "simulate": ["trajectory.frames=2", "simulator.rays=20000"],
    "label": ["--views", "1"],
}  # fmt: skip
AUTO = ["simulator.parts=none", "trajectory.period_s=4"]  # simulator=auto needs a whole revolution
CAMPAIGN = [
    "profile.campaign.turntable_objects=[corner_reflector]", "profile.campaign.reflector_distances_m=[1.0]",
    "profile.campaign.rail_objects=[]", "profile.campaign.rover_rooms=[]",
]  # fmt: skip
# Tested in test_dashboard.py, test_demo.py, test_live.py and tests/experiments.
ELSEWHERE = {"dashboard", "demo", "--live", "tables"}
ROOM = blocks(DOCS / "your-room.md")
CAPTURE = [block for block in blocks(DOCS / "radars.md") if "capture_adc_data" in block.text]
PAGES = [*blocks(ROOT / "README.md"), *ROOM, *CAPTURE]
STUDY = blocks(DOCS / "sweeps.md")[:1]


@pytest.fixture
def folder(here: Path, shared_data: Path) -> Path:
    """Return a working folder with the input files of the README's commands."""
    room = rooms.lab(detail="shell")
    trimesh.util.concatenate([s.mesh for s in room]).export(here / "room.glb")
    (here / "profile.cfg").write_text(
        "channelCfg 15 5 0\nprofileCfg 0 77 7 6 57 0 0 70 1 256 5209 0 0 30\nchirpCfg 0 0 0 0 0 0 0 1\nchirpCfg 1 1 0 0 0 0 0 4\n"
        "frameCfg 0 1 16 0 100 1 0\n"
    )
    capture = shared_data / "radar" / "iwr6843_static_room"
    (here / "layout.yaml").write_text(next(block.text for block in ROOM if block.language == "yaml"))
    (here / "frames").mkdir()
    for file in (shared_data / "scans" / "arkit_lidar_chair_scan").glob("*_000[01]?.*"):  # seven of the frames
        (here / "frames" / file.name).symlink_to(file)
    (here / "capture_adc_data.bin").symlink_to(capture / "iwr6843_frame_adc_data.bin")
    (here / "capture_adc_data.mmwave.json").symlink_to(capture / "iwr6843_mmwaveDevice.mmwave.json")
    (here / "cube.npy").symlink_to(shared_data / "radar" / "openradar_77ghz_frame" / "doppler_example_1.npy")
    return here


def wooden_answer(kind: str) -> dict[str, object]:
    answer = {"material": "wood", "finish": "smooth", "confidence": 0.8, "reason": "grain"}
    return answer | ({"wall_thickness_mm": 1.0, "contents": "solid"} if kind == "object" else {})


@pytest.fixture
def model() -> Iterator[ChatServer]:
    """Start a chat server that labels every surface as wood."""
    server = ChatServer(lambda _, body: completion(wooden_answer("object" if "contents" in json.dumps(body["response_format"]) else "")))
    yield server
    server.stop()


def followed(page: list[Block], folder: Path, model: ChatServer | None = None) -> int:
    def small(words: list[str]) -> list[str] | None:
        if ELSEWHERE & set(words):
            return None
        if "simulator=auto" in words:
            return [*words, *AUTO]
        if "server" in words and model:
            words = [*words, "--url", model.url]
        if "--import" in words:
            asked = [json.loads(line) for line in (folder / "questions" / "questions.jsonl").read_text().splitlines()]
            lines = [json.dumps({"id": question["id"], **wooden_answer(question["kind"])}) for question in asked]
            (folder / "answers.jsonl").write_text("\n".join(lines))
        if words[0] == "run" and not any(word.startswith("materials=") for word in words):
            words = [*words, "materials=uniform"]  # the sweep has the same run
        more = {"experiment=campaign": CAMPAIGN, "experiment=environment": ["experiment.distances_m=[1.0]"]}
        return [*words, *SMALL.get(words[0], []), *(override for word in words for override in more.get(word, []))]

    return follow(page, folder, small)


def test_commands_on_the_users_data_and_the_python_example_run(folder: Path, model: ChatServer) -> None:
    assert followed(PAGES, folder, model) >= 16
    assert np.fromfile(folder / "outputs" / "recordings" / "room.bin", "<i2").any()
    assert (folder / "outputs" / "processed" / "room" / "range_azimuth.png").is_file()


def test_commands_of_the_study_run(folder: Path) -> None:
    assert followed(STUDY, folder) == 3
