"""A virtual measurement campaign that is killed, loses a worker or is interrupted, and starts again, writes the same files, byte for byte,
as one that runs without interruption. Only the files meta.json differ, because they hold times. One test traces rays; the others replace
the ray tracer by a synthetic signal.
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
from processes import interrupted_twice, started, wait_until

pytestmark = pytest.mark.slow
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


def test_a_campaign_killed_twice_ends_with_the_same_files(tmp_path: Path) -> None:
    program, seconds = ["-c", MADE_UP], 120
    completed(tmp_path / "whole", program, seconds)
    whole = products(tmp_path / "whole")
    assert len(whole) == 4 * RECORDINGS  # samples and description, arrays and radar
    said = disturbed(tmp_path / "killed", program, 2, 0.2, seconds)
    assert products(tmp_path / "killed") == whole
    assert not list((tmp_path / "killed").rglob("*.tmp"))
    assert "scored 1" in said


@pytest.mark.parametrize("whole", [WITHOUT, ["materials=uniform", "measured.gap.solver=0", "profile.campaign.rover_rooms=[]"]])
def test_a_traced_campaign_does_not_depend_on_the_number_of_workers_or_on_kills(tmp_path: Path, whole: list[str]) -> None:
    """The second campaign has scan errors, clutter and slow mechanical drift (creep)."""
    program, seconds = ["-m", "radartwin"], 1800
    completed(tmp_path / "one", program, seconds, *whole, "jobs=1")
    disturbed(tmp_path / "killed", program, 3, 2.0, seconds, *whole, "jobs=2", recordings=finished(tmp_path / "one"))
    assert products(tmp_path / "killed") == products(tmp_path / "one")


HEAD, TAIL = MADE_UP.split("truth.record, twin.record =")
MISBEHAVING = f"""{HEAD}
import os, signal
from pathlib import Path

HERE = Path(os.environ["MISBEHAVE"])
calm = record

def record(case, config, measured):
    last = case.motion == "turntable"  # after others have been made
    if last and (HERE / "DIE").exists():
        os.kill(os.getpid(), signal.SIGKILL)
    while last and (HERE / "HOLD").exists():
        time.sleep(0.05)
    return calm(case, config, measured)

truth.record, twin.record ={TAIL.replace("sys.exit(main(sys.argv[1:]))", "")}
if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
"""


def start_workers(folder: Path, output: Path) -> subprocess.Popen[str]:
    (folder / "campaign.py").write_text(MISBEHAVING)
    command = [sys.executable, str(folder / "campaign.py"), *TINY, *WITHOUT, f"output={output}", "jobs=2"]
    return started(command, folder, MISBEHAVE=str(folder))


def ended(folder: Path, output: Path) -> tuple[int, str, str]:
    campaign = start_workers(folder, output)
    said, complained = campaign.communicate(timeout=300)
    return campaign.returncode, said, complained


def resumes(folder: Path, output: Path, kept: dict[str, str]) -> None:
    """Check that the campaign ends and keeps the products that it had made."""
    code, _, complained = ended(folder, output)
    assert code == 0, complained
    assert kept.items() <= products(output).items()
    assert finished(output) == RECORDINGS
    assert not list(output.rglob("*.tmp"))


def members(group: int) -> list[int]:
    """Return the ids of the running processes in the process group `group`."""
    found = subprocess.run(["pgrep", "-g", str(group), "-r", "R,S,D"], capture_output=True, text=True, check=False)
    return [int(word) for word in found.stdout.split()]


def test_a_killed_worker_loses_no_finished_recording(tmp_path: Path) -> None:
    output = tmp_path / "out"
    (tmp_path / "DIE").touch()
    code, _, complained = ended(tmp_path, output)
    assert code == 1, complained
    assert "ended unexpectedly, perhaps because memory ran out. Finished recordings and tables are kept" in complained
    assert "Traceback" not in complained
    kept = products(output)
    assert 0 < finished(output) < RECORDINGS
    (tmp_path / "DIE").unlink()
    resumes(tmp_path, output, kept)
    code, printed, _ = ended(tmp_path, tmp_path / "calm")
    assert code == 0
    assert f"run: simulated {2 * RECORDINGS}, reused 0, scored 1" in printed, "recordings of the workers are not counted"
    assert products(output) == products(tmp_path / "calm")


def test_two_interrupts_end_all_workers_and_the_campaign_resumes(tmp_path: Path) -> None:
    output = tmp_path / "out"
    (tmp_path / "HOLD").touch()
    campaign = start_workers(tmp_path, output)
    wait_until(lambda: finished(output) or campaign.poll() is not None)
    assert campaign.poll() is None, campaign.communicate()[1]
    interrupted_twice(campaign)
    wait_until(lambda: not members(campaign.pid))
    kept = products(output)
    (tmp_path / "HOLD").unlink()
    resumes(tmp_path, output, kept)
