"""The command line: verbs and their arguments, nothing else. Each verb imports what it needs when it is called.

Exit status: 0 done, 1 a run failed, 2 the user's input is wrong (one line on standard error, no traceback).
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
import textwrap
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NoReturn

from radartwin.commands import examples
from radartwin.errors import MissingError, OutputError, UserError
from radartwin.io import secret

Verb = Callable[[argparse.Namespace], int]


def main(arguments: Sequence[str] | None = None) -> int:
    options = _parse(arguments)
    try:
        with warnings.catch_warnings():
            warnings.showwarning = _show_warning
            return options.verb(options)
    except UserError as error:
        print(f"radartwin: {_line(error)}", file=sys.stderr)
        return 2
    except MemoryError as error:
        said = f" ({_line(error)})" if str(error) else ""
        print(f"radartwin: out of memory{said}; what is finished is kept; ask for less, such as fewer frames or jobs=1", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        signal.signal(signal.SIGINT, lambda *_: os._exit(1))  # the impatient need not wait for what ends with the process
        goes_on = "resumes where it stopped" if options.verb in (_run, _tables, _import, _export, _label) else "starts over"
        print(f"radartwin: interrupted; the same command {goes_on}", file=sys.stderr)
        return 1
    except BrokenPipeError:  # the reader of a pipe has seen enough
        sys.stderr.close()
        return 0
    except OSError as error:
        if error.filename is None:  # no path of the user's: a defect
            raise
        print(f"radartwin: {_line(error.filename)}: {error.strerror}; choose another path", file=sys.stderr)
        return 2


def _show_warning(message: Warning | str, category: type[Warning], *_: Any, **__: Any) -> None:
    print(f"radartwin: warning: {_line(message)}", file=sys.stderr)


def _line(said: object) -> str:
    """One line for a terminal: without keys of the environment, and without signs by which a file's name could steer it."""
    return "".join(sign if sign.isprintable() else "?" for sign in " ".join(secret.hidden(str(said)).split()))


class _Parser(argparse.ArgumentParser):
    """Wrong arguments are one line, as every other mistake."""

    def error(self, message: str) -> NoReturn:
        self.exit(2, f"{self.prog}: {message}; see {self.prog} --help\n")


def _parse(arguments: Sequence[str] | None) -> argparse.Namespace:
    """As parse_args, but overrides may stand on both sides of an option: run experiment=NAME -m materials=vlm,void."""
    parser = _parser()
    options, rest = parser.parse_known_args(_joined(sys.argv[1:] if arguments is None else arguments))
    unknown = [word for word in rest if word.startswith("-") or not hasattr(options, "overrides")]
    if unknown:
        parser.error(f"unrecognized arguments: {' '.join(unknown)}")
    if rest:
        options.overrides += rest
    return options


