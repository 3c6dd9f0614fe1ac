"""Read raw radar data (captures) of other tools as recordings.

| capture | samples | radar |
|---|---|---|
| .bin of the DCA1000, in one or more files (radartwin.radar.dca1000) | as described (radartwin.radar.word_order) | given, or beside it |
| folder of the cascade's capture board (radartwin.radar.cascade_capture) | I before Q | given |
| iq in the folder of a trace (radartwin.radar.roverd) | Q before I | given, or in the trace |
| .npy cube, or .npz with the cube as `iq` and optional `poses` (F, 4, 4) | complex, or int16 with a last axis of I and Q | given |

A capture of another tool has no amplitude calibration, so the samples of its recording are in ADC counts and its scale is 1. The receive
filter passes beat frequencies from 0 to 0.9 fs (complex 1x mode), where fs is the sample rate. The noise is therefore lower just below fs,
which appears just below zero in the sampled spectrum. If I and Q are exchanged, the spectrum is mirrored. This module finds the order of I
and Q from the step of the noise at zero beat frequency. If the noise does not show the order, the description of the capture decides. The
echoes do not show the order, because with complex sampling they may fill the whole band. Frames with lost packets, which are zeros, take no
part in these tests.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import InputError, MissingError, RecordingError
from radartwin.io import files, scratch
from radartwin.io.git_lfs import refuse_pointer
from radartwin.io.one_line import plural
from radartwin.radar import cascade_capture, dca1000, roverd, studio_log
from radartwin.radar.chirp import Radar
from radartwin.radar.description_files import present, read_json
from radartwin.radar.recording import Recording, gathered, recording_files
from radartwin.radar.ti_files import Description
from radartwin.radar.word_order import FULL_SCALE, Layout

CUBES = (".npy", ".npz")  # suffixes of files with an array of samples
EDGE_DB = 2.0  # smallest magnitude of band_edge_db that determines the sample order; real captures have 2.7 to 9.9 dB
EDGE_FRAMES = 16  # number of frames that test whether I and Q are exchanged; in one frame of few chirps, band_edge_db is off by 1 to 2 dB
_REORDERED_DB = 0.5  # smallest flattening of the spectrum by a wrong order of the words; noise has 0.1 dB, captures have 1 to 7 dB
_GAP = 1.5  # a longer time between two frames, in frame periods, is a gap
_UNSIGNED = 24576  # median magnitude of unsigned words that are read as signed; signed words are nearer to zero

Say = Callable[[str], None]


@dataclass
class _Source:
    """A capture that can be read by blocks.

    Attributes:
        path: the file that the provenance names.
        radar: radar that recorded the samples.
        frames: numbers of the frames that can be read.
        read: function that returns frames (count, chirp, tx, rx, sample) in counts as if I came first, from the number of the first frame
            and the number of frames.
        poses: poses of `frames`, or one pose.
        sample_file: the files of a DCA1000 capture or of a trace.
        times_s: times of all frames in seconds since 1970.
        incomplete: numbers of frames that the capture marks as incomplete.
    """

    path: Path
    radar: Radar
    frames: range
    read: Callable[[int, int], NDArray[np.complex64]]
    poses: NDArray[np.float64] | None = None
    sample_file: dca1000.SampleFile | None = None
    times_s: NDArray[np.float64] | None = None
    incomplete: NDArray[np.int64] | tuple[()] = ()


def load_capture(
    path: str | Path,
    radar: Radar | str | Path | None = None,
    *,
    board: str | None = None,
    iq_swapped: bool | None = None,
    cut: bool = False,
    frames: slice = slice(None),
    say: Say = lambda line: None,
) -> Recording:
    """Read a recording of this package, or a capture of another tool.

    Args:
        path: path of a recording of this package (without suffix, or with .bin or .json), of a .bin file of the DCA1000, of a folder of the
            cascade's capture board, or of a .npy or .npz file. For a capture in several .bin files, the path of any of these files selects
            the whole capture. A cube has the shape [chirp, sample], [chirp, channel, sample], [frame, chirp, channel, sample] or
            [frame, chirp, tx, rx, sample], with channels ordered by transmitter first. With three and four axes, the chirps of all
            transmitters may follow each other instead, so that the channels are the receivers.
        radar: a Radar or the path of a radar file. A cube and a capture of the cascade require `radar`; for a .bin file, `radar` replaces
            the .mmwave.json beside it.
        board: name of the board, in place of the board in the radar file (radartwin.radar.boards).
        iq_swapped: whether Q comes before I in a capture of another tool; None takes the order from the noise or the description. For a
            recording of this package, the .json file gives the order.
        cut: whether to leave out an incomplete frame at the end; False makes it an error.
        frames: the frames to read, as a slice without a step.
        say: function that receives the board and notes on the capture, such as lost packets, as lines of text.
    Raises:
        MissingError: the capture or its radar description is missing.
        RecordingError: the size of the capture does not fit the radar, or samples are NaN or infinite.
    """
    path = Path(path)
    bin_path, json_path = recording_files(path)
    for file in (path, bin_path):
        refuse_pointer(file)
    is_trace = path.name == roverd.CHANNEL and path.is_file()
    if is_trace and radar is None:
        radar = roverd.radar_of(path.parent.parent)
    if path.suffix not in CUBES and not cascade_capture.is_cascade_capture(path) and radar is None:
        beside = read_json(json_path) if json_path.is_file() else {}
        if {"capturedFiles", "mmWaveDevices", "DCA1000Config"} & beside.keys():
            if not bin_path.is_file() or "capturedFiles" in beside:
                raise RecordingError(f"{json_path}: it holds no samples; {_instead(beside)}")
        elif json_path.is_file() or not bin_path.is_file():
            recording = Recording.load(path)
            indices = _frame_range(path, range(recording.num_frames), frames)
            return recording if frames == slice(None) else recording.part(indices)
        bin_path = dca1000.parts(bin_path)[0]
        radar = description_beside(bin_path)
    if radar is None:
        kind = f"a {path.suffix} cube" if path.suffix in CUBES else "a capture of the cascade"
        raise RecordingError(f"{path}: {kind} does not name its radar; give it as radar (--radar): a .cfg, .mmwave.json, .yaml or a name")
    if isinstance(radar, Radar):
        if board is not None:
            raise RecordingError(f"radar {radar.name} has its own antennas, so that board {board} cannot apply; leave out --board")
        description = Description({}, Layout(real=radar.real_sampling))
    else:
        radar, description = Radar.described(radar, board)
    if path.suffix in CUBES:
        source = _cube(path, radar)
    elif cascade_capture.is_cascade_capture(path):
        count, read = cascade_capture.frame_reader(path, radar)
        source = _Source(path, radar, range(count), read)
    elif is_trace:
        source = _Source(path, radar, **roverd.opened(path, radar, cut, say))
        description = description._replace(layout=replace(description.layout, q_first=True))
    elif not bin_path.is_file():
        if path.exists():
            raise RecordingError(f"{path}: it is no .bin, .npy or .npz file and no folder of the cascade; convert it to a .npy cube")
        raise MissingError(f"{bin_path}: no such recording; give a .bin, a .npy cube, or the stem of a recording")
    else:
        source = _dca1000(bin_path, radar, description.layout, cut, say)
    return _recorded(source, description, iq_swapped, _frame_range(path, source.frames, frames), say)


def capture_name(path: str | Path) -> str:
    """Return the file name of a capture without its suffix .bin, .json, .npy or .npz. Raise RecordingError if the path has no file name."""
    path = Path(path)
    return path.stem if path.suffix in CUBES else recording_files(path)[0].stem


def band_edge_db(iq: NDArray[np.complexfloating]) -> float:
    """Compute the ratio of the noise just above zero beat frequency to the noise just below zero beat frequency, in decibels.

    The ratio is positive if I comes first, negative if Q comes first, and about zero for a receiver without a filter. With fewer than eight
    chirps or 64 samples per chirp, the function returns zero, because it cannot separate noise from echoes.

    Args:
        iq: samples (chirp, tx, rx, sample) of one frame.
    """
    chirps, samples = iq.shape[0], iq.shape[-1]
    if chirps < 8 or samples < 64:
        return 0.0
    windowed = iq * np.blackman(samples)
    # Echoes fill only a few Doppler bins, so the median over the Doppler bins estimates the noise.
    noise = np.median(np.abs(np.fft.fft2(windowed, axes=(0, -1))) ** 2, axis=0).mean(axis=(0, 1))
    low, high = (noise[round(a * samples) : round(b * samples)].mean() for a, b in ((0.03, 0.07), (0.93, 0.97)))
    return float(10 * np.log10(low / high)) if low > 0 and high > 0 else 0.0


def description_beside(path: Path) -> Path:
    """Find the description of a .bin file by mmWave Studio: the .json or .mmwave.json of the same name, or the only .mmwave.json in its
    folder.

    Raises:
        MissingError: the folder has no such file, or several .mmwave.json files with different names.
    """
    if (plain := path.with_suffix(".json")).is_file() and "mmWaveDevices" in read_json(plain):
        return plain
    candidates = sorted(path.parent.glob("*.mmwave.json"))
    same = [p for p in candidates if p.name == f"{path.stem}.mmwave.json"]
    if len(same or candidates) != 1:
        several, none = f"{len(candidates)} .mmwave.json files are", f"neither {path.stem}.json nor a .mmwave.json is"
        raise MissingError(f"{path}: {several if candidates else none} beside it; give the right radar file as radar (--radar)")
    return (same or candidates)[0]


def spread_frames(frames: int) -> list[int]:
    """Return the numbers of up to EDGE_FRAMES frames that are spread over a recording."""
    return np.unique(np.linspace(0, frames - 1, EDGE_FRAMES).round().astype(int)).tolist()


def few(items: Sequence[object]) -> str:
    """Return the first five items of a list as text."""
    return ", ".join(map(str, items[:5])) + (", ..." if len(items) > 5 else "")


def _instead(content: dict[str, Any]) -> str:
    """Return, as text, which files to give in place of a setup file or a radar description of mmWave Studio."""
    name, radar = "the .bin of the capture", str(content.get("configUsed", "its radar file")).replace("\\", "/").split("/")[-1]
    with contextlib.suppress(KeyError, IndexError, TypeError):
        name = content["capturedFiles"]["files"][0]["processedFileName"]
    return f"give {name}, and {'this file' if 'mmWaveDevices' in content else radar} as radar (--radar)"


def _frame_range(path: Path, usable: range, frames: slice) -> range:
    if not (indices := usable[frames]):
        raise RecordingError(f"{path}: it has {plural(len(usable), 'frame')}, none of which is chosen; choose others with --frames")
    return indices


def _recorded(source: _Source, description: Description, iq_swapped: bool | None, frames: range, say: Say) -> Recording:
    """Read the chosen frames of a capture as a recording in ADC counts, and add what its description and its log say."""
    radar, stated = source.radar, description.layout.q_first
    logged = _log(source, description.frames, say) if source.sample_file is not None and source.times_s is None else {}
    if description.board:
        say(f"board: {description.board}")
    edge = 0.0
    if not radar.real_sampling and description.layout.image_filtered:
        edges = [band_edge_db(source.read(frame, 1)[0]) for frame in _test_frames(source)]
        edge = float(np.mean(edges)) if edges else 0.0
    swapped = iq_swapped
    if swapped is None:
        swapped = edge < 0 if abs(edge) > EDGE_DB else bool(stated)
        if stated is not None and stated != swapped:
            say(f"its description says {'Q' if stated else 'I'} first, but its noise shows the other order, which is used (--iq-swapped)")
    lost: list[int] = []
    factors = None if description.factors is None else np.array(description.factors, np.complex64)[..., None]

    def read(first: int, count: int) -> NDArray[np.complex64]:
        if source.sample_file is not None:
            lost.extend((first + dca1000.lost_frames(source.sample_file.words(first, count)) - frames.start).tolist())
        block = source.read(first, count)
        # The samples Q + jI equal j conj(I + jQ), so the multiplication of their conjugate by j restores I + jQ exactly.
        block = 1j * block.conj() if swapped else block
        return block if factors is None else block * factors

    iq = gathered(source.path, frames, dca1000.frame_shape(radar), read)
    lost[:] = sorted({*lost, *(int(n) - frames.start for n in source.incomplete if n in frames)})
    board = {"board": description.board} if description.board else {}
    provenance = {"source": source.path.name, "unit": "counts", "band_edge_db": round(edge, 1), **board, **logged}
    poses, first = source.poses, frames.start - source.frames.start
    if poses is not None and len(poses) == len(source.frames):
        poses = poses[first : first + len(frames)]
    if source.times_s is not None:
        times_s = source.times_s[frames.start : frames.stop]
        if gaps := int(np.sum(np.diff(times_s) > _GAP / radar.frame_rate_hz)):
            say(f"frames are missing at {gaps} places, where the times have gaps")
        provenance["log"] = {"started": datetime.fromtimestamp(float(times_s[0]), UTC).isoformat(timespec="seconds"), "lost": len(lost)}
    if lost:
        say(f"{len(lost)} of {plural(len(frames), 'frame')} hold lost packets, which are zeros: frame {few(lost)}")
    return Recording(iq, radar, poses, scale=1.0, iq_swapped=bool(swapped), provenance=provenance)


def _log(source: _Source, configured: int, say: Say) -> dict[str, Any]:
    """Return provenance from the log beside a DCA1000 capture, and say which packets and frames are missing."""
    expected, provenance = {"configured": configured}, {}
    if path := studio_log.find_log(source.path):
        log = studio_log.read_log(path, lanes=4 if source.sample_file and source.sample_file.layout.interleaved else 2)
        expected["logged"] = log.frames(dca1000.frame_bytes(source.radar))
        provenance["log"] = asdict(log)
        if log.lost:
            say(f"{log.lost} of {log.received + log.lost} packets were lost ({log.lost_bytes} bytes of zeros)")
        if log.out_of_sequence:
            say(f"{log.out_of_sequence} packets were out of sequence")
    if 0 < configured < len(source.frames):
        say(f"the capture holds {plural(len(source.frames), 'frame')} instead of the {configured} of its description; check --radar")
    if more := {origin: count for origin, count in expected.items() if count > len(source.frames)}:
        missing = ", ".join(f"{count} {origin}" for origin, count in more.items())
        say(f"frames are missing: the capture holds {plural(len(source.frames), 'frame')}, {missing}")
    return {**provenance, "frames": expected}


def _test_frames(source: _Source) -> list[int]:
    """Return up to EDGE_FRAMES frames that are spread over a capture and hold no lost packets."""
    spread, file = [source.frames[n] for n in spread_frames(len(source.frames))], source.sample_file
    return [frame for frame in spread if file is None or not dca1000.lost_frames(file.words(frame, 1)).size]


def _dca1000(path: Path, radar: Radar, layout: Layout, cut: bool, say: Say) -> _Source:
    """Open the files of a DCA1000 capture. Refuse words that are unsigned or in another order without a description that says so."""
    if layout.interleaved and radar.num_rx < 4:
        reason = "its receivers alternate, and the places of fewer than four receivers on the lanes are unknown"
        raise RecordingError(f"{path}: {reason}; record all four receivers, or without interleaving")
    layout, described = dca1000.with_card_settings(layout, path.parent)
    file = dca1000.SampleFile(dca1000.parts(path), radar, replace(layout, q_first=False))
    if lost := file.packets_without_zeros():
        packets = f"{plural(lost, 'packet')} of {dca1000.PACKET_BYTES} bytes without zeros instead"
        raise RecordingError(
            f"{path}: it lacks {packets}, so that later samples are shifted; record again, or fill lost packets with zeros"
        )
    if file.rest and not (cut and file.frames):
        hint = "drop the incomplete frame of an interrupted capture with --cut" if file.frames else "record again"
        raise RecordingError(f"{file.leftover(radar)}; it is truncated or belongs to another radar description; {hint}")
    if file.rest:
        say(f"the last frame is incomplete and dropped ({file.rest} of {file.frame_bytes} bytes)")
    source = _Source(file.path, radar, range(file.frames), file.samples, sample_file=file)
    words = np.concatenate([np.zeros((0, file.frame_bytes // 2), np.int16), *(file.words(n, 1) for n in _test_frames(source)[:4])])
    remedy = "correct the cf.json beside it" if described else "put the cf.json of the capture beside it"
    magnitudes = np.abs((words ^ np.int16(-32768) if layout.unsigned else words).astype(np.int32))
    if words.size and np.median(magnitudes) > _UNSIGNED and np.mean(magnitudes >= FULL_SCALE) < 0.5:
        raise RecordingError(f"{path}: its counts seem {'signed' if layout.unsigned else 'unsigned'}; {remedy} (MSBToggle)")
    if words.size and not (layout.real or layout.interleaved) and radar.num_samples >= 16:
        stated, other = (
            _flatness_db(replace(layout, alternating=order), words, file.shape) for order in (layout.alternating, not layout.alternating)
        )
        if stated - other > _REORDERED_DB:
            order = "I0 I1 Q0 Q1" if layout.alternating else "I0 Q0 I1 Q1"
            raise RecordingError(f"{path}: its samples seem to be in the order {order}; {remedy} (reorderEnable)")
    return source


def _flatness_db(layout: Layout, words: NDArray[np.int16], shape: tuple[int, ...]) -> float:
    """Return the mean level in dB of the range spectra of words. A wrong order spreads each echo over the spectrum and raises the mean."""
    iq = layout.samples(words.reshape(-1), (len(words), *shape))
    power = np.abs(np.fft.fft(iq * np.hanning(shape[-1]), axis=-1)).astype(np.float64) ** 2
    return float(10 * np.log10(power.mean(axis=(0, 1)) + 1e-9 * power.max() + 1e-12).mean())


def _cube(path: Path, radar: Radar) -> _Source:
    """Open an array of samples in a .npy or .npz file."""
    present(path)
    try:
        stored = {"iq": files.read_array(path)} if path.suffix == ".npy" else files.read_arrays(path)
    except (InputError, OSError) as error:
        raise RecordingError(f"{error}; give a {path.suffix} cube of complex samples") from error
    if "iq" not in stored:
        raise RecordingError(f"{path}: it has no array iq; name the array of the samples iq")
    cube: NDArray[Any] = stored["iq"]
    pairs = cube.dtype == np.int16 and cube.ndim > 2 and cube.shape[-1] == 2
    if not pairs and not np.iscomplexobj(cube):
        raise RecordingError(f"{path}: expected complex samples, or int16 with a last axis of I and Q, not {cube.dtype} {cube.shape}")
    axes = cube.shape[:-1] if pairs else cube.shape
    if len(axes) == 2:
        # The array has a single channel. Its successive chirps are one loop of all transmitters apart.
        first = {"tx_positions_m": radar.tx_positions_m[:1], "rx_positions_m": radar.rx_positions_m[:1]}
        radar = replace(radar, **first, chirp_interval=radar.loop_interval_s)
    shape = chirps, tx, rx, samples = dca1000.frame_shape(radar)
    count, frame = (axes[0], axes[1:]) if len(axes) > 3 else (1, axes)
    if frame not in ((chirps, samples), (chirps, tx * rx, samples), (chirps * tx, rx, samples), shape):
        frames = f"whose frames are (chirp, tx, rx, sample) = {shape}"
        raise RecordingError(f"{path}: shape {axes} does not fit radar {radar.name}, {frames}; give its radar")
    if count < 1:
        raise RecordingError(f"{path}: it has zero frames; record again")
    cube = cube.reshape(count, *shape, *([2] if pairs else []))

    def parts(first: int, count: int) -> NDArray[Any]:
        """Return the real and the imaginary parts (2, count, chirp, tx, rx, sample) of frames."""
        scratch.release(cube)  # the pages of the frames before
        block = cube[first : first + count]
        return np.moveaxis(block, -1, 0) if pairs else np.stack([np.real(block), np.imag(block)])

    unsigned, largest = True, 0.0  # whether all real and imaginary parts are whole numbers from 0 to 65535, and the largest part
    for frame in range(count):
        values = parts(frame, 1)
        with np.errstate(over="ignore"):  # a value beyond the range of float32 becomes infinite
            if not np.isfinite(values.astype(np.float32)).all():
                raise RecordingError(f"{path}: frame {frame} holds NaN or infinite samples; record or simulate it again")
        largest = max(largest, float(values.max()))
        unsigned = unsigned and values.min() >= 0 and largest <= 65535 and np.array_equal(values, np.rint(values))

    def read(first: int, count: int) -> NDArray[np.complex64]:
        values = parts(first, count)
        if unsigned and largest > FULL_SCALE:  # 16 bits whose sign was lost
            values = values.astype(np.uint16).view(np.int16)
        real, imag = values.astype(np.float32)
        return real + np.complex64(1j) * imag

    return _Source(path, radar, range(count), read, stored.get("poses"))
