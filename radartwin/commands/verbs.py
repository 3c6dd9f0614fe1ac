"""Implement the verbs (subcommands). A verb's function returns the exit status, and imports its modules when it is called."""

from __future__ import annotations

import argparse
import sys
import warnings
from pathlib import Path
from typing import Any

from radartwin.errors import ConfigError, OutputError
from radartwin.io.one_line import plural

SIMULATE_READS = ("radar", "scene", "materials", "contents", "trajectory", "simulator", "features", "seed", "output")


def demo(options: argparse.Namespace) -> int:
    from radartwin.commands.demo import demo
    from radartwin.materials.itu import StandInWarning

    with warnings.catch_warnings(action="ignore", category=StandInWarning):  # the page names each substitute beside its material
        print(demo(options.output))
    return 0


def run(options: argparse.Namespace) -> int:
    given = {name: value for name in ("trials", "direction", "at_once") if (value := getattr(options, name)) is not None}
    if options.cfg:
        from radartwin.runs.run import print_config

        if options.multirun or options.search:
            raise ConfigError(f"run: --cfg prints one configuration; leave {'-m' if options.multirun else '--search'} out")
        return print_config(_all_overrides(options), options.config_dir)
    if options.search:
        from radartwin.runs.optimise import SearchGoal, search

        if options.multirun:
            raise ConfigError("run: --search starts its own jobs; leave -m out")
        return search(_all_overrides(options), options.config_dir, SearchGoal(options.search, **given))
    if given:
        raise ConfigError(f"run: --{next(iter(given)).replace('_', '-')} applies only to a search; add --search METRIC, or leave it out")
    if options.multirun:
        from radartwin.runs.sweep import sweep

        return sweep(_all_overrides(options), options.config_dir)
    from radartwin.runs.run import run

    return run(_all_overrides(options), options.config_dir)


def tables(options: argparse.Namespace) -> int:
    from radartwin.runs import checkout

    return checkout.module("analysis.main").tables(options.profile, options.only, options.output)


def simulate(options: argparse.Namespace) -> int:
    from radartwin.builders.recording import simulate_scene
    from radartwin.builders.scene import materials_line
    from radartwin.config.compose import compose, refuse_unread
    from radartwin.io import files
    from radartwin.radar.recording import recording_files, refuse_foreign
    from radartwin.store.products import Store

    overrides = _all_overrides(options)
    refuse_unread("simulate", overrides, SIMULATE_READS)
    config = compose(overrides, options.config_dir)
    path = options.out or Path(config.output) / "recordings" / config.scene.name
    for file in recording_files(path):
        if file.is_dir():
            raise OutputError(f"{file} is a folder; choose another name for the recording")
    refuse_foreign(path)
    files.sweep(files.check_folder(path.parent))
    store = Store(Path(config.output) / "cache") if config.simulator.backend == "auto" else None
    recording = simulate_scene(config, noise=options.noise, store=store, say=_note, out=path)
    if line := materials_line(recording.provenance):
        _note(line)
    if not any(recording.iq[block].any() for block in recording.frame_blocks()):
        _note("warning: nothing returns an echo to the radar; check trajectory.position_m, heading_deg and height_m")
    print(f"{', '.join(map(str, recording_files(path)))}: {plural(recording.iq.shape[0], 'frame')}")
    return 0


def process(options: argparse.Namespace) -> int:
    from radartwin.io import files
    from radartwin.radar.captures import capture_name
    from radartwin.radar.process_capture import PEAKS_FILE, POINTS_FILE, process_capture

    out = options.out or options.output / "processed" / capture_name(options.recording)
    files.sweep(files.check_folder(out))
    peaks = process_capture(options.recording, out, static_removed=options.moving, angle=options.angle, **_capture(options))
    digits = {"range_m": 3, "doppler_mps": 3, "azimuth_deg": 1, "power_db": 1}
    print(" ".join(digits))
    for peak in peaks.itertuples(index=False):
        cells = ("" if value != value else f"{value:.{places}f}" for value, places in zip(peak, digits.values(), strict=True))
        print(*(cell.rjust(len(name)) for cell, name in zip(cells, digits, strict=True)))
    if len(peaks) and peaks["doppler_mps"].isna().to_numpy().all():
        _note("a frame has one chirp, from which no speed can be measured; doppler_mps is empty")
    print(f"{plural(len(peaks), 'peak')}; pictures, {PEAKS_FILE} and {POINTS_FILE} in {out}", file=sys.stderr)
    return 0


def import_captures(options: argparse.Namespace) -> int:
    from radartwin.io.progress import Progress
    from radartwin.recordings.importers import import_captures, key_values
    from radartwin.recordings.mapping import read_mapping

    progress = Progress()
    target, added = import_captures(
        options.source,
        options.out,
        key_values(options.overrides),
        read_mapping(options.map) if options.map else None,
        frames=options.frames,
        progress=progress,
        **_capture(options),
    )
    print(f"{options.out}: {plural(len(added), 'recording')} added, {len(target)} in all")
    return 0


