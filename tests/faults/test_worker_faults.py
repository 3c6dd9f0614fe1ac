"""Tests of a virtual measurement campaign with several workers: one worker is killed, or the user interrupts the campaign.

The signals are synthetic as in test_campaign_kills.py, but the worker processes are real.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from processes import interrupted_twice, started, wait_until
from test_campaign_kills import MADE_UP, RECORDINGS, TINY, WITHOUT, finished, products

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


def start(folder: Path, output: Path) -> subprocess.Popen[str]:
    (folder / "campaign.py").write_text(MISBEHAVING)
    command = [sys.executable, str(folder / "campaign.py"), *TINY, *WITHOUT, f"output={output}", "jobs=2"]
    return started(command, folder, MISBEHAVE=str(folder))


def ended(folder: Path, output: Path) -> tuple[int, str, str]:
    campaign = start(folder, output)
    said, complained = campaign.communicate(timeout=300)
    return campaign.returncode, said, complained


def members(group: int) -> list[int]:
    """Return the ids of the running processes in the process group `group`."""
    found = subprocess.run(["pgrep", "-g", str(group), "-r", "R,S,D"], capture_output=True, text=True, check=False)
    return [int(word) for word in found.stdout.split()]


@pytest.mark.slow
def test_a_killed_worker_loses_no_finished_recording(tmp_path: Path) -> None:
    """The test covers the kill of a worker; tests/runs/test_workers.py covers exceptions and other failures of a worker."""
    output = tmp_path / "out"
    (tmp_path / "DIE").touch()
    code, _, complained = ended(tmp_path, output)
    assert code == 2, complained
    assert "ended unexpectedly, perhaps because memory ran out. Finished recordings and tables are kept" in complained
    assert "Traceback" not in complained
    kept = products(output)
    assert 0 < finished(output) < RECORDINGS
    (tmp_path / "DIE").unlink()
    code, _, complained = ended(tmp_path, output)
    assert code == 0, complained
    assert kept.items() <= products(output).items()
    assert finished(output) == RECORDINGS
    assert not list(output.rglob("*.tmp"))
    code, printed, _ = ended(tmp_path, tmp_path / "calm")
    assert code == 0
    assert f"run: simulated {2 * RECORDINGS}, reused 0, scored 1" in printed, "recordings of the workers are not counted"
    assert products(output) == products(tmp_path / "calm")


@pytest.mark.slow
def test_two_interrupts_end_all_workers_and_the_campaign_resumes(tmp_path: Path) -> None:
    output = tmp_path / "out"
    (tmp_path / "HOLD").touch()
    campaign = start(tmp_path, output)
    wait_until(lambda: finished(output) or campaign.poll() is not None)
    assert campaign.poll() is None, campaign.communicate()[1]
    interrupted_twice(campaign)
    wait_until(lambda: not members(campaign.pid))
    kept = products(output)
    (tmp_path / "HOLD").unlink()
    code, _, complained = ended(tmp_path, output)
    assert code == 0, complained
    assert kept.items() <= products(output).items()
    assert finished(output) == RECORDINGS
    assert not list(output.rglob("*.tmp"))
