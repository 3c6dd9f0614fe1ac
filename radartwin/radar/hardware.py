"""Apply the imperfections of a real IWR1843 and its capture card to ideal samples.

The effects are applied in this order:
1. `echoes`: a chirp starts on time or one clock late, and the oscillator has phase noise.
2. `leaked`: leakage from transmitter to receiver adds, and the channels have different gains and phases.
3. radartwin.simulation.signal.synthesis adds thermal noise with the noise figure of the radar.
4. `digitised`: the mixer adds an image, the ADC adds an offset, saturates and rounds.
The IF filter must act on each echo before its frequency folds, so the simulated radar contains the filter (`front_end`). All other effects
act on the ideal samples. An effect that depends on delay is applied to the spectrum of each chirp, where a frequency stands for a delay.
This approximation was compared with exact phase noise for each echo. The energy of the phase error differs by at most 0.1 dB. Under a Hann
window its amplitude differs by at most 5 %. Without a window the amplitude differs by 20 %, because a strong near echo leaks into all
spectral lines; this error is in the first and last samples only.

Sources of the default values, all of which were chosen before the simulation was compared with any measurement:
- if_filter: both high-pass stages at their lowest corner, 175 and 350 kHz (codes 0 0), receiver gain 30 dB. This is the profile of the
  paper in the mmWave SDK ("profileCfg 0 77 429 7 57.14 0 0 70 1 256 5209 0 0 30", TI E2E 757413). It is a setting, so `scaled` keeps it.
- line_loss: 5.2 dB both ways. An antenna alone has 10.5 dBi; measured through the feed lines, TX and RX have 7.8 and 8 dBi (TI E2E 681535).
- coupling: -45 dB between the nearest TX and RX, 8.77 mm apart (xWR1642BOOST, TI E2E 674013), falling with distance, over 6 cm of feed line
  (order of magnitude). In two public captures with the same high-pass stages, the leakage is 12.6 dB (IWR6843, shelta-zhao/mmwave-eyes) and
  15.2 dB (77 GHz, PreSenseRadar/OpenRadar) above the noise power of a sample; the default gives 14 dB.
- full scale: in the same captures the noise of a sample is 7.3 counts. With the noise figures of the data sheets, full scale is then at -23
  and -22 dBm received power, at 30 dB of gain. At this gain the in-band compression point is at -29 dBm (IWR1443 data sheet, figure 5-1, by
  TI E2E 702363: -23, -35, -47 dBm at 24, 36, 48 dB). Compression of large signals is not modelled.
- image: 1 dB and 2 degrees between I and Q (AWR1243 data sheet by TI E2E 654592). The SDK's "complex 1x" output filters the image band, so
  only echoes in the first tenth of the range have an image, which appears at the far end of the range.
- offset: -70 dBFS, the mean of the samples in both captures (5 to 16 counts).
- channels: 0.6 dB and 5 degrees, the spread of a measured AWR1843L calibration (compRangeBiasAndRxChanPhase in the README of a fork of
  RadarML/xwr). Data sheets promise only +-0.5 dB and +-3 degrees over temperature (AWR2944P, TI SWRS330).
- chirp_late: 0 or 1.1 ns, at random, between the chirp and its samples (TI SPRACV2).
- start: a software trigger is uncertain by "several tens of microseconds", while frames repeat exactly (TI SWRA574B).
- jitter: a microsecond from frame to frame as an order of magnitude, far above the 5 ns steps of the frame timer. The time stamps of a host
  that receives frames over Ethernet have errors of about a millisecond, but they affect the motion log only.
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

_NODES = (0.2, 0.55, 0.95)  # beat frequencies, as fractions of the band, whose delays get a computed phase error


def _iwr1843_filter() -> IfFilter:
    return IfFilter((175e3, 350e3))


@dataclass(frozen=True)
class Hardware:
    """Describe the deviations of a radar from the ideal radar."""

    line_loss_db: float = 5.2  # loss of every echo in the lines to and from the antennas
    coupling_db: float = -45.0  # leakage power into the nearest receiver over transmitted power, before the IF filter
    feed_m: float = 0.06  # electrical length of the feed lines
    # distance from the nearest transmitter to the nearest receiver; transmitters and receivers form two groups side by side
    spacing_m: float = 0.00877
    gain_imbalance_db: float = 1.0  # of Q against I
    phase_imbalance_deg: float = 2.0
    image_filtered: bool = True  # whether the image band is filtered ("complex 1x")
    offset_dbfs: float = -70.0  # offset of each ADC relative to full scale
    channel_gain_db: float = 0.6  # standard deviation over the channels of a board
    channel_phase_deg: float = 5.0
    board: int = 0  # number of the board; seeds the random gains and phases of its channels
    chirp_late_s: float = 1.1e-9  # delay of late chirps; each chirp is late with probability 1/2
    start_s: float = 50e-6  # largest delay of the start of a recording against its motion log
    jitter_s: float = 1e-6  # standard deviation of the start time of a frame
    full_scale_db: float | None = -35.0  # received over transmitted power at full scale of the ADC; None leaves out the ADC
    if_filter: IfFilter | None = field(default_factory=_iwr1843_filter)  # None leaves the effect out
    phase_noise: PhaseNoise | None = field(default_factory=PhaseNoise)  # of the oscillator; None leaves the effect out

    @property
    def scale(self) -> float | None:
        """Amplitude per ADC count."""
        return None if self.full_scale_db is None else 10 ** (self.full_scale_db / 20) / FULL_SCALE

    def scaled(self, strength: float) -> Hardware:
        """Scale the imperfections: strength 0 gives the ideal radar, 1 the same radar, 2 doubles all amplitudes and spreads.

        IF filter, full scale and geometry are settings of the radar and do not scale, but strength 0 removes them.
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
        """Return the radar for the simulation of ideal samples: with the IF filter, without phase noise, which `echoes` adds later."""
        return replace(radar, if_filter=self.if_filter or radar.if_filter, phase_noise=None)

    def frame_times(self, frames: int, rate_hz: float, rng: np.random.Generator) -> NDArray[np.float64]:
        """Draw the true start times of the frames in seconds, shape (F,); their nominal times are f / rate_hz."""
        late = self.start_s * rng.random()
        return np.arange(frames) / rate_hz + late + self.jitter_s * rng.standard_normal(frames)

    def echoes(self, iq: NDArray[np.complex64], radar: Radar, rng: np.random.Generator) -> NDArray[np.complex64]:
        """Add late chirps and phase noise to ideal samples (F, C, T, R, N). All receivers of a chirp have the same delay and noise."""
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
        """Apply line loss, leakage between the antennas, and the gain and phase of each channel to the samples."""
        transmission = np.float32(10 ** (-self.line_loss_db / 20))
        leakage, channels = _leakage_and_channels(self, radar)
        out = transmission * iq
        out += leakage
        out *= channels[:, :, None]
        return out

    def leakage(self, radar: Radar) -> NDArray[np.complex64]:
        """Compute the leakage between every transmitter and receiver after the IF filter, (T, R, N).

        The leakage has no phase noise, because its delay is too short.
        """
        time = np.arange(radar.num_samples) / radar.sample_rate_hz
        frequency = radar.start_frequency_hz + radar.slope_hz_per_s * time
        # On the real board the transmitters and the receivers lie side by side; the ideal radar centres both groups at the origin.
        shift = radar.tx_positions[:, 1].max() - radar.rx_positions[:, 1].min() + self.spacing_m
        apart = np.linalg.norm(radar.rx_positions + np.array([0.0, shift, 0.0]) - radar.tx_positions[:, None], axis=-1)
        path = apart + self.feed_m
        gain = 10 ** (self.coupling_db / 20) * apart.min() / apart
        if (if_filter := self.if_filter or radar.if_filter) is not None:
            gain = gain * if_filter.gain(radar.slope_hz_per_s * path / SPEED_OF_LIGHT, radar.band_hz)
        signal = gain[..., None] * np.exp(2j * np.pi * frequency * path[..., None] / SPEED_OF_LIGHT)
        return (signal.real if radar.real_sampling else signal).astype(np.complex64)

    def channels(self, radar: Radar) -> NDArray[np.complex64]:
        """Return the complex gain of each channel of this board, (T, R): the product of a transmitter factor and a receiver factor."""
        rng = np.random.default_rng(np.random.SeedSequence([self.board, *b"channels"]))
        unit = rng.standard_normal((2, radar.num_tx + radar.num_rx)) / np.sqrt(2)
        decibels, degrees = self.channel_gain_db * unit[0], self.channel_phase_deg * unit[1]
        factors = 10 ** (decibels / 20) * np.exp(1j * np.radians(degrees))
        if radar.real_sampling:
            factors = np.abs(factors)
        return (factors[: radar.num_tx, None] * factors[radar.num_tx :]).astype(np.complex64)

    def digitised(self, iq: NDArray[np.complex64], radar: Radar) -> tuple[NDArray[np.complex64], int]:
        """Add image and offset to the samples, saturate them and round them to counts.

        Returns:
            iq: the samples, as counts times amplitude per count.
            saturated: number of saturated values.
        """
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
        """Return the part of the samples whose image passes the IF filter; the filter's lower edge is as wide as its upper edge."""
        if not self.image_filtered or self.if_filter is None:
            return iq
        from scipy import fft

        transition = np.clip(_beats(radar) / radar.band_hz / (1 - self.if_filter.pass_share), 0, 1)
        passed = 10 ** (-self.if_filter.stop_db / 20 * np.sin(np.pi / 2 * transition) ** 2)
        return np.asarray(fft.ifft(np.asarray(fft.fft(iq, axis=-1)) * passed.astype(np.float32), axis=-1))


