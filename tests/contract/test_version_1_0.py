"""Files that version 1.0.0 wrote load; its keys and metrics that are gone are refused by a line that names what to write."""

from __future__ import annotations

import inspect
import shlex
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from experiments.turntable.environment import GAIN
from experiments.verdicts import CONTRADICTED, MISSES, NOT_HERE, SHOWN, SUPPORTED, UNDECIDED
from radartwin.benchmark import entry_folder
from radartwin.config.compose import compose
from radartwin.config.messages import GONE, METRICS
from radartwin.errors import ConfigError
from radartwin.radar.recording import Recording
from radartwin.recognize.model import Recogniser
from radartwin.recordings.examine import examine
from radartwin.recordings.recording_set import RecordingSet
from radartwin.scene.scene import Scene

FILES = Path(__file__).with_name("version_1_0")


def test_a_recording_loads() -> None:
    recording = Recording.load(FILES / "recording")
    assert recording.iq.shape == (2, 2, 2, 4, 64)
    assert recording.sensor_poses is not None
    np.testing.assert_allclose(recording.sensor_poses[1, :3, 3], [0, 0.01, 1])
    assert recording.iq[1, 1, 1, 3, 5] == pytest.approx(6.048287e-06 - 1.0659817e-04j, rel=1e-6)


def test_a_scene_loads() -> None:
    wall, sphere = Scene.load(FILES / "scene").surfaces
    assert (wall.name, wall.roughness_m, sphere.name, sphere.material) == ("wall", 0.0005, "sphere", "metal")
    np.testing.assert_allclose(sphere.mesh.bounds, [[-0.05] * 3, [0.05] * 3], atol=1e-6)
    assert getattr(wall.material, "layers", None) == (("plasterboard", 0.0125),)


def test_a_recording_set_loads() -> None:
    recordings = RecordingSet.load(FILES / "set")
    assert [row.object for row in recordings.rows] == ["mug", "can"]
    assert examine(FILES / "set").problems == []


def test_a_model_answers() -> None:
    model = Recogniser.load(FILES / "model")
    assert model.classes == ("can", "mug", "bottle")
    assert model.features["set"] == "rotation"
    np.testing.assert_allclose(model.probabilities(np.array([[1.0, 2.0, 3.0, 4.0]])), [[1, 0, 0]], atol=1e-6)


def test_an_entry_of_the_benchmark_loads() -> None:
    method, signals = entry_folder.read(FILES / "entry")[:2]
    assert method
    assert signals["near"][0]["trihedral 15 cm"].shape == (11, 256)


def test_options_in_yaml_files_compose() -> None:
    config: Any = compose(["experiment=mine"], [FILES / "conf"])
    assert (config.scene.name, config.scene.size_m, config.radar.num_samples, config.trajectory.period_s, config.profile.resamples) == (
        "lab", [5.0, 4.0, 2.5], 128, 50.0, 50,
    )  # fmt: skip


@pytest.mark.parametrize("key", GONE)
def test_a_key_that_is_gone_names_what_to_write(key: str, tmp_path: Path) -> None:
    """The key is an override and a line in a file of the user."""
    group, _, option = key.partition("/")
    if option:
        wrong = [[f"{group}={option}"]]
    else:
        owner, _, name = key.rpartition(".")
        choose = {"materials": ["materials=vlm"], "simulator": ["simulator=points"]}.get(owner, [])
        (tmp_path / "experiment").mkdir()
        (tmp_path / "experiment" / "old.yaml").write_text(f"# @package {owner}\n{name}: 1\n")
        wrong = [[*choose, f"{key}=1"], ["experiment=old", *choose]]
    for overrides in wrong:
        with pytest.raises(ConfigError) as caught:
            compose(overrides, [tmp_path])
        assert f"was removed after version 1.0; {GONE[key]}" in str(caught.value)


LITERAL = {(experiment, old): new for experiment, of in METRICS.items() for old, new in of.items() if "(" not in old}
PRESENT = {  # experiment, metric of version 1.0: what to write, or columns of the row with its value (upper case: names in the module)
    ("contrastive", "geometry_object"):
        {"attribute": "geometry", "left out": "object", "method": "EMBEDDED", "metric": "balanced accuracy"},
    ("encoder_comparison", "accuracy_two-layer_network"): {"method": "OF_LOOKS", "labels per class": 0},
    ("encoder_comparison", "accuracy_two-layer_network_radar_texts"): {"method": "NETWORK", "labels per class": 0},
    ("encoder_comparison", "accuracy_boosted_trees"): {"method": "TREES", "labels per class": 0},
    ("labelled_probe", "accuracy_pretrained_other_revolutions"): {"probe": "REVOLUTIONS", "method": "PRETRAINED"},
    ("labelled_probe", "accuracy_raw_other_recordings"): {"probe": "RECORDINGS", "method": "RAW"},
    ("randomisation_ablation", "accuracy_nearest_text_noise_only"): {"probe": "nearest text", "copies": "NOISE_ONLY"},
    ("reconstruction_ablation", "object_no_room"): {"classes": "object", "method": "VOID"},
    ("simulation_parts", "accuracy_nearest_text_RF-Genesis_corrected"): {"probe": "TEXT", "simulation": "RIVAL"},
    ("turntable_label_free", "accuracy_identity"): {"attribute": "identity", "method": "ENCODER"},
    ("headline", "holds"): f"write {SUPPORTED}", ("headline", "fails"): f"write '{SHOWN}', {UNDECIDED} or {CONTRADICTED}",
    ("headline", "untestable"): f"write '{NOT_HERE}'", ("headline", "gain in correlation"): f'read the row with the metric "{GAIN}"',
    ("reality", "fails_rows"): f"write {MISSES}_rows", ("validation", "cases_fails"): f"write cases_{MISSES}",
}  # fmt: skip


@pytest.mark.parametrize(("experiment", "old", "new"), [(*old, new) for old, new in (LITERAL | PRESENT).items()])
def test_a_search_for_an_old_metric_names_the_present_one(inside, experiment: str, old: str, new: dict[str, Any] | str) -> None:
    if isinstance(new, dict):
        module = import_module(f"experiments.recognition.{experiment}")
        row = {"metric": "accuracy", "value": 1.0} | {name: getattr(module, str(value), value) for name, value in new.items()}
        new = f"write {shlex.quote(*inspect.getclosurevars(module.score).nonlocals['measured']([row]))}"
    done = inside("run", f"experiment={experiment}", "--search", old, "seed=1,2")
    assert done.returncode == 2
    assert done.stderr.endswith(f"--search {old}: the metric was renamed or removed after version 1.0; {new}\n")
