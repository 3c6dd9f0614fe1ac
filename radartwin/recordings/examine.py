"""Check a recording set in one pass: data card, index, files, radars, trajectories and samples."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from radartwin.errors import InputError, MissingError, RecordingError, UserError
from radartwin.io import files
from radartwin.io.progress import Progress
from radartwin.radar.captures import EDGE_DB, band_edge_db, few, spread_frames
from radartwin.radar.chirp import Radar
from radartwin.radar.dca1000 import lost_frames
from radartwin.radar.recording import Recording, recording_files
from radartwin.radar.word_order import FULL_SCALE
from radartwin.recordings.card import CARD, Card
from radartwin.recordings.index import INDEX, RECORDINGS, TRAJECTORIES, Row, read_index
from radartwin.scene.trajectories.file import read_track

CLIPPED_SHARE = 1e-3  # largest tolerated share of samples at full scale, by judgement; above it, clipping causes notable harmonics
LOST_SHARE = 0.01  # a recording set is unusable if more than this share of frames has lost samples, even if the log reports the loss


@dataclass
class Report:
    """The problems and notes that `examine` found, each one line of text that begins with the file or place.

    Problems make a recording set unusable, notes do not. `bytes` is the recordings' size.
    """

    rows: list[Row] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    card: Card | None = None
    radar: Radar | None = None
    bytes: int = 0
    frames: int = 0

    def counts(self, column: str) -> Counter[str]:
        """Count how many rows of the index have each value in a column."""
        tally = Counter(row.value(column) for row in self.rows)
        number = column == "distance_m"
        keys = sorted(tally, key=lambda value: (value is None, value))
        return Counter({("unknown" if key is None else f"{key:g} m") if number else str(key): tally[key] for key in keys})


def examine(folder: str | Path, progress: Progress | None = None) -> Report:
    """Find all problems of the recording set in a folder. Every recording is read once, one after the other.

    Raises:
        MissingError: the folder of the recording set does not exist.
    """
    folder, report = Path(folder), Report()
    if not folder.is_dir():
        raise MissingError(f"{folder}: no such folder; give a recording set")
    try:
        report.card = Card.load(folder)
        report.problems += [f"{CARD}: {line}" for line in report.card.problems()]
    except (UserError, OSError) as error:
        report.problems.append(f"{CARD}: {str(error).removeprefix(f'{folder / CARD}: ').removeprefix(f'{folder}: ')}")
    report.rows, index_problems = read_index(folder / INDEX)
    report.problems += [f"{INDEX}: {line}" for line in index_problems]
    radars: list[tuple[str, Radar]] = []
    for row in (progress or Progress(quiet=True)).over(report.rows, "recordings"):
        where = f"{RECORDINGS}/{row.recording}"
        pair = recording_files(folder / RECORDINGS / row.recording)
        if missing := [path.name for path in pair if not path.is_file()]:
            report.problems.append(f"{where}: {' and '.join(missing)}: no such file; record again or remove the row from {INDEX}")
            continue
        try:
            for path in pair:
                files.inside(folder, f"{RECORDINGS}/{path.name}")
            recording = Recording.load(folder / RECORDINGS / row.recording)
        except (UserError, OSError) as error:
            report.problems.append(f"{where}: {str(error).replace(f'{folder / RECORDINGS}/', '')}")
            continue
        report.bytes += sum(path.stat().st_size for path in pair)
        report.frames += recording.num_frames
        radars.append((where, recording.radar))
        problems, notes = check_samples(recording, row, report.card)
        report.problems += [f"{where}: {line}" for line in (*problems, *_trajectory(folder, row, recording))]
        report.notes += [f"{where}: {line}" for line in notes]
    if radars:
        report.radar = Counter(radar for _, radar in radars).most_common(1)[0][0]
        report.problems += [
            f"{where}: its radar differs from the other recordings: {difference(radar, report.radar)}; make a separate set"
            for where, radar in radars
            if not same_radar(radar, report.radar)
        ]
    elif not report.rows and not index_problems:
        report.notes.append(f"{INDEX}: the set has no recordings yet; add some with radartwin import")
    if not index_problems:  # recording files without a row in the index, for example from an interrupted import
        known = {row.recording for row in report.rows}
        for path in sorted((folder / RECORDINGS).glob("[!.]*")):
            if path.suffix in (".bin", ".json") and path.stem not in known:
                report.notes.append(f"{RECORDINGS}/{path.name}: {INDEX} has no row for it; add it again or remove it")
    return report


def check_samples(recording: Recording, row: Row, card: Card | None = None) -> tuple[list[str], list[str]]:
    """Check the samples of one recording. Return a list of problems and a list of notes, each one line of text."""
    problems, notes = [], []
    if not recording.iq.any():
        return ["all samples are zero; record again with the sensor started"], notes
    alive = np.logical_or.reduce([recording.iq[block].any(axis=(0, 1, 4)) for block in recording.frame_blocks()])  # (tx, rx)
    dead = [f"tx {t} rx {r}" for t, r in np.argwhere(~alive).tolist()]
    if dead:
        problems.append(f"no samples from {', '.join(dead)}: all zero; enable the channel and record again")
    if (clipped := clipped_share(recording)) > 0:
        text = f"{100 * clipped:.2g} % of the samples are at full scale"
        (problems if clipped > CLIPPED_SHARE else notes).append(f"{text}; lower the receiver's gain" if clipped > CLIPPED_SHARE else text)
    if not dead and (frames := zero_filled_frames(recording)):
        text = f"{len(frames)} of {recording.num_frames} frames have lost samples, filled with zeros (frame {few(frames)})"
        logged = row.extra.get("lost_packets", "0") not in ("", "0")
        if logged and len(frames) <= LOST_SHARE * recording.num_frames:
            notes.append(text)
        else:
            problems.append(f"{text}; record again with a larger packet delay")
    edges = [band_edge_db(recording.iq[frame]) for frame in spread_frames(recording.num_frames) if not recording.radar.real_sampling]
    if edges and (edge := np.mean(edges)) < -EDGE_DB:
        flag = str(not recording.iq_swapped).lower()
        problems.append(
            f"I and Q seem exchanged: noise is {-edge:.1f} dB lower above zero beat frequency than below it; set iq_swapped to {flag}"
        )
    if card is not None and (card.units == "counts") != (recording.scale == 1.0):
        problems.append(f"its scale {recording.scale:g} contradicts units {card.units} in {CARD}; correct one of them")
    return problems, notes


def clipped_share(recording: Recording) -> float:
    """Return the share of the int16 sample values that are at the limits of the int16 range."""
    limit = FULL_SCALE * (recording.scale or np.inf) * (1 - 1e-6)
    parts = recording.iq.view(np.float32)
    clipped = sum(int(np.count_nonzero(np.abs(parts[block]) >= limit)) for block in recording.frame_blocks())
    return clipped / (recording.iq.size * (1 if recording.radar.real_sampling else 2))


def zero_filled_frames(recording: Recording) -> list[int]:
    """Return the indices of frames that contain at least half a packet of zeros. The capture card writes zeros for lost packets."""
    lost: list[int] = []
    for block in recording.frame_blocks():
        iq = recording.iq[block].reshape(block.stop - block.start, -1)
        lost += (block.start + lost_frames(iq.real if recording.radar.real_sampling else iq.view(np.float32))).tolist()
    return lost


def frame_poses(path: Path, start_s: float, frames: int, rate_hz: float) -> np.ndarray:
    """Interpolate the sensor poses (F, 4, 4) at the frame times. A frame outside the time span of the file, by at most half a frame period,
    takes the nearest pose.

    Args:
        path: a trajectory file that `read_track` accepts.
        start_s: time of the first frame in seconds, on the clock of the trajectory file.
        frames: number of frames of the recording.
        rate_hz: frame rate of the recording.
    Raises:
        MissingError, PoseError: the trajectory file is missing or unreadable.
        RecordingError: the trajectory file does not cover the time of all frames.
    """
    track = read_track(path)
    (begin, end), times, slack = track.times_s[[0, -1]], start_s + np.arange(frames) / rate_hz, 0.5 / rate_hz
    if times[0] < begin - slack or times[-1] > end + slack:
        covered = f"it covers {begin:.3f} to {end:.3f} s, the frames are at {times[0]:.3f} to {times[-1]:.3f} s"
        raise RecordingError(f"{path}: {covered}; give a longer trajectory, or a start_s column")
    return track.at(times.clip(begin, end))


def _trajectory(folder: Path, row: Row, recording: Recording) -> Iterator[str]:
    if not row.trajectory:
        return
    path = folder / TRAJECTORIES / row.trajectory
    try:
        files.inside(folder, f"{TRAJECTORIES}/{row.trajectory}")
        frame_poses(path, row.start_s, recording.num_frames, recording.radar.frame_rate_hz)
    except (InputError, OSError) as error:
        yield str(error).removeprefix("trajectory ").replace(str(path), f"trajectory {row.trajectory}")


def same_radar(radar: Radar, other: Radar) -> bool:
    """Return whether one recording set may hold recordings of both radars: they may differ only in frame rate and radar file name."""
    return replace(radar, frame_rate_hz=other.frame_rate_hz, name=other.name) == other


def difference(radar: Radar, other: Radar) -> str:
    """Return the names of the fields in which two radars differ, as text. The radars' own names are not compared."""
    pairs = {key: (value, getattr(other, key)) for key, value in vars(radar).items() if key != "name" and value != getattr(other, key)}
    return ", ".join(key if len(f"{a}{b}") > 60 else f"{key} {a} instead of {b}" for key, (a, b) in pairs.items())