def export(options: argparse.Namespace) -> int:
    if options.mcap is not None:
        from radartwin.commands.export import export_timeline

        return export_timeline(options, _capture(options))
    from radartwin.commands.export import refuse_timeline_options
    from radartwin.runs import checkout

    refuse_timeline_options(options)
    return checkout.module("experiments.campaign.export_set").export_verb(_all_overrides(options), options.config_dir, options.out)


def reconstruct(options: argparse.Namespace) -> int:
    from radartwin.io.progress import Progress
    from radartwin.reconstruct.build import ScanOptions, reconstruct, summary

    how = ScanOptions(options.up, options.unit, options.object, options.depth_model, options.intrinsics, options.depth_unit, options.poses)
    scene = reconstruct(options.scan, options.out, options=how, material=options.material, progress=Progress())
    print("\n".join(summary(scene)))
    print(f"{options.out}: {plural(len(scene), 'surface')}")
    return 0


def label(options: argparse.Namespace) -> int:
    """Label the surfaces of a scene with materials. Options that the user does not give have the defaults of `LabelOptions`."""
    from radartwin.io.progress import Progress
    from radartwin.label.labelling import LabelOptions, label_folder

    names = ("provider", "model", "url", "timeout_s", "concurrency", "views")
    given = {name: value for name in names if (value := getattr(options, name)) is not None}
    label_options = LabelOptions(**given, export=options.export, answers=options.answers, missing=options.missing)
    batch = next((name for name, value in (("export", options.export), ("import", options.answers)) if value is not None), None)
    if batch and options.provider:
        raise ConfigError(f"label: --{batch} asks no provider; leave --provider out")
    for name, option in (("url", "url"), ("concurrency", "concurrency"), ("timeout_s", "timeout")):
        if name in given and (batch or options.provider != "server"):
            raise ConfigError(f"label: --{option} applies only to --provider server; add --provider server, or leave --{option} out")
    for line in label_folder(options.scene, label_options, Progress()):
        print(line)
    return 0


def view(options: argparse.Namespace) -> int:
    from radartwin.scene.scene import Scene
    from radartwin.scene.viewer.page import view

    if options.live:
        from radartwin.commands.live import live

        return live(options)
    for name in ("port", "radar", "recording"):
        if getattr(options, name) is not None:
            raise ConfigError(f"view: --{name} applies only to the live page; add --live, or leave --{name} out")
    out = options.out or (options.scene if options.scene.is_dir() else options.scene.parent) / "view.html"
    scene, poses = Scene.load(options.scene), None
    if options.trajectory:
        from radartwin.scene.trajectories.file import read_track

        poses = scene.placed(read_track(options.trajectory).poses, str(options.trajectory))
    if options.layout:
        from radartwin.scene.layouts.layout import Layout
        from radartwin.scene.layouts.place import furnish

        scene = furnish(scene, Layout.load(options.layout), None if poses is None else poses[0])
    view(scene, out, poses, by=options.by)
    print(out)
    return 0


def classify(options: argparse.Namespace) -> int:
    from radartwin.recognize.classify import classify

    given = _capture(options)
    answer = classify(options.recording, options.model, distance_m=options.distance, period_s=options.period, **given)
    print("label probability")
    for label, probability in zip(answer.classes, answer.probabilities, strict=True):
        print(f"{label} {probability:.4f}")
    print(f"{options.recording}: {answer.classes[0]}, with the target at {answer.distance_m:.2f} m", file=sys.stderr)
    return 0


def train(options: argparse.Namespace) -> int:
    from radartwin.commands.train import train

    return train(options)


def benchmark(options: argparse.Namespace) -> int:
    from radartwin.benchmark.leaderboard import benchmark, table
    from radartwin.io.progress import Progress

    path, rows = benchmark(options.output, options.method, options.problem, Progress().say)
    print(table(rows))
    print(path)
    return 0


def dashboard(options: argparse.Namespace) -> int:
    from radartwin.config.compose import compose
    from radartwin.runs.dashboard import dashboard

    return dashboard(compose().tracking, options.output, options.port)


def report(options: argparse.Namespace) -> int:
    from radartwin.runs import checkout

    return checkout.module("analysis.main").report_verb(options.output)


def doctor(options: argparse.Namespace) -> int:
    from radartwin.runs.doctor import doctor, doctor_data

    return doctor_data(options.data) if options.data is not None else doctor(options.output)


def _capture(options: argparse.Namespace) -> dict[str, Any]:
    """Return the options that describe a capture as arguments of `radartwin.radar.captures.load_capture`."""
    from radartwin.builders.radar import named_radar
    from radartwin.io.progress import Progress

    name = options.radar
    radar = name if not name or Path(name).suffix or Path(name).exists() else named_radar(name)
    return {"radar": radar, "board": options.board, "iq_swapped": options.iq_swapped, "cut": options.cut, "say": Progress().say}


def _all_overrides(options: argparse.Namespace) -> list[str]:
    from radartwin.config.compose import with_output

    return with_output(options.overrides, options.output)


def _note(line: str) -> None:
    print(f"radartwin: {line}", file=sys.stderr)
