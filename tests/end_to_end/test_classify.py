"""A model classifies new recordings, which are not part of the virtual measurement campaign, through the library, through the command line
and through MLflow.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from radartwin.config.study import TrackingConfig
from radartwin.features import families
from radartwin.features.log import Nominal
from radartwin.features.processed import process
from radartwin.radar.chirp import Radar
from radartwin.radar.recording import Recording
from radartwin.recognize.classify import classify
from radartwin.recognize.encoder import Settings
from radartwin.recognize.model import Recogniser
from radartwin.recognize.samples import MEASURED, SIMULATED, Part, gather
from radartwin.recognize.split import label_free
from radartwin.recognize.training import fit
from radartwin.runs.tracking import Tracker

FRAMES, PERIOD_S = 60, 6.0
TURNS = {"steady": 0, "once": 1, "thrice": 3}  # glints per revolution


def radar() -> Radar:
    described = Radar.iwr1843().to_dict() | {"num_chirps": 2, "frame_rate_hz": FRAMES / PERIOD_S}
    return Radar.from_dict(described)


def turning(kind: str, seed: int, distance_m: float = 1.0, gain: float = 1.0) -> Recording:
    """Simulate a point echo in front of a fixed wall; the amplitude of the echo oscillates `TURNS` times per revolution."""
    rng, one = np.random.default_rng(seed), radar()
    phase = 2 * np.pi * np.arange(FRAMES) / FRAMES + rng.uniform(0, 2 * np.pi)
    amplitude = 1 + 0.6 * (TURNS[kind] > 0) * np.cos(TURNS[kind] * phase)
    samples = np.arange(one.num_samples)

    def echo(range_m: float) -> np.ndarray:
        return np.exp(2j * np.pi * samples * range_m / one.range_resolution_m / one.num_samples)

    shape = (FRAMES, one.num_chirps, one.num_tx, one.num_rx, one.num_samples)
    wobble = np.exp(0.3j * np.sin(phase))[:, None]  # the echo is slightly off the turntable's axis
    frames = amplitude[:, None] * wobble * echo(distance_m) + 3 * echo(3.0)
    noise = 0.05 * (rng.normal(size=shape) + 1j * rng.normal(size=shape))
    return Recording((gain * 1e-4 * (frames[:, None, None, None] + noise)).astype(np.complex64), one)


def rows(recording: Recording, distance_m: float = 1.0):
    log = Nominal(FRAMES / PERIOD_S, np.full(FRAMES, distance_m), 2 * np.pi * np.arange(FRAMES) / FRAMES)
    return families.vector(process(recording, doppler=False), log, "rotation", ["brightness"])


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    names, parts = [], []
    for kind in TURNS:
        for seed in range(3):
            names, values = rows(turning(kind, seed))
            parts.append(Part(f"{kind} {seed} s", kind, SIMULATED, values))
    measured = [Part(f"{kind} m", kind, MEASURED, rows(turning(kind, 9))[1]) for kind in TURNS]
    simulated = gather(names, parts)
    centre, spread = simulated.values.mean(axis=0), simulated.values.std(axis=0)
    scaled = simulated.with_values((simulated.values - centre) / spread)
    anchors = dict(zip(TURNS, np.eye(3, 8, dtype=np.float32), strict=True))
    encoder = fit(label_free(scaled, gather(names, measured)), anchors, Settings(hidden=16, epochs=60), seed=0).encoder
    features = {"set": "rotation", "without": ["brightness"], "period_s": PERIOD_S}
    classes = tuple(sorted(anchors))
    prototypes = np.stack([anchors[label] for label in classes])
    made = Recogniser(encoder, classes, prototypes, 0.07, tuple(names), features, centre, spread, {"trained on": "a test"})
    return made.save(tmp_path_factory.mktemp("models") / "turning")


@pytest.mark.parametrize("kind", TURNS)
def test_a_recording_at_another_distance_and_gain_is_recognised(model: Path, tmp_path: Path, inside, kind: str):
    """The model recognises a recording with another target distance and amplitude, and the command line prints the same probabilities as
    the library.
    """
    turning(kind, 77, distance_m=1.8, gain=20.0).save(tmp_path / "seen")
    answer = classify(tmp_path / "seen", model)
    assert answer.classes[0] == kind
    assert answer.distance_m == pytest.approx(1.8, abs=0.05)
    assert answer.probabilities.sum() == pytest.approx(1.0)
    done = inside("classify", "seen", "--model", model)
    expected = [f"{label} {p:.4f}" for label, p in zip(answer.classes, answer.probabilities, strict=True)]
    assert done.stdout.splitlines() == ["label probability", *expected]


def test_a_raw_cube_with_a_radar_description_is_classified(model: Path, tmp_path: Path):
    """The model classifies a .npy cube of ADC counts that has neither an amplitude scale nor poses."""
    seen = turning("once", 6)
    cube = np.round(seen.iq / np.abs(seen.iq).max() * 8000)
    np.save(tmp_path / "seen.npy", cube.astype(np.complex64))
    assert classify(tmp_path / "seen.npy", model, radar(), iq_swapped=False).classes[0] == "once"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["seen", "--model", "nowhere"], "no such file"),
        (["nothing", "--model", "MODEL"], "nothing"),
        (["seen", "--model", "MODEL", "--period", "25"], "record a whole revolution"),
        (["seen", "--model", "MODEL", "--distance", "40"], "is not between"),
    ],
)
def test_mistakes_give_a_one_line_message(model: Path, tmp_path: Path, inside, arguments: list[str], message: str):
    turning("once", 5).save(tmp_path / "seen")
    done = inside("classify", *(str(model) if word == "MODEL" else word for word in arguments))
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert message in done.stderr


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:The .*noload.* loader strategy")
def test_mlflow_loads_a_tracked_model_and_predicts(model: Path, tmp_path: Path):
    """MLflow loads the model from a tracked run, and no file of the model is a pickle."""
    import mlflow
    import pandas as pd

    folder = tmp_path / "product" / "models"
    Recogniser.load(model).save(folder / "recogniser")
    tracker = Tracker(TrackingConfig(), tmp_path / "out")
    with tracker.run("contrastive", "0" * 32, "a run", {}) as record:
        record.artifacts = [folder]
    local = Path(mlflow.MlflowClient(tracker.uri).download_artifacts(record.run_id, "models/recogniser"))
    assert not [path for path in local.rglob("*") if path.suffix in (".pkl", ".pickle", ".pt", ".joblib")]
    assert json.loads(next(local.rglob("model.json")).read_text())["provenance"] == {"trained on": "a test"}
    turning("thrice", 5).save(tmp_path / "seen")
    loaded = mlflow.pyfunc.load_model(str(local))
    answer = loaded.predict(pd.DataFrame({"recording": [str(tmp_path / "seen")]}))
    assert answer["label"].tolist() == ["thrice"]
    assert answer[["once", "steady", "thrice"]].sum(axis=1).tolist() == pytest.approx([1.0])
