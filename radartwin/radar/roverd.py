"""Read the radar of a trace in the roverd format, in which RadarML publishes the data set I/Q-1M.

A trace is a folder with one folder for each sensor. This module reads these files of a trace:

    config.yaml            settings of the sensors; radar.args.radar holds the waveform
    radar/meta.json        format, type and shape of each channel: {"iq": {"format": "raw", "type": "i2", "shape": [64, 3, 4, 512]}, ...}
    radar/iq               int16 samples [frame, chirp, tx, rx, 2 * sample], in the order Q0 Q1 I0 I1, Q2 Q3 I2 I3, ...
    radar/valid            uint8, 0 for a frame with lost packets, which are zeros; optional
    radar/ts               float64 start time of each frame, seconds since 1970
    _radar/pose.npz        poses at the times t (N,): pos (N, 3) in metres, rot (N, 3, 3), and mask (F,), the frames with a pose; optional

The samples have the layout of a DCA1000 .bin with Q before I, so that an imported recording has the same bytes as the channel.

Source: the public description of the format and of the data set (github RadarML/red-rover: docs/roverd/index.md, docs/iq1m/index.md,
collect/config/grt-i.yaml, processing/src/roverp/readers/pose.py) and of the samples (github RadarML/xwr: RadarFrame, XWRConfig,
AWR1843Boost). Earlier descriptions name the type i16. This module was tested on files written from this description. The
module was not run on the files of the data set. Two facts are assumptions. The poses (front, left, up) are taken as those of the sensor
rig, so that the distance from the rig to the radar is ignored. The transmitters are assumed to fire in the order TX1, TX2, TX3.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from radartwin.errors import InputError, RecordingError
from radartwin.io import files
from radartwin.radar import dca1000
from radartwin.radar.boards import IWR1642BOOST, IWR1843BOOST
from radartwin.radar.chirp import Radar
from radartwin.radar.description_files import present, read_json, read_yaml
from radartwin.radar.word_order import Layout

CHANNEL = "iq"
# Boards by the device names of xwr; AWR1843L is an AWR1843 without TX2.
_BOARDS = {"AWR1843": IWR1843BOOST, "AWR1843L": IWR1843BOOST.part((0, 2), range(4)), "AWR1642": IWR1642BOOST}


def opened(channel: Path, radar: Radar, cut: bool, say: Callable[[str], None]) -> dict[str, Any]:
    """Open the channel iq of a trace, TRACE/radar/iq, and return its frames, their poses and times, and the file of its samples.

    If the trace has poses, only the longest run of frames with a pose is used.

    Args:
        cut: True drops an incomplete frame and frames without a time at the end; False makes them an error.
    """
    folder = channel.parent
    described = read_json(folder / "meta.json").get("iq")
    if not isinstance(described, dict) or described.get("format") != "raw" or str(described.get("type")).lstrip("<") not in ("i2", "i16"):
        raise RecordingError(f"{folder / 'meta.json'}: it describes no channel iq of format raw and type i2; copy the whole trace")
    shape, expected = described.get("shape"), [*dca1000.frame_shape(radar)[:-1], 2 * radar.num_samples]
    if shape != expected:
        raise RecordingError(f"{folder / 'meta.json'}: iq has shape {shape}, not {expected} of radar {radar.name}; give its radar")
    stored = dca1000.SampleFile([channel], radar, Layout(real=radar.real_sampling, q_first=False))
    times = np.fromfile(present(folder / "ts", "copy the whole trace"), "<f8")
    if not cut and (stored.rest or len(times) < stored.frames):
        raise RecordingError(f"{stored.leftover(radar)}, and {folder / 'ts'} holds {len(times)} times; drop the end with --cut")
    if stored.rest:
        say(f"the last frame is incomplete and dropped ({stored.rest} of {stored.frame_bytes} bytes)")
    frames, poses = range(min(stored.frames, len(times))), None
    if (path := folder.parent / "_radar" / "pose.npz").is_file():
        mask, poses = _poses(path, len(times))
        runs = np.flatnonzero(np.diff(np.concatenate([[0], mask[: len(frames)], [0]]))).reshape(-1, 2)
        start, stop = runs[np.argmax(np.diff(runs, axis=1))].tolist() if len(runs) else (0, 0)
        if left_out := len(frames) - (stop - start):
            say(f"{left_out} of {len(frames)} frames have no pose, or precede or follow a frame without a pose, and are left out")
        frames, poses = range(start, stop), poses[np.count_nonzero(mask[:start]) :][: stop - start]
    incomplete = np.zeros(0, np.int64)
    if (folder / "valid").is_file():  # a frame without a value counts as incomplete
        incomplete = np.flatnonzero(np.pad(np.fromfile(present(folder / "valid"), "u1"), (0, stored.frames))[: stored.frames] == 0)
    return {
        "frames": frames, "read": stored.samples, "poses": poses, "sample_file": stored, "times_s": times, "incomplete": incomplete,
    }  # fmt: skip


def radar_of(trace: Path) -> Radar:
    """Build the radar of a trace from its config.yaml: times in us, slope in MHz/us, sample rate in ksps, frame period in ms."""
    path = present(trace / "config.yaml", "copy it, or give the radar with --radar")
    sensors: Any = read_yaml(path, "sensors")
    try:
        settings = sensors["radar"]["args"]["radar"]
        board, slope = _BOARDS[settings.get("device", "AWR1843")], 1e12 * float(settings["freq_slope"])
        return Radar(
            name=board.name,
            start_frequency_hz=1e9 * float(settings["frequency"]) + slope * 1e-6 * float(settings["adc_start_time"]),
            slope_hz_per_s=slope,
            sample_rate_hz=1e3 * float(settings["sample_rate"]),
            num_samples=settings["adc_samples"],
            num_chirps=settings["frame_length"],
            tx_positions_m=board.tx_positions_m,
            rx_positions_m=board.rx_positions_m,
            chirp_interval=1e-6 * (float(settings["idle_time"]) + float(settings["ramp_end_time"])),
            frame_rate_hz=1e3 / float(settings["frame_period"]),
            element=board.element,
        )
    except (KeyError, TypeError, ValueError, AttributeError, ZeroDivisionError) as error:
        reason = f"radar.args.radar has no {error}, or it is no known device" if isinstance(error, KeyError) else error
        raise RecordingError(f"{path}: {reason}; give the radar with --radar") from error


def _poses(path: Path, frames: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the mask (F,) of the frames that have a pose, and the poses (N, 4, 4) of these frames."""
    try:
        stored = files.read_arrays(path)
        mask, poses = stored["mask"].astype(bool), np.tile(np.eye(4), (len(stored["pos"]), 1, 1))
        poses[:, :3, :3], poses[:, :3, 3] = stored["rot"], stored["pos"]
        if mask.shape != (frames,) or mask.sum() != len(poses):
            raise ValueError(f"mask has {mask.size} values, {int(mask.sum())} of them set, for {frames} frames and {len(poses)} poses")
    except (InputError, KeyError, ValueError, TypeError, IndexError) as error:
        raise RecordingError(f"{path}: {error}; copy it again, or remove it to import without poses") from error
    return mask, poses
