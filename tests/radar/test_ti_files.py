"""Tests of TI configuration files against values computed by hand from their text."""

import numpy as np
import pytest
from made_files import CFG

from radartwin.radar.chirp import Radar

C = 299_792_458.0


def read(folder, *changes):
    text = CFG
    for change in changes:
        text = text.replace(*change)
    (folder / "radar.cfg").write_text(text)
    return Radar.from_file(folder / "radar.cfg")


def test_sdk_cfg_is_read_as_the_radar_of_its_values(tmp_path):
    radar = read(tmp_path)
    assert radar.name == "radar"
    # The first sample is 5 us after the start of a 70 MHz/us ramp.
    assert radar.start_frequency_hz == pytest.approx(77.35e9)
    assert radar.slope_hz_per_s == pytest.approx(70e12)
    assert radar.sample_rate_hz == pytest.approx(5.21e6)
    assert (radar.num_samples, radar.num_chirps) == (256, 16)
    assert radar.chirp_interval == pytest.approx(67e-6)
    assert radar.frame_rate_hz == pytest.approx(10.0)
    assert not radar.real_sampling
    # TX1 and TX3 with four receivers: eight half-wavelength channels.
    line = np.sort(radar.virtual_positions[:, 1])
    np.testing.assert_allclose(np.diff(line), C / 77e9 / 2, rtol=1e-9)


def test_receiver_mask_and_firing_order_set_the_array(tmp_path):
    order = ("0 0 0 0 0 0 0 1", "0 0 0 0 0 0 0 4"), ("1 1 0 0 0 0 0 4", "1 1 0 0 0 0 0 1")
    radar = read(tmp_path, ("channelCfg 15 5", "channelCfg 6 5"), *order)
    assert radar.num_rx == 2
    assert radar.tx_positions[0, 1] > radar.tx_positions[1, 1]


def test_power_backoff_and_real_sampling_are_read(tmp_path):
    radar = read(tmp_path, ("60 0 0 70", "60 6 0 70"), ("adcCfg 2 1", "adcCfg 2 0"))
    assert radar.transmit_power_dbm == pytest.approx(6.0)
    assert radar.real_sampling


@pytest.mark.parametrize(("start_ghz", "tx_mask", "spacing_m"), [(60, 5, 2 * C / 62e9), (77, 5, 2 * C / 77e9), (77, 3, 2 * C / 77e9)])
def test_board_follows_from_carrier_and_enabled_transmitters(tmp_path, start_ghz, tx_mask, spacing_m):
    """On the boards IWR6843ISK, IWR1843BOOST and IWR1642BOOST, the outer azimuth transmitters are two wavelengths apart."""
    changes = {"profileCfg 0 77": f"profileCfg 0 {start_ghz}", "channelCfg 15 5": f"channelCfg 15 {tx_mask}"}
    radar = read(tmp_path, *changes.items(), ("0 0 0 0 0 4", f"0 0 0 0 0 {tx_mask - 1}"))
    assert np.ptp(radar.tx_positions[:, 1]) == pytest.approx(spacing_m, rel=1e-9)
