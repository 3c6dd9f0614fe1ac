"""simulator=auto from the command line: it says what it chose and why, remembers it, and can be overridden."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from radartwin.build.recording import simulate_scene
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


def test_it_says_what_it_chose_and_why_and_remembers(tmp_path: Path) -> None:
    overrides = ["simulator=auto", "features=depth", "features.without=[multipath,window,extent]"]
    first, told = simulated(tmp_path, *overrides)
    assert told[0].startswith("radartwin: simulator=auto for track, brightness: ")
    assert any("parts of the room none" in line for line in told[1:])
    again, told_again = simulated(tmp_path, *overrides)
    assert told_again[0].endswith(", as chosen before")
    assert told_again[1:] == told[1:]
    assert np.array_equal(first.iq, again.iq)
    (kept,) = (tmp_path / "cache" / "choice").glob("*/choice.json")
    model = json.loads(kept.read_text())["model"]
    assert first.provenance["max_bounces"] == model["max_bounces"]
    assert ("wall" in " ".join(first.provenance["surfaces"])) == (model["parts"] != "none")


def test_what_is_set_is_not_chosen() -> None:
    config = compose(["simulator=auto", "simulator.max_bounces=2", "simulator.elements=exact", "simulator.parts=whole", *PLATE])
    told: list[str] = []
    made = simulate_scene(config, say=told.append)
    assert (made.provenance["max_bounces"], made.provenance["elements"]) == (2, "exact")
    assert not any("bounces 1" in line or "parts of the room" in line for line in told)
    chosen = made.provenance["rays_per_wavelength2"]
    same = [*PLATE, "simulator.max_bounces=2", f"simulator.rays_per_wavelength2={chosen}"]
    same += [f"simulator.{name}={str(made.provenance[name]).lower()}" for name in ("coupling", "diffuse")]
    assert np.array_equal(simulate_scene(compose(same)).iq, made.iq)


def test_parts_of_a_room_are_left_out_by_hand_too() -> None:
    whole, none = (simulate_scene(compose([f"simulator.parts={parts}", *PLATE])) for parts in ("whole", "none"))
    assert set(none.provenance["surfaces"]) == {"target"}
    assert len(whole.provenance["surfaces"]) > 1


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        (["simulator=auto", "simulator.tolerance=0"], "simulator.tolerance=0.0 must be above zero"),
        (["simulator.tolerance=2"], "simulator.tolerance=2.0 is not read by simulator=mitsuba; choose simulator=auto"),
        (["simulator=auto", "simulator.parts=half"], "simulator.parts=half is not known; options: none, large, whole"),
        (["simulator=auto", "simulator.rays=1000"], "simulator.rays=1000 is not read by simulator=auto"),
    ],
)
def test_wrong_options_are_one_line(overrides: list[str], message: str) -> None:
    with pytest.raises(ConfigError, match=message.replace("(", r"\(")):
        compose(overrides)
