"""A mistake on the command line gives one line on standard error and exit status 2, and leaves no file behind."""

from __future__ import annotations

import warnings
from pathlib import Path

import pytest

from radartwin import cli
from radartwin.commands import verbs
from radartwin.commands.arguments import parse
from radartwin.errors import RecordingError
from radartwin.radar.captures import capture_name

LONG = "n" * 300  # file name that is longer than file systems allow
INTERVAL = "trajectory.height_m=interval(1,2)"
SEARCH = ["run", "experiment=environment", "--search", "peak"]
SECRET = "s3cr3t-w0rd-of-the-test"

MISTAKES = {
    "no verb": ([], "VERB"),
    "unknown verb": (["simulat"], "simulat"),
    "unknown option": (["doctor", "--colour"], "--colour"),
    "unknown option of a verb with overrides": (["run", "experiment=environment", "--unknown"], "--unknown"),
    "override after an option": (["run", "experiment=environment", "-m", "materials=cheese"], "materials=cheese is not an option"),
    "no experiment": (["run"], "experiment=NAME"),
    "unknown value in a sweep": (["run", "experiment=environment", "-m", "scene=lab,labb"], "scene=labb"),
    "interval in a sweep": (["run", "experiment=environment", "-m", INTERVAL], "search the interval with --search"),
    "unknown table": (["tables", "--only", "nonsense"], "nonsense"),
    "report without tables": (["report"], "run radartwin tables first"),
    "search without an interval": ([*SEARCH, "seed=1"], "interval"),
    "search over an unknown key": ([*SEARCH, "trajectory.heigth_m=interval(1,2)"], "did you mean height_m"),
    "search without a trial": ([*SEARCH, "--trials", "0", INTERVAL], "--trials 0"),
    "search in a sweep": ([*SEARCH, "-m", INTERVAL], "leave -m out"),
    "trials without a search": (["run", "experiment=environment", "--trials", "40"], "--trials applies only to a search"),
    "parallel trials without a search": (["run", "experiment=environment", "--at-once", "4"], "--at-once applies only to a search"),
    "option that simulate does not read": (["simulate", "scene=plate", "measured.gap.person=3"], "does not read measured.gap.person"),
    "experiment for simulate": (["simulate", "experiment=growth"], "simulate does not read experiment"),
    "server option without a server": (["label", "scene", "--concurrency", "8"], "--concurrency applies only to --provider server"),
    "address without a server": (["label", "scene", "--url", "http://127.0.0.1:9/v1"], "--url applies only to --provider server"),
    "provider of exported questions": (["label", "scene", "--export", "q", "--provider", "server"], "leave --provider out"),
    "dashboard of an absent folder": (["dashboard", "--output", "nowhere"], "nowhere"),
    "dashboard of a folder without runs": (["dashboard", "--output", "."], "no run is tracked in this folder"),
    "configuration of a sweep": (["run", "experiment=environment", "-m", "--cfg", "job"], "leave -m out"),
    "port above 65535": (["dashboard", "--port", "70000"], "70000"),
    "port that is no number": (["dashboard", "--port", "http"], "http"),
    "tolerance of zero": (["simulate", "simulator=auto", "simulator.tolerance=0"], "simulator.tolerance=0 must be above zero"),
    "absent scan": (["simulate", "scene=scan", "scene.path=absent.glb"], "absent.glb"),
    "file as a folder": (["simulate", "scene=plate", "trajectory=static", "output=file/below"], "file"),
    "demonstration into a file": (["demo", "--output", "file"], "is not a folder; choose another place"),
    "demonstration below a file": (["demo", "--output", "file/below"], "is not a folder; choose another place"),
    "folder without a scene to label": (["label", "."], "is not a scene folder"),
    "unknown material": (["simulate", "trajectory=static", "materials.material=cheese", "scene=lab"], "cheese"),
    "output to the folder itself": (["simulate", "scene=plate", "--out", "."], "names no recording"),
    "output to an empty path": (["simulate", "scene=plate", "--out", ""], "names no recording"),
    "output to the root folder": (["simulate", "scene=plate", "--out", "/"], "names no recording"),
    "output to a name too long": (["simulate", "scene=plate", "--out", LONG], "too long"),
    "absent recording": (["process", "absent"], "absent"),
    "recording without a name": (["process", "."], "names no recording"),
    "recording with a name too long": (["process", LONG], "too long"),
    "unknown angle method": (["process", "file", "--angle", "esprit"], "bartlett"),
    "removed verb": (["clean", "--cache"], "delete the folder outputs/cache"),
    "absent recording set": (["doctor", "--data", "nowhere"], "nowhere"),
    "absent capture": (["import", "nowhere.bin", "--out", "set"], "nowhere.bin"),
    "description without a key": (["import", ".", "--out", "set", "mug"], "KEY=VALUE"),
    "absent mapping": (["import", ".", "--out", "set", "--map", "map.yaml"], "map.yaml"),
    "no set to import into": (["import", "."], "--out"),
    "scene with a name too long": (["view", LONG], "too long"),
    "scan with a name too long": (["reconstruct", f"{LONG}.ply", "--out", "out"], "too long"),
    "unknown axis": (["reconstruct", "scan.ply", "--up", "-q", "--out", "out"], "--up"),
    "axis of another kind": (["reconstruct", "scan.ply", "--up=up", "--out", "out"], "-x, -y, -z"),
    "depth unit for a mesh": (["reconstruct", "scan.ply", "--depth-unit", "0.001", "--out", "out"], "--depth-unit applies only"),
    "intrinsics for a mesh": (["reconstruct", "scan.ply", "--intrinsics", "1", "1", "1", "1", "--out", "o"], "--intrinsics applies only"),
    "depth model for a mesh": (["reconstruct", "scan.ply", "--depth-model", "w", "--out", "out"], "--depth-model applies only"),
    "poses for a mesh": (["reconstruct", "scan.ply", "--poses", "opengl", "--out", "out"], "--poses applies only"),
    "unknown unit": (["reconstruct", "scan.ply", "--unit", "furlong", "--out", "out"], "in, ft"),
    "password in tracking.uri": (
        ["run", "experiment=environment", f"tracking.uri=http://me:{SECRET}@127.0.0.1:9/v1"],
        "contains a user name or password",
    ),
    "password in --url": (["label", "scene", "--url", f"http://me:{SECRET}@127.0.0.1:9/v1"], "contains a user name or password"),
}


