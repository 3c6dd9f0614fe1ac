"""Files that version 1.0.0 wrote load; its configuration keys that are gone are refused by a line that names what to write."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from radartwin.benchmark import entry_folder
from radartwin.config.compose import compose
from radartwin.config.messages import GONE
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