def _joined(words: Sequence[str]) -> list[str]:
    """--up -y as --up=-y, which argparse would read as two options."""
    out: list[str] = []
    for word in words:
        if out and out[-1] == "--up" and word in ("-x", "-y", "-z"):
            out[-1] = f"--up={word}"
        else:
            out.append(word)
    return out


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="radartwin",
        description="Simulate the radar of a scanned room, learn from it, and measure what transfers.",
        epilog=examples.epilog(more="Exit status: 0 done, 1 a run failed, 2 the input is wrong."),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    verbs = parser.add_subparsers(title="verbs", metavar="VERB", required=True)

    run = _verb(verbs, "run", _run, "one experiment, or a sweep over comma-separated values with -m")
    _overrides(run, "experiment=NAME [group=option ...] [key=value ...]")
    run.epilog = examples.epilog("run", textwrap.fill(f"Experiments: {', '.join(_experiments())}.", 78))
    run.add_argument("-m", "--multirun", action="store_true", help="sweep: materials=vlm,uniform,void runs three jobs")
    run.add_argument("--search", metavar="METRIC", help="search: 'trajectory.height_m=interval(0.5,1.5)' is tried where METRIC may be best")
    run.add_argument("--trials", metavar="N", type=int, default=20, help="of a search, in all (default: 20)")
    run.add_argument("--direction", choices=("maximize", "minimize"), default="maximize", help="of a search (default: maximize)")
    run.add_argument("--at-once", metavar="N", type=int, default=1, help="trials at once, for hydra/launcher=joblib or slurm (default: 1)")

    tables = _verb(verbs, "tables", _tables, "run what is missing, write tables, figures and the report")
    tables.add_argument("--profile", choices=("quick", "paper"), default="quick", help="how much is computed (default: quick)")
    tables.add_argument("--only", metavar="NAME", action="append", help="one table; may be given again")
    _output(tables)

    simulate = _verb(verbs, "simulate", _simulate, "a scene to a DCA1000 recording")
    _overrides(simulate, "scene=lab|atrium|squash_court|void|empty|plate|scan [radar=...] [trajectory=...] [key=value ...]")
    simulate.add_argument("--out", metavar="PATH", type=Path, help="recording without suffix (default: OUTPUT/recordings/SCENE)")
    simulate.add_argument("--noise", action="store_true", help="add the receiver's thermal noise")

    process = _verb(verbs, "process", _process, "a recording to peaks.csv and range-time, Doppler and azimuth pictures")
    process.add_argument("recording", metavar="RECORDING", type=Path, help="our recording, a mmWave Studio .bin, or a .npy cube")
    process.add_argument(
        "--radar",
        metavar="FILE",
        help=".cfg, .mmwave.json or .yaml of the radar that recorded it, or a radar option's name",
    )
    process.add_argument("--moving", action="store_true", help="remove what does not move before looking for peaks")
    process.add_argument(
        "--iq-swapped",
        action=argparse.BooleanOptionalAction,
        help="Q before I in the file (default: read off the data)",
    )
    process.add_argument("--out", metavar="FOLDER", type=Path, help="where to write (default: OUTPUT/processed/NAME)")
    _output(process)

    captures = _verb(verbs, "import", _import, "raw captures to a recording set")
    captures.add_argument("source", metavar="SOURCE", type=Path, help="a mmWave Studio .bin, a .npy cube, or a folder of captures")
    captures.add_argument("overrides", nargs="*", metavar="KEY=VALUE", help="columns of the index for all, keys of a new set's card")
    captures.add_argument("--out", metavar="SET", type=Path, required=True, help="folder of the set; it is added to if it exists")
    captures.add_argument("--map", metavar="FILE", type=Path, help=".yaml or .csv: which capture shows what")
    captures.add_argument("--radar", metavar="FILE", help="as for process (default: the .mmwave.json beside each capture)")
    captures.add_argument("--cut", action="store_true", help="leave out an incomplete frame at the end of a capture")

    export = _verb(verbs, "export", _export, "the virtual measurement campaign to a recording set, as measured=recordings reads it")
    _overrides(export, "[profile=...] [profile.campaign.KEY=value ...] [measured.gap.NAME=strength ...]")
    export.add_argument("--out", metavar="SET", type=Path, required=True, help="folder of the set; what it holds already stays")

    reconstruct = _verb(verbs, "reconstruct", _reconstruct, "a mesh or a folder of frames to a labelled scene folder")
    reconstruct.add_argument("scan", metavar="SCAN", type=Path, help="a .glb, .ply or .obj mesh, or a folder of RGB-D frames with poses")
    reconstruct.add_argument("--out", metavar="FOLDER", type=Path, required=True)
    reconstruct.add_argument("--material", default="plasterboard", help="of every surface (default: plasterboard)")
    reconstruct.add_argument("--unit", default="auto", help="unit of a mesh: auto (metres), m, cm, mm, in or ft")
    reconstruct.add_argument("--up", default="auto", help="up axis of the scan: auto (found), x, y, z, -x, -y or -z")
    reconstruct.add_argument(
        "--object", action=argparse.BooleanOptionalAction, help="a mesh is of an object, seen from outside (default: below 1 m)"
    )
    reconstruct.add_argument("--depth-model", metavar="WEIGHTS", help="monocular depth model, for frames without depth")
    reconstruct.add_argument(
        "--intrinsics", metavar=("FX", "FY", "CX", "CY"), nargs=4, type=float, help="of the depth pictures, where the folder does not say"
    )
    reconstruct.add_argument(
        "--depth-unit", metavar="METRES", type=float, help="metres per count of the depth pictures (default: the layout's)"
    )
    reconstruct.add_argument(
        "--poses", metavar="AXES", help="what the frames' poses are: opencv (default), opengl, opencv-inverse or opengl-inverse"
    )

    label = _verb(verbs, "label", _label, "a scene's materials from a vision-language model's answers: live, or as a batch file and back")
    label.add_argument("scene", metavar="SCENE", type=Path, help="a scene folder; its manifest takes the labels")
    label.add_argument("--provider", choices=("recorded", "server", "local"), help="who answers (default: recorded answers)")
    label.add_argument("--model", help="name of the model; local: a folder or name that transformers loads; --import: who answered")
    label.add_argument(
        "--url", help="server: base of an OpenAI-compatible API (default: http://127.0.0.1:8000/v1); RADARTWIN_VLM_KEY: its key"
    )
    batch = label.add_mutually_exclusive_group()
    batch.add_argument("--export", metavar="FOLDER", type=Path, help="write the questions and their pictures instead of asking")
    batch.add_argument("--import", metavar="FILE", type=Path, dest="answers", help="take the answers of a JSONL file")
    label.add_argument("--missing", metavar="uniform:MATERIAL", help="what unanswered surfaces take (default: they are refused)")
    label.add_argument("--views", type=int, help="pictures of each surface (default: 3)")
    label.add_argument("--concurrency", type=int, help="server: requests at once (default: 4)")
    label.add_argument("--timeout", type=float, metavar="SECONDS", dest="timeout_s", help="server: of one request (default: 120)")

    view = _verb(verbs, "view", _view, "a standalone 3D page of a scene, coloured by material, segment, reflectivity or scan colour")
    view.add_argument("scene", metavar="SCENE", type=Path, help="a scene folder; the page needs no server and no network")
    colourings = ("material", "segment", "reflectivity", "colour")
    view.add_argument("--by", choices=colourings, default="material", help="the colouring the page opens in (default: material)")
    view.add_argument("--trajectory", metavar="FILE", type=Path, help="draw the radar's track: TUM or CSV text, or a ROS bag")
    view.add_argument("--layout", metavar="FILE", type=Path, help="put a layout's objects into the scene, for this page only")
    view.add_argument("--out", metavar="FILE", type=Path, help="default: SCENE/view.html")

    classify = _verb(verbs, "classify", _classify, "what a recording shows, by a model: labels with probabilities")
    classify.add_argument("recording", metavar="RECORDING", type=Path, help="our recording, a mmWave Studio .bin, or a .npy cube")
    classify.add_argument("--model", metavar="FOLDER", type=Path, required=True, help="model.json and model.safetensors of a run")
    classify.add_argument("--radar", metavar="FILE", help="as for process")
    classify.add_argument("--iq-swapped", action=argparse.BooleanOptionalAction, help="as for process")
    classify.add_argument("--distance", metavar="METRES", type=float, help="from the radar to the target at the start (default: found)")
    classify.add_argument("--period", metavar="SECONDS", type=float, help="of one revolution of the turntable (default: the model's)")

    dashboard = _verb(verbs, "dashboard", _dashboard, "the MLflow server on loopback")
    dashboard.add_argument("--port", type=_port, help="default: 5000, or a free one if it is taken")
    _output(dashboard)

    report = _verb(verbs, "report", _report, "the static report from the tables already written")
    _output(report)

    doctor = _verb(verbs, "doctor", _doctor, "versions, devices, disk, tracking store, and what to do; or a recording set")
    doctor.add_argument("--data", metavar="FOLDER", type=Path, help="check this recording set instead: all that is wrong with it")
    _output(doctor)
    return parser


