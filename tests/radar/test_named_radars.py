"""Compare the named radars with the published layouts and timings of their boards."""

import numpy as np
import pytest

from radartwin.builders.radar import named_radar
from radartwin.radar.boards import MMWCAS_RF_EVM
from radartwin.radar.processing import azimuth_row

C = 299_792_458.0
# Places of the antennas of the MMWCAS-RF-EVM in half wavelengths at 76.8 GHz, as TI's processing example lists them by TX and RX number.
CASCADE_TX_AZIMUTH = [11, 10, 9, 32, 28, 24, 20, 16, 12, 8, 4, 0]
CASCADE_TX_ELEVATION = [6, 4, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0]
CASCADE_RX_AZIMUTH = [11, 12, 13, 14, 50, 51, 52, 53, 46, 47, 48, 49, 0, 1, 2, 3]


# Number of channels, of channels in the azimuth row and of their different places, and the design frequency of the half wavelength.
ARRAYS = {"iwr1843": (8, 8, 8, 77e9), "iwr6843": (12, 8, 8, 62e9), "awr2243_cascade": (192, 144, 86, 76.8e9)}


@pytest.mark.parametrize("name", ARRAYS)
def test_azimuth_row_is_a_filled_half_wavelength_line(name):
    channels, row, places, design_hz = ARRAYS[name]
    radar = named_radar(name)
    assert radar.name == name
    assert radar.num_tx * radar.num_rx == channels
    channels_of_row = azimuth_row(radar)
    assert len(channels_of_row) == row
    y = np.unique(np.round(radar.virtual_positions[channels_of_row, 1] / (C / design_hz / 2), 6))
    assert len(y) == places
    np.testing.assert_allclose(np.diff(y), 1.0, atol=1e-5)  # rounded to 1e-6 above


def test_boards_have_the_published_places_and_the_cascade_fires_from_tx12_down_to_tx1():
    """TI's Cascade_Configuration_MIMO.lua sends chirps 0 to 11 with TX2, TX1, TX0 of device 4, then of devices 3, 2 and 1. Transmitter k of
    device d is TX 3 (d - 1) + k + 1 of the board.
    """
    fired = [3 * (device - 1) + k for device in (4, 3, 2, 1) for k in (2, 1, 0)]
    radar, half = named_radar("awr2243_cascade"), C / 76.8e9 / 2
    assert (radar.tx_positions_m, radar.rx_positions_m) == (MMWCAS_RF_EVM.tx_positions_m[::-1], MMWCAS_RF_EVM.rx_positions_m)
    tx, rx = radar.tx_positions / half, radar.rx_positions / half
    np.testing.assert_allclose(tx[:, 1] - tx[:, 1].min(), np.array(CASCADE_TX_AZIMUTH)[fired], atol=1e-9)
    np.testing.assert_allclose(tx[:, 2], np.array(CASCADE_TX_ELEVATION)[fired], atol=1e-9)
    np.testing.assert_allclose(rx[:, 1] - rx[12, 1], CASCADE_RX_AZIMUTH, atol=1e-9)
    assert not tx[:, 0].any()
    assert not rx[:, [0, 2]].any()
    isk, wavelength = named_radar("iwr6843"), C / 62e9
    np.testing.assert_allclose(np.diff(isk.tx_positions[:, 1]), wavelength, rtol=1e-9)
    np.testing.assert_allclose(isk.tx_positions[:, 2], [0, wavelength / 2, 0], atol=1e-12)
    np.testing.assert_allclose(np.diff(isk.rx_positions[:, 1]), wavelength / 2, rtol=1e-9)


@pytest.mark.parametrize(
    ("name", "first_hz", "bandwidth_hz", "chirp_s", "transmitters", "band_hz"),
    [
        ("iwr1843", 77e9, 70e12 * 256 / 5.21e6, 64e-6, 2, (76e9, 81e9)),
        ("iwr6843", 60.49e9, 70e12 * 256 / 5.21e6, 64.14e-6, 3, (60e9, 64e9)),
        ("awr2243_cascade", 77.474e9, 79e12 * 256 / 8e6, 45e-6, 12, (76e9, 81e9)),
    ],
)
def test_resolution_and_speed_follow_from_the_waveform(name, first_hz, bandwidth_hz, chirp_s, transmitters, band_hz):
    """The transmitters take turns, so that one of them fires every N chirp intervals. Between its chirps, the phase of a target may change
    by pi, which is a quarter wavelength of motion.
    """
    radar = named_radar(name)
    assert radar.range_resolution_m == pytest.approx(C / (2 * bandwidth_hz), rel=1e-12)
    wavelength = C / (first_hz + bandwidth_hz / 2)
    assert radar.max_velocity_mps == pytest.approx(wavelength / (4 * transmitters * chirp_s), rel=1e-12)
    assert radar.velocity_resolution_mps == pytest.approx(wavelength / (2 * radar.num_chirps * transmitters * chirp_s), rel=1e-12)
    assert band_hz[0] <= radar.start_frequency_hz
    assert radar.start_frequency_hz + radar.sampled_bandwidth_hz <= band_hz[1]
