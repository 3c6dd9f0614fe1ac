"""Make a small valid folder for every folder format that radartwin reads; each call fills an empty folder."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import yaml
from made_files import log_text, recogniser, studio_json
from PIL import Image

from radartwin.features.processed import process
from radartwin.label.answers import Answer
from radartwin.label.journal import Journal, Record
from radartwin.label.labelling import prepare
from radartwin.label.photos import save_photos
from radartwin.radar.chirp import Radar
from radartwin.radar.recording import Recording
from radartwin.reconstruct.frames.folder import save_frames
from radartwin.reconstruct.frames.frames import Frame, Frames
from radartwin.recordings.card import Card
from radartwin.recordings.index import Row
from radartwin.recordings.recording_set import RecordingSet
from radartwin.scene import rooms
from radartwin.scene.scene import Scene

CAMERA = np.array([[500.0, 0, 32], [0, 500, 24], [0, 0, 1]])
UPRIGHT = np.array([[0.0, 0, 1, 1], [-1, 0, 0, 1], [0, -1, 0, 1], [0, 0, 0, 1]])  # a camera that looks along +x
TEXTS = {
    "radar.cfg": b"channelCfg 15 5 0\n"
    b"profileCfg 0 77 7 6 57 0 0 70 1 256 5210 0 0 30\nchirpCfg 0 0 0 0 0 0 0 1\nframeCfg 0 0 16 0 100 1 0\n",
    "radar.mmwave.json": studio_json(2).encode(),
    "radar.yaml": json.dumps(Radar.iwr1843().to_dict()).encode(),
    "track.txt": b"# t x y z qx qy qz qw\n0 0 0 1 0 0 0 1\n0.1 0.1 0 1 0 0 0 1\n0.2 0.2 0 1 0 0 0 1\n",
    "track.csv": b"t,x,y,z,yaw_deg\n0,0,0,1,0\n0.1,0.1,0,1,5\n",
    "layout.yaml": b"objects:\n  - object: mug\n    position_m: [2.0, 0.5]\n",
    "objects.yaml": b"objects:\n  - {name: a, catalogue: mug}\n  - {name: b, mesh: a.obj, material: metal}\n",
    "map.yaml": b"captures:\n  - file: a.bin\n    object: mug\n    room: lab\n",
    "a.obj": b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n",
    "a.ply": b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\n"
    b"property list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n",
    "a.stl": b"solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid a\n",
}


def texts(folder: Path) -> None:
    for name, content in TEXTS.items():
        (folder / name).write_bytes(content)


def recording(folder: Path) -> None:
    radar = replace(Radar.iwr1843(), num_samples=16, num_chirps=2)
    Recording(np.ones((2, 2, 2, 4, 16), np.complex64), radar, np.eye(4)[None]).save(folder / "a")


def scene(folder: Path) -> None:
    Scene(rooms.lab().surfaces[:3], {"room": "lab"}).save(folder)


def labelled_scene(folder: Path) -> None:
    scene(folder)
    journal = Journal(folder / "answers.jsonl")
    for question in prepare(folder, Scene.load(folder), views=1).questions:
        journal.append(Record.of(question, Answer("wood", 0.5, "grain"), "m", "server"))


def photos(folder: Path) -> None:
    save_photos(folder, [(np.zeros((8, 8, 3), np.uint8), UPRIGHT, CAMERA)])


def recording_set(folder: Path) -> None:
    target = RecordingSet.create(folder, Card("set", "MIT", "counts", "IWR1843", "A", "2026"))
    radar = replace(Radar.iwr1843(), num_samples=16, num_chirps=2)
    path = folder.parent / "track.csv"
    path.write_bytes(TEXTS["track.csv"])
    for name, repetition in (("a", 0), ("b", 1)):
        recording = Recording(np.ones((1, 2, 2, 4, 16), np.complex64), radar, scale=1.0, provenance={"unit": "counts"})
        target.add(recording, Row(name, "mug", 1.0, "lab", "turntable", repetition, extra={"start_s": "0"}), path)


def frames(folder: Path) -> None:
    depth, colour = np.full((48, 64), 2.0, np.float32), np.zeros((48, 64, 3), np.uint8)
    frame = Frame("0", UPRIGHT, CAMERA, depth, colour, CAMERA, np.ones((48, 64), np.uint8))
    save_frames(Frames(["0"], UPRIGHT[None], lambda i: frame, "here", ""), folder)


def _depth(path: Path) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(np.full((48, 64), 2000, np.uint16)).save(path)


def arkit(folder: Path) -> None:
    _depth(folder / "depth_0.png")
    camera = {"cameraPoseARFrame": np.eye(4).ravel().tolist(), "intrinsics": CAMERA.ravel().tolist()}
    (folder / "frame_0.json").write_text(json.dumps(camera))


def pose_file(folder: Path) -> None:
    _depth(folder / "depth" / "0.png")
    _depth(folder / "depth" / "1.png")
    (folder / "pose.txt").write_text("0 0 0 0 0 0 1\n0.1 0 0 0 0 0 1 # the second\n")
    (folder / "intrinsics.json").write_text(json.dumps({"fx": 500.0, "fy": 500.0, "cx": 32.0, "cy": 24.0}))


def tum(folder: Path) -> None:
    _depth(folder / "depth" / "0.png")
    (folder / "depth.txt").write_text("# time file\n0.0 depth/0.png\n0.1 depth/0.png\n")
    (folder / "groundtruth.txt").write_text("# t x y z q\n0.0 0 0 0 0 0 0 1\n0.1 0.1 0 0 0 0 0 1\n")


def model(folder: Path) -> None:
    recogniser().save(folder)


def processed(folder: Path) -> None:
    radar = replace(Radar.iwr1843(), num_samples=32, num_chirps=8)
    noise = np.random.default_rng(0).standard_normal((2, 8, 2, 4, 32)).astype(np.complex64)
    process(Recording(noise, radar)).save(folder)


def log(folder: Path) -> None:
    (folder / "log.csv").write_text(log_text(100, lost=2))


LAYOUT = {
    "objects": [
        {"object": "mug", "name": "first", "position_m": [2.0, 0.5], "yaw_deg": 30.0},
        {"object": "drink_can_355", "relations": [{"relation": "left of", "anchor": "first", "distance_m": 0.3}]},
        {"object": "corner_reflector", "position_m": [2.0, 1.0, 1.0], "held": True},
    ]
}


def layout(folder: Path) -> None:
    (folder / "layout.json.yaml").write_text(json.dumps(LAYOUT))
    (folder / "layout.yaml").write_text(yaml.safe_dump(LAYOUT))
