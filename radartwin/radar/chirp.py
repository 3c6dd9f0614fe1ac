"""Describe the waveform, array and timing of a TDM-MIMO FMCW radar, and derive its resolution and limits.

The only waveform is a train of equal linear up-chirps (FMCW), which the transmitters send one after the other (TDM). RadarTwin refuses
descriptions of other waveforms, for example several transmitters at a time, chirps of several profiles, falling chirps, PMCW or OFDM.

Symbols and their names in the code: f0 -> start_frequency_hz, S -> slope_hz_per_s, fs -> sample_rate_hz, N -> num_samples,
Tc -> chirp_interval, B = S N / fs -> sampled_bandwidth_hz, lambda at f0 -> wavelength_m, f0 + B/2 -> center_frequency_hz.
The axes of the sensor frame are x forward, y left and z up, and positions are in metres from the origin of this frame.

References: the default values are those of the radar configuration table in the RadarTwin paper (77 GHz, 70 MHz/us, 5.21 Msps, 256 samples,
16 chirps, 10 Hz; B = 3.44 GHz, range resolution 0.044 m). The relations between waveform and resolution are those of S. Rao, Introduction
to mmWave sensing: FMCW radars (TI).
"""

from __future__ import annotations

import reprlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from radartwin.constants import SPEED_OF_LIGHT
from radartwin.errors import InputError, RecordingError
from radartwin.radar.antenna import ELEMENTS, element_gain
from radartwin.radar.antenna_errors import AntennaErrors
from radartwin.radar.boards import IWR1843BOOST, Position
from radartwin.radar.description_files import read_description
from radartwin.radar.field_checks import check_distinct, from_mapping, is_number, is_whole, require
from radartwin.radar.if_filter import IfFilter
from radartwin.radar.phase_noise import PhaseNoise
from radartwin.radar.ti_files import Description

_PARTS: dict[str, Any] = {"if_filter": IfFilter, "phase_noise": PhaseNoise, "antenna_errors": AntennaErrors}
WAVEFORM = "fmcw"  # the only waveform that a radar description may name
_MAX_COUNT = 1_000_000  # largest number of samples or chirps; the limit keeps a typing error from filling the memory


