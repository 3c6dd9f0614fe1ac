"""What a real IWR1843 and its capture card do to the ideal signal.

Order of the chain: TX-RX leakage adds, the mixer has I/Q imbalance, the ADC quantises to 16 bits at a physical scale (thermal noise
comes from the radar's own noise figure). There is no published figure of the board for any of these defaults; each is an order of
magnitude, chosen before anything was scored: leakage -60 dB over 6 cm (patch antennas some wavelengths apart on one board); imbalance
0.1 dB and 1 degree (a calibrated quadrature receiver); full scale at -40 dB of received over transmitted power, 20 dB above leakage.
"""

from dataclasses import dataclass

import numpy as np

from radartwin.constants import SPEED_OF_LIGHT
from radartwin.radar.chirp import Radar
from radartwin.radar.dca1000 import FULL_SCALE


@dataclass(frozen=True)
class Hardware:
    """Departures from the ideal radar; zero strength is the ideal one.

    Attributes:
        leakage_db: direct TX-RX power over transmitted power; leakage_path_m: its electrical length.
        gain_imbalance_db, phase_imbalance_deg: of Q against I.
        full_scale_db: received over transmitted power that drives the ADC to full scale.
    """

    leakage_db: float = -60.0
    leakage_path_m: float = 0.06
    gain_imbalance_db: float = 0.1
    phase_imbalance_deg: float = 1.0
    full_scale_db: float = -40.0

    @property
    def scale(self) -> float:
        """Amplitude per ADC count."""
        return 10 ** (self.full_scale_db / 20) / FULL_SCALE

    def scaled(self, strength: float) -> "Hardware":
        """The same imperfections at another strength: 0 none, 1 as they are, 2 doubled (amplitudes, not decibels)."""
        leakage = self.leakage_db + 20 * np.log10(strength) if strength > 0 else -np.inf
        return Hardware(
            leakage,
            self.leakage_path_m,
            strength * self.gain_imbalance_db,
            strength * self.phase_imbalance_deg,
            self.full_scale_db,
        )

    def apply(self, iq: np.ndarray, radar: Radar) -> np.ndarray:
        """Leakage and I/Q imbalance on samples [frame, chirp, tx, rx, sample]; quantisation happens when the recording is saved."""
        frequency = radar.start_frequency_hz + radar.slope_hz_per_s * np.arange(radar.num_samples) / radar.sample_rate_hz
        leakage = 10 ** (self.leakage_db / 20) * np.exp(2j * np.pi * frequency * self.leakage_path_m / SPEED_OF_LIGHT)
        signal = iq + leakage
        phase = np.radians(self.phase_imbalance_deg)
        in_phase = signal.real
        quadrature = 10 ** (self.gain_imbalance_db / 20) * (signal.imag * np.cos(phase) + signal.real * np.sin(phase))
        return (in_phase + 1j * quadrature).astype(np.complex64)
