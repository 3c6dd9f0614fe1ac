"""Process recordings into the data from which all features are computed: power, azimuth channels and Doppler spectra of each frame.

The formulas use the range profile s_fcv(r) of frame f, chirp c (of C chirps) and virtual channel v at range r, with a Hann window over the
samples. The chirps of a frame form K consecutive blocks of nearly equal length. Block k has C_k chirps and lasts at most BLOCK_S.
- The power P(f, r) = mean_v sum_k (C_k / C) |mean_{c in k} s_fcv(r)|^2 is averaged coherently over the chirps of a block, and incoherently
  over blocks and channels. A coherent average over a long frame would lose the echo of a moving target.
- The azimuth channels A_fv(r) = mean_{c in k} s_fcv(r) use the block k = K // 2 in the middle of the frame. The azimuth channels exist only
  for the virtual channels v of the azimuth row. A contains the phase that a moving echo gains between the chirps of two transmitters.
- The Doppler spectrum D(f, u, r) = mean_v |sum_c w_c s_fcv(r) exp(-j 2 pi u c / C)|^2 has a Hann window w over the chirps.
- The noise N(r) is the power P that noise without echoes would have. The noise is estimated from the Doppler bin of the highest speed,
  because nothing indoors moves so fast. The formula is N = K mean_f D / (C sum_c w_c^2), where the factor converts from D to P. A slow echo
  leaks into this Doppler bin with less than -60 dB.
An echo of amplitude a in the centre of its range bin and Doppler bin gives P = D = a^2 and A = a if its phase is constant over a block. An
echo with the speed v has the phase step x = 4 pi v T / lambda_c between the C_k chirps of one transmitter, which are T apart. The speed
multiplies P and |A|^2 by |sin(C_k x / 2) / (C_k sin(x / 2))|^2. This factor is a loss of 0.7 dB at 77 GHz for 0.2 m/s and a block of 2 ms.
The frame of the IWR1843 is one block. The frame of the cascade has 22 blocks. The range bins end at MAX_RANGE_M, because no feature uses
larger ranges.
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
BLOCK_S = 2.1e-3  # longest block of chirps that is averaged coherently, in seconds; the frame of the IWR1843 lasts 2.05 ms
MIN_CHIRPS = 8  # smallest number of chirps for the noise estimate; with fewer, echoes at rest leak into the bin of the highest speed
_ARRAYS, _RADAR = "processed.npz", "processed.json"


@dataclass(frozen=True, eq=False)
class Processed:
    """Hold power, azimuth channels and Doppler spectra of F frames in B range bins, as the module's docstring defines them.

    Attributes:
        radar: radar of the recording.
        range_m: (B,) centres of the range bins in metres.
        power: (F, B) float32 echo power in squared amplitude units.
        channels: (F, A, B) complex64 signals of the A channels of `azimuth_row` in the middle of each frame, in the order of `azimuth_row`.
        doppler: (F, C, B) float32 power in C Doppler bins; None if the caller of `process` did not request it.
        velocity_mps: (C,) velocities of the Doppler bins in m/s, in ascending order; receding echoes have positive velocities.
        noise: (B,) float32 noise power that `power` contains. `noise` is None if the radar has fewer than MIN_CHIRPS chirps per frame;
            features then assume zero noise.
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
        """Return the noise power in each of the B range bins, (B,), or zeros if `noise` is None."""
        return np.zeros(len(self.range_m)) if self.noise is None else self.noise.astype(np.float64)

    def frames(self, selection: slice | NDArray) -> Processed:
        """Return only the frames that `selection` selects. If `selection` is a slice, the result shares its arrays with this object."""
        doppler = None if self.doppler is None else self.doppler[selection]
        return Processed(self.radar, self.range_m, self.power[selection], self.channels[selection], doppler, self.velocity_mps, self.noise)

    def save(self, folder: str | Path) -> None:
        """Write the processed recording into a folder. The method writes the arrays last, so that `load` refuses an interrupted save."""
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
            MissingError: processed.npz or processed.json is missing.
            RecordingError: a file is damaged or belongs to a recording of another radar.
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
    """Compute power, azimuth channels, noise and Doppler spectra of a recording, in blocks of frames to limit the memory.

    Args:
        recording: IQ samples with their radar.
        doppler: whether to compute the Doppler spectra, which need C times the memory of `power` for C chirps per frame.
    Raises:
        RecordingError: samples are NaN or infinite.
    """
    radar, row, blocks = recording.radar, azimuth_row(recording.radar), _blocks(recording.radar)
    weights = np.array([block.stop - block.start for block in blocks]) / radar.num_chirps
    taps = hann(radar.num_chirps)
    fastest = (taps * (-1.0) ** np.arange(radar.num_chirps)).astype(np.float32)  # window for the Doppler bin of the highest speed
    power, channels, cubes, noise = [], [], [], []
    range_m = np.zeros(0)
    for frames in recording.frame_blocks():
        iq = recording.iq[frames]
        sums, range_m = _profiles(
            np.stack([*(iq[:, block].mean(axis=1) for block in blocks), np.tensordot(iq, fastest, (1, 0))], axis=1), radar
        )
        coherent = sums[:, :-1].reshape(len(iq), len(blocks), -1, len(range_m))
        if not np.isfinite(coherent).all():
            raise RecordingError("the recording holds NaN or infinite samples; simulate or record it again")
        by_block = (np.abs(coherent) ** 2).mean(axis=2, dtype=np.float64)
        power.append(np.einsum("k,fkb->fb", weights, by_block).astype(np.float32))
        channels.append(coherent[:, len(blocks) // 2, row].astype(np.complex64))
        noise.append((np.abs(sums[:, -1]) ** 2).mean(axis=(1, 2), dtype=np.float64))
        if doppler:
            spectra, _ = doppler_fft(_profiles(iq, radar)[0], radar)
            cubes.append((np.abs(spectra) ** 2).mean(axis=(2, 3)).astype(np.float32))
    floor = np.concatenate(noise).mean(axis=0) * len(blocks) / (radar.num_chirps * np.sum(taps**2))
    return Processed(
        radar,
        range_m,
        np.concatenate(power),
        np.concatenate(channels),
        np.concatenate(cubes) if doppler else None,
        velocity_axis(radar, radar.num_chirps),
        floor.astype(np.float32) if radar.num_chirps >= MIN_CHIRPS else None,
    )


def _blocks(radar: Radar) -> list[slice]:
    """Return the blocks of chirps that `process` averages coherently, as few as BLOCK_S allows, each with at least one chirp."""
    longest = max(1, int(BLOCK_S / radar.loop_interval_s))
    parts = np.array_split(np.arange(radar.num_chirps), -(-radar.num_chirps // longest))
    return [slice(int(part[0]), int(part[-1]) + 1) for part in parts]


def _profiles(iq: NDArray[np.complexfloating], radar: Radar) -> tuple[NDArray[np.complexfloating], NDArray[np.float64]]:
    """Compute the range profiles of IQ samples up to MAX_RANGE_M, and the range axis in metres."""
    profiles, range_m = range_fft(iq, radar)
    near = range_m <= MAX_RANGE_M
    return profiles[..., near], range_m[near]
