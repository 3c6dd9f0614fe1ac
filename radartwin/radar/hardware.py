"""Apply the imperfections of a real IWR1843 and its capture card to ideal simulated samples.

The simulation applies the imperfections in this order:
1. The method `echoes` starts each chirp on time or one clock cycle late, and adds the phase noise of the oscillator.
2. The method `leaked` adds leakage from the transmitters to the receivers, and gives the channels different gains and phases.
3. radartwin.simulation.signal.synthesis adds thermal noise with the noise figure of the radar, shaped by the IF filter.
4. The method `digitised` adds the image of the mixer and the offset of the ADC, and saturates and rounds the samples.
The IF filter must act on each echo before the beat frequency folds, so the simulated radar contains the filter (`front_end`). All other
imperfections act on the ideal samples. If an imperfection depends on the delay of the echo, the simulation applies it to the spectrum of
each chirp, in which each beat frequency corresponds to a delay. A test compared this approximation with exact phase noise for each echo.
The energy of the phase error differs by at most 0.1 dB. With a Hann window, the amplitude of the phase error differs by at most 5 %.
Without a window, this amplitude differs by 20 %, because a strong near echo leaks into all spectral lines. The difference of 20 % occurs
only in the first and last samples of a chirp.

Sources of the default values, all of which were chosen before the simulation was compared with any measurement:
- if_filter: both high-pass stages have their lowest corner frequencies, 175 and 350 kHz (codes 0 0), and the receiver gain is 30 dB. These
  are the values of a published mmWave SDK profile with the paper's sampling ("profileCfg 0 77 429 7 57.14 0 0 70 1 256 5209 0 0 30",
  TI E2E 757413). The IF filter is a setting and no imperfection, so `scaled` does not change the filter, except that strength 0 removes it.
- line_loss: the feed lines attenuate an echo by 5.2 dB on both ways together. An antenna alone has a gain of 10.5 dBi. Measured through the
  feed lines, a transmit antenna has 7.8 dBi and a receive antenna 8 dBi (TI E2E 681535).
- coupling: the leakage is -45 dB between the nearest transmitter and receiver, which are 8.77 mm apart (xWR1642BOOST, TI E2E 674013). The
  leakage falls with the distance between transmitter and receiver. The length of the feed line, 6 cm, is an order-of-magnitude estimate. In
  two public captures with the same high-pass stages, the leakage is 12.6 dB (IWR6843, shelta-zhao/mmwave-eyes) and 15.2 dB
  (77 GHz, PreSenseRadar/OpenRadar) above the noise power of a sample. The default coupling gives a leakage of 14 dB above the noise.
- full_scale: in the same two captures, the noise of a sample is 7.3 counts. With the noise figures of the data sheets and a receiver gain
  of 30 dB, the ADC's full scale then corresponds to a received power of -23 and -22 dBm. At a gain of 30 dB, the in-band compression point
  is at -29 dBm (IWR1443 data sheet, figure 5-1, according to TI E2E 702363: -23, -35, -47 dBm at gains of 24, 36, 48 dB). The simulation
  does not model the compression of large signals.
- image: the gains of I and Q differ by 1 dB and their phases by 2 degrees (AWR1243 data sheet, according to TI E2E 654592). The SDK's
  "complex 1x" output filters the image band, so only echoes in the first tenth of the range have an image. This image appears at the far
  end of the range.
- offset: the offset of -70 dBFS is the mean of the samples in both captures (5 to 16 counts).
- channels: the standard deviations of 0.6 dB and 5 degrees are the spread of a measured AWR1843L calibration (compRangeBiasAndRxChanPhase
  in the README of a fork of RadarML/xwr). Data sheets promise only +-0.5 dB and +-3 degrees over temperature (AWR2944P, TI SWRS330).
- chirp_late: the delay between a chirp and its samples is 0 or 1.1 ns, at random (TI SPRACV2).
- start: the time of a software trigger is uncertain by "several tens of microseconds", while frames repeat exactly (TI SWRA574B).
- jitter: a standard deviation of one microsecond from frame to frame is an order-of-magnitude estimate, far above the 5 ns steps of the
  frame timer. If a computer receives frames over Ethernet, its time stamps have errors of about a millisecond. These errors affect only the
  motion log.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from radartwin.constants import SPEED_OF_LIGHT
from radartwin.radar.chirp import Radar
from radartwin.radar.if_filter import IfFilter
from radartwin.radar.phase_noise import PhaseNoise, interpolation
from radartwin.radar.word_order import FULL_SCALE

_IWR1843_FILTER = IfFilter((175e3, 350e3))
_NODES = (0.2, 0.55, 0.95)  # beat frequencies, as fractions of the band, for whose delays the simulation computes the phase error


@dataclass(frozen=True)
class Hardware:
    """Describe the deviations of a radar from the ideal radar."""

    line_loss_db: float = 5.2  # loss of every echo in the feed lines to the transmit antenna and from the receive antenna, in dB
    coupling_db: float = -45.0  # leakage power in the nearest receiver over transmitted power before the IF filter, in dB
    feed_m: float = 0.06  # electrical length of the feed lines, in metres
    # Distance in metres from the transmitter to the receiver that are nearest to each other. On the board, transmitters and receivers form
    # two groups side by side.
    spacing_m: float = 0.00877
    gain_imbalance_db: float = 1.0  # gain of Q relative to I, in dB
    phase_imbalance_deg: float = 2.0  # deviation of the phase between I and Q from 90 degrees, in degrees
    image_filtered: bool = True  # whether the receiver filters the image band ("complex 1x" output)
    offset_dbfs: float = -70.0  # constant offset of each ADC relative to its full scale, in dB
    channel_gain_db: float = 0.6  # standard deviation of the gain over the channels of a board, in dB
    channel_phase_deg: float = 5.0  # standard deviation of the phase over the channels of a board, in degrees
    board: int = 0  # number of the board, which is the seed of the random gains and phases of its channels
    chirp_late_s: float = 1.1e-9  # delay of late chirps in seconds; each chirp is late with probability 1/2
    start_s: float = 50e-6  # largest delay of the start of a recording against its motion log, in seconds
    jitter_s: float = 1e-6  # standard deviation of the start time of a frame, in seconds
    full_scale_db: float | None = -35.0  # received over transmitted power at full scale of the ADC, in dB; None leaves out the ADC
    if_filter: IfFilter | None = _IWR1843_FILTER  # IF filter of the receiver; None leaves out the filter
    phase_noise: PhaseNoise | None = field(default_factory=PhaseNoise)  # phase noise of the oscillator; None leaves out phase noise

    @property
    def scale(self) -> float | None:
        """Return the amplitude per ADC count, or None if the hardware has no ADC."""
        return None if self.full_scale_db is None else 10 ** (self.full_scale_db / 20) / FULL_SCALE

    def scaled(self, strength: float) -> Hardware:
        """Multiply the amplitudes and spreads of all imperfections by `strength`.

        A strength of 1 gives the same hardware, and a strength of 0 gives the ideal radar. IF filter, full scale of the ADC and geometry
        are settings of the radar, which do not depend on the strength. The strength 0 removes the IF filter and the ADC as well.
        """
        strength = max(strength, 0.0)
        decibels = float(20 * np.log10(strength)) if strength else -np.inf
        spreads = (
            "line_loss_db", "gain_imbalance_db", "phase_imbalance_deg", "channel_gain_db", "channel_phase_deg",
            "chirp_late_s", "start_s", "jitter_s",
        )  # fmt: skip
        levels = {name: getattr(self, name) + decibels for name in ("coupling_db", "offset_dbfs")}
        scaled = replace(self, **levels, **{name: strength * getattr(self, name) for name in spreads})
        if not strength:
            return replace(scaled, full_scale_db=None, if_filter=None, phase_noise=None)
        noise = self.phase_noise and replace(self.phase_noise, level_dbc_hz=self.phase_noise.level_dbc_hz + decibels)
        return replace(scaled, phase_noise=noise)

    def front_end(self, radar: Radar) -> Radar:
        """Return the radar for the simulation of samples without receiver errors.

        This radar has the IF filter of the hardware. It has no phase noise, because `echoes` adds phase noise to the ideal samples.
        """
        return replace(radar, if_filter=self.if_filter or radar.if_filter, phase_noise=None)

    def frame_times(self, frames: int, rate_hz: float, rng: np.random.Generator) -> NDArray[np.float64]:
        """Draw the true start times (F,) of the frames in seconds. The nominal start time of frame f is f / rate_hz."""
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
            spectrum *= np.where(np.arange(samples) <= samples // 2, 2, 0).astype(np.float32)  # keep only positive beat frequencies
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
        """Compute the leakage signal (T, R, N) from each of T transmitters to each of R receivers after the IF filter, for N samples.

        The leakage has no phase noise, because its delay is so short that the phase noise cancels in the mixer.
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
        """Return the complex gain (T, R) of each channel of this board, which is the product of a transmitter and a receiver factor."""
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
        """Return the part of the samples whose image passes the IF filter."""
        if not self.image_filtered or self.if_filter is None:
            return iq
        from scipy import fft

        transition = np.clip(_beats(radar) / radar.band_hz / (1 - self.if_filter.pass_share), 0, 1)
        passed = 10 ** (-self.if_filter.stop_db / 20 * np.sin(np.pi / 2 * transition) ** 2)
        return np.asarray(fft.ifft(np.asarray(fft.fft(iq, axis=-1)) * passed.astype(np.float32), axis=-1))


