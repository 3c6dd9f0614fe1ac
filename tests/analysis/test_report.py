"""Tests of the report's folder: the content of each table, HTML escaping, intact links, and equal bytes of a second report."""

from __future__ import annotations

import base64
import csv
import hashlib
import json
import re
import shutil
from collections import Counter
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
import pytest
import reported

from analysis import main, registry
from analysis.pages.template import ROOT, interval, number
from analysis.report import markup, origin
from analysis.report.content import Section
from experiments.positioning import positioning
from experiments.turntable import linear_rail
from radartwin.config.compose import compose
from radartwin.errors import InputError, MissingError
from radartwin.runs.experiment import Result

VOID = {"meta", "link", "img", "input", "br"}


class Read(HTMLParser):
    """Read the elements of an HTML page: unbalanced tags, ids, links, and the text of each section."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.ids: list[str] = []
        self.links: list[str] = []
        self.tags: Counter[str] = Counter()
        self.headings: list[int] = []
        self.within: list[str] = []
        self.said: dict[str, str] = {}
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        self.tags[tag] += 1
        self.ids += [given["id"] or ""] if "id" in given else []
        self.links += [value for key in ("href", "src") if (value := given.get(key))]
        if re.fullmatch("h[1-6]", tag):
            self.headings.append(int(tag[1]))
        assert not any(key.startswith("on") for key in given), f"{tag} has a handler: {given}"
        if tag not in VOID:
            self.open.append(tag)
            self.within += [given.get("id") or ""] if tag == "section" else []

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag
        if tag == "section":
            self.within.pop()

    def handle_data(self, data: str) -> None:
        for name in self.within:
            self.said[name] = self.said.get(name, "") + data


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    output = tmp_path_factory.mktemp("out")
    reported.write(output)
    return output


@pytest.fixture(scope="module")
def read(written: Path) -> Read:
    return Read((written / "report" / "index.html").read_text(encoding="utf-8"))


def test_page_is_well_formed_and_links_work_in_a_moved_folder(written: Path, read: Read, tmp_path: Path) -> None:
    moved = Path(shutil.copytree(written / "report", tmp_path / "elsewhere"))
    assert read.open == []
    assert len(read.ids) == len(set(read.ids))
    for link in read.links:
        if link.startswith("#"):
            assert link[1:] in read.ids
        elif not link.startswith("data:"):
            assert (moved / unquote(link)).is_file(), link
    linked = {unquote(link) for link in read.links}
    held = {path.relative_to(moved).as_posix() for path in moved.rglob("*") if path.is_file()} - {"index.html"}
    assert held <= linked, "a file that nothing links to"
    assert max(np.diff(read.headings)) <= 1, "a level of heading is skipped"


def test_every_table_is_present_or_named_missing_stale_or_failed(read: Read) -> None:
    for name in registry.of_profile("quick"):
        assert registry.table(name).title in read.said[name]
    assert "stale" in read.said["stability"]
    assert "radartwin tables --profile paper --only stability" in read.said["stability"]
    assert "an old figure" not in "".join(read.said.values())
    assert "failed" in read.said["positioning"]
    assert "RuntimeError: a cell" in read.said["positioning"]
    assert "not run" in read.said["validation"]
    index = read.said["tables"]
    assert "failed: Capabilities of RadarTwin and other systems (RuntimeError" in index
    assert "stale: Where methods fail" in index
    assert "not run: Comparison with real measurements, Checks of the tracer" in " ".join(index.split())


def test_answer_follows_from_the_headline() -> None:
    with (ROOT / "docs" / "results" / "headline.csv").open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    text = markup.answer(rows)
    known = next(row for row in rows if row["table"] == "rover_recognition")
    assert len(re.split(r"(?<=[a-z])\. ", text)) == 2, "it has two sentences"
    assert f"accuracy of {interval(known)}, where chance is {number(known['null'])}" in text
    assert f"that it knows more than chance is {known['verdict']}." in text
    for verdict, count in Counter(row["verdict"] for row in rows).items():
        assert re.search(rf"\b{count} (are )?{verdict or markup.NO_VERDICT}", text)
    changed = [{**row, "verdict": "supported"} if row["claim of the paper"].startswith("labelled") else row for row in rows]
    assert "that the labelled materials help is supported, and that the room helps is not testable here." in markup.answer(changed)
    assert markup.answer([row for row in rows if row["table"] != "reconstruction_ablation"]) == ""


def test_hostile_text_is_escaped(written: Path, read: Read) -> None:
    text = (written / "report" / "index.html").read_text(encoding="utf-8")
    assert read.tags["script"] == 1
    assert "<img src=x" not in text
    assert text.count("{{") == text.count("{{script}}"), "a part of the template was left unfilled"
    assert read.said["environment"].count(reported.HOSTILE) == 6  # room, claim, metric, paper, and the two that describe the case
    assert reported.HOSTILE in read.said["positioning"]


def test_content_policy_allows_only_the_pages_own_script(written: Path) -> None:
    text = (written / "report" / "index.html").read_text(encoding="utf-8")
    (script,) = re.findall(r"<script>(.*?)</script>", text, re.DOTALL)
    (allowed,) = re.findall(r"script-src 'sha256-([^']+)'", text)
    assert base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() == allowed


def test_second_report_has_equal_bytes_and_removes_leftovers(written: Path, tmp_path: Path) -> None:
    output = Path(shutil.copytree(written, tmp_path / "out"))

    def files() -> dict[str, bytes]:
        return {path.relative_to(output).as_posix(): path.read_bytes() for path in (output / "report").rglob("*") if path.is_file()}

    first = files()
    (output / "report" / "figures" / "old.png").write_bytes(b"of an earlier report")
    (output / "report" / "notes.txt").write_text("the user's own")
    (output / "report" / "figures" / "environment_curve.png").write_bytes(b"touched")
    reported.report(output)
    assert files() == {**first, "report/notes.txt": b"the user's own"}
    main.write(registry.table("environment"), Result("environment", reported.rows(), {}, run_key=reported.KEY), "quick", output)
    reported.report(output)
    assert not any("environment_" in name for name in files() if "/figures/" in name)


def test_missing_figure_is_named_and_the_old_report_stays(written: Path, tmp_path: Path) -> None:
    output = Path(shutil.copytree(written, tmp_path / "out"))
    before = (output / "report" / "index.html").read_bytes()
    (output / "figures" / "environment_curve.pdf").unlink()
    with pytest.raises(MissingError, match=r"environment_curve\.pdf is missing.*--only environment"):
        reported.report(output)
    assert (output / "report" / "index.html").read_bytes() == before
    assert [path.name for path in (output / "report").iterdir() if path.name.startswith(".")] == []


@pytest.mark.parametrize("text", ["room,claim\nlab,x\n", None, b"\xff\xfe\x00"])
def test_damaged_csv_is_named(written: Path, tmp_path: Path, text: str | bytes | None) -> None:
    output = Path(shutil.copytree(written, tmp_path / "out"))
    path = output / "tables" / "environment.csv"
    broken = path.read_text().replace("supported", "perhaps") if text is None else text
    path.write_bytes(broken if isinstance(broken, bytes) else broken.encode())
    with pytest.raises(MissingError, match=r"environment\.csv is missing or damaged"):
        reported.report(output)


def test_run_times_and_seed_come_from_the_cache(tmp_path: Path) -> None:
    for name, key in (("environment", reported.KEY), ("scan", reported.OLD_KEY)):
        path = tmp_path / "cache" / "run" / key
        path.mkdir(parents=True)
        (path / "meta.json").write_text(json.dumps({"core_seconds": 2.0, "spec": {"config": {"seed": 7}}, "finished": f"of {name}"}))
    sections = [
        Section(registry.table(name), tmp_path, "quick", key) for name, key in (("environment", reported.KEY), ("scan", reported.OLD_KEY))
    ]
    origins = origin.of(sections, tmp_path)
    assert [(run.seed, run.finished) for run in origins.runs] == [(7, "of environment"), (7, "of scan")]
    assert origins.core_seconds == 2 + 2
    assert "no mlflow.db" in origins.tracking
    (tmp_path / "mlflow.db").write_bytes(b"not a database, but long enough to be read as one" * 100)
    assert "cannot be read" in origin.of(sections, tmp_path).tracking
    (cleared,) = origin.of([Section(registry.table("environment"), tmp_path, "quick", "../../etc")], tmp_path).runs
    assert (cleared.seed, cleared.core_seconds, cleared.mlflow) == (None, None, "")


def test_failed_run_loses_only_its_own_table(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    def broken(*_: Any) -> Result:
        raise ArithmeticError("the solver broke\nfor good")

    monkeypatch.setattr(main, "compose", lambda overrides: compose([*overrides, "tracking=off"]))
    monkeypatch.setattr(positioning, "run", lambda *_: Result("positioning", [reported.row()], {}))
    monkeypatch.setattr(linear_rail, "run", broken)
    monkeypatch.setattr(linear_rail, "recordings", lambda *_: {})
    assert main.tables("quick", ["linear_rail", "positioning"], tmp_path) == 1
    said = capsys.readouterr()
    assert said.out.splitlines()[-1].startswith("tables: 1 written, simulated 0, reused 0, scored 1; report: ")
    assert "failed: linear_rail" in said.out.splitlines()
    assert "Traceback" in said.err
    read = Read((tmp_path / "report" / "index.html").read_text(encoding="utf-8"))
    assert "failed: The run ended with an error: ArithmeticError: the solver broke for good" in read.said["linear_rail"]
    assert "closer than 3 dB" in read.said["positioning"]
    monkeypatch.setattr(linear_rail, "run", lambda *_: Result("linear_rail", [reported.row()], {}))
    assert main.tables("quick", ["linear_rail"], tmp_path) == 0
    read = Read((tmp_path / "report" / "index.html").read_text(encoding="utf-8"))
    assert "failed" not in read.said["linear_rail"]
    assert json.loads((tmp_path / "tables" / "failures.json").read_text()) == {}


def test_user_error_stops_the_tables(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def refused(*_: Any) -> Result:
        raise InputError("nothing to measure")

    monkeypatch.setattr(main, "compose", lambda overrides: compose([*overrides, "tracking=off"]))
    monkeypatch.setattr(linear_rail, "run", refused)
    monkeypatch.setattr(linear_rail, "recordings", lambda *_: {})
    with pytest.raises(InputError, match="nothing to measure"):
        main.tables("quick", ["linear_rail", "positioning"], tmp_path)
    assert not (tmp_path / "tables" / "failures.json").exists()
