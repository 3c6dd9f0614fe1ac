"""A mistake on the command line is one line on standard error and exit status 2."""

from __future__ import annotations

import signal
import warnings
from pathlib import Path

import pytest

from radartwin import cli
from radartwin.commands import verbs
from radartwin.commands.arguments import parse
from radartwin.errors import RecordingError
from radartwin.radar.captures import capture_name

LONG = "n" * 300  # longer than file systems allow

MISTAKES = {
    "no verb": ([], "VERB"),
    "unknown verb": (["simulat"], "simulat"),
    "unknown option": (["doctor", "--colour"], "--colour"),
    "port above 65535": (["dashboard", "--port", "70000"], "70000"),
    "port that is no number": (["dashboard", "--port", "http"], "http"),
    "recording without a name": (["process", "."], "names no recording"),
    "recording with a name too long": (["process", LONG], "too long"),
    "output to the folder itself": (["simulate", "scene=plate", "--out", "."], "names no recording"),
    "output to an empty path": (["simulate", "scene=plate", "--out", ""], "names no recording"),
    "output to the root folder": (["simulate", "scene=plate", "--out", "/"], "names no recording"),
    "output to a name too long": (["simulate", "scene=plate", "--out", LONG], "too long"),
    "scene with a name too long": (["view", LONG], "too long"),
    "scan with a name too long": (["reconstruct", f"{LONG}.ply", "--out", "out"], "too long"),
    "unknown axis": (["reconstruct", "scan.ply", "--up", "-q", "--out", "out"], "--up"),
    "axis of another kind": (["reconstruct", "scan.ply", "--up=up", "--out", "out"], "-x, -y, -z"),
    "depth unit for a mesh": (["reconstruct", "scan.ply", "--depth-unit", "0.001", "--out", "out"], "--depth-unit applies only"),
    "intrinsics for a mesh": (["reconstruct", "scan.ply", "--intrinsics", "1", "1", "1", "1", "--out", "o"], "--intrinsics applies only"),
    "depth model for a mesh": (["reconstruct", "scan.ply", "--depth-model", "w", "--out", "out"], "--depth-model applies only"),
    "poses for a mesh": (["reconstruct", "scan.ply", "--poses", "opengl", "--out", "out"], "--poses applies only"),
    "unknown unit": (["reconstruct", "scan.ply", "--unit", "furlong", "--out", "out"], "in, ft"),
}


@pytest.mark.parametrize(("arguments", "word"), MISTAKES.values(), ids=MISTAKES)
def test_mistake_is_one_line_and_status_2(
    arguments: list[str], word: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.chdir(tmp_path)
    try:
        status = cli.main(arguments)
    except SystemExit as stopped:  # argparse
        status = stopped.code
    printed = capsys.readouterr().err
    assert status == 2
    assert printed.count("\n") == 1
    assert word in printed


def test_negative_axis_is_accepted_with_and_without_an_equals_sign() -> None:
    for words in (["--up", "-y"], ["--up=-y"]):
        assert parse(["reconstruct", "scan.ply", "--out", "out", *words]).up == "-y"


@pytest.mark.parametrize(("verb", "words"), [("reconstruct", "starts over"), ("label", "resumes where it stopped")])
def test_interruption_prints_whether_the_same_command_resumes(
    verb: str, words: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupted(_: object) -> int:
        raise KeyboardInterrupt

    monkeypatch.setattr(verbs, verb, interrupted)
    monkeypatch.setattr(signal, "signal", lambda *_: None)
    assert cli.main([verb, "scan.ply", *(["--out", "out"] if verb == "reconstruct" else [])]) == 1
    assert words in capsys.readouterr().err


def test_os_error_without_a_path_keeps_its_traceback(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_: object) -> int:
        raise OSError(5, "the device is on fire")

    monkeypatch.setattr(verbs, "doctor", fail)
    with pytest.raises(OSError, match="on fire"):
        cli.main(["doctor"])


def test_warning_is_one_line(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    def warn(_: object) -> int:
        warnings.simplefilter("default")
        warnings.warn("glass stands in\nfor ice", stacklevel=1)
        return 0

    monkeypatch.setattr(verbs, "doctor", warn)
    assert cli.main(["doctor"]) == 0
    assert capsys.readouterr().err == "radartwin: warning: glass stands in for ice\n"


def test_results_of_captures_with_dots_in_their_names_stay_apart() -> None:
    names = ("r.1.bin", "r.2.bin", "r.2.npy", "a/r.json", "r.5m", "..hid.bin", ".bin")
    assert [capture_name(name) for name in names] == ["r.1", "r.2", "r.2", "r", "r.5m", "..hid", ".bin"]
    for nameless in ("", ".", "..", "/", "..bin"):
        with pytest.raises(RecordingError, match="names no recording"):
            capture_name(nameless)
