"""Read raw radar data (captures) of other tools as recordings: mmWave Studio .bin files with .mmwave.json, sample arrays in .npy files, and
folders with the files of a cascade.

A capture of another tool has no amplitude calibration, so the samples of its recording are in ADC counts and its scale is 1. If the caller
does not state whether I or Q comes first, this module finds the sample order from the noise spectrum. The receive filter passes beat
frequencies from 0 to 0.9 fs (complex 1x mode), where fs is the sample rate. The noise is therefore lower just below fs, which appears just
below zero in the sampled spectrum. If I and Q are exchanged, the spectrum is mirrored. The echoes do not show the sample order, because
with complex sampling they may fill the whole band.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import InputError, MissingError, RecordingError
from radartwin.io import files
from radartwin.radar import cascade_capture, dca1000
from radartwin.radar.chirp import Radar
from radartwin.radar.recording import Recording, read_counts, recording_files

CUBES = (".npy", ".npz")  # suffixes of files with an array of samples
EDGE_DB = 2.0  # smallest magnitude of band_edge_db that determines the sample order; real captures have 2.7 to 9.9 dB


def load_capture(path: str | Path, radar: Radar | str | Path | None = None, *, iq_swapped: bool | None = None) -> Recording:
    """Read a recording of this package, a mmWave Studio capture, or an array of samples in a .npy or .npz file.

    Args:
        path: path of a recording of this package (without suffix, or with .bin or .json), of a mmWave Studio .bin file with one
            .mmwave.json in its folder, or of a .npy file. For a capture in several .bin files, the path of any of these files selects the
            whole capture. The array in a .npy file has the shape [chirp, sample], [chirp, channel, sample], [frame, chirp, channel, sample]
            or [frame, chirp, tx, rx, sample], with channels ordered by transmitter first. The samples of the array are complex, or int16
            with an additional last axis of I and Q. A .npz file holds this array as `iq`, and may hold the poses of the radar as `poses`
            (F, 4, 4). A folder with the files of the cascade's capture board is a capture too (radartwin.radar.cascade_capture).
        radar: a Radar or the path of a radar file. An array and a capture of the cascade require `radar`; for a .bin file, `radar` replaces
            the .mmwave.json.
        iq_swapped: whether Q comes before I in a capture of another tool. None detects the sample order from the noise. For a recording of
            this package, the .json file gives the sample order.
    Raises:
        MissingError: the capture or its radar description is missing.
        RecordingError: the size of the capture does not fit the radar, or samples are NaN or infinite.
    """
    path = Path(path)
    if radar is not None and not isinstance(radar, Radar):
        radar = Radar.from_file(radar)
    if path.suffix in CUBES:
        return _load_cube(path, radar, iq_swapped)
    if cascade_capture.is_cascade_capture(path):
        if radar is None:
            raise RecordingError(f"{path}: a capture of the cascade does not name its radar; give it (--radar), such as awr2243_cascade")
        return from_counts(path, cascade_capture.read_counts(path, radar), radar, iq_swapped)
    bin_path, json_path = recording_files(path)
    if radar is None and (json_path.is_file() or not bin_path.is_file()):
        return Recording.load(path)
    if not bin_path.is_file():
        raise MissingError(f"{bin_path}: no such recording; give a .bin, a .npy cube, or the stem of a recording")
    bin_path, *others = dca1000.parts(bin_path)
    if radar is None:
        radar = Radar.from_file(description_beside(bin_path))
    return from_counts(bin_path, read_counts(bin_path, radar, others=others), radar, iq_swapped)


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


def from_counts(path: Path, iq: NDArray[np.complex64], radar: Radar, iq_swapped: bool | None) -> Recording:
    """Make a recording in ADC counts from the samples of another tool.

    Args:
        path: path of the source file, which the provenance of the recording names.
        iq: samples [frame, chirp, tx, rx, sample] in ADC counts, read under the assumption that I comes first.
        radar: radar that recorded the samples.
        iq_swapped: whether Q comes first in the source file; None detects the sample order from the noise.
    """
    edge = 0.0 if radar.real_sampling else band_edge_db(iq[0])
    if iq_swapped is None:
        iq_swapped = edge < -EDGE_DB
    if iq_swapped:
        # The samples Q + jI equal j conj(I + jQ), so the multiplication of their conjugate by j restores I + jQ exactly.
        iq = 1j * iq.conj()
    provenance: dict[str, Any] = {"source": path.name, "unit": "counts", "band_edge_db": round(edge, 1)}
    return Recording(iq, radar, scale=1.0, iq_swapped=bool(iq_swapped), provenance=provenance)


def description_beside(path: Path) -> Path:
    """Find the .mmwave.json file of a .bin file: the only .mmwave.json in its folder, or the .mmwave.json of the same name.

    Raises:
        MissingError: the folder has no such file, or several .mmwave.json files with different names.
    """
    found = sorted(path.parent.glob("*.mmwave.json"))
    same = [p for p in found if p.name.removesuffix(".mmwave.json") == path.stem]
    if len(found) == 1 or same:
        return (same or found)[0]
    if found:
        raise MissingError(f"{path}: {len(found)} .mmwave.json files are beside it; give the right file as radar (--radar)")
    raise MissingError(f"{path}: neither {path.stem}.json nor a .mmwave.json is beside it; give a radar file as radar (--radar)")


def _load_cube(path: Path, radar: Radar | None, iq_swapped: bool | None) -> Recording:
    if not path.is_file():
        raise MissingError(f"{path}: no such file; check the path")
    if radar is None:
        raise RecordingError(f"{path}: a {path.suffix} cube does not name its radar; give a .cfg, .mmwave.json or .yaml as radar (--radar)")
    try:
        stored = {"iq": files.read_array(path)} if path.suffix == ".npy" else files.read_arrays(path)
    except (InputError, OSError) as error:
        raise RecordingError(f"{error}; give a {path.suffix} cube of complex samples") from error
    if "iq" not in stored:
        raise RecordingError(f"{path}: it has no array iq; name the array of the samples iq")
    cube = stored["iq"]
    if cube.dtype == np.int16 and cube.ndim > 2 and cube.shape[-1] == 2:
        cube = (cube[..., 0] + 1j * cube[..., 1]).astype(np.complex64)
    if not np.iscomplexobj(cube):
        raise RecordingError(f"{path}: expected complex samples, or int16 with a last axis of I and Q, not {cube.dtype} {cube.shape}")
    if cube.ndim == 2:
        # The array has a single channel. Its successive chirps are one loop of all transmitters apart.
        radar = replace(
            radar,
            tx_positions_m=radar.tx_positions_m[:1],
            rx_positions_m=radar.rx_positions_m[:1],
            chirp_interval=radar.loop_interval_s,
        )
    shape = dca1000.frame_shape(radar)
    frames = cube.shape[0] if cube.ndim > 3 else 1
    if cube.ndim not in (2, 3, 4, 5) or cube.size != frames * np.prod(shape) or cube.shape[-1] != radar.num_samples:
        raise RecordingError(
            f"{path}: shape {cube.shape} does not fit radar {radar.name}, whose frames are (chirp, tx, rx, sample) = {shape}; give the "
            "right radar"
        )
    if frames < 1:
        raise RecordingError(f"{path}: it has zero frames; record again")
    cube = cube.reshape(frames, *shape)
    with np.errstate(over="ignore"):  # a value beyond the range of complex64 becomes infinite
        broken = next((frame for frame in range(frames) if not np.isfinite(cube[frame].astype(np.complex64)).all()), None)
    if broken is not None:
        raise RecordingError(f"{path}: frame {broken} holds NaN or infinite samples; record or simulate it again")
    recording = from_counts(path, _signed(cube), radar, iq_swapped)
    return replace(recording, sensor_poses=stored.get("poses"))


def _signed(cube: NDArray[np.complexfloating]) -> NDArray[np.complex64]:
    """Reinterpret unsigned 16-bit counts as signed counts, if all real and imaginary parts are whole numbers from 0 to 65535."""
    parts = np.stack([cube.real, cube.imag])
    if parts.min() >= 0 and 32767 < parts.max() <= 65535 and np.array_equal(parts, np.rint(parts)):
        parts = parts.astype(np.uint16).view(np.int16)
    return (parts[0] + 1j * parts[1].astype(np.float64)).astype(np.complex64)