@pytest.mark.parametrize(("arguments", "word"), MISTAKES.values(), ids=MISTAKES)
def test_mistake_is_one_line_and_status_2(arguments: list[str], word: str, inside, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    done = inside(*arguments)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.count("\n") == 1
    assert done.stderr.startswith("radartwin")
    assert word in done.stderr
    assert SECRET not in done.stdout + done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.filterwarnings("ignore:The .*noload.* loader strategy")  # SQLAlchemy warns about a loader that mlflow uses
@pytest.mark.parametrize("seconds", ["x", "0", "nan"])
def test_a_wrong_interval_between_looks_at_the_slurm_queue_is_named_before_jobs_are_submitted(
    seconds: str, inside, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("RADARTWIN_SLURM_POLL", seconds)
    done = inside("run", "experiment=environment", "-m", "seed=0,1", "hydra/launcher=slurm")
    assert done.returncode == 2
    assert done.stderr == f"radartwin: RADARTWIN_SLURM_POLL={seconds} is not a number of seconds above zero; correct it or unset it\n"


def test_negative_axis_is_accepted_with_and_without_an_equals_sign() -> None:
    for words in (["--up", "-y"], ["--up=-y"]):
        assert parse(["reconstruct", "scan.ply", "--out", "out", *words]).up == "-y"


@pytest.mark.parametrize(("verb", "words"), [("reconstruct", "starts over"), ("label", "resumes where it stopped")])
def test_interruption_prints_whether_the_same_command_resumes(verb: str, words: str, inside, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupted(_: object) -> int:
        raise KeyboardInterrupt

    monkeypatch.setattr(verbs, verb, interrupted)
    done = inside(verb, "scan.ply", *(["--out", "out"] if verb == "reconstruct" else []))
    assert done.returncode == 130
    assert words in done.stderr


def test_os_error_without_a_path_keeps_its_traceback(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_: object) -> int:
        raise OSError(5, "the device is on fire")

    monkeypatch.setattr(verbs, "doctor", fail)
    with pytest.raises(OSError, match="on fire"):
        cli.main(["doctor"])


def test_warning_is_one_line(monkeypatch: pytest.MonkeyPatch, inside) -> None:
    def warn(_: object) -> int:
        warnings.simplefilter("default")
        warnings.warn("glass stands in\nfor ice", stacklevel=1)
        return 0

    monkeypatch.setattr(verbs, "doctor", warn)
    assert inside("doctor").stderr == "radartwin: warning: glass stands in for ice\n"


def test_results_of_captures_with_dots_in_their_names_stay_apart() -> None:
    names = ("r.1.bin", "r.2.bin", "r.2.npy", "a/r.json", "r.5m", "..hid.bin", ".bin")
    assert [capture_name(name) for name in names] == ["r.1", "r.2", "r.2", "r", "r.5m", "..hid", ".bin"]
    for nameless in ("", ".", "..", "/", "..bin"):
        with pytest.raises(RecordingError, match="names no recording"):
            capture_name(nameless)
