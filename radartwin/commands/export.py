"""Export the timeline of a recording: the command `radartwin export RECORDING --mcap FILE`."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from radartwin.errors import InputError
from radartwin.io.one_line import plural


def export_timeline(options: argparse.Namespace, capture: dict[str, Any]) -> int:
    """Write the MCAP file of a recording, and print its number of messages by topic. `capture` holds arguments of `load_capture`."""
    from radartwin.io.progress import Progress
    from radartwin.radar.captures import load_capture
    from radartwin.recordings.camera_pictures import nanoseconds, read_pictures
    from radartwin.recordings.timeline import check_target, write_timeline

    options.resumes = False  # an interrupted timeline starts over, unlike an interrupted export of the campaign
    if len(options.overrides) != 1:
        given = f"the command line has {', '.join(options.overrides) or 'none'}"
        raise InputError(f"--mcap needs one recording, but {given}; write radartwin export RECORDING --mcap FILE")
    if refused := [f"--{name.replace('_', '-')}" for name in ("config_dir", "output") if getattr(options, name)]:
        raise InputError(f"{refused[0]} applies only to the export of the virtual campaign (--out); leave it out with --mcap")
    check_target(options.mcap)
    start_ns = nanoseconds(options.start, "--start") if options.start is not None else 0
    pictures = read_pictures(options.pictures) if options.pictures is not None else None
    recording = load_capture(Path(options.overrides[0]), **capture)
    counts = write_timeline(recording, options.mcap, start_ns=start_ns, pictures=pictures, progress=Progress())
    print("topic messages")
    for topic, count in sorted(counts.items()):
        print(topic, count)
    print(f"{options.mcap}: {plural(recording.num_frames, 'frame')}, {plural(sum(counts.values()), 'message')}", file=sys.stderr)
    return 0


def refuse_timeline_options(options: argparse.Namespace) -> None:
    """Raise InputError if an option of a timeline is given with --out."""
    for name in ("pictures", "start", "radar", "board", "iq_swapped", "cut"):
        if getattr(options, name) not in (None, False):
            raise InputError(f"--{name.replace('_', '-')} applies only to a timeline (--mcap FILE); leave it out with --out")
