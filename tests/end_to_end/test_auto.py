"""With simulator=auto, the chosen settings are printed with reasons and stored, and a given setting is not chosen."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from radartwin.builders.recording import simulate_scene
from radartwin.config.compose import compose
from radartwin.radar.recording import Recording

PLATE = [
    "scene=squash_court", "scene.detail=shell", "scene.target=plate", "trajectory=rail", "trajectory.length_m=0.1",
    "trajectory.distance_m=1.0",
]  # fmt: skip


def test_choice_is_printed_with_reasons_and_stored(inside, tmp_path: Path) -> None:
    def simulated() -> tuple[Recording, list[str]]:
        auto = ["simulator=auto", "features=depth", "features.without=[multipath,window,extent]"]
        done = inside("simulate", *PLATE, *auto, "--out", "made")
        assert done.returncode == 0, done.stderr
        return Recording.load(tmp_path / "made"), [line for line in done.stderr.splitlines() if line.startswith("radartwin: ")]

    first, lines = simulated()
    assert lines[0].startswith("radartwin: simulator=auto for track, brightness: ")
    assert any("parts of the room none" in line for line in lines[1:])
    again, lines_again = simulated()
    assert lines_again[0].endswith(", as an earlier search chose")
    assert lines_again[1:] == lines[1:]
    assert np.array_equal(first.iq, again.iq)
    (stored,) = (tmp_path / "outputs" / "cache" / "choice").glob("*/choice.json")
    model = json.loads(stored.read_text())["model"]
    assert first.provenance["max_bounces"] == model["max_bounces"]
    assert ("wall" in " ".join(first.provenance["surfaces"])) == (model["parts"] != "none")


def test_given_settings_are_not_chosen() -> None:
    config = compose(["simulator=auto", "simulator.max_bounces=2", "simulator.elements=exact", "simulator.parts=none", *PLATE])
    lines: list[str] = []
    made = simulate_scene(config, say=lines.append)
    assert (made.provenance["max_bounces"], made.provenance["elements"]) == (2, "exact")
    assert set(made.provenance["surfaces"]) == {"target"}
    assert not any("bounces 1" in line or "parts of the room" in line for line in lines)
    same = [*PLATE, "simulator.max_bounces=2", "simulator.parts=none"]
    same += [f"simulator.{name}={str(made.provenance[name]).lower()}" for name in ("rays_per_wavelength2", "coupling", "diffuse")]
    assert np.array_equal(simulate_scene(compose(same)).iq, made.iq)
