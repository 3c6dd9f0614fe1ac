"""Read captures of other tools as recordings: mmWave Studio .bin with its .mmwave.json, and .npy cubes.

A capture of another tool (a foreign capture) has no amplitude calibration, so its iq is in ADC counts and its scale is 1.
Unless the caller states whether I or Q comes first, the noise spectrum shows the sample order. The receive filter passes beat
frequencies from 0 to 0.9 fs (complex 1x mode), so the noise is lower just below fs, which in the sampled spectrum is just
below zero. If I and Q are exchanged, the spectrum is mirrored. The echoes do not show the sample order, because with complex
sampling they may fill the whole band.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import InputError, MissingError, RecordingError
from radartwin.io import files
from radartwin.radar import dca1000
from radartwin.radar.chirp import Radar
from radartwin.radar.recording import Recording, read_counts, recording_files

EDGE_DB = 2.0  # smallest band_edge_db that shows the sample order; real captures have 2.7 to 9.9 dB


def load_capture(path: str | Path, radar: Radar | str | Path | None = None, *, iq_swapped: bool | None = None) -> Recording:
    """Read a recording of this package, a mmWave Studio capture or a .npy cube.

    Args:
        path: a recording (stem, .bin or .json); a raw .bin with one .mmwave.json in its folder; or a .npy
            cube shaped [chirp, sample], [chirp, channel, sample], [frame, chirp, channel, sample] or
            [frame, chirp, tx, rx, sample], channels transmitter-major.
        radar: a Radar or the path of a radar file. A .npy cube requires `radar`; for a .bin, `radar` replaces the .mmwave.json.
        iq_swapped: whether Q comes before I in a foreign capture; None detects the sample order from the noise. For
            recordings of this package the .json holds the sample order.
    Raises:
        MissingError: the capture or its radar description is missing.
        RecordingError: the size of the capture does not fit the radar.
    """
    path = Path(path)
    if radar is not None and not isinstance(radar, Radar):
        radar = Radar.from_file(radar)
    if path.suffix == ".npy":
        return _load_cube(path, radar, iq_swapped)
    bin_path, json_path = recording_files(path)
    if radar is None and (json_path.is_file() or not bin_path.is_file()):
        return Recording.load(path)
    if not bin_path.is_file():
        raise MissingError(f"{bin_path}: no such recording; give a .bin, a .npy cube, or the stem of a recording")
    if radar is None:
        radar = Radar.from_file(description_beside(bin_path))
    return from_counts(bin_path, read_counts(bin_path, radar), radar, iq_swapped)


def capture_name(path: str | Path) -> str:
    """Return the file name of a capture without .bin, .json or .npy. Raises RecordingError for a path without a file name."""
    path = Path(path)
    return path.stem if path.suffix == ".npy" else recording_files(path)[0].stem


def band_edge_db(iq: NDArray[np.complexfloating]) -> float:
    """Compute the ratio of noise just above to noise just below zero beat frequency, in decibels.

    The ratio is positive if I comes first, negative if Q comes first, and about zero for a receiver without a filter. With fewer
    than eight chirps the function returns zero, because noise and echoes cannot be separated.

    Args:
        iq: one frame, (chirp, tx, rx, sample).
    """
    chirps, samples = iq.shape[0], iq.shape[-1]
    if chirps < 8 or samples < 64:
        return 0.0
    windowed = iq * np.blackman(samples)
    # Echoes fill few Doppler bins, so the median over Doppler estimates the noise.
    noise = np.median(np.abs(np.fft.fft2(windowed, axes=(0, -1))) ** 2, axis=0).mean(axis=(0, 1))
    low, high = (noise[round(a * samples) : round(b * samples)].mean() for a, b in ((0.03, 0.07), (0.93, 0.97)))
    return float(10 * np.log10(low / high)) if low > 0 and high > 0 else 0.0


def from_counts(path: Path, iq: NDArray[np.complex64], radar: Radar, iq_swapped: bool | None) -> Recording:
    """Make a recording in ADC counts from samples that were read as if I came first.

    Args:
        path: the source file, for the provenance.
        iq_swapped: whether Q comes first in the source; None detects the sample order from the noise.
    """
    edge = 0.0 if radar.real_sampling else band_edge_db(iq[0])
    if iq_swapped is None:
        iq_swapped = edge < -EDGE_DB
    if iq_swapped:
        # Samples Q + jI equal j conj(I + jQ), so multiplying their conjugate by j restores I + jQ exactly.
        iq = 1j * iq.conj()
    provenance: dict[str, Any] = {"source": path.name, "unit": "counts", "band_edge_db": round(edge, 1)}
    return Recording(iq, radar, scale=1.0, iq_swapped=bool(iq_swapped), provenance=provenance)


def description_beside(path: Path) -> Path:
    """Find the .mmwave.json of a .bin: the only such file in its folder, or the file of the same name. Raises MissingError."""
    found = sorted(path.parent.glob("*.mmwave.json"))
    same = [p for p in found if p.name.removesuffix(".mmwave.json") == path.stem]
    if len(found) == 1 or same:
        return (same or found)[0]
    if found:
        raise MissingError(f"{path}: {len(found)} .mmwave.json files are beside it; give the file of its radar")
    raise MissingError(f"{path}: neither {path.stem}.json nor a .mmwave.json is beside it; give the radar file")


def _load_cube(path: Path, radar: Radar | None, iq_swapped: bool | None) -> Recording:
    if not path.is_file():
        raise MissingError(f"{path}: no such file")
    if radar is None:
        raise RecordingError(f"{path}: a .npy cube does not name its radar; give a .cfg, .mmwave.json or .yaml")
    try:
        cube = files.read_array(path)
    except (InputError, OSError) as error:
        raise RecordingError(f"{error}; give a .npy cube of complex samples") from error
    if not np.iscomplexobj(cube):
        raise RecordingError(f"{path}: expected complex samples, not {cube.dtype}")
    if cube.ndim == 2:
        # The cube has one channel, but its chirps repeat at the loop interval of all transmitters.
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
            f"{path}: shape {cube.shape} does not fit radar {radar.name}, whose frames are (chirp, tx, rx, sample) = {shape}"
        )
    if frames < 1:
        raise RecordingError(f"{path}: it has zero frames; record again")
    return from_counts(path, _signed(cube).reshape(frames, *shape), radar, iq_swapped)


def _signed(cube: NDArray[np.complexfloating]) -> NDArray[np.complex64]:
    """Reinterpret unsigned 16-bit counts as signed counts, if all real and imaginary parts of the cube are unsigned 16-bit integers."""
    parts = np.stack([cube.real, cube.imag])
    if parts.min() >= 0 and 32767 < parts.max() <= 65535 and np.array_equal(parts, np.rint(parts)):
        parts = parts.astype(np.uint16).view(np.int16)
    return (parts[0] + 1j * parts[1].astype(np.float64)).astype(np.complex64)
