"""`radartwin tables` writes the same files after it was killed, while a second `radartwin tables` runs, and after the disk was full."""

from __future__ import annotations

import json
import os
import random
import re
import signal
import sqlite3
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from pathlib import Path

import pytest
from disks import Disk
from processes import started
from reported import row

from analysis import main, registry, table_runs
from radartwin.errors import OutputError
from radartwin.plotting import style
from radartwin.runs.experiment import Result

TABLES = ["labels", "positioning"]  # the cheapest tables that trace, scan and start Sionna's process
# Parts of the report that differ between equal runs: end time, processor time, and run id in MLflow.
STATED = re.compile(r"\d{4}-\d\d-\d\dT[\d:]+Z|[\d,.]+ core-seconds|<a href=\"http://127[^\"]*\"><code>[0-9a-f]+</code></a>")


def start(output: Path) -> subprocess.Popen[str]:
    only = [word for name in TABLES for word in ("--only", name)]
    return started([sys.executable, "-m", "radartwin", "tables", *only, "--output", str(output)], output.parent)


def completed(output: Path) -> str:
    process = start(output)
    said, complained = process.communicate(timeout=1200)
    assert process.returncode == 0, complained[-2000:]
    return said


def written(output: Path) -> dict[str, bytes]:
    """Return the content of tables, figures and report, without times and MLflow numbers in the report, and without the report's hash."""
    found = [path for part in ("tables", "figures", "report") for path in sorted((output / part).rglob("*")) if path.is_file()]
    content = {path.relative_to(output).as_posix(): path.read_bytes() for path in found}
    page = content["report/index.html"].decode()
    stamps = json.loads(content["tables/stamps.json"]) | {"report": "stated"}
    return content | {"report/index.html": STATED.sub("stated", page).encode(), "tables/stamps.json": json.dumps(stamps).encode()}


def products(output: Path) -> set[str]:
    return {path.parent.relative_to(output).as_posix() for path in (output / "cache").glob("*/*/meta.json")}


def worked_s(process: int) -> float:
    """Return the processor seconds of a process so far (proc(5), utime and stime), because they do not depend on the
    load of the machine.
    """
    words = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")


@pytest.mark.slow
def test_tables_killed_at_random_moments_equal_those_of_a_run_without_kills(tmp_path: Path) -> None:
    began = sum(os.times()[2:4])
    completed(tmp_path / "whole")
    whole, long_s = written(tmp_path / "whole"), sum(os.times()[2:4]) - began
    began = sum(os.times()[2:4])
    assert "simulated 0" in completed(tmp_path / "whole")
    short_s = sum(os.times()[2:4]) - began
    assert written(tmp_path / "whole") == whole

    output, chance, killed = tmp_path / "killed", random.Random(0), 0
    for longest_s in [long_s / 2] * 5 + [short_s] * 8:  # first kills during computation, then kills while results are read and written
        process, moment = start(output), chance.uniform(0.1, longest_s)
        while process.poll() is None and worked_s(process.pid) < moment:
            time.sleep(0.02)
        if process.poll() is None:
            before = products(output)
            os.killpg(process.pid, signal.SIGKILL)
            killed += 1
            assert before <= products(output), "a finished product was lost"
        process.communicate()
    assert killed >= 8
    with closing(sqlite3.connect(output / "mlflow.db")) as connection:
        assert connection.execute("SELECT count(*) FROM runs WHERE status != 'FINISHED'").fetchone()[0] > 1, "none in the midst of a run"
    completed(output)
    assert written(output) == whole
    assert products(output) == products(tmp_path / "whole")
    assert not list(output.rglob("*.tmp"))
    assert not list(output.rglob("*.lock"))
    with closing(sqlite3.connect(output / "mlflow.db")) as connection:
        once = "SELECT count(*), count(DISTINCT t.value) FROM runs r JOIN tags t USING (run_uuid) WHERE t.key = 'run_key' AND r.status = ?"
        assert connection.execute(once, ["FINISHED"]).fetchone() == (len(TABLES), len(TABLES))
        assert connection.execute(once, ["RUNNING"]).fetchone() == (0, 0)


def test_two_concurrent_writers_of_tables_lose_no_index_entry(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    read = table_runs.read

    def slowly(output: Path, name: str) -> table_runs.Entries:
        entries = read(output, name)
        time.sleep(0.2)  # the other process has time to write files that a race would lose
        return entries

    monkeypatch.setattr(table_runs, "read", slowly)
    names = ["backend_crosscheck", "stability", "validation"]
    tables = [registry.table(name) for name in names]
    with ThreadPoolExecutor(len(tables)) as pool:
        list(pool.map(lambda table: main.write(table, Result(table.name, [row()], {}, {}, [], "0"), "quick", tmp_path), tables))
    assert sorted(json.loads((tmp_path / "tables" / "index.json").read_text())) == names
    assert not list(tmp_path.rglob("*.lock"))


def test_a_disk_that_fills_up_leaves_each_file_of_a_table_old_or_new(small_disk: Disk, tmp_path: Path) -> None:
    table, output = registry.table("environment"), small_disk.folder / "out"
    results = {}
    for value in (0.5, 0.45):
        drawing, axes = style.figure(width_in=2.0, height_in=1.0)
        axes.plot([0, value])
        style.save(drawing, tmp_path / f"{value}")
        results[value] = Result(table.name, [row(value=value)], {"drawn": tmp_path / f"{value}"}, {}, [], f"{value:032}")

    def write(value: float) -> None:
        main.write(table, results[value], "quick", output)

    write(0.45)
    new = small_disk.content()
    write(0.5)
    old, refusals = small_disk.content(), []
    for free in range(0, 80_000, 4096):
        small_disk.fill(leave=free)
        try:
            write(0.45)
        except OutputError as error:
            refusals.append(str(error))
        found = small_disk.content()
        assert found.keys() == old.keys()
        assert all(content in (old[path], new[path]) for path, content in found.items())
        small_disk.empty()
        write(0.5)
        assert small_disk.content() == old
    assert 2 < len(refusals) < 20
    assert all("No space left" in said and "free some space" in said for said in refusals)