@functools.lru_cache(maxsize=8)
def _leakage_and_channels(hardware: Hardware, radar: Radar) -> tuple[NDArray[np.complex64], NDArray[np.complex64]]:
    """Return leakage (T, R, N) and channel gains (T, R), cached because they are the same in every frame."""
    return hardware.leakage(radar), hardware.channels(radar)


@functools.lru_cache(maxsize=8)
def _beats(radar: Radar) -> NDArray[np.float64]:
    """Return the beat frequency of each spectral line of a chirp, (N,); 0 Hz in the last 2 % of the band, where near echoes leak."""
    line = np.arange(radar.num_samples) / radar.num_samples
    if radar.real_sampling:
        return np.minimum(line, 1 - line) * radar.sample_rate_hz
    return np.where(line < 0.98, line, 0.0) * radar.sample_rate_hz


@functools.lru_cache(maxsize=8)
def _nodes(radar: Radar) -> tuple[tuple[float, ...], NDArray[np.float32]]:
    """Return the K delays with a computed phase error, and interpolation weights (K, N) for the delay of each spectral line.

    The interpolation error is at most 0.3 % over the band of the iwr1843.
    """
    longest = radar.band_hz / radar.slope_hz_per_s
    nodes = tuple(share * longest for share in _NODES)
    return nodes, interpolation(_beats(radar) / radar.slope_hz_per_s, nodes).astype(np.float32)
