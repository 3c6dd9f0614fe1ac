"""Add noise to simulated recordings, at the signal-to-noise ratio of the measured recordings.

The paper (recognition with simulation-trained representations) uses 30 noise-augmented copies per object, matched to the measured SNR.
Receiver noise is white over the samples of a chirp, so this module draws noise samples for each chirp and applies the range FFT to the
noise as to a signal. The window of the range FFT then correlates the noise of neighbouring range bins. The noise power is computed from the
median target energy of all recordings of a stratum (recordings under equal conditions, such as one distance). Objects with weak echoes
therefore keep a lower signal-to-noise ratio than objects with strong echoes. The computation uses energies and noise floors of the measured
recordings, but not their class labels.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import InputError
from radartwin.features.processed import Processed
from radartwin.radar.processing import range_fft


def added_noise(simulated: NDArray, measured: NDArray, measured_noise: float) -> float:
    """Compute the noise power per range bin that gives simulated recordings the signal-to-noise ratio of the measured recordings.

    Args:
        simulated: target energies (n,) of the n simulated recordings of a stratum (recordings under equal conditions).
        measured: target energies (m,) of the m measured recordings of the same stratum.
        measured_noise: noise power per range bin of the measured recordings.
    Returns:
        The noise power per range bin, median(simulated) / median(measured) * measured_noise.
    Raises:
        InputError: the median target energy of the simulated or of the measured recordings is not above zero.
    """
    simulated_energy, measured_energy = float(np.median(simulated)), float(np.median(measured))
    if not (simulated_energy > 0 and measured_energy > 0 and measured_noise >= 0):
        raise InputError("noise copies: the targets have no energy above the noise; check that the logged distances match the recordings")
    return simulated_energy / measured_energy * measured_noise


def noisy(processed: Processed, noise_power: float, rng: np.random.Generator) -> Processed:
    """Return a noisy copy of a processed recording, without its Doppler data, with the noise power `noise_power` per range bin.

    If the recording already has noise, only the missing noise power is added. If the recording's noise exceeds `noise_power`, no noise is
    added.
    """
    added = max(0.0, noise_power - float(processed.noise_floor.mean()))
    frames, channels, _ = processed.channels.shape
    samples = processed.radar.num_samples
    white = rng.standard_normal((frames, channels, 2 * samples), dtype=np.float32).view(np.complex64)
    profile, _ = range_fft(white, processed.radar)
    unit = float(np.sqrt(np.mean(np.abs(profile) ** 2)))
    noise = profile[..., : len(processed.range_m)] * np.float32(np.sqrt(added) / unit)
    changed = (processed.channels + noise).astype(np.complex64)
    # The noise is exact if all channels are in the azimuth row of virtual antennas; channels outside are assumed to be equally noisy.
    gain = np.mean(np.abs(changed) ** 2 - np.abs(processed.channels) ** 2, axis=1)
    power = np.maximum(processed.power + gain, 0).astype(np.float32)
    floor = (processed.noise_floor + added).astype(np.float32)
    return Processed(processed.radar, processed.range_m, power, changed, None, processed.velocity_mps, floor)
