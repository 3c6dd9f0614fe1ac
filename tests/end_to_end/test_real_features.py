"""Processed recording of a real capture: its noise agrees with the quiet Doppler bins, and echoes at rest have no speed."""

import numpy as np
import pytest

from radartwin.features import doppler
from radartwin.features.processed import process
from radartwin.radar.captures import load_capture

ROOM = "radar/iwr6843_static_room/iwr6843_frame_adc_data.bin"


def test_noise_and_rest_of_a_real_room(shared_data):
    made = process(load_capture(shared_data / ROOM))
    assert made.doppler is not None
    # The noise bandwidth is 1.5 / chirps with the Hann window and 1 / chirps without. Most Doppler bins of a static room are noise only.
    quiet = np.median(made.doppler, axis=1)[0] / 1.5
    level = 10 * np.log10(made.noise_floor.mean() / quiet.mean())
    assert level == pytest.approx(0, abs=0.5)
    # A bin averages one exponential draw of 12 channels.
    assert np.abs(10 * np.log10(made.noise_floor / quiet)).mean() < 2
    strongest = float(made.range_m[made.power[0].argmax()])
    assert np.abs(doppler.radial_velocity(made, strongest)) < 0.01
