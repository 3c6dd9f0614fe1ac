"""A virtual measurement campaign that is killed and restarted writes the same files, byte for byte, as a campaign that runs without
interruption.

Only the files meta.json differ, because they hold times. The quick test replaces the ray tracer by a synthetic signal; the slow tests trace
rays.
"""

from __future__ import annotations

import hashlib
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from processes import started

WITHOUT = ["materials=void", "measured.gap.solver=0", "measured.gap.clutter=0"]  # no scan, clutter or creep
TINY = [
    "run", "experiment=campaign", "tracking=off",
    "profile.campaign.turntable_objects=[corner_reflector,can_211_400]", "profile.campaign.reflector_distances_m=[1.0]",
    "profile.campaign.draws=1",
    "profile.campaign.frames_per_turn=40", "profile.campaign.reflector_repeats=2", "profile.campaign.rail_repeats=1",
    "profile.campaign.rover_objects=[can_211_400]", "profile.campaign.rover_every=10",
]  # fmt: skip
RECORDINGS = 13  # number of recordings, measured and simulated together
# Replaces the tracer: a recording is noise, or is interpolated from aspects if there are more frames than aspects. Each takes 0.1 s.
MADE_UP = """
import sys, time
import numpy as np
from experiments.campaign import truth, twin
from experiments.campaign.cases import log
from experiments.campaign.turned import Turned
from radartwin.builders.radar import build_radar
from radartwin.cli import main
from radartwin.radar.recording import Recording
from radartwin.simulation.aspects import Aspects

def measured(case, config):
    return record(case, config, True)

def simulated(case, nominal, config, *more):
    return record(case, config, False)

def record(case, config, measured):
    time.sleep(0.1)
    rng = np.random.default_rng([*case.name.encode(), measured])
    radar = build_radar(config.radar)
    def noise(*shape):
        return (1e-6 * (rng.standard_normal(shape) + 1j * rng.standard_normal(shape))).astype(np.complex64)
    frames = log(case, config.profile.campaign, measured).frames
    if case.motion == "turntable" and frames > truth.aspects(case.object, truth.gaps_of(config)) and measured:
        return Turned(Aspects(noise(64, 2, 4, 256)), rng.uniform(0, 6, (frames, 16, 2)), radar)
    return Recording(noise(frames, 16, 2, 4, 256), radar)

truth.record, twin.record = measured, simulated
sys.exit(main(sys.argv[1:]))
"""


def start(output: Path, program: list[str], *more: str) -> subprocess.Popen[str]:
    # worker processes would not have the synthetic tracer, which exists only in this process
    alone = ["jobs=1"] if program[0] == "-c" else []
    return started([sys.executable, *program, *TINY, *(more or WITHOUT), f"output={output}", *alone], output.parent)


def completed(output: Path, program: list[str], seconds: float, *more: str) -> str:
    campaign = start(output, program, *more)
    said, complained = campaign.communicate(timeout=seconds)
    assert campaign.returncode == 0, complained[-2000:]
    return said


def products(output: Path) -> dict[str, str]:
    """Return the digest of every file of the measurement campaign except meta.json."""
    cache = output / "cache"
    found = [path for kind in ("clean", "processed") for path in cache.glob(f"{kind}/*/*") if path.name != "meta.json"]
    found = [path for path in found if path.parent.suffix != ".tmp"]  # left by a killed process
    return {path.relative_to(cache).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted(found)}


def finished(output: Path) -> int:
    return len(list(output.glob("cache/clean/*/meta.json")))


def disturbed(
    output: Path, program: list[str], kills: int, pause_s: float, seconds: float, *more: str, recordings: int = RECORDINGS
) -> str:
    """Start the measurement campaign and kill it `kills` times, each time during another recording, then start it again
    and let it finish.
    """
    chance = random.Random(0)
    goals = sorted(chance.sample(range(recordings - 1), kills))
    for goal in goals:
        campaign, end = start(output, program, *more), time.monotonic() + seconds
        while finished(output) < goal or not list(output.glob("cache/*/*.tmp")):
            assert campaign.poll() is None, campaign.communicate()[1][-2000:]
            assert time.monotonic() < end, f"{finished(output)} of {goal} recordings in {seconds} s"
            time.sleep(0.01)
        time.sleep(pause_s * chance.random())
        os.killpg(campaign.pid, signal.SIGKILL)
        campaign.communicate()
    return completed(output, program, seconds, *more)


@pytest.mark.slow
def test_a_campaign_killed_twice_ends_with_the_same_files(tmp_path: Path) -> None:
    program, seconds = ["-c", MADE_UP], 120
    completed(tmp_path / "whole", program, seconds)
    whole = products(tmp_path / "whole")
    assert len(whole) == 4 * RECORDINGS  # samples and description, arrays and radar
    said = disturbed(tmp_path / "killed", program, 2, 0.2, seconds)
    assert products(tmp_path / "killed") == whole
    assert not list((tmp_path / "killed").rglob("*.tmp"))
    assert "scored 1" in said


@pytest.mark.slow
@pytest.mark.parametrize("whole", [WITHOUT, ["materials=uniform", "measured.gap.solver=0", "profile.campaign.rover_rooms=[]"]])
def test_a_traced_campaign_does_not_depend_on_the_number_of_workers_or_on_kills(tmp_path: Path, whole: list[str]) -> None:
    """In this test, the second measurement campaign has scan errors, clutter and slow mechanical drift (creep)."""
    program, seconds = ["-m", "radartwin"], 1800
    completed(tmp_path / "one", program, seconds, *whole, "jobs=1")
    disturbed(tmp_path / "killed", program, 3, 2.0, seconds, *whole, "jobs=2", recordings=finished(tmp_path / "one"))
    assert products(tmp_path / "killed") == products(tmp_path / "one")
