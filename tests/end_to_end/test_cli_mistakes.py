"""A mistake on the command line is one line on standard error and status 2, wherever it is found."""

from __future__ import annotations

import warnings
from pathlib import Path

import pytest

from radartwin import cli
from radartwin.errors import RecordingError
from radartwin.radar.captures import capture_name

LONG = "n" * 300  # longer than a file name may be

MISTAKES = {
    "no verb": ([], "VERB"),
    "an unknown verb": (["simulat"], "simulat"),
    "an unknown option": (["doctor", "--colour"], "--colour"),
    "a port beyond the last": (["dashboard", "--port", "70000"], "70000"),
    "a port that is a word": (["dashboard", "--port", "http"], "http"),
    "a recording without a name": (["process", "."], "names no recording"),
    "a recording with a name too long": (["process", LONG], "too long"),
    "a recording to the folder itself": (["simulate", "scene=plate", "--out", "."], "names no recording"),
    "a recording to nowhere": (["simulate", "scene=plate", "--out", ""], "names no recording"),
    "a recording to the root": (["simulate", "scene=plate", "--out", "/"], "names no recording"),
    "a recording to a name too long": (["simulate", "scene=plate", "--out", LONG], "too long"),
    "a scene with a name too long": (["view", LONG], "too long"),
    "a scan with a name too long": (["reconstruct", f"{LONG}.ply", "--out", "out"], "too long"),
    "an axis nobody knows": (["reconstruct", "scan.ply", "--up", "-q", "--out", "out"], "--up"),
    "an axis that a mesh cannot have": (["reconstruct", "scan.ply", "--up=up", "--out", "out"], "-x, -y, -z"),
    "a depth unit for a mesh": (["reconstruct", "scan.ply", "--depth-unit", "0.001", "--out", "out"], "--depth-unit is only read for"),
    "intrinsics for a mesh": (["reconstruct", "scan.ply", "--intrinsics", "1", "1", "1", "1", "--out", "o"], "--intrinsics is only read"),
    "a depth model for a mesh": (["reconstruct", "scan.ply", "--depth-model", "w", "--out", "out"], "--depth-model is only read"),
    "poses for a mesh": (["reconstruct", "scan.ply", "--poses", "opengl", "--out", "out"], "--poses is only read"),
    "a unit nobody uses": (["reconstruct", "scan.ply", "--unit", "furlong", "--out", "out"], "in, ft"),
}


@pytest.mark.parametrize(("arguments", "word"), MISTAKES.values(), ids=MISTAKES)
def test_a_mistake_is_one_line_and_status_2(
    arguments: list[str], word: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    try:
        status = cli.main(arguments)
    except SystemExit as stopped:  # argparse
        status = stopped.code
    said = capsys.readouterr().err
    assert status == 2
    assert said.count("\n") == 1
    assert word in said


def test_a_negative_axis_is_taken_in_either_form() -> None:
    for words in (["--up", "-y"], ["--up=-y"]):
        assert cli._parse(["reconstruct", "scan.ply", "--out", "out", *words]).up == "-y"


@pytest.mark.parametrize(("verb", "words"), [("reconstruct", "starts over"), ("label", "resumes where it stopped")])
def test_an_interruption_says_what_the_same_command_does(
    verb: str, words: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(_: object) -> int:
        raise KeyboardInterrupt

    monkeypatch.setattr(cli, f"_{verb}", interrupted)
    monkeypatch.setattr(cli.signal, "signal", lambda *_: None)
    assert cli.main([verb, "scan.ply", *(["--out", "out"] if verb == "reconstruct" else [])]) == 1
    assert words in capsys.readouterr().err


def test_an_error_that_is_not_about_a_path_keeps_its_traceback(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_: object) -> int:
        raise OSError(5, "the device is on fire")

    monkeypatch.setattr(cli, "_doctor", fail)
    with pytest.raises(OSError, match="on fire"):
        cli.main(["doctor"])


def test_a_warning_is_one_line(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    def warn(_: object) -> int:
        warnings.simplefilter("default")
        warnings.warn("glass stands in\nfor ice", stacklevel=1)
        return 0

    monkeypatch.setattr(cli, "_doctor", warn)
    assert cli.main(["doctor"]) == 0
    assert capsys.readouterr().err == "radartwin: warning: glass stands in for ice\n"


def test_recordings_that_share_the_first_word_of_their_name_keep_their_results_apart() -> None:
    names = ("r.1.bin", "r.2.bin", "r.2.npy", "a/r.json", "r.5m", "..hid.bin", ".bin")
    assert [capture_name(name) for name in names] == ["r.1", "r.2", "r.2", "r", "r.5m", "..hid", ".bin"]
    for nameless in ("", ".", "..", "/", "..bin"):
        with pytest.raises(RecordingError, match="names no recording"):
            capture_name(nameless)
