"""Make noisy copies of simulated recordings, at the signal-to-noise ratio of the measured recordings.

Paper, recognition with simulation-trained representations: 30 noise-augmented copies per object, matched to measured SNR. Receiver noise is
white over the samples of a chirp, so the noise is drawn there and transformed like a signal. The window of the range FFT then correlates
the noise of neighbouring range bins. The noise level is matched to the median target energy of a whole stratum, so that objects with weak
echoes keep a lower signal-to-noise ratio than objects with strong echoes. The measured recordings contribute energies and noise floors, but
no labels.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from radartwin.errors import InputError
from radartwin.features.processed import Processed
from radartwin.radar.processing import range_fft


def added_noise(simulated: NDArray, measured: NDArray, measured_noise: float) -> float:
    """Compute the noise power per range bin that gives simulated recordings the signal-to-noise ratio of the measured recordings.

    Args:
        simulated, measured: target energies of the simulated (n,) and measured (m,) recordings of a stratum.
        measured_noise: noise power per range bin of the measured recordings.
    Returns:
        median(simulated) / median(measured) * measured_noise.
    Raises:
        InputError: a median energy is not above zero.
    """
    ours, theirs = float(np.median(simulated)), float(np.median(measured))
    if not (ours > 0 and theirs > 0 and measured_noise >= 0):
        raise InputError("noise copies: the targets have no energy above the noise; check that the logged distances match the recordings")
    return ours / theirs * measured_noise


def noisy(processed: Processed, noise_power: float, rng: np.random.Generator) -> Processed:
    """Return a copy, without Doppler, whose noise power per range bin is `noise_power`.

    If the recording already has noise, only the missing noise power is added, or none if its noise is stronger.
    """
    added = max(0.0, noise_power - float(processed.noise_floor.mean()))
    frames, channels, _ = processed.channels.shape
    samples = processed.radar.num_samples
    white = rng.standard_normal((frames, channels, 2 * samples), dtype=np.float32).view(np.complex64)
    profile, _ = range_fft(white, processed.radar)
    unit = float(np.sqrt(np.mean(np.abs(profile) ** 2)))
    noise = profile[..., : len(processed.range_m)] * np.float32(np.sqrt(added) / unit)
    changed = (processed.channels + noise).astype(np.complex64)
    # Exact if the azimuth row of virtual antennas is all channels; channels outside the row are assumed to have the same noise.
    gain = np.mean(np.abs(changed) ** 2 - np.abs(processed.channels) ** 2, axis=1)
    power = np.maximum(processed.power + gain, 0).astype(np.float32)
    floor = (processed.noise_floor + added).astype(np.float32)
    return Processed(processed.radar, processed.range_m, power, changed, None, processed.velocity_mps, floor)


def copies(processed: Processed, noise_power: float, count: int, seed: int | list[int]) -> Iterator[Processed]:
    for number in range(count):
        yield noisy(processed, noise_power, np.random.default_rng([*np.atleast_1d(seed).tolist(), number]))