def _verb(verbs: argparse._SubParsersAction, name: str, body: Verb, text: str) -> argparse.ArgumentParser:
    verb = verbs.add_parser(
        name,
        help=text,
        description=textwrap.fill(text[0].upper() + text[1:] + ".", 78),
        epilog=examples.epilog(name),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    verb.set_defaults(verb=body)
    return verb


def _output(verb: argparse.ArgumentParser) -> None:
    verb.add_argument("--output", metavar="DIR", type=Path, default=Path("outputs"), help="root of everything written")


def _port(text: str) -> int:
    if not (text.isdecimal() and int(text) <= 65535):
        raise argparse.ArgumentTypeError(f"{text!r} is not a port, a whole number from 0 to 65535")
    return int(text)


def _overrides(verb: argparse.ArgumentParser, text: str) -> None:
    verb.add_argument("overrides", nargs="*", metavar="OVERRIDE", help=text)
    verb.add_argument("--config-dir", metavar="DIR", type=Path, action="append", default=[], help="more configuration options")
    verb.add_argument("--output", metavar="DIR", help="root of everything written (the same as output=DIR)")


def _experiments() -> list[str]:
    """Names for experiment=NAME, by their files."""
    from radartwin.config.compose import groups

    try:
        return groups().get("experiment", [])
    except MissingError:  # a broken installation still explains itself
        return ["none found"]


def _given(options: argparse.Namespace) -> list[str]:
    from radartwin.config.compose import path_override

    return [*options.overrides, *([path_override("output", options.output)] if options.output else [])]


def _run(options: argparse.Namespace) -> int:
    if options.search:
        from radartwin.runs.search import Wish, search

        wish = Wish(options.search, options.trials, options.direction, options.at_once)
        return search(_given(options), options.config_dir, wish)
    if options.multirun:
        from radartwin.runs.sweep import sweep

        return sweep(_given(options), options.config_dir)
    from radartwin.runs.run import run

    return run(_given(options), options.config_dir)


def _tables(options: argparse.Namespace) -> int:
    from radartwin.runs import study

    return study.module("analysis.main").tables(options.profile, options.only, options.output)


def _simulate(options: argparse.Namespace) -> int:
    from radartwin.build.recording import simulate_scene
    from radartwin.build.room_materials import line
    from radartwin.config.compose import compose
    from radartwin.io import files
    from radartwin.radar.recording import recording_files
    from radartwin.store.products import Store

    config = compose(_given(options), options.config_dir)
    path = options.out or Path(config.output) / "recordings" / config.scene.name
    for file in recording_files(path):
        if file.is_dir():
            raise OutputError(f"{file} is a folder; choose another name for the recording")
    files.sweep(files.check_folder(path.parent))
    store = Store(Path(config.output) / "cache") if config.simulator.backend == "auto" else None
    recording = simulate_scene(config, noise=options.noise, store=store, say=lambda line: print(f"radartwin: {line}", file=sys.stderr))
    if materials := line(recording.provenance):
        print(f"radartwin: {materials}", file=sys.stderr)
    recording.save(path)
    if not recording.iq.any():
        where = "trajectory.position_m, heading_deg and height_m"
        print(f"radartwin: warning: nothing returns an echo to the radar; check {where}", file=sys.stderr)
    print(f"{', '.join(map(str, recording_files(path)))}: {recording.iq.shape[0]} frames")
    return 0


def _process(options: argparse.Namespace) -> int:
    from radartwin.build.recording import named_radar
    from radartwin.io import files
    from radartwin.radar.captures import capture_name
    from radartwin.radar.power_maps import FftSettings
    from radartwin.radar.process_capture import PEAKS_FILE, process_capture

    out = options.out or options.output / "processed" / capture_name(options.recording)
    files.sweep(files.check_folder(out))
    radar = named_radar(options.radar) if options.radar else None
    settings = FftSettings(static_removed=options.moving)
    peaks = process_capture(options.recording, out, radar, iq_swapped=options.iq_swapped, settings=settings)
    digits = {"range_m": 3, "doppler_mps": 3, "azimuth_deg": 1, "power_db": 1}
    print(" ".join(digits))
    for peak in peaks.itertuples(index=False):
        cells = ("" if value != value else f"{value:.{places}f}" for value, places in zip(peak, digits.values(), strict=True))
        print(*(cell.rjust(len(name)) for cell, name in zip(cells, digits, strict=True)))
    if len(peaks) and peaks["doppler_mps"].isna().all():
        print("radartwin: a frame has one chirp, from which no speed can be measured; doppler_mps is empty", file=sys.stderr)
    print(f"{len(peaks)} peaks; pictures and {PEAKS_FILE} in {out}", file=sys.stderr)
    return 0


def _import(options: argparse.Namespace) -> int:
    from radartwin.build.recording import named_radar
    from radartwin.io.progress import Progress
    from radartwin.recordings.importers import import_captures, key_values
    from radartwin.recordings.mapping import read_mapping

    progress = Progress()
    target, added = import_captures(
        options.source,
        options.out,
        key_values(options.overrides),
        read_mapping(options.map) if options.map else None,
        radar=named_radar(options.radar) if options.radar else None,
        cut=options.cut,
        progress=progress,
        say=progress.say,
    )
    print(f"{options.out}: {len(added)} recording{'' if len(added) == 1 else 's'} added, {len(target)} in all")
    return 0


def _export(options: argparse.Namespace) -> int:
    from radartwin.runs import study

    return study.module("experiments.campaign.export").export_verb(_given(options), options.config_dir, options.out)


def _reconstruct(options: argparse.Namespace) -> int:
    from radartwin.io.progress import Progress
    from radartwin.reconstruct.build import ScanOptions, reconstruct, summary

    how = ScanOptions(options.up, options.unit, options.object, options.depth_model, options.intrinsics, options.depth_unit, options.poses)
    scene = reconstruct(options.scan, options.out, options=how, material=options.material, progress=Progress())
    print("\n".join(summary(scene)))
    print(f"{options.out}: {len(scene)} surfaces")
    return 0


def _label(options: argparse.Namespace) -> int:
    from radartwin.build.recording import label_wishes
    from radartwin.io.progress import Progress
    from radartwin.label.labelling import label_folder

    for line in label_folder(options.scene, label_wishes(vars(options)), Progress()):
        print(line)
    return 0


def _view(options: argparse.Namespace) -> int:
    from radartwin.scene.scene import Scene
    from radartwin.scene.viewer.page import view

    out = options.out or (options.scene if options.scene.is_dir() else options.scene.parent) / "view.html"
    scene, poses = Scene.load(options.scene), None
    if options.trajectory:
        from radartwin.scene.trajectories.file import read_track

        poses = read_track(options.trajectory).poses
    if options.layout:
        from radartwin.scene.layouts.layout import Layout
        from radartwin.scene.layouts.place import furnish

        scene = furnish(scene, Layout.load(options.layout), None if poses is None else poses[0])
    view(scene, out, poses, by=options.by)
    print(out)
    return 0


def _classify(options: argparse.Namespace) -> int:
    from radartwin.build.recording import named_radar
    from radartwin.recognize.classify import classify

    radar = named_radar(options.radar) if options.radar else None
    answer = classify(
        options.recording, options.model, radar, iq_swapped=options.iq_swapped, distance_m=options.distance, period_s=options.period
    )
    print("label probability")
    for label, probability in zip(answer.classes, answer.probabilities, strict=True):
        print(f"{label} {probability:.4f}")
    print(f"{options.recording}: {answer.classes[0]}, with the target at {answer.distance_m:.2f} m", file=sys.stderr)
    return 0


def _dashboard(options: argparse.Namespace) -> int:
    from radartwin.config.compose import compose
    from radartwin.runs.dashboard import dashboard

    return dashboard(compose().tracking, options.output, options.port)


def _report(options: argparse.Namespace) -> int:
    from radartwin.runs import study

    return study.module("analysis.main").report_verb(options.output)


def _doctor(options: argparse.Namespace) -> int:
    from radartwin.runs.doctor import doctor, doctor_data

    return doctor_data(options.data) if options.data is not None else doctor(options.output)
