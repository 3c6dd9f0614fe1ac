"""After every fault during a parameter sweep, the results of finished runs remain, unfinished runs are removed, and the error message says
what to do.
"""

from __future__ import annotations

import os
import random
import signal
import sqlite3
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path

import own_experiment
import pytest
from disks import Disk
from processes import interrupted_twice, started, wait_until

pytestmark = pytest.mark.slow
SEEDS = "seed=0,1,2,3"


class Study:
    """A user's experiment and its output folder; the method `start` runs the command line on this experiment."""

    def __init__(self, folder: Path, output: Path) -> None:
        self.folder, self.output = folder / "mine", output
        self.arguments, self.environment = own_experiment.write(self.folder)

    def start(self, *more: str, **environment: str) -> subprocess.Popen[str]:
        command = [sys.executable, "-m", "radartwin", *self.arguments, *more, "--output", str(self.output)]
        return started(command, self.folder.parent, **self.environment, **environment)

    def run(self, *more: str, **environment: str) -> tuple[int, str, str]:
        process = self.start(*more, **environment)
        said, complained = process.communicate(timeout=500)
        return process.returncode, said, complained

    def done(self, *more: str, **environment: str) -> str:
        code, said, complained = self.run(*more, **environment)
        assert code == 0, complained[-2000:]
        return said

    def tracked(self, question: str) -> list[tuple]:
        with closing(sqlite3.connect(self.output / "mlflow.db")) as connection:
            return connection.execute(question).fetchall()

    def no_traces(self) -> bool:
        """Return True if the output folder contains no unfinished files."""
        return not list(self.output.rglob("*.tmp")) and not list(self.output.rglob("*.lock"))


@pytest.fixture
def study(tmp_path: Path) -> Study:
    return Study(tmp_path, tmp_path / "out")


ONCE_EACH = """SELECT count(*), count(DISTINCT t.value) FROM runs r JOIN tags t USING (run_uuid)
WHERE t.key = 'run_key' AND t.value != 'sweep' AND r.status = 'FINISHED'"""


def test_a_job_whose_worker_is_killed_fails_alone_with_a_message(study: Study) -> None:
    (study.folder / "KILL_1").touch()
    joblib = ("-m", "hydra/launcher=joblib", "hydra.launcher.n_jobs=2", SEEDS)
    code, said, complained = study.run(*joblib)
    assert code == 1, complained
    assert "sweep: 3 done, 0 cached, 1 failed" in said
    assert "its process was killed (memory ran out, or another program ended it)" in said
    (study.folder / "KILL_1").unlink()
    said = study.done(*joblib)
    assert "sweep: 1 done, 3 cached, 0 failed" in said
    assert study.tracked(ONCE_EACH) == [(4, 4)]
    assert study.no_traces()


def test_a_run_out_of_memory_is_one_line_and_resumes(study: Study) -> None:
    (study.folder / "EAT_1").touch()
    code, said, complained = study.run("seed=1")
    assert code == 1
    assert "Traceback" not in complained
    assert complained.splitlines()[-1].startswith("radartwin: out of memory (")
    assert "finished results are stored" in complained
    code, said, complained = study.run("-m", "seed=0,1,2")
    assert code == 1, complained
    assert "sweep: 2 done, 0 cached, 1 failed" in said
    assert "out of memory" in said
    (study.folder / "EAT_1").unlink()
    said = study.done("-m", "seed=0,1,2")
    assert "sweep: 1 done, 2 cached, 0 failed" in said
    assert study.no_traces()


def test_two_interrupts_keep_the_finished_runs_of_a_sweep_which_resumes(study: Study) -> None:
    (study.folder / "HOLD_2").touch()
    for launcher in ("basic", "joblib"):
        sweep = study.start("-m", f"hydra/launcher={launcher}", SEEDS)
        wait_until(lambda: bool(list((study.output / "sweeps").glob("*/2/log.txt"))))
        time.sleep(1)
        assert "sweep: " in interrupted_twice(sweep)
        for path in (study.output / "sweeps").glob("*/2/log.txt"):
            path.unlink()
    (study.folder / "HOLD_2").unlink()
    study.done("-m", SEEDS)
    assert study.tracked(ONCE_EACH) == [(4, 4)]
    assert study.tracked("SELECT count(*) FROM runs WHERE status = 'RUNNING'") == [(0,)]
    assert study.no_traces()