@dataclass(frozen=True)
class Radar:
    """Describe one radar configuration: waveform, antennas and timing. Instances are immutable, hashable and comparable.

    Attributes:
        start_frequency_hz, slope_hz_per_s: frequency at the start of a chirp, and its increase per second.
        sample_rate_hz, num_samples: rate of the ADC, and number of samples per chirp.
        num_chirps: number of chirp loops per frame; in each loop every transmitter sends one chirp.
        tx_positions_m: positions (x, y, z) of the transmit antennas' phase centres in metres, in firing order.
        rx_positions_m: positions (x, y, z) of the receive antennas' phase centres in metres.
        chirp_interval: seconds between the starts of successive chirps. The transmitters alternate: in loop c, the chirp of
            transmitter t starts (c * num_tx + t) * chirp_interval after the start of the frame.
        element: antenna pattern, "iwr1843" or "isotropic" (see radartwin.radar.antenna).
        real_sampling: whether the ADC samples only one real channel per receiver, which halves the unambiguous range.
        if_filter: gain of the receiver as a function of the beat frequency. None passes all beat frequencies, so that echoes beyond the
            unambiguous range fold to shorter ranges.
        phase_noise: phase noise of the local oscillator; None for an ideal oscillator.
        antenna_errors: deviations of the antennas from the pattern `element`; None for antennas with this pattern.
        tx_gains_db, rx_gains_db: power gain of each antenna in addition to `element`, in dB; None for 0 dB.

    >>> round(Radar.iwr1843().range_resolution_m, 4)
    0.0436
    """

    name: str
    start_frequency_hz: float
    slope_hz_per_s: float
    sample_rate_hz: float
    num_samples: int
    num_chirps: int
    tx_positions_m: tuple[Position, ...]
    rx_positions_m: tuple[Position, ...]
    chirp_interval: float
    frame_rate_hz: float
    element: str = "isotropic"
    noise_figure_db: float = 15.0
    transmit_power_dbm: float = 12.0
    real_sampling: bool = False
    if_filter: IfFilter | None = None
    phase_noise: PhaseNoise | None = None
    antenna_errors: AntennaErrors | None = None
    tx_gains_db: tuple[float, ...] | None = None
    rx_gains_db: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        require(self, "radar", "name", lambda value: isinstance(value, str), "text")
        what = f"radar {self.name}"
        for name in ("start_frequency_hz", "slope_hz_per_s", "sample_rate_hz", "chirp_interval", "frame_rate_hz"):
            require(self, what, name, lambda value: is_number(value) and value > 0, "a positive number")
        for name in ("num_samples", "num_chirps"):
            require(self, what, name, lambda value: is_whole(value) and 1 <= value <= _MAX_COUNT, f"a whole number from 1 to {_MAX_COUNT}")
        for name in ("noise_figure_db", "transmit_power_dbm"):
            require(self, what, name, is_number, "a finite number")
        require(self, what, "real_sampling", lambda value: isinstance(value, bool), "true or false")
        require(self, what, "element", lambda value: isinstance(value, str) and value in ELEMENTS, f"one of {', '.join(ELEMENTS)}")
        for name, kind in _PARTS.items():
            if isinstance(value := getattr(self, name), Mapping):
                object.__setattr__(self, name, from_mapping(kind, name, value))
            else:
                require(self, what, name, lambda value, kind=kind: value is None or isinstance(value, kind), f"a {kind.__name__} or None")
        for name in ("tx_positions_m", "rx_positions_m"):
            object.__setattr__(self, name, _positions(self.name, name, getattr(self, name)))
        for name, antennas in (("tx_gains_db", self.num_tx), ("rx_gains_db", self.num_rx)):
            if (gains := getattr(self, name)) is not None:
                object.__setattr__(self, name, _gains(self.name, name, gains, antennas))
        self._check_timing()

    def _check_timing(self) -> None:
        sampling = self.num_samples / self.sample_rate_hz
        # The tolerance is 1e-6 of the time, because configuration files round times to nanoseconds.
        if sampling > self.chirp_interval * (1 + 1e-6):
            times = f"sampling takes {sampling * 1e6:.2f} us but chirps start every {self.chirp_interval * 1e6:.2f} us"
            raise InputError(f"radar {self.name}: {times}; lengthen chirp_interval or take fewer samples")
        if self.frame_duration_s > (1 + 1e-6) / self.frame_rate_hz:
            times = (
                f"the chirps of a frame take {self.frame_duration_s * 1e3:.2f} ms but frames start every {1e3 / self.frame_rate_hz:.2f} ms"
            )
            raise InputError(f"radar {self.name}: {times}; lower frame_rate_hz or num_chirps")

    @property
    def num_tx(self) -> int:
        return len(self.tx_positions_m)

    @property
    def num_rx(self) -> int:
        return len(self.rx_positions_m)

    @property
    def tx_positions(self) -> NDArray[np.float64]:
        """Return the phase centres (num_tx, 3) of the transmit antennas in firing order, in metres."""
        return np.array(self.tx_positions_m, dtype=np.float64)

    @property
    def rx_positions(self) -> NDArray[np.float64]:
        """Return the phase centres (num_rx, 3) of the receive antennas, in metres."""
        return np.array(self.rx_positions_m, dtype=np.float64)

    @property
    def virtual_positions(self) -> NDArray[np.float64]:
        """Return the virtual antenna positions (num_tx * num_rx, 3) in metres, ordered by transmitter first.

        A virtual position is the sum of the transmit position and the receive position of a channel.
        """
        return (self.tx_positions[:, None] + self.rx_positions[None]).reshape(-1, 3)

    @property
    def wavelength_m(self) -> float:
        """Return the wavelength at the start frequency of the chirp, in metres."""
        return SPEED_OF_LIGHT / self.start_frequency_hz

    @property
    def sampled_bandwidth_hz(self) -> float:
        return self.slope_hz_per_s * self.num_samples / self.sample_rate_hz

    @property
    def center_frequency_hz(self) -> float:
        """Return the middle frequency of the sampled sweep in Hz, which sets how the phase of a range bin depends on motion and angle."""
        return self.start_frequency_hz + 0.5 * self.sampled_bandwidth_hz

    @property
    def range_resolution_m(self) -> float:
        return SPEED_OF_LIGHT / (2 * self.sampled_bandwidth_hz)

    @property
    def band_hz(self) -> float:
        """Return the width of the unambiguous band of beat frequencies in Hz: the sample rate, or half of it for real sampling."""
        return self.sample_rate_hz / 2 if self.real_sampling else self.sample_rate_hz

    @property
    def unambiguous_range_m(self) -> float:
        """Return the range in metres at which the beat frequency folds.

        The beat frequency folds at the sample rate for complex sampling, and at half the sample rate for real sampling.
        """
        return self.band_hz * SPEED_OF_LIGHT / (2 * self.slope_hz_per_s)

    @property
    def loop_interval_s(self) -> float:
        """Return the time between the starts of successive chirps of one transmitter, in seconds."""
        return self.num_tx * self.chirp_interval

    @property
    def frame_duration_s(self) -> float:
        """Return the time from the start of a frame's first chirp to the end of its last chirp interval, in seconds."""
        return self.num_chirps * self.loop_interval_s

    @property
    def max_velocity_mps(self) -> float:
        """Return the speed in m/s at which the Doppler frequency folds: lambda / (4 num_tx Tc), with lambda at the middle of the sweep."""
        return SPEED_OF_LIGHT / (4 * self.center_frequency_hz * self.loop_interval_s)

    @property
    def velocity_resolution_mps(self) -> float:
        """Return the width of one Doppler bin of a frame in m/s."""
        return 2 * self.max_velocity_mps / self.num_chirps

    @property
    def pattern(self) -> Any:
        """Return the plain values that determine the result of `gain`. They are part of the keys of stored results."""
        errors = self.antenna_errors
        return self.element if errors is None else [self.element, errors.side_lobe_db, errors.back_lobe_db]

    @property
    def sees_behind(self) -> bool:
        """Return whether the antennas have a gain behind the board."""
        return bool(self.gain([-1.0, 0.0, 0.0]) > 0)

    def gain(self, directions: ArrayLike) -> NDArray[np.float64]:
        """Compute the amplitude gain (...,) of the antennas, without the ripples that differ between antennas.

        Args:
            directions: vectors (..., 3) in the sensor frame that point away from the radar, of any length above zero.
        """
        errors = self.antenna_errors
        return element_gain(self.element, directions) if errors is None else errors.gain(self.element, directions)

    def channel_gains(self) -> NDArray[np.float64] | None:
        """Return the amplitude gains (num_tx, num_rx) of the channels in addition to `gain`, or None if all are 1."""
        if self.tx_gains_db is None and self.rx_gains_db is None:
            return None
        tx, rx = (np.array(gains or (0.0,)) for gains in (self.tx_gains_db, self.rx_gains_db))
        return np.broadcast_to(10 ** ((tx[:, None] + rx) / 20), (self.num_tx, self.num_rx))

    def chirp_times(self) -> NDArray[np.float64]:
        """Return the start times (num_chirps, num_tx) of all chirps of a frame, in seconds from the start of the frame."""
        loop, tx = np.arange(self.num_chirps)[:, None], np.arange(self.num_tx)[None]
        return (loop * self.num_tx + tx).astype(np.float64) * self.chirp_interval

    @classmethod
    def iwr1843(cls, element: str = "iwr1843") -> Radar:
        """Return the radar of the RadarTwin paper, an IWR1843BOOST with two alternating azimuth transmitters and four receivers.

        The chirp interval of 64 us is an assumption of this project, because the paper gives no interval. The published profile from which
        `radartwin.radar.hardware` takes the IF filter has a chirp interval of 486 us. With this interval, the unambiguous speed would be
        0.97 m/s instead of 7.44 m/s. The noise figure of 15 dB and the transmit power of 12 dBm are typical values of the IWR1843 data
        sheet (TI SWRS228, RF specification).
        """
        return cls(
            name="iwr1843",
            start_frequency_hz=77e9,
            slope_hz_per_s=70e12,
            sample_rate_hz=5.21e6,
            num_samples=256,
            num_chirps=16,
            tx_positions_m=tuple(IWR1843BOOST.tx_positions_m[i] for i in (0, 2)),
            rx_positions_m=IWR1843BOOST.rx_positions_m,
            chirp_interval=64e-6,
            frame_rate_hz=10.0,
            element=element,
            noise_figure_db=15.0,
            transmit_power_dbm=12.0,
        )

    @classmethod
    def from_file(cls, path: str | Path) -> Radar:
        """Read a radar from a file: a mmWave SDK .cfg, a mmWave Studio .mmwave.json, or a .yaml or .json with the fields of this class.

        Raises:
            MissingError: the file does not exist.
            RecordingError: the file is malformed or unsupported; if the format allows, the message names the line.
        """
        return cls.described(path)[0]

    @classmethod
    def described(cls, path: str | Path, board: str | None = None) -> tuple[Radar, Description]:
        """Read a radar file as `from_file` does, and return the radar with the rest of the file's content (`read_description`)."""
        description = read_description(Path(path), board)
        try:
            return cls.from_dict(description.fields), description
        except InputError as error:
            raise RecordingError(f"{path}: {error}") from error

    def to_dict(self) -> dict[str, Any]:
        """Return the fields of the radar as plain values for JSON or YAML. Leave out fields that are None."""
        return {name: _plain(value) for name, value in asdict(self).items() if value is not None}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Radar:
        """Build a radar from the mapping that `to_dict` returns, which may also hold `waveform: fmcw`.

        Raises:
            InputError: a field is unknown, missing or invalid, or the waveform is not linear FMCW.
        """
        if isinstance(values, Mapping) and "waveform" in values:
            values = dict(values)
            if (waveform := values.pop("waveform")) != WAVEFORM:
                remedy = f"RadarTwin simulates linear FMCW chirps in time division (waveform: {WAVEFORM})"
                raise InputError(f"radar description: waveform {reprlib.repr(waveform)} is not simulated; {remedy}")
        return from_mapping(cls, "radar description", values)


def _plain(value: Any) -> Any:
    """Convert tuples to lists, also inside lists and mappings."""
    if isinstance(value, Mapping):
        return {name: _plain(item) for name, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, tuple | list) else value


def _positions(radar: str, name: str, positions: Any) -> tuple[Position, ...]:
    try:
        array = np.array(positions, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        array = np.empty(0)
    if array.ndim != 2 or array.shape[0] < 1 or array.shape[-1] != 3 or not np.isfinite(array).all():
        raise InputError(f"radar {radar}: {name} must be one or more finite (x, y, z) positions in metres")
    places = tuple((float(x), float(y), float(z)) for x, y, z in zip(*array.T, strict=True))
    check_distinct(places, f"radar {radar}: {name}")
    return places


def _gains(radar: str, name: str, gains: Any, antennas: int) -> tuple[float, ...]:
    if not isinstance(gains, Sequence) or len(gains) != antennas or not all(map(is_number, gains)):
        raise InputError(f"radar {radar}: {name} must be {antennas} finite numbers in dB, one for each antenna, not {reprlib.repr(gains)}")
    return tuple(map(float, gains))
