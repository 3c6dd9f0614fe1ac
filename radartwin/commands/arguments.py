"""Arguments of every verb (subcommand) of the command line."""

from __future__ import annotations

import argparse
import textwrap
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NoReturn

from radartwin.commands import examples, verbs
from radartwin.errors import MissingError

Verbs = argparse._SubParsersAction

# What each verb does, under the purpose for which a user needs it: the lines of `radartwin --help`, and the first line of a verb's help.
PURPOSES = {
    "My room": {
        "demo": "show all steps on a shipped phone scan, in two minutes",
        "reconstruct": "turn a scan (mesh or RGB-D frames) into a scene folder",
        "label": "name the materials of a scene by a vision-language model",
        "view": "show a scene as a 3D page; --live: drag the radar in it",
        "simulate": "simulate a radar recording (DCA1000 format) in a scene",
    },
    "My radar": {
        "process": "compute peaks, points and pictures of a recording or capture",
        "import": "add raw captures to a set of recordings",
        "export": "write a recording for Foxglove, or a set of virtual recordings",
    },
    "My objects": {
        "train": "train a recogniser of my objects on simulation alone",
        "classify": "name the object in a recording, with probabilities",
    },
    "The study": {
        "tables": "make the tables, figures and report of the paper's claims",
        "report": "write the report again from existing tables",
        "run": "compute one experiment, or a sweep with -m",
        "benchmark": "compare simulators on six problems with known answers",
        "dashboard": "show the runs in MLflow, on this machine only",
    },
    "This machine": {"doctor": "check this machine, or with --data a set of recordings"},
}


def parse(words: Sequence[str]) -> argparse.Namespace:
    """Parse the words of a command line. `verb` is the function to call, and `resumes` says whether the same command resumes its work.

    Configuration overrides may stand before and after an option such as -m: run experiment=NAME -m materials=vlm,void.
    """
    parser = _parser()
    options, rest = parser.parse_known_args(_join_axes(words))
    unknown = [word for word in rest if word.startswith("-") or not hasattr(options, "overrides")]
    if unknown:
        parser.error(f"unrecognized arguments: {' '.join(unknown)}")
    if rest:
        options.overrides += rest
    return options


class _Parser(argparse.ArgumentParser):
    """An argument parser that reports a wrong argument in one line instead of the full usage text."""

    def error(self, message: str) -> NoReturn:
        if "invalid choice: 'clean'" in message:
            message = "clean was removed after version 1.0; delete the folder outputs/cache"
        self.exit(2, f"{self.prog}: {message}; see {self.prog} --help\n")


def _join_axes(words: Sequence[str]) -> list[str]:
    """Rewrite the two words --up -y as --up=-y, because argparse would read -y as an option."""
    out: list[str] = []
    for word in words:
        if out and out[-1] == "--up" and word in ("-x", "-y", "-z"):
            out[-1] = f"--up={word}"
        else:
            out.append(word)
    return out


def _parser() -> argparse.ArgumentParser:
    purposes = (f"{title}\n" + "\n".join(f"  {verb:<13}{text}" for verb, text in verbs.items()) for title, verbs in PURPOSES.items())
    parser = _Parser(
        prog="radartwin",
        usage="radartwin VERB ...    (radartwin VERB --help: options and examples)",
        description="\n".join(["Simulate a radar in a scanned room, train on it, and test on measurements.\n", *purposes]),
        epilog="Exit status: 0 done, 1 a run failed, 2 the input is wrong.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        add_help=False,
    )
    parser.add_argument("-h", "--help", action="help", help=argparse.SUPPRESS)
    group = parser.add_subparsers(prog="radartwin", metavar="VERB", required=True, help=argparse.SUPPRESS)
    _add_study(group)
    _add_recordings(group)
    _add_scenes(group)
    _add_results(group)
    return parser


