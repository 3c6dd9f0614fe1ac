"""What a real IWR1843 and its capture card do to the ideal signal.

Order of the chain: the oscillator has phase noise and the receiver an IF filter, which depend on each echo's delay and are therefore part
of the radar that is simulated (`Hardware.radar`); TX-RX leakage adds, the mixer has I/Q imbalance, the ADC quantises to 16 bits at a
physical scale (`Hardware.apply`; thermal noise comes from the radar's own noise figure). Filter and phase noise have their sources in
their modules. There is no published figure of the board for the other defaults; each is an order of magnitude, chosen before anything
was scored: leakage -60 dB over 6 cm behind the filter (patch antennas some wavelengths apart on one board; so short a delay keeps no
phase noise); imbalance 0.1 dB and 1 degree (a calibrated quadrature receiver); full scale at -40 dB of received over transmitted power,
20 dB above leakage.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from radartwin.constants import SPEED_OF_LIGHT
from radartwin.radar.chirp import Radar
from radartwin.radar.dca1000 import FULL_SCALE
from radartwin.radar.if_filter import IfFilter
from radartwin.radar.phase_noise import PhaseNoise


@dataclass(frozen=True)
class Hardware:
    """Departures from the ideal radar; zero strength is the ideal one.

    Attributes:
        leakage_db: direct TX-RX power over transmitted power; leakage_path_m: its electrical length.
        gain_imbalance_db, phase_imbalance_deg: of Q against I.
        full_scale_db: received over transmitted power that drives the ADC to full scale.
        if_filter, phase_noise: of the radar; None is none.
    """

    leakage_db: float = -60.0
    leakage_path_m: float = 0.06
    gain_imbalance_db: float = 0.1
    phase_imbalance_deg: float = 1.0
    full_scale_db: float = -40.0
    if_filter: IfFilter | None = field(default_factory=IfFilter)
    phase_noise: PhaseNoise | None = field(default_factory=PhaseNoise)

    @property
    def scale(self) -> float:
        """Amplitude per ADC count."""
        return 10 ** (self.full_scale_db / 20) / FULL_SCALE

    def scaled(self, strength: float) -> "Hardware":
        """The same imperfections at another strength: 0 none, 1 as they are, 2 doubled (amplitudes and corners, not decibels)."""
        if strength <= 0:
            return Hardware(-np.inf, self.leakage_path_m, 0.0, 0.0, self.full_scale_db, None, None)
        decibels = 20 * np.log10(strength)
        noise, passes = self.phase_noise, self.if_filter
        return Hardware(
            self.leakage_db + decibels,
            self.leakage_path_m,
            strength * self.gain_imbalance_db,
            strength * self.phase_imbalance_deg,
            self.full_scale_db,
            passes and replace(passes, high_pass_hz=tuple(strength * corner for corner in passes.high_pass_hz)),
            noise and replace(noise, level_dbc_hz=float(noise.level_dbc_hz + decibels)),
        )

    def radar(self, radar: Radar) -> Radar:
        """The radar with this receiver and oscillator, to simulate with noise."""
        return replace(radar, if_filter=self.if_filter, phase_noise=self.phase_noise)

    def apply(self, iq: np.ndarray, radar: Radar) -> np.ndarray:
        """Leakage and I/Q imbalance on samples [frame, chirp, tx, rx, sample]; quantisation happens when the recording is saved."""
        frequency = radar.start_frequency_hz + radar.slope_hz_per_s * np.arange(radar.num_samples) / radar.sample_rate_hz
        leakage = 10 ** (self.leakage_db / 20) * np.exp(2j * np.pi * frequency * self.leakage_path_m / SPEED_OF_LIGHT)
        signal = iq + leakage
        phase = np.radians(self.phase_imbalance_deg)
        in_phase = signal.real
        quadrature = 10 ** (self.gain_imbalance_db / 20) * (signal.imag * np.cos(phase) + signal.real * np.sin(phase))
        return (in_phase + 1j * quadrature).astype(np.complex64)
