"""What features are read from, on a real capture: noise is what its quiet Doppler bins show, and what stands still has no speed."""

import numpy as np
import pytest

from radartwin.features import doppler
from radartwin.features.processed import process
from radartwin.radar.captures import load_capture

ROOM = "radar/iwr6843_static_room/iwr6843_frame_adc_data.bin"


def test_noise_and_rest_of_a_real_room(shared_data):
    made = process(load_capture(shared_data / ROOM))
    assert made.doppler is not None
    # Hann over the chirps has 1.5 / chirps of noise bandwidth, no window 1 / chirps; most Doppler bins of a room at rest hold noise alone.
    quiet = np.median(made.doppler, axis=1)[0] / 1.5
    level = 10 * np.log10(made.noise_floor.mean() / quiet.mean())
    assert level == pytest.approx(0, abs=0.5)
    # One exponential draw per channel: single bins scatter by 12 channels' worth.
    assert np.abs(10 * np.log10(made.noise_floor / quiet)).mean() < 2
    strongest = float(made.range_m[made.power[0].argmax()])
    assert np.abs(doppler.radial_velocity(made, strongest)) < 0.01
