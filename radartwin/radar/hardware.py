"""Imperfections of a real IWR1843 and its capture card, applied to ideal samples.

Order of the chain:
1. `echoes`: chirps start late by one clock or on time, and the oscillator has phase noise.
2. `leaked`: TX-RX leakage adds, and the channels have different gains and phases.
3. Thermal noise adds by the noise figure of the radar (radartwin.simulation.signal.synthesis).
4. `digitised`: the mixer has an image, the ADC an offset; the ADC saturates and rounds.
The IF filter acts on each echo before folding, so the simulated radar contains it (`front_end`). All other effects act on clean samples;
effects that depend on delay weight the lines of the spectrum of a chirp. Compared with the exact phase noise of each echo, the energy
differs by at most 0.1 dB and, under a Hann window, the amplitude by at most 5 %. Without a window the amplitude differs by 20 %, all of it
in the first and last samples, where a strong near echo leaks into all lines.

Sources of the default values, all of which were chosen before any result was scored:
- if_filter: both high-pass stages at their lowest corner, 175 and 350 kHz (codes 0 0), receiver gain 30 dB. This is the profile of the
  paper in the mmWave SDK ("profileCfg 0 77 429 7 57.14 0 0 70 1 256 5209 0 0 30", TI E2E 757413). It is a setting, so `scaled` keeps it.
- line_loss: 5.2 dB both ways, from 10.5 dBi of an antenna and the 7.8 and 8 dBi behind its lines (TI E2E 681535).
- coupling: -45 dB between the nearest TX and RX, 8.77 mm apart (xWR1642BOOST, TI E2E 674013), falling with distance, over 6 cm of feed line
  (order of magnitude). Two public captures with the same high-pass stages have leakage 12.6 dB (IWR6843, shelta-zhao/mmwave-eyes) and
  15.2 dB (77 GHz, PreSenseRadar/OpenRadar) above the noise of a sample; the default gives 14 dB.
- full scale: in the same captures the noise of a sample is 7.3 counts. With the noise figures of the data sheets, full scale is then at -23
  and -22 dBm received power, at 30 dB of gain. The in-band compression point is at -29 dBm there (IWR1443 data sheet, figure 5-1, by TI E2E
  702363: -23, -35, -47 dBm at 24, 36, 48 dB). Compression of large signals is not modelled.
- image: 1 dB and 2 degrees between I and Q (AWR1243 data sheet by TI E2E 654592). The SDK's "complex 1x" output filters the image band, so
  only echoes nearer than a tenth of the band have an image, at the far end.
- offset: -70 dBFS, the mean of the samples in both captures (5 to 16 counts).
- channels: 0.6 dB and 5 degrees, the spread of a measured AWR1843L calibration (compRangeBiasAndRxChanPhase in the README of a fork of
  RadarML/xwr). Data sheets promise only +-0.5 dB and +-3 degrees over temperature (AWR2944P, TI SWRS330).
- chirp_late: 0 or 1.1 ns, at random, between the chirp and its samples (TI SPRACV2).
- start: a software trigger is uncertain by "several tens of microseconds", while frames repeat exactly (TI SWRA574B).
- jitter: a microsecond from frame to frame as an order of magnitude, far above the 5 ns steps of the frame timer. The time stamps of a host
  that receives frames over Ethernet are a millisecond off, but they concern the log only.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from radartwin.constants import SPEED_OF_LIGHT
from radartwin.radar.chirp import Radar
from radartwin.radar.dca1000 import FULL_SCALE
from radartwin.radar.if_filter import IfFilter
from radartwin.radar.phase_noise import PhaseNoise, interpolation

_NODES = (0.2, 0.55, 0.95)  # shares of the band at which phase noise is computed


def _iwr1843_filter() -> IfFilter:
    return IfFilter((175e3, 350e3))


@dataclass(frozen=True)
class Hardware:
    """Deviations from the ideal radar.

    Attributes:
        line_loss_db: loss of every echo in the lines to and from the antennas.
        coupling_db: power into the nearest receiver over transmitted power, before the filter.
        feed_m: electrical length of the feed lines.
        spacing_m: distance from the nearest transmitter to the nearest receiver; the two groups lie side by side.
        gain_imbalance_db, phase_imbalance_deg: imbalance of Q against I.
        image_filtered: whether the image band is filtered ("complex 1x").
        offset_dbfs: offset of each ADC over full scale.
        channel_gain_db, channel_phase_deg: standard deviation over the channels of a board.
        board: number of the board, which seeds its channels.
        chirp_late_s: delay of the chirps that start late; the other half starts on time.
        start_s: largest delay of a recording behind its log.
        jitter_s: standard deviation of the time of a frame.
        full_scale_db: received over transmitted power at full scale of the ADC; None has no ADC.
        if_filter, phase_noise: filter and phase noise of the radar; None for an ideal one.
    """

    line_loss_db: float = 5.2
    coupling_db: float = -45.0
    feed_m: float = 0.06
    spacing_m: float = 0.00877
    gain_imbalance_db: float = 1.0
    phase_imbalance_deg: float = 2.0
    image_filtered: bool = True
    offset_dbfs: float = -70.0
    channel_gain_db: float = 0.6
    channel_phase_deg: float = 5.0
    board: int = 0
    chirp_late_s: float = 1.1e-9
    start_s: float = 50e-6
    jitter_s: float = 1e-6
    full_scale_db: float | None = -35.0
    if_filter: IfFilter | None = field(default_factory=_iwr1843_filter)
    phase_noise: PhaseNoise | None = field(default_factory=PhaseNoise)

    @property
    def scale(self) -> float | None:
        """Amplitude per ADC count."""
        return None if self.full_scale_db is None else 10 ** (self.full_scale_db / 20) / FULL_SCALE

    def scaled(self, strength: float) -> Hardware:
        """Imperfections at another strength: 0 is the ideal radar, 1 the same, 2 twice the amplitudes and spreads.

        Settings (filter, full scale, geometry) do not change, except that strength 0 has none of them.
        """
        if strength <= 0:
            return replace(
                self, line_loss_db=0.0, coupling_db=-np.inf, gain_imbalance_db=0.0, phase_imbalance_deg=0.0, offset_dbfs=-np.inf,
                channel_gain_db=0.0, channel_phase_deg=0.0, chirp_late_s=0.0, start_s=0.0, jitter_s=0.0, full_scale_db=None,
                if_filter=None, phase_noise=None,
            )  # fmt: skip
        decibels = float(20 * np.log10(strength))
        spreads = (
            "line_loss_db", "gain_imbalance_db", "phase_imbalance_deg", "channel_gain_db", "channel_phase_deg",
            "chirp_late_s", "start_s", "jitter_s",
        )  # fmt: skip
        noise = self.phase_noise and replace(self.phase_noise, level_dbc_hz=self.phase_noise.level_dbc_hz + decibels)
        return replace(
            self, coupling_db=self.coupling_db + decibels, offset_dbfs=self.offset_dbfs + decibels, phase_noise=noise,
            **{name: strength * getattr(self, name) for name in spreads},
        )  # fmt: skip

    def front_end(self, radar: Radar) -> Radar:
        """The radar to simulate without noise: with the filter of this hardware, without phase noise, which `echoes` adds."""
        return replace(radar, if_filter=self.if_filter or radar.if_filter, phase_noise=None)

    def frame_times(self, frames: int, rate_hz: float, rng: np.random.Generator) -> NDArray[np.float64]:
        """True start times of the frames that a log puts at f/rate, seconds, shape (F,)."""
        late = self.start_s * rng.random()
        return np.arange(frames) / rate_hz + late + self.jitter_s * rng.standard_normal(frames)

    def echoes(self, iq: NDArray[np.complex64], radar: Radar, rng: np.random.Generator) -> NDArray[np.complex64]:
        """Clean samples (F, C, T, R, N) with late chirps and phase noise, which the antennas share and the chirps do not."""
        if self.phase_noise is None and not self.chirp_late_s:
            return iq
        from scipy import fft

        frames, chirps, tx, _, samples = iq.shape
        out = iq.astype(np.complex64)
        spectrum = np.asarray(fft.fft(out, axis=-1))
        if radar.real_sampling:
            spectrum *= np.where(np.arange(samples) <= samples // 2, 2, 0).astype(np.float32)  # positive beat frequencies only
        if self.chirp_late_s:
            late = rng.integers(0, 2, (frames, chirps, tx)).astype(bool)
            spectrum[late] *= np.exp(-2j * np.pi * self.chirp_late_s * _beats(radar)).astype(np.complex64)
            out[late] = np.asarray(fft.ifft(spectrum[late], axis=-1))
        if self.phase_noise is not None:
            nodes, weights = _nodes(radar)
            phases = self.phase_noise.at_delays(frames * chirps * tx, samples, radar.sample_rate_hz, nodes, rng)
            shape = (frames, chirps, tx, 1, samples)
            for weight, phase in zip(weights, phases, strict=True):
                out += np.complex64(1j) * phase.reshape(shape) * np.asarray(fft.ifft(spectrum * weight, axis=-1))
        return out.real.astype(np.complex64) if radar.real_sampling else out

    def leaked(self, iq: NDArray[np.complex64], radar: Radar) -> NDArray[np.complex64]:
        """The samples with line loss, with leakage between the antennas, and with the gain and phase of each channel."""
        transmission = np.float32(10 ** (-self.line_loss_db / 20))
        leakage, channels = _leakage_and_channels(self, radar)
        out = transmission * iq
        out += leakage
        out *= channels[:, :, None]
        return out

    def leakage(self, radar: Radar) -> NDArray[np.complex64]:
        """Leakage of every pair of antennas through the filter, (T, R, N), without phase noise because its delay is so short."""
        time = np.arange(radar.num_samples) / radar.sample_rate_hz
        frequency = radar.start_frequency_hz + radar.slope_hz_per_s * time
        # The transmitters and receivers lie side by side, not about one origin as in the radar.
        shift = radar.tx_positions[:, 1].max() - radar.rx_positions[:, 1].min() + self.spacing_m
        apart = np.linalg.norm(radar.rx_positions + np.array([0.0, shift, 0.0]) - radar.tx_positions[:, None], axis=-1)
        path = apart + self.feed_m
        gain = 10 ** (self.coupling_db / 20) * apart.min() / apart
        if (if_filter := self.if_filter or radar.if_filter) is not None:
            gain = gain * if_filter.gain(radar.slope_hz_per_s * path / SPEED_OF_LIGHT, radar.band_hz)
        signal = gain[..., None] * np.exp(2j * np.pi * frequency * path[..., None] / SPEED_OF_LIGHT)
        return (signal.real if radar.real_sampling else signal).astype(np.complex64)

    def channels(self, radar: Radar) -> NDArray[np.complex64]:
        """Complex gain of each channel of this board, (T, R): the product of a transmitter factor and a receiver factor."""
        rng = np.random.default_rng(np.random.SeedSequence([self.board, *b"channels"]))
        unit = rng.standard_normal((2, radar.num_tx + radar.num_rx)) / np.sqrt(2)
        decibels, degrees = self.channel_gain_db * unit[0], self.channel_phase_deg * unit[1]
        factors = 10 ** (decibels / 20) * np.exp(1j * np.radians(degrees))
        if radar.real_sampling:
            factors = np.abs(factors)
        return (factors[: radar.num_tx, None] * factors[radar.num_tx :]).astype(np.complex64)

    def digitised(self, iq: NDArray[np.complex64], radar: Radar) -> tuple[NDArray[np.complex64], int]:
        """The samples with image and offset, saturated and rounded to counts, and the number of saturated values."""
        error = 10 ** (self.gain_imbalance_db / 20) * np.exp(1j * np.radians(self.phase_imbalance_deg))
        out = iq
        if error != 1 and not radar.real_sampling:
            out = np.complex64((1 + error) / 2) * iq + np.complex64((1 - np.conj(error)) / 2) * np.conj(self._imaged(iq, radar))
        if self.scale is None:
            return out.astype(np.complex64), 0
        offset = FULL_SCALE * 10 ** (self.offset_dbfs / 20) * (1 if radar.real_sampling else 1 + 1j) / np.sqrt(2)
        counts = (out / self.scale + offset).astype(np.complex64)
        parts = counts.view(np.float32)
        np.rint(parts, out=parts)
        clipped = np.clip(parts, -FULL_SCALE - 1, FULL_SCALE)
        saturated = int(np.count_nonzero(clipped != parts))
        return (clipped * np.float32(self.scale)).view(np.complex64), saturated

    def _imaged(self, iq: NDArray[np.complex64], radar: Radar) -> NDArray[np.complex64]:
        """The part of the samples whose image passes the filter, whose lower edge is as wide as its upper edge."""
        if not self.image_filtered or self.if_filter is None:
            return iq
        from scipy import fft

        transition = np.clip(_beats(radar) / radar.band_hz / (1 - self.if_filter.pass_share), 0, 1)
        passed = 10 ** (-self.if_filter.stop_db / 20 * np.sin(np.pi / 2 * transition) ** 2)
        return np.asarray(fft.ifft(np.asarray(fft.fft(iq, axis=-1)) * passed.astype(np.float32), axis=-1))


@functools.lru_cache(maxsize=8)
def _leakage_and_channels(hardware: Hardware, radar: Radar) -> tuple[NDArray[np.complex64], NDArray[np.complex64]]:
    """Leakage (T, R, N) and gains of the channels (T, R), cached because they are the same in every frame."""
    return hardware.leakage(radar), hardware.channels(radar)


@functools.lru_cache(maxsize=8)
def _beats(radar: Radar) -> NDArray[np.float64]:
    """Beat frequency of each line of the spectrum of a chirp, (N,). The last fiftieth of the band is leakage from zero."""
    line = np.arange(radar.num_samples) / radar.num_samples
    if radar.real_sampling:
        return np.minimum(line, 1 - line) * radar.sample_rate_hz
    return np.where(line < 0.98, line, 0.0) * radar.sample_rate_hz


@functools.lru_cache(maxsize=8)
def _nodes(radar: Radar) -> tuple[tuple[float, ...], NDArray[np.float32]]:
    """Delays of the phase noise, and their interpolation weights per line (K, N), exact to 0.3 % over the band of the iwr1843."""
    longest = radar.band_hz / radar.slope_hz_per_s
    nodes = tuple(share * longest for share in _NODES)
    return nodes, interpolation(_beats(radar) / radar.slope_hz_per_s, nodes).astype(np.float32)
