"""simulator=auto from the command line: it prints its choice and the reasons, stores the choice, and can be overridden."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from radartwin.builders.recording import simulate_scene
from radartwin.config.compose import compose
from radartwin.errors import ConfigError
from radartwin.radar.recording import Recording

PLATE = [
    "scene=squash_court",
    "scene.detail=shell",
    "scene.target=plate",
    "trajectory=rail",
    "trajectory.length_m=0.1",
    "trajectory.distance_m=1.0",
]


def simulated(folder: Path, *overrides: str) -> tuple[Recording, list[str]]:
    command = [sys.executable, "-m", "radartwin", "simulate", *PLATE, f"output={folder}", "--out", str(folder / "made"), *overrides]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return Recording.load(folder / "made"), [line for line in done.stderr.splitlines() if line.startswith("radartwin: ")]


def test_choice_is_printed_with_reasons_and_stored(tmp_path: Path) -> None:
    overrides = ["simulator=auto", "features=depth", "features.without=[multipath,window,extent]"]
    first, lines = simulated(tmp_path, *overrides)
    assert lines[0].startswith("radartwin: simulator=auto for track, brightness: ")
    assert any("parts of the room none" in line for line in lines[1:])
    again, lines_again = simulated(tmp_path, *overrides)
    assert lines_again[0].endswith(", as chosen before")
    assert lines_again[1:] == lines[1:]
    assert np.array_equal(first.iq, again.iq)
    (stored,) = (tmp_path / "cache" / "choice").glob("*/choice.json")
    model = json.loads(stored.read_text())["model"]
    assert first.provenance["max_bounces"] == model["max_bounces"]
    assert ("wall" in " ".join(first.provenance["surfaces"])) == (model["parts"] != "none")


def test_given_settings_are_not_chosen() -> None:
    config = compose(["simulator=auto", "simulator.max_bounces=2", "simulator.elements=exact", "simulator.parts=whole", *PLATE])
    lines: list[str] = []
    made = simulate_scene(config, say=lines.append)
    assert (made.provenance["max_bounces"], made.provenance["elements"]) == (2, "exact")
    assert not any("bounces 1" in line or "parts of the room" in line for line in lines)
    chosen = made.provenance["rays_per_wavelength2"]
    same = [*PLATE, "simulator.max_bounces=2", f"simulator.rays_per_wavelength2={chosen}"]
    same += [f"simulator.{name}={str(made.provenance[name]).lower()}" for name in ("coupling", "diffuse")]
    assert np.array_equal(simulate_scene(compose(same)).iq, made.iq)


def test_simulator_parts_leaves_out_the_room() -> None:
    whole, none = (simulate_scene(compose([f"simulator.parts={parts}", *PLATE])) for parts in ("whole", "none"))
    assert set(none.provenance["surfaces"]) == {"target"}
    assert len(whole.provenance["surfaces"]) > 1


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (["simulator=auto", "simulator.tolerance=0"], "simulator.tolerance=0.0 must be above zero"),
        (["simulator.tolerance=2"], "simulator.tolerance is not read by simulator=mitsuba; choose simulator=auto"),
        (["simulator=auto", "simulator.parts=half"], "simulator.parts=half is not known; options: none, large, whole"),
        (["simulator=auto", "simulator.rays=1000"], "simulator.rays is not read by simulator=auto"),
    ],
)
def test_wrong_setting_is_refused(overrides: list[str], message: str) -> None:
    with pytest.raises(ConfigError, match=message.replace("(", r"\(")):
        compose(overrides)