def _add_study(group: Verbs) -> None:
    _output(_add(group, "demo", verbs.demo))

    run = _add(group, "run", verbs.run, resumes=True)
    _overrides(run, "experiment=NAME [group=option ...] [key=value ...]")
    run.epilog = examples.epilog("run", textwrap.fill(f"Experiments: {', '.join(_experiments())}.", 78))
    run.add_argument("-m", "--multirun", action="store_true", help="sweep: materials=vlm,uniform,void runs three jobs")
    run.add_argument("--cfg", choices=("job",), help="print the composed configuration, and run nothing")
    run.add_argument("--search", metavar="METRIC", help="search for the best METRIC over 'trajectory.height_m=interval(0.5,1.5)'")
    run.add_argument("--trials", metavar="N", type=int, help="number of trials of a search (default: 20)")
    run.add_argument("--direction", choices=("maximize", "minimize"), help="direction of a search (default: maximize)")
    run.add_argument("--at-once", metavar="N", type=int, help="parallel trials, for hydra/launcher=joblib or slurm (default: 1)")

    tables = _add(group, "tables", verbs.tables, resumes=True)
    tables.add_argument("--profile", choices=("quick", "paper"), default="quick", help="amount of computation (default: quick)")
    tables.add_argument("--only", metavar="NAME", action="append", help="one table; repeat it for more")
    _output(tables)


def _add_recordings(group: Verbs) -> None:
    simulate = _add(group, "simulate", verbs.simulate)
    _overrides(simulate, "scene=lab|atrium|squash_court|void|empty|plate|scan [radar=...] [trajectory=...] [key=value ...]")
    simulate.add_argument("--out", metavar="PATH", type=Path, help="recording without suffix (default: OUTPUT/recordings/SCENE)")
    simulate.add_argument("--noise", action="store_true", help="add the receiver's thermal noise")

    process = _add(group, "process", verbs.process)
    _recording(process)
    process.add_argument("--moving", action="store_true", help="remove static echoes before the peaks are detected")
    angles = ("bartlett", "capon", "music")
    process.add_argument("--angle", choices=angles, default="bartlett", help="method for directions (default: bartlett)")
    process.add_argument("--out", metavar="FOLDER", type=Path, help="folder for the results (default: OUTPUT/processed/NAME)")
    _output(process)

    captures = _add(group, "import", verbs.import_captures, resumes=True)
    captures.add_argument("source", metavar="SOURCE", type=Path, help="a .bin, a .npy or .npz cube, a roverd trace, or a folder of them")
    captures.add_argument("overrides", nargs="*", metavar="KEY=VALUE", help="index columns of all captures, or card keys of a new set")
    captures.add_argument("--out", metavar="SET", type=Path, required=True, help="folder of the set; an existing set is extended")
    captures.add_argument("--map", metavar="FILE", type=Path, help=".yaml: the columns of each capture")
    _capture(captures)
    captures.add_argument("--frames", metavar="FIRST:END", type=_frames, default=slice(None), help="only these frames, such as 100:200")

    export = _add(group, "export", verbs.export, resumes=True)
    words = "with --mcap one RECORDING, as for process; with --out [profile=...] [profile.campaign.KEY=value ...] [key=value ...]"
    _overrides(export, words, metavar="RECORDING|OVERRIDE")
    use = export.add_mutually_exclusive_group(required=True)
    use.add_argument("--mcap", metavar="FILE", type=Path, help="write the timeline of RECORDING: maps, detections and poses of each frame")
    use.add_argument("--out", metavar="SET", type=Path, help="export the campaign to the set in this folder; recordings in it stay")
    export.add_argument("--pictures", metavar="FOLDER", type=Path, help="--mcap: pictures of a camera, named by seconds, such as 0.100.jpg")
    export.add_argument("--start", metavar="SECONDS", help="--mcap: time of the first frame in seconds since 1970 (default: 0)")
    _capture(export, prefix="--mcap: ")


