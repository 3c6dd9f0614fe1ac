"""On a real SLURM cluster, the jobs of a job array share the campaign: no recording is made twice, and a killed part resumes."""

from __future__ import annotations

import subprocess
import time
from pathlib import Path

import pytest
from test_slurm import environment, outcomes, queue, radartwin

pytestmark = pytest.mark.slow
__all__ = ["environment"]  # the fixture
MODULE = """
import os
import time
from pathlib import Path

import numpy as np

from experiments.campaign import part, truth, twin
from experiments.campaign.cases import log
from radartwin.builders.radar import build_radar
from radartwin.radar.recording import Recording

HERE = Path(os.environ["OWN_EXPERIMENT"])


def record(case, config, domain):
    with (HERE / "made.txt").open("a") as made:
        made.write(f"{domain}/{case.name}\\n")
    radar, frames = build_radar(config.radar), log(case, config.profile.campaign, domain == "measured").frames
    return Recording(np.ones((frames, radar.num_chirps, radar.num_tx, radar.num_rx, radar.num_samples), np.complex64), radar)


truth.record = lambda case, config: record(case, config, "measured")
twin.record = lambda case, nominal, config, *more: record(case, config, "twin")


def run(config, store, progress):
    make = part.Campaign.process

    def process(self, domain, case):
        made = make(self, domain, case)
        while (HERE / f"HOLD_{config.experiment.part}").exists():
            time.sleep(0.05)
        return made

    part.Campaign.process = process
    return part.run(config, store, progress)
"""
YAML = "# @package _global_\nexperiment:\n  name: campaign_part\n  module: my_part\n"
PARTS = 3
SMALL = [
    "jobs=1", "materials=void", "tracking=off", f"experiment.parts={PARTS}", f"experiment.part=range(0,{PARTS})",
    "profile.campaign.turntable_objects=[can_211_400]", "profile.campaign.frames_per_turn=13", "profile.campaign.turns=1",
    "profile.campaign.draws=1",
    "profile.campaign.rail_repeats=1", "profile.campaign.rover_objects=[mug]", "profile.campaign.rover_every=25",
]  # fmt: skip


def test_parts_of_the_campaign_make_each_recording_once(environment, tmp_path: Path) -> None:
    own, output = tmp_path / "mine", tmp_path / "shared"
    (own / "experiment").mkdir(parents=True)
    (own / "experiment" / "mine.yaml").write_text(YAML)
    (own / "my_part.py").write_text(MODULE)
    (own / "HOLD_1").touch()
    environment = {**environment, "OWN_EXPERIMENT": str(own)}
    arguments = ["run", "-m", "experiment=mine", "--config-dir", str(own), "hydra/launcher=slurm", "hydra.launcher.cpus_per_task=1", *SMALL]
    first = radartwin(arguments, environment, output)
    end = time.monotonic() + 300
    while outcomes(output) < PARTS - 1 or queue(environment) != {"1": "RUNNING"} or not (output / "cache" / "processed").exists():
        assert time.monotonic() < end, f"queue {queue(environment)}, {outcomes(output)} outcomes"
        assert first.poll() is None, first.communicate()
        time.sleep(0.5)
    before = set((own / "made.txt").read_text().split())
    ids = subprocess.run(["squeue", "-h", "-r", "-o", "%i"], env=environment, capture_output=True, text=True, check=True).stdout.split()
    subprocess.run(["scancel", *ids], env=environment, check=True)
    said, complained = first.communicate(timeout=120)
    assert first.returncode == 1, complained
    assert f"sweep: {PARTS - 1} done, 0 cached, 1 failed" in said
    (own / "HOLD_1").unlink()

    said, complained = radartwin(arguments, environment, output).communicate(timeout=300)
    assert f"sweep: 1 done, {PARTS - 1} cached, 0 failed" in said, complained
    made = (own / "made.txt").read_text().split()
    assert before < set(made)
    assert len(made) == len(set(made)) == len(list((output / "cache" / "clean").glob("*/meta.json")))
    assert not list((output / "cache").glob("*/*.tmp"))
