"""Store a recording (IQ samples and their radar) as a .bin file in the DCA1000 format and a .json file of the same name.

The .json file holds the radar, the amplitude per ADC count (scale), the sensor poses and the provenance. `load` multiplies the counts by
the scale, so saving a loaded recording writes the same .bin file. `save` first writes both files under temporary names and then renames
them, the .json file last. A .bin file without its .json file is therefore the result of an interrupted save. `load` keeps the samples of
a large recording on disk (radartwin.io.scratch) and maps them into memory.
"""

from __future__ import annotations

import contextlib
import json
import math
import reprlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import OutputError, RecordingError
from radartwin.io import files, scratch
from radartwin.io.one_line import plural
from radartwin.radar import dca1000
from radartwin.radar.chirp import Radar
from radartwin.radar.description_files import present, read_json
from radartwin.radar.field_checks import check_rigid
from radartwin.radar.word_order import FULL_SCALE, Layout

_FORMAT = "radartwin recording 1"
_PAIR = "a recording needs a .bin and a .json of the same name"
# If a recording has no scale, `save` writes the recording's largest value as this ADC count, which is 6 dB below clipping.
_PEAK_COUNT = FULL_SCALE // 2
_BLOCK_BYTES = 64 << 20
_SAVED_BYTES = 8 << 20  # size of the samples that `save` and `load` convert at once; the conversion needs seven times this memory
MAPPED_BYTES = 1 << 30  # `load` maps recordings with more bytes of complex samples into memory
_SCALES = (1e-37, 1e33)  # limits of the scale, within which all counts times scale are finite, normal float32 numbers