def _add_scenes(group: Verbs) -> None:
    reconstruct = _add(group, "reconstruct", verbs.reconstruct)
    reconstruct.add_argument("scan", metavar="SCAN", type=Path, help="a .glb, .ply or .obj mesh, or a folder of RGB-D frames with poses")
    reconstruct.add_argument("--out", metavar="FOLDER", type=Path, required=True, help="folder of the new scene")
    reconstruct.add_argument("--material", default="plasterboard", help="material of every surface (default: plasterboard)")
    reconstruct.add_argument("--unit", default="auto", help="unit of a mesh: auto (metres), m, cm, mm, in or ft")
    reconstruct.add_argument("--up", default="auto", help="up axis of the scan: auto (found), x, y, z, -x, -y or -z")
    reconstruct.add_argument("--object", action=argparse.BooleanOptionalAction, help="the mesh is an object (default: yes below 1 m)")
    reconstruct.add_argument("--depth-model", metavar="WEIGHTS", help="monocular depth model, for frames without depth")
    matrix = "intrinsics of the depth pictures in pixels, for a folder without a camera file"
    reconstruct.add_argument("--intrinsics", metavar=("FX", "FY", "CX", "CY"), nargs=4, type=float, help=matrix)
    reconstruct.add_argument("--depth-unit", metavar="METRES", type=float, help="of a count (default: 0.001, for a TUM folder 0.0002)")
    reconstruct.add_argument("--poses", metavar="AXES", help="opencv (default), opengl, opencv-inverse or opengl-inverse")

    label = _add(group, "label", verbs.label, resumes=True)
    label.add_argument("scene", metavar="SCENE", type=Path, help="a scene folder; its manifest stores the labels")
    label.add_argument("--provider", choices=("recorded", "server", "local"), help="source of the answers (default: recorded)")
    label.add_argument("--model", help="model name; local: a folder or name that transformers loads; --import: the model that answered")
    label.add_argument("--url", help="server: OpenAI-compatible API (default: http://127.0.0.1:8000/v1); RADARTWIN_VLM_KEY is its key")
    batch = label.add_mutually_exclusive_group()
    batch.add_argument("--export", metavar="FOLDER", type=Path, help="write the questions and their pictures instead of asking")
    batch.add_argument("--import", metavar="FILE", type=Path, dest="answers", help="read the answers from a JSONL file")
    label.add_argument("--missing", metavar="uniform:MATERIAL", help="material of surfaces without an answer (default: an error)")
    label.add_argument("--views", type=int, help="pictures of each surface (default: 3)")
    label.add_argument("--concurrency", type=int, help="server: simultaneous requests (default: 4)")
    label.add_argument("--timeout", type=float, metavar="SECONDS", dest="timeout_s", help="server: limit for one request (default: 120)")

    view = _add(group, "view", verbs.view)
    view.add_argument("scene", metavar="SCENE", type=Path, help="a scene folder; the page needs no server and no network")
    colourings = ("material", "segment", "reflectivity", "colour")
    view.add_argument("--by", choices=colourings, default="material", help="initial colouring (default: material)")
    view.add_argument("--trajectory", metavar="FILE", type=Path, help="draw the radar's track: TUM or CSV text, or a ROS bag")
    view.add_argument("--layout", metavar="FILE", type=Path, help="add a layout's objects on this page")
    view.add_argument("--out", metavar="FILE", type=Path, help="file of the page (default: SCENE/view.html)")
    text = "serve a page on this machine in which you drag the radar and the objects; SCENE may also be lab, atrium or squash_court"
    view.add_argument("--live", action="store_true", help=text)
    view.add_argument("--port", type=_port, help="live: port of the server (default: 8080, or a free port if 8080 is taken)")
    view.add_argument("--radar", metavar="FILE", help="live: .cfg, .mmwave.json or .yaml, or the name of a radar option (default: iwr1843)")
    view.add_argument("--recording", metavar="FILE", type=Path, help="live: play this recording beside its simulation")


