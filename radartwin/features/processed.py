"""Process recordings into the input of every feature: range profiles, azimuth channels and Doppler spectra of each frame.

Symbols: s_fcv(r) -> range profile of frame f, chirp c and virtual channel v (Hann window over the samples).
- Power P(f, r) = mean_v |mean_c s_fcv(r)|^2 is coherent over chirps and incoherent over channels.
- Channels A_fv(r) = mean_c s_fcv(r) exist for the channels v of the azimuth row only.
- Doppler D(f, u, r) = mean_v |sum_c w_c s_fcv(r) exp(-j 2 pi u c / C)|^2 has a Hann window w over the chirps.
- Noise N(r) is the power P without echoes. It is estimated from the Doppler bin of the highest speed, because nothing indoors moves so
  fast: N = mean_f D / (C sum_c w_c^2), where the divisor converts from D to P. A slow echo leaks less than -60 dB into this bin.
An echo of amplitude a in the centre of its bins gives P = D = a^2 and A = a. An echo that moves at 0.2 m/s loses 0.7 dB in P and A. Range
bins end at MAX_RANGE_M, because no feature uses larger ranges.
"""

from __future__ import annotations

import io
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import InputError, MissingError, RecordingError
from radartwin.io import files
from radartwin.radar.chirp import Radar
from radartwin.radar.description_files import read_json
from radartwin.radar.processing import azimuth_row, doppler_fft, hann, range_fft, velocity_axis
from radartwin.radar.recording import Recording

MAX_RANGE_M = 6.0
MIN_CHIRPS = 8  # with fewer chirps, echoes at rest leak into the Doppler bin of the highest speed
_ARRAYS, _RADAR = "processed.npz", "processed.json"


@dataclass(frozen=True, eq=False)
class Processed:
    """Hold power, azimuth channels and Doppler spectra of F frames in B range bins.

    Attributes:
        range_m: (B,) bin centres in metres.
        power: (F, B) float32, in squared amplitude units.
        channels: (F, A, B) complex64, the A channels of `azimuth_row` in its order.
        doppler: (F, C, B) float32 over `velocity_mps` (C,), ascending and receding positive; None if not requested.
        noise: (B,) float32, noise power in `power`; None with fewer than MIN_CHIRPS chirps, and features then assume zero noise.
    """

    radar: Radar
    range_m: NDArray[np.float64]
    power: NDArray[np.float32]
    channels: NDArray[np.complex64]
    doppler: NDArray[np.float32] | None
    velocity_mps: NDArray[np.float64]
    noise: NDArray[np.float32] | None = None

    def __post_init__(self) -> None:
        frames, bins = len(self.power), len(self.range_m)
        expected = {"power": (frames, bins), "channels": (frames, len(azimuth_row(self.radar)), bins)}
        if self.doppler is not None:
            expected["doppler"] = (frames, len(self.velocity_mps), bins)
        if self.noise is not None:
            expected["noise"] = (bins,)
        for name, shape in expected.items():
            if getattr(self, name).shape != shape:
                raise InputError(f"processed recording: {name} must be {shape}, not {getattr(self, name).shape}")
        if not frames:
            raise InputError("processed recording: it has zero frames; give at least one")

    @property
    def num_frames(self) -> int:
        return len(self.power)

    @property
    def noise_floor(self) -> NDArray[np.float64]:
        """Return the noise power (B,), or zeros if `noise` is None."""
        return np.zeros(len(self.range_m)) if self.noise is None else self.noise.astype(np.float64)

    def frames(self, chosen: slice | NDArray) -> Processed:
        """Select frames; the arrays of the result are views if `chosen` is a slice."""
        doppler = None if self.doppler is None else self.doppler[chosen]
        return Processed(self.radar, self.range_m, self.power[chosen], self.channels[chosen], doppler, self.velocity_mps, self.noise)

    def save(self, folder: str | Path) -> None:
        """Write the recording into a folder. The arrays are written last, so that `load` refuses an interrupted save."""
        folder = Path(folder)
        arrays = {"range_m": self.range_m, "power": self.power, "channels": self.channels, "velocity_mps": self.velocity_mps}
        arrays |= {name: value for name in ("doppler", "noise") if (value := getattr(self, name)) is not None}
        stream = io.BytesIO()
        np.savez(stream, allow_pickle=False, **arrays)
        files.write_atomically(folder / _RADAR, json.dumps({"radar": self.radar.to_dict()}, indent=1, allow_nan=False) + "\n")
        files.write_atomically(folder / _ARRAYS, stream.getvalue())

    @classmethod
    def load(cls, folder: str | Path) -> Processed:
        """Read a processed recording from a folder that `save` wrote.

        Raises:
            MissingError: either file is missing.
            RecordingError: a file is damaged or belongs to another radar.
        """
        folder = Path(folder)
        for name in (_RADAR, _ARRAYS):
            if not (folder / name).is_file():
                raise MissingError(f"{folder / name}: no such file; a processed recording needs {_ARRAYS} and {_RADAR}")
        try:
            radar = Radar.from_dict(read_json(folder / _RADAR)["radar"])
            data = files.read_arrays(folder / _ARRAYS)
            range_m, power, channels, velocity_mps = (data[name] for name in ("range_m", "power", "channels", "velocity_mps"))
            return cls(radar, range_m, power, channels, data.get("doppler"), velocity_mps, data.get("noise"))
        except (KeyError, ValueError, OSError) as error:
            raise RecordingError(f"{folder}: not a processed recording ({error}); delete it and process the recording again") from error