def test_two_concurrent_sweeps_on_one_store_compute_each_run_once(study: Study) -> None:
    for _ in range(2):
        pair = [study.start("-m", SEEDS), study.start("-m", SEEDS)]
        for sweep in pair:
            said, complained = sweep.communicate(timeout=300)
            assert sweep.returncode == 0, complained
            assert "0 failed" in said
    (table,) = own_experiment.tables(study.output)
    assert [float(row["correlation"]) for row in table] == [seed / 1000 for seed in range(4)]
    assert study.tracked(ONCE_EACH) == [(4, 4)]
    assert study.no_traces()


def test_a_clock_set_back_between_and_during_runs_changes_nothing(study: Study, tmp_path: Path) -> None:
    # A clock that jumps an hour back at every second call; it is installed before any other module is imported.
    (tmp_path / "sitecustomize.py").write_text(
        "import itertools, time\nreal, n = time.time, itertools.count()\ntime.time = lambda: real() - 3600 * (next(n) % 2)\n"
    )
    study.done("-m", SEEDS, PYTHONPATH=os.pathsep.join((str(tmp_path), os.environ.get("PYTHONPATH", ""))))
    said = study.done("-m", SEEDS)
    assert "sweep: 0 done, 4 cached" in said
    assert study.tracked("SELECT count(*) FROM runs WHERE end_time < start_time") == [(0,)]


def test_a_full_disk_is_reported_and_the_run_resumes_without_partial_files(small_disk: Disk, tmp_path: Path) -> None:
    study = Study(tmp_path, small_disk.folder / "out")
    assert study.run("seed=0")[0] == 0
    small_disk.fill()
    code, said, complained = study.run("-m", "seed=0,1")
    assert code in (1, 2), said + complained
    assert "space" in complained + said
    assert "Traceback" not in complained
    small_disk.empty()
    said = study.done("-m", "seed=0,1")
    assert "1 cached" in said, "what was finished before the disk was full was lost"
    assert study.tracked(ONCE_EACH) == [(2, 2)]
    assert study.no_traces()


def test_many_jobs_and_kills_give_the_right_table(study: Study) -> None:
    jobs, kills = 150, 4
    arguments = ("-m", "hydra/launcher=joblib", "hydra.launcher.n_jobs=2", f"seed=range({jobs})")
    chance = random.Random(0)
    for kill in range(kills):
        sweep = study.start(*arguments)
        goal = (kill + 1) * jobs // (kills + 2) + chance.randrange(20)
        wait_until(lambda goal=goal: len(list((study.output / "cache" / "run").glob("*/meta.json"))) >= goal, 900)
        time.sleep(chance.random())
        if kill % 2:  # kill the parent process of the sweep, which ends all its workers
            os.killpg(sweep.pid, signal.SIGKILL)
            sweep.communicate()
        else:  # kill one of the workers; the sweep continues
            workers = [int(p) for p in subprocess.run(["pgrep", "-P", str(sweep.pid)], capture_output=True, text=True).stdout.split()]
            os.kill(chance.choice(workers), signal.SIGKILL)
            wait_until(lambda goal=goal: len(list((study.output / "cache" / "run").glob("*/meta.json"))) >= goal + 10, 900)
            os.killpg(sweep.pid, signal.SIGKILL)
            sweep.communicate()
    said = study.done(*arguments)
    assert "0 failed, 0 refused" in said
    table = own_experiment.tables(study.output)[-1]
    assert [(row["seed"], float(row["correlation"])) for row in table] == [(str(n), n / 1000) for n in range(jobs)]
    assert len({row["run_key"] for row in table}) == jobs
    assert study.tracked(ONCE_EACH) == [(jobs, jobs)]
    assert study.no_traces()