def _add_results(group: Verbs) -> None:
    classify = _add(group, "classify", verbs.classify)
    _recording(classify)
    classify.add_argument("--model", metavar="FOLDER", type=Path, required=True, help="model folder (model.json, model.safetensors)")
    classify.add_argument("--distance", metavar="METRES", type=float, help="radar to target at the start (default: estimated)")
    classify.add_argument("--period", metavar="SECONDS", type=float, help="duration of one revolution (default: that of the training)")

    train = _add(group, "train", verbs.train, resumes=True)
    train.add_argument("objects", metavar="OBJECTS", type=Path, help=".yaml: the objects with their meshes and materials")
    _overrides(train, "[radar=...] [trajectory.KEY=value ...] [supervision.KEY=value ...] [seed=N] [simulator=...] [key=value ...]")
    train.add_argument("--out", metavar="MODEL", type=Path, required=True, help="folder of the model; a model in it is replaced")
    train.add_argument("--room", metavar="SCENE", type=Path, help="scene folder with materials around the objects (default: free space)")
    metres = "distances from the radar to the axis of the turntable in metres (default: 0.5,1,1.5,2)"
    train.add_argument("--distances", metavar="D,D,...", type=_distances, default=(0.5, 1.0, 1.5, 2.0), help=metres)
    train.add_argument("--frames", metavar="N", type=int, help="frames per revolution, at least 13 (default: those of the radar)")

    compare = _add(group, "benchmark", verbs.benchmark)
    compare.add_argument("--method", metavar="NAME_OR_FOLDER", action="append", default=[], help="a simulator or a folder of signals")
    compare.add_argument("--problem", metavar="NAME", action="append", default=[], help="one problem; repeat it for more (default: all)")
    _output(compare)

    dashboard = _add(group, "dashboard", verbs.dashboard)
    dashboard.add_argument("--port", type=_port, help="port of the server (default: 5000, or a free port if 5000 is taken)")
    _output(dashboard)

    _output(_add(group, "report", verbs.report))

    doctor = _add(group, "doctor", verbs.doctor)
    doctor.add_argument("--data", metavar="FOLDER", type=Path, help="check this recording set instead and list all its faults")
    _output(doctor)


def _add(group: Verbs, name: str, function: Callable[[argparse.Namespace], int], resumes: bool = False) -> argparse.ArgumentParser:
    text = next(verbs[name] for verbs in PURPOSES.values() if name in verbs)
    verb = group.add_parser(
        name,
        description=textwrap.fill(text[0].upper() + text[1:] + ".", 78),
        epilog=examples.epilog(name),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    verb.set_defaults(verb=function, resumes=resumes)
    return verb


def _overrides(verb: argparse.ArgumentParser, text: str, metavar: str = "OVERRIDE") -> None:
    verb.add_argument("overrides", nargs="*", metavar=metavar, help=text)
    verb.add_argument("--config-dir", metavar="DIR", type=Path, action="append", default=[], help="folder with more configuration options")
    verb.add_argument("--output", metavar="DIR", help="root folder of all written files (the same as output=DIR)")


def _recording(verb: argparse.ArgumentParser) -> None:
    text = "a recording, a mmWave Studio .bin, a folder of a cascade's capture files, or a .npy or .npz cube"
    verb.add_argument("recording", metavar="RECORDING", type=Path, help=text)
    _capture(verb)


def _capture(verb: argparse.ArgumentParser, prefix: str = "") -> None:
    """Add the options that describe a capture of another tool (radartwin.radar.captures.load_capture)."""
    radar = ".cfg, .mmwave.json or .yaml of the radar that recorded it, or a radar option (default: the .mmwave.json beside a capture)"
    verb.add_argument("--radar", metavar="FILE", help=prefix + radar)
    verb.add_argument("--board", metavar="NAME", help=f"{prefix}board with the antennas, such as IWR6843AOP (default: of the radar file)")
    verb.add_argument("--iq-swapped", action=argparse.BooleanOptionalAction, help=f"{prefix}Q before I (default: found from the data)")
    verb.add_argument("--cut", action="store_true", help=prefix + "leave out an incomplete frame at the end of a capture")


def _output(verb: argparse.ArgumentParser) -> None:
    verb.add_argument("--output", metavar="DIR", type=Path, default=Path("outputs"), help="root folder of all written files")


def _port(text: str) -> int:
    if not (text.isdecimal() and int(text) <= 65535):
        raise argparse.ArgumentTypeError(f"{text!r} is not a port, a whole number from 0 to 65535")
    return int(text)


def _frames(text: str) -> slice:
    first, separator, end = text.partition(":")
    if not separator or not all(part == "" or part.isdecimal() for part in (first, end)) or (end and int(end) <= int(first or 0)):
        raise argparse.ArgumentTypeError(f"{text!r} is not FIRST:END; give two frame numbers, of which END is larger, such as 100:200")
    return slice(int(first) if first else None, int(end) if end else None)


def _distances(text: str) -> tuple[float, ...]:
    try:
        return tuple(float(word) for word in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a list of metres, such as 0.5,1,1.5,2") from None


def _experiments() -> list[str]:
    from radartwin.config.compose import groups

    try:
        return groups().get("experiment", [])
    except MissingError:  # a broken installation can still print its help
        return ["none found"]
