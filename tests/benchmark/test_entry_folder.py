"""Folders of signals enter the benchmark, and a wrong folder is refused in one line with exit status 2."""

from __future__ import annotations

import csv
import hashlib
import json
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from markdown_blocks import DOCS, blocks, follow

from radartwin.benchmark import entrants, entry_folder, frozen_problems
from radartwin.benchmark.leaderboard import COLUMNS, benchmark
from radartwin.errors import InputError
from radartwin.io import files

PUBLIC = {"method", "problem", "profile_error_db", "signal_error", "seconds_per_frame", "answers_version"}


def quiet_signals(problem: str, factor: complex = 0.5) -> dict[str, np.ndarray]:
    return {scenario.name: factor * scenario.answer for scenario in frozen_problems.problem(problem).scenarios}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    seconds = {"near": 0.25, "furnished_drive": 2.0}
    return entry_folder.write(tmp_path / "mine", "my solver", {name: quiet_signals(name) for name in seconds}, seconds, "a desk")


def rows(output: Path) -> list[dict[str, str]]:
    return list(csv.DictReader((output / "benchmark" / "leaderboard.csv").read_text().splitlines()))


def test_folder_is_scored_on_its_problems(folder: Path, tmp_path: Path, inside: Callable) -> None:
    done = inside("benchmark", "--method", folder, "--output", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    board = rows(tmp_path / "out")
    assert [(row["method"], row["problem"]) for row in board] == [("my solver", "near"), ("my solver", "furnished_drive")]
    assert set(board[0]) >= PUBLIC
    assert tuple(board[0]) == COLUMNS
    assert (board[0]["signal_error"], board[0]["seconds_per_frame"], board[0]["machine"]) == ("0.5000", "0.25", "a desk")
    assert board[0]["answers_version"] == frozen_problems.version()
    assert str(tmp_path / "out" / "benchmark" / "leaderboard.csv") in done.stdout


def test_a_simulator_joins_the_rows_and_replaces_only_its_own(folder: Path, tmp_path: Path, inside: Callable) -> None:
    output = tmp_path / "out"
    inside("benchmark", "--method", folder, "--output", output)
    for _ in range(2):
        done = inside("benchmark", "--method", "points", "--problem", "near", "--output", output)
        assert done.returncode == 0, done.stderr
    board = rows(output)
    assert [row["method"] for row in board] == ["my solver", "my solver", "points"]
    assert float(board[-1]["profile_error_db"]) > 10, "a far-field table is wrong at 0.5 m"
    assert float(board[-1]["seconds_per_frame"]) > 0


def change(folder: Path, edit: Callable[[dict[str, Any]], object]) -> None:
    described = json.loads((folder / entry_folder.DESCRIPTION).read_text())
    edit(described["problems"]["near"])
    (folder / entry_folder.DESCRIPTION).write_text(json.dumps(described))


def checksum(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def put(folder: Path, array: np.ndarray, key: str = "trihedral 15 cm") -> None:
    """Replace the array of the problem near, with a correct checksum in method.json."""
    (folder / "near.npz").write_bytes(frozen_problems.packed({key: array}))
    change(folder, lambda near: near.update(sha256=checksum(folder / "near.npz")))


def edited(edit: Callable[[dict[str, Any]], object]) -> Callable[[Path], object]:
    return lambda folder: change(folder, edit)


def with_array(array: np.ndarray, key: str = "trihedral 15 cm") -> Callable[[Path], object]:
    return lambda folder: put(folder, array, key)


def with_description(change: Callable[[str], str]) -> Callable[[Path], object]:
    return lambda folder: (folder / "method.json").write_text(change((folder / "method.json").read_text()))


GRID = "compute at these frequencies"
WRONG: dict[str, tuple[Callable[[Path], object], str]] = {
    "shape": (with_array(np.zeros((11, 255), complex)), "has the shape (11, 255), but needs (11, 256), frames by samples"),
    "scenario": (with_array(np.zeros((11, 256), complex), "cube"), "the array of scenario 'trihedral 15 cm' is missing"),
    "not finite": (with_array(np.full((11, 256), np.nan + 0j)), "samples that are not finite numbers; give finite complex samples"),
    "start frequency": (edited(lambda near: near["frequencies"].update(start_hz=76e9)), "the frequency grid is 256 samples"),
    "step": (edited(lambda near: near["frequencies"].update(step_hz=13.4e6)), GRID),
    "nan step": (edited(lambda near: near["frequencies"].update(step_hz=float("nan"))), GRID),
    "samples": (edited(lambda near: near["frequencies"].update(samples=64)), GRID),
    "huge samples": (edited(lambda near: near["frequencies"].update(samples=10**400)), "the frequency grid is inf samples"),
    "no grid": (edited(lambda near: near.pop("frequencies")), "'frequencies' must hold the numbers start_hz, step_hz, samples"),
    "checksum": (lambda f: (f / "near.npz").write_bytes((f / "near.npz").read_bytes() + b" "), "has the SHA-256 checksum"),
    "no checksum": (edited(lambda near: near.pop("sha256")), "has the SHA-256 checksum"),
    "seconds": (edited(lambda near: near.update(seconds_per_frame=0)), "seconds_per_frame is 0"),
    "huge seconds": (edited(lambda near: near.update(seconds_per_frame=10**400)), "seconds_per_frame is inf"),
    "file": (lambda f: (f / "near.npz").unlink(), "near.npz: no such file"),
    "escape": (edited(lambda near: near.update(file="../near.npz")), "'../near.npz' outside this folder"),
    "json": (with_description(lambda text: "{"), "is no JSON"),
    "format": (with_description(lambda text: "[]"), "'format' must be"),
    "version": (
        with_description(lambda text: text.replace('"answers_version": "', '"answers_version": "0')),
        "run the method on the problems of this version",
    ),
    "absent": (lambda f: (f / "method.json").unlink(), "method.json: no such file"),
    "two lines": (lambda f: named(f, "my\nsolver"), "'method' must be a text of printable characters on one line"),
    "escape code": (lambda f: named(f, "my \x1b[31msolver"), "'method' must be a text of printable characters on one line"),
    "no name": (lambda f: named(f, " "), "'method' must be the name of the method"),
    "shipped method": (lambda f: named(f, "ours"), "the name 'ours' belongs to a shipped method or an installed simulator"),
    "simulator": (lambda f: named(f, "mitsuba"), "the name 'mitsuba' belongs to a shipped method or an installed simulator"),
}


@pytest.mark.parametrize("fault", WRONG)
def test_wrong_folder_is_one_line(fault: str, folder: Path, tmp_path: Path, inside: Callable) -> None:
    spoil, message = WRONG[fault]
    spoil(folder)
    done = inside("benchmark", "--method", folder, "--output", tmp_path / "out")
    assert (done.returncode, len(done.stderr.splitlines())) == (2, 1)
    assert message in done.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--method", "nothing"], "--method nothing is neither a folder nor a method"),
        (["--problem", "far"], "problem 'far' is not known"),
        (["--method", "no/folder"], "no/folder/method.json: no such file"),
        (
            ["--method", "points", "--method", "mine", "--problem", "canonical"],
            "has none of the chosen problems; choose --problem from near",
        ),
    ],
)
def test_a_wrong_choice_is_refused_before_any_method_runs(
    words: list[str], message: str, folder: Path, inside: Callable, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(entrants, "solve", lambda *_: pytest.fail("a method ran"))
    done = inside("benchmark", *words)
    assert (done.returncode, len(done.stderr.splitlines())) == (2, 1)
    assert message in done.stderr


def test_a_foreign_leaderboard_is_kept(tmp_path: Path, inside: Callable) -> None:
    path = tmp_path / "out" / "benchmark" / "leaderboard.csv"
    path.parent.mkdir(parents=True)
    path.write_text("name,score\nme,1\n")
    done = inside("benchmark", "--method", "points", "--problem", "near", "--output", tmp_path / "out")
    assert (done.returncode, path.read_text()) == (2, "name,score\nme,1\n")


BOTH = {name: quiet_signals(name) for name in ("near", "furnished_drive")}


@pytest.mark.parametrize(
    ("signals", "seconds", "machine", "message"),
    [
        ({"near": {"trihedral 15 cm": np.zeros(3, complex)}}, {"near": 1.0}, "", "has the shape"),
        ({}, {}, "a\ndesk", "'machine' must be a text of printable characters"),
        (BOTH, {"near": 1.0}, "", "mine: problem furnished_drive has no entry in seconds_per_frame"),
        (BOTH, {"near": 1.0, "furnished_drive": 0.0}, "", "problem furnished_drive: seconds_per_frame is 0.0"),
        (BOTH, {"near": 1.0, "furnished_drive": 10**400}, "", "problem furnished_drive: seconds_per_frame is inf"),
    ],
    ids=["shape", "machine", "absent", "zero", "huge"],
)
def test_write_checks_everything_before_it_writes(signals, seconds, machine: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=message):
        entry_folder.write(tmp_path / "mine", "mine", signals, seconds, machine)
    assert not (tmp_path / "mine" / entry_folder.DESCRIPTION).exists()


def named(folder: Path, method: str) -> Path:
    described = json.loads((folder / entry_folder.DESCRIPTION).read_text())
    (folder / entry_folder.DESCRIPTION).write_text(json.dumps({**described, "method": method}))
    return folder


def test_a_known_name_wins_over_a_folder_and_repetitions_count_once(folder: Path, tmp_path: Path, inside: Callable) -> None:
    folder.rename(tmp_path / "points")  # the command runs in tmp_path
    done = inside("benchmark", *2 * ["--method", "points", "--method", "./points", "--problem", "near"])
    assert done.returncode == 0, done.stderr
    assert [row["method"] for row in rows(tmp_path / "outputs")] == ["points", "my solver"]


def test_two_runs_on_one_leaderboard_keep_the_rows_of_both(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """While the first run solves its problem, a second run writes its rows."""
    output = tmp_path / "out"

    def solve(method: entrants.Method, problem: frozen_problems.Problem) -> tuple[dict[str, np.ndarray], float]:
        benchmark(output, [str(folder)], ["near"], lambda line: None)
        return quiet_signals(problem.name, 0.9), 1.0

    monkeypatch.setattr(entrants, "solve", solve)
    _, board = benchmark(output, ["points"], ["near"], lambda line: None)
    assert [row["method"] for row in rows(output)] == [row["method"] for row in board] == ["my solver", "points"]
    assert [path.name for path in (output / "benchmark").iterdir()] == ["leaderboard.csv"]


def test_a_run_waits_while_another_run_writes_the_leaderboard(folder: Path, tmp_path: Path) -> None:
    path = tmp_path / "out" / "benchmark" / "leaderboard.csv"
    runner = threading.Thread(target=benchmark, args=(tmp_path / "out", [str(folder)], ["near"], lambda line: None))
    with files.lock(path.with_name(f".{path.name}.lock")):
        runner.start()
        runner.join(1.0)  # the run needs a few milliseconds without the lock
        assert runner.is_alive()
        assert not path.exists()
    runner.join(30)
    assert [row["method"] for row in rows(tmp_path / "out")] == ["my solver"]


def test_tutorial_enters_a_method_as_printed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The page docs/benchmark.md enters a method. The test runs its program and the command that scores the folder."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    page = blocks(DOCS / "benchmark.md")
    try:
        assert follow(page, tmp_path, lambda words: words if words[1:] == ["--method", "mine"] else None) == 1
    finally:
        sys.modules.pop("enter", None)
    board = rows(tmp_path / "outputs")
    assert [row["problem"] for row in board] == frozen_problems.names()
    assert {row["method"] for row in board} == {"centres"}
