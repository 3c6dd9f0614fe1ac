"""A registration keeps the claims of a headline table; a changed file, and a claim without a test, are refused in one line."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

from experiments.gaps import registration

CLAIM = {
    "claim of the paper": "order is kept", "table": "t", "metric": "m", "bound": "0.0", "direction": "above", "null": "0.0", "margin": "",
    "test": "permutation", "unit": "objects", "verdict": "undecided",
}  # fmt: skip


def table(path: Path, *rows: dict) -> Path:
    with path.open("w", newline="") as stream:
        writer = csv.DictWriter(stream, list(CLAIM))
        writer.writeheader()
        writer.writerows({**CLAIM, **row} for row in rows)
    return path


def test_registered_claims_are_kept_and_compared(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    given = table(tmp_path / "h.csv", {}, {"claim of the paper": "other", "verdict": "not testable here"})
    file = str(tmp_path / "r.json")
    assert registration.main(["write", file, str(given)]) == 0
    content = json.loads(Path(file).read_text())
    assert (len(content["claims"]), content["claims"][0]["family"], content["draws"]["drives"]) == (1, "primary", [100, 102])
    assert registration.main(["check", file, str(given)]) == 0
    other = table(tmp_path / "o.csv", {"direction": "below"}, {"claim of the paper": "more"})
    assert registration.main(["check", file, str(other)]) == 1
    said = capsys.readouterr().out
    assert "'order is kept': direction 'below', registered 'above'" in said
    assert "'more' is not registered" in said


@pytest.mark.parametrize(
    ("change", "told"),
    [(lambda c: c["claims"][0].update(bound="0.1"), "the hash does not match"), (lambda c: c.pop("sha256"), "is no registration")],
)
def test_a_changed_file_is_refused_in_one_line(change, told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    given, file = table(tmp_path / "h.csv", {}), tmp_path / "r.json"
    registration.main(["write", str(file), str(given)])
    content = json.loads(file.read_text())
    change(content)
    file.write_text(json.dumps(content))
    assert registration.main(["check", str(file), str(given)]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert told in lines[0]


@pytest.mark.parametrize("name", ["test", "direction", "bound"])
def test_a_claim_without_a_test_is_refused(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    given = table(tmp_path / "h.csv", {name: ""})
    assert registration.main(["write", str(tmp_path / "r.json"), str(given)]) == 2
    assert capsys.readouterr().err.strip() == f"registration: the claim 'order is kept' has no {name}; make its table again"
    assert not (tmp_path / "r.json").exists()
