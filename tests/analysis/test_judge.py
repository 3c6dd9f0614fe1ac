"""The verdicts of the committed tables follow from the columns of their rows; a wrong verdict is named with its line."""

from __future__ import annotations

from pathlib import Path

import pytest

from analysis import judge
from analysis.pages.template import RESULTS

HEAD = "claim,bound,direction,null,margin,reason,limit,value,low,high,verdict\n"
ROWS = {
    "c,0.2,above,0.0,,,,0.3,0.1,0.5,direction shown\n": "direction shown",
    "c,0.2,above,0.0,,,,0.3,0.25,,supported\n": "supported",
    "c,0.1,none,0.1,0.05,no room,,0.3,0.25,0.4,not testable here\n": "not testable here",
    "c,1.0,below,1.0,,,,0.3,0.2,1.1,misses\n": "misses",
    "c,,,,,made again in 1.1,,0.3,0.2,1.1,\n": "",
    "c,,,,,,>= 0.9,0.95,0.91,1.0,holds\n": "holds",
    "c,,,,,,low <= 0.9,0.95,0.91,1.0,misses\n": "misses",
    "c,,,,,,1.5,1.0,,,holds\n": "holds",
}


@pytest.mark.parametrize("folder", [RESULTS, RESULTS / "registered", RESULTS / "draws_0_to_9"])
def test_the_committed_verdicts_follow_from_their_rows(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert judge.main([str(folder)]) == 0
    assert "supported" in capsys.readouterr().out


def test_a_wrong_verdict_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "t.csv").write_text(HEAD + "".join(ROWS))
    assert judge.main([str(tmp_path)]) == 0
    capsys.readouterr()
    (tmp_path / "t.csv").write_text((HEAD + "".join(ROWS)).replace("direction shown", "supported"))
    assert judge.main([str(tmp_path)]) == 1
    assert "t.csv:2: the verdict is 'supported', but its columns say 'direction shown'" in capsys.readouterr().out


def test_a_share_outside_its_limits_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    head = HEAD.replace("reason", "lowest,highest,reason")
    for low, status in (("0.0", 0), ("-0.1", 1)):
        (tmp_path / "t.csv").write_text(f"{head}c,0.2,above,0.0,,0.0,1.0,,,0.1,{low},0.3,undecided\n")
        assert judge.main([str(tmp_path)]) == status
    assert "t.csv:2: value or interval lies outside the limits 0.0 to 1.0" in capsys.readouterr().out


def test_a_folder_without_tables_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert judge.main([str(tmp_path)]) == 2
    assert "holds no table" in capsys.readouterr().err