@dataclass
class Recording:
    """Hold the IQ samples of one radar over a number of frames.

    Attributes:
        iq: complex64 samples [frame, chirp, tx, rx, sample] in amplitude units, so that |iq|^2 is received over transmitted power. In a
            recording that another tool captured, iq is in ADC counts and scale is 1.
        radar: radar that recorded the samples.
        sensor_poses: transformations from the sensor frame to the world, (F, 4, 4) for F frames, or (1, 4, 4) for a radar at rest. None
            means that the poses are unknown.
        scale: amplitude per ADC count; None until the receiver simulation or `save` sets the scale.
        iq_swapped: whether the .bin file holds Q before I.
        saturated: number of int16 values that `save` clipped.
        provenance: description of how the recording was made, as plain JSON values.
    """

    iq: NDArray[np.complex64]
    radar: Radar
    sensor_poses: NDArray[np.float64] | None = None
    scale: float | None = None
    iq_swapped: bool = False
    saturated: int = 0
    provenance: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        where, expected = f"recording of radar {self.radar.name}", dca1000.frame_shape(self.radar)
        self.iq = np.asarray(self.iq, dtype=np.complex64)
        if self.iq.ndim != 5 or self.iq.shape[1:] != expected:
            axes = f"[frame, chirp, tx, rx, sample] = (F, {', '.join(map(str, expected))})"
            raise RecordingError(f"{where}: iq must be {axes}, not {self.iq.shape}")
        if self.num_frames < 1:
            raise RecordingError(f"{where}: it has zero frames; give at least one")
        if self.scale is not None:
            _check_scale(self.scale, "recording")
        if self.sensor_poses is not None:
            try:
                self.sensor_poses = np.asarray(self.sensor_poses, dtype=np.float64)
            except (TypeError, ValueError, OverflowError):
                self.sensor_poses = np.empty(0)
            if self.sensor_poses.shape not in ((self.num_frames, 4, 4), (1, 4, 4)):
                raise RecordingError(f"{where}: sensor_poses must be numbers of the shape ({self.num_frames}, 4, 4) or (1, 4, 4)")
            check_rigid(self.sensor_poses, f"{where}: sensor_poses", RecordingError)

    @property
    def num_frames(self) -> int:
        return self.iq.shape[0]

    @property
    def in_counts(self) -> bool:
        """Whether another tool captured the recording without amplitude calibration, so that the samples are in ADC counts."""
        return self.provenance.get("unit") == "counts"

    def part(self, frames: range) -> Recording:
        """Return a recording of consecutive frames of this recording."""
        poses, selection = self.sensor_poses, slice(frames.start, frames.stop)
        return replace(self, iq=self.iq[selection], sensor_poses=poses[selection] if poses is not None and len(poses) > 1 else poses)

    def frame_blocks(self, block_bytes: int = _BLOCK_BYTES) -> Iterator[slice]:
        """Yield slices of consecutive frames, each with about `block_bytes` of samples.

        After each block, the pages of a memory-mapped recording leave the memory.
        """
        step = max(1, block_bytes // max(1, self.iq[:1].nbytes))
        for start in range(0, self.num_frames, step):
            yield slice(start, min(start + step, self.num_frames))
            scratch.release(self.iq)

    def save(self, path: str | Path, *, iq_swapped: bool | None = None) -> int:
        """Write the files path.bin and path.json, and set the fields `scale`, `iq_swapped` and `saturated` of the recording.

        If `scale` is None, the method chooses a scale with which the largest sample is near half of the ADC's full scale.

        Args:
            path: path of the recording without suffix; a suffix .bin or .json is ignored.
            iq_swapped: whether to write Q before I; None keeps the sample order of the recording.
        Returns:
            Number of int16 values that the method clipped to the 16-bit range.
        Raises:
            RecordingError: samples are NaN or infinite.
            OutputError: the folder cannot be written. No temporary file remains in this case.
        """
        bin_path, json_path = recording_files(path)
        swapped = self.iq_swapped if iq_swapped is None else iq_swapped
        scale = self._peak_scale() if self.scale is None else self.scale
        saturated, layout = 0, Layout(real=self.radar.real_sampling, q_first=swapped)
        with files.replacing_together([bin_path, json_path]) as temporary:
            with temporary[bin_path].open("wb") as stream:
                for block in self.frame_blocks(_SAVED_BYTES):
                    words, clipped = layout.words(self.iq[block], scale)
                    stream.write(words.tobytes())
                    saturated += clipped
            with temporary[json_path].open("w", encoding="utf-8") as stream:
                described = {
                    "format": _FORMAT, "frames": self.num_frames, "scale": scale, "iq_swapped": swapped, "saturated": saturated,
                    "radar": self.radar.to_dict(), "provenance": self.provenance,
                    "sensor_poses": None if self.sensor_poses is None else self.sensor_poses.tolist(),
                }  # fmt: skip
                json.dump(described, stream, indent=1, allow_nan=False)
                stream.write("\n")
        self.scale, self.iq_swapped, self.saturated = scale, swapped, saturated
        return saturated

    @classmethod
    def load(cls, path: str | Path) -> Recording:
        """Read a recording from the files path.bin and path.json. The loaded samples are ADC counts times scale.

        Raises:
            MissingError: one of the two files is missing.
            RecordingError: the .json file is malformed or does not match the .bin file, or the .bin file is truncated or empty.
        """
        bin_path, json_path = recording_files(path)
        present(bin_path, _PAIR)
        radar, described = read_described(path)
        scale = _check_scale(described["scale"], str(json_path))
        swapped = described.get("iq_swapped", False)
        if not isinstance(swapped, bool):
            raise RecordingError(f"{json_path}: iq_swapped must be true or false, not {reprlib.repr(swapped)}")
        stored = dca1000.SampleFile([bin_path], radar, Layout(real=radar.real_sampling, q_first=swapped))
        if stored.rest:
            raise RecordingError(f"{stored.leftover(radar)}; the file is truncated or belongs to another radar description")
        counts = gathered(bin_path, range(stored.frames), stored.shape, stored.samples, scale)
        frames = described.get("frames", len(counts))
        if frames != len(counts):
            held = plural(len(counts), "frame")
            raise RecordingError(f"{bin_path}: it holds {held} but {json_path.name} says {frames}; copy both files of one recording")
        poses = described.get("sensor_poses")
        try:
            return cls(
                counts,
                radar,
                sensor_poses=poses,
                scale=scale,
                iq_swapped=swapped,
                saturated=int(described.get("saturated", 0)),
                provenance=dict(described.get("provenance", {})),
            )
        except (TypeError, ValueError, OverflowError) as error:
            raise RecordingError(f"{json_path}: {error}") from error

    def _peak_scale(self) -> float:
        peak = max(float(max(np.abs(self.iq[b].real).max(), np.abs(self.iq[b].imag).max())) for b in self.frame_blocks(_SAVED_BYTES))
        if not math.isfinite(peak):
            raise RecordingError("the recording holds NaN or infinite samples, which int16 cannot hold; simulate or record it again")
        return peak / _PEAK_COUNT if peak > 0 else 1.0


def read_described(path: str | Path) -> tuple[Radar, dict[str, Any]]:
    """Read the radar of a recording and the content of its .json file, without reading the samples.

    Raises:
        MissingError: the .json file is missing.
        RecordingError: the .json file is malformed.
    """
    json_path = present(recording_files(path)[1], _PAIR)
    content = read_json(json_path)
    for key in ("radar", "scale"):
        if key not in content:
            raise RecordingError(f"{json_path}: it has no {key!r}; give the .json of a recording that RadarTwin saved")
    if (written := content.get("format", _FORMAT)) != _FORMAT:
        raise RecordingError(f"{json_path}: format {reprlib.repr(written)} is not '{_FORMAT}'; save the recording again with this version")
    try:
        return Radar.from_dict(content["radar"]), content
    except (ValueError, TypeError) as error:
        raise RecordingError(f"{json_path}: {error}") from error


def refuse_foreign(path: str | Path) -> None:
    """Raise OutputError if one of the files of a recording exists and was not written by `Recording.save`, such as a real capture."""
    bin_path, json_path = recording_files(path)
    if bin_path.exists() or json_path.exists():
        try:
            is_recording = json.loads(json_path.read_text(encoding="utf-8"))["format"].startswith(_FORMAT.rstrip("0123456789"))
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            is_recording = False
        if not is_recording:
            raise OutputError(f"{bin_path} or {json_path.name} exists and is no recording of RadarTwin; choose another name")


def recording_files(path: str | Path) -> tuple[Path, Path]:
    """Return the paths of a recording's .bin file and .json file. The argument `path` may end with .bin, with .json or without suffix.

    Raises:
        RecordingError: `path` has no file name.
    """
    path = Path(path)
    given = {path.suffix.lower(): path} if path.suffix.lower() in (".bin", ".json") else {}
    name = path.name[: -len(path.suffix)] if given else path.name
    if not name.strip("."):
        raise RecordingError(f"'{path}' names no recording; give FOLDER/NAME")
    return given.get(".bin", path.with_name(name + ".bin")), given.get(".json", path.with_name(name + ".json"))


def gathered(
    path: Path, frames: range, shape: tuple[int, ...], read: Callable[[int, int], NDArray[np.complex64]], scale: float = 1.0
) -> NDArray[np.complex64]:
    """Collect frames, times `scale`, in blocks. More than MAPPED_BYTES of samples are written to a scratch file and mapped into memory.

    Args:
        path: path of the source, beside which the scratch file lies.
        read: function that returns frames as an array, from the number of the first frame and the number of frames.
    Raises:
        OutputError: the samples of a large recording fit neither on the disk of the source nor on the disk of the temporary files.
    """
    frame_size = math.prod(shape) * np.dtype(np.complex64).itemsize
    mapped = len(frames) * frame_size > MAPPED_BYTES
    step = max(1, _SAVED_BYTES // frame_size)
    blocks = (read(frames[n], min(step, len(frames) - n)) for n in range(0, len(frames), step))
    scaled = (block if scale == 1 else block * (np.float32(scale) if np.float32(scale) == scale else scale) for block in blocks)
    if mapped:
        with contextlib.closing(scratch.ScratchArray(scratch.folder_for(path), (len(frames), *shape), np.complex64)) as stored:
            for block in scaled:
                stored.write(block)
            return stored.array()
    samples = np.empty((len(frames), *shape), np.complex64)
    for n, block in enumerate(scaled):
        samples[n * step : n * step + len(block)] = block
    return samples


def _check_scale(scale: Any, where: str) -> float:
    low, high = _SCALES
    if isinstance(scale, bool) or not isinstance(scale, int | float) or not low <= scale <= high:
        raise RecordingError(f"{where}: scale must be an amplitude per count from {low:g} to {high:g}, not {reprlib.repr(scale)}")
    return float(scale)