@functools.lru_cache(maxsize=8)
def _leakage_and_channels(hardware: Hardware, radar: Radar) -> tuple[NDArray[np.complex64], NDArray[np.complex64]]:
    """Return and cache the leakage signal (T, R, N) and the channel gains (T, R), which are the same in every frame."""
    return hardware.leakage(radar), hardware.channels(radar)


@functools.lru_cache(maxsize=8)
def _beats(radar: Radar) -> NDArray[np.float64]:
    """Return the beat frequency (N,) of each range bin in Hz. The last 2 % get 0 Hz, because near echoes leak into them."""
    line = np.arange(radar.num_samples) / radar.num_samples
    if radar.real_sampling:
        return np.minimum(line, 1 - line) * radar.sample_rate_hz
    return np.where(line < 0.98, line, 0.0) * radar.sample_rate_hz


@functools.lru_cache(maxsize=8)
def _nodes(radar: Radar) -> tuple[tuple[float, ...], NDArray[np.float32]]:
    """Return the K delays of the computed phase errors, and the weights (K, N) that interpolate to the delays of the N spectral lines."""
    longest = radar.band_hz / radar.slope_hz_per_s
    nodes = tuple(share * longest for share in _NODES)
    return nodes, interpolation(_beats(radar) / radar.slope_hz_per_s, nodes).astype(np.float32)
