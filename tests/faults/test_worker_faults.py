"""A campaign in several workers when one of them runs out of memory, is killed or has a defect, and when the user interrupts it.

The signals are made up as in test_campaign_kills.py; the workers are real.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest
from interrupts import interrupted_twice
from test_campaign_kills import MADE_UP, RECORDINGS, TINY, WITHOUT, finished, products

HEAD, TAIL = MADE_UP.split("truth.record, twin.record =")
MISBEHAVING = f"""{HEAD}
import os, resource, signal
from pathlib import Path

HERE = Path(os.environ["MISBEHAVE"])
calm = record

def record(case, config, measured):
    last = case.motion == "turntable"  # after others have been made
    if last and (HERE / "EAT").exists():
        size = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (size + (64 << 20), resource.RLIM_INFINITY))
        np.ones(1 << 30)
    if last and (HERE / "DIE").exists():
        os.kill(os.getpid(), signal.SIGKILL)
    if last and (HERE / "BREAK").exists():
        raise ZeroDivisionError("the tracer broke")
    while last and (HERE / "HOLD").exists():
        time.sleep(0.05)
    return calm(case, config, measured)

truth.record, twin.record ={TAIL.replace("sys.exit(main(sys.argv[1:]))", "")}
if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
"""


def started(folder: Path, output: Path) -> subprocess.Popen[str]:
    (folder / "campaign.py").write_text(MISBEHAVING)
    return subprocess.Popen(
        [sys.executable, str(folder / "campaign.py"), *TINY, *WITHOUT, f"output={output}", "jobs=2"],
        cwd=folder,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env={**os.environ, "PYTHONPATH": str(Path(__file__).resolve().parents[2]), "MISBEHAVE": str(folder)},
    )


def ended(folder: Path, output: Path) -> tuple[int, str, str]:
    campaign = started(folder, output)
    said, complained = campaign.communicate(timeout=300)
    return campaign.returncode, said, complained


def members(group: int) -> list[int]:
    """Running processes of the group."""
    found = subprocess.run(["pgrep", "-g", str(group), "-r", "R,S,D"], capture_output=True, text=True, check=False)
    return [int(word) for word in found.stdout.split()]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("how", "status", "words"),
    [
        ("EAT", 2, ("ran out of memory", "Finished recordings and tables are kept", "jobs=1 needs the least memory")),
        ("DIE", 2, ("ended unexpectedly, perhaps because memory ran out", "Finished recordings and tables are kept", "jobs=1")),
        ("BREAK", 1, ("ZeroDivisionError: the tracer broke", 'campaign.py", line')),  # a defect keeps its traceback
    ],
)
def test_a_failing_worker_loses_no_finished_recording(how: str, status: int, words: tuple[str, ...], tmp_path: Path) -> None:
    output = tmp_path / "out"
    (tmp_path / how).touch()
    code, _, complained = ended(tmp_path, output)
    assert code == status, complained
    assert all(word in complained for word in words), complained
    assert status == 1 or "Traceback" not in complained
    kept = products(output)
    assert 0 < finished(output) < RECORDINGS
    (tmp_path / how).unlink()
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
    campaign, end = started(tmp_path, output), time.monotonic() + 120
    while not finished(output):
        assert campaign.poll() is None, campaign.communicate()[1]
        assert time.monotonic() < end
        time.sleep(0.05)
    interrupted_twice(campaign)
    while members(campaign.pid):
        assert time.monotonic() < end, "a worker lives on"
        time.sleep(0.05)
    kept = products(output)
    (tmp_path / "HOLD").unlink()
    code, _, complained = ended(tmp_path, output)
    assert code == 0, complained
    assert kept.items() <= products(output).items()
    assert finished(output) == RECORDINGS
    assert not list(output.rglob("*.tmp"))