def process(recording: Recording, doppler: bool = True) -> Processed:
    """Compute power, channels and Doppler of a recording. Blocks of frames limit the memory.

    Args:
        doppler: also compute the range-Doppler power, which is as large as C (the number of chirps) times `power`.
    Raises:
        RecordingError: samples are NaN or infinite.
    """
    radar, row = recording.radar, azimuth_row(recording.radar)
    taps = hann(radar.num_chirps)
    fastest = (taps * (-1.0) ** np.arange(radar.num_chirps)).astype(np.float32)  # window for the Doppler bin of the highest speed
    power, channels, cubes, noise = [], [], [], []
    range_m = np.zeros(0)
    for block in recording.frame_blocks():
        iq = recording.iq[block]
        sums, range_m = _profiles(np.stack([iq.mean(axis=1), np.tensordot(iq, fastest, (1, 0))], axis=1), radar)
        coherent = sums[:, 0].reshape(len(iq), -1, len(range_m))
        if not np.isfinite(coherent).all():
            raise RecordingError("the recording holds NaN or infinite samples; simulate or record it again")
        power.append((np.abs(coherent) ** 2).mean(axis=1, dtype=np.float64).astype(np.float32))
        channels.append(coherent[:, row].astype(np.complex64))
        noise.append((np.abs(sums[:, 1]) ** 2).mean(axis=(1, 2), dtype=np.float64))
        if doppler:
            spectra, _ = doppler_fft(_profiles(iq, radar)[0], radar)
            cubes.append((np.abs(spectra) ** 2).mean(axis=(2, 3)).astype(np.float32))
    floor = np.concatenate(noise).mean(axis=0) / (radar.num_chirps * np.sum(taps**2))
    return Processed(
        radar,
        range_m,
        np.concatenate(power),
        np.concatenate(channels),
        np.concatenate(cubes) if doppler else None,
        velocity_axis(radar, radar.num_chirps),
        floor.astype(np.float32) if radar.num_chirps >= MIN_CHIRPS else None,
    )


def _profiles(iq: NDArray[np.complexfloating], radar: Radar) -> tuple[NDArray[np.complexfloating], NDArray[np.float64]]:
    """Compute range profiles up to MAX_RANGE_M, and their range axis in metres."""
    profiles, range_m = range_fft(iq, radar)
    near = range_m <= MAX_RANGE_M
    return profiles[..., near], range_m[near]
