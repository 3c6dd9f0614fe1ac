"""Tests of TI configuration files: values computed by hand from their text, and errors that name the line."""

import json

import numpy as np
import pytest
from made_files import refused, studio_json

from radartwin.radar.chirp import Radar

C = 299_792_458.0
CFG = """% made with the mmWave SDK visualizer
sensorStop
flushCfg
dfeDataOutputMode 1
channelCfg 15 5 0
adcCfg 2 1
adcbufCfg -1 0 1 1 1
profileCfg 0 77 7 5 60 0 0 70 1 256 5210 0 0 30   % comment
chirpCfg 0 0 0 0 0 0 0 1
chirpCfg 1 1 0 0 0 0 0 4
frameCfg 0 1 16 0 100 1 0
lowPower 0 0
sensorStart
"""


def _write(folder, text, name="radar.cfg"):
    path = folder / name
    path.write_text(text)
    return path


def test_sdk_cfg_is_read_as_the_radar_of_its_values(tmp_path):
    radar = Radar.from_file(_write(tmp_path, CFG))
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
    text = CFG.replace("channelCfg 15 5 0", "channelCfg 6 5 0").replace("0 0 0 0 0 0 0 1", "0 0 0 0 0 0 0 8")
    text = text.replace("0 0 0 0 0 0 0 8", "0 0 0 0 0 0 0 4").replace("1 1 0 0 0 0 0 4", "1 1 0 0 0 0 0 1")
    radar = Radar.from_file(_write(tmp_path, text))
    assert radar.num_rx == 2
    assert radar.tx_positions[0, 1] > radar.tx_positions[1, 1]


def test_power_backoff_and_real_sampling_are_read(tmp_path):
    text = CFG.replace("60 0 0 70", "60 6 0 70").replace("adcCfg 2 1", "adcCfg 2 0")
    radar = Radar.from_file(_write(tmp_path, text))
    assert radar.transmit_power_dbm == pytest.approx(6.0)
    assert radar.real_sampling


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("frameCfg 0 1 16", "frameCfg 0 1 x16", "line 11: frameCfg: 'x16' is not a number"),
        ("profileCfg 0 77", "profileCfg nan 77", "line 8: profileCfg: nan is not a finite number"),
        ("profileCfg 0 77", "profileCfg 0 1e999", "line 8: profileCfg: 1e999 is not a finite number"),
        ("0 77 7 5 60 0 0 70 1 256 5210 0 0 30", "0 77 7 5", "line 8: profileCfg needs"),
        ("70 1 256 5210", "70 1 256.5 5210", "line 8: 256.5 must be a whole number"),
        ("frameCfg 0 1 16 0 100 1 0\n", "", "no frameCfg"),
        ("frameCfg 0 1 16", "advFrameCfg 0 1 16", "line 11: advFrameCfg"),
        ("frameCfg 0 1 16", "frameCfg 0 2 16", "chirp 2"),
        ("frameCfg 0 1 16", "frameCfg 1 0 16", "fires no chirp, because it goes from chirp 1 to 0"),
        ("chirpCfg 1 1 0 0 0 0 0 4", "chirpCfg 1 1 0 0 0 0 0 5", "time division"),
        ("chirpCfg 1 1 0 0 0 0 0 4", "chirpCfg 1 1 0 0 0 0 0 1", "fires twice"),
        ("chirpCfg 1 1 0 0 0 0 0 4", "chirpCfg 1 1 0 0 0 5 0 4", "changes frequency, slope or times"),
        ("chirpCfg 1 1 0 0 0 0 0 4", "chirpCfg 1 1 3 0 0 0 0 4", "profile"),
        ("channelCfg 15 5 0", "channelCfg 0 5 0", "rx 0x0"),
        ("frameCfg 0 1 16 0 100", "frameCfg 0 1 16 0 1", "frame_rate_hz"),
        ("frameCfg 0 1 16 0 100", "frameCfg 0 1 16 0 0", "frame period"),
        ("70 1 256 5210", "70 1 2048 5210", "chirp_interval"),
    ],
)
def test_malformed_cfg_is_refused_with_its_place(tmp_path, old, new, words):
    assert old in CFG
    refused(["radar.cfg", words], Radar.from_file, _write(tmp_path, CFG.replace(old, new)))


@pytest.mark.parametrize(("start_ghz", "tx_mask", "spacing_m"), [(60, 5, 2 * C / 62e9), (77, 5, 2 * C / 77e9), (77, 3, 2 * C / 77e9)])
def test_board_follows_from_carrier_and_enabled_transmitters(tmp_path, start_ghz, tx_mask, spacing_m):
    """The carrier frequency and the enabled transmitters of a radar file identify the boards IWR6843ISK, IWR1843BOOST and IWR1642BOOST. On
    each board, the outer azimuth transmitters are two wavelengths apart.
    """
    text = CFG.replace("profileCfg 0 77", f"profileCfg 0 {start_ghz}").replace("channelCfg 15 5", f"channelCfg 15 {tx_mask}")
    radar = Radar.from_file(_write(tmp_path, text.replace("0 0 0 0 0 4", f"0 0 0 0 0 {tx_mask - 1}")))
    assert np.ptp(radar.tx_positions[:, 1]) == pytest.approx(spacing_m, rel=1e-9)


def test_studio_json_is_read_as_the_radar_of_the_static_room(shared_data):
    radar = Radar.from_file(shared_data / "radar/iwr6843_static_room/iwr6843_mmwaveDevice.mmwave.json")
    assert (radar.num_tx, radar.num_rx, radar.num_chirps, radar.num_samples) == (3, 4, 85, 512)
    assert radar.start_frequency_hz == pytest.approx(60e9 + 6 * 29.837e6, rel=1e-9)
    assert radar.range_resolution_m == pytest.approx(0.0392, abs=1e-4)
    assert radar.unambiguous_range_m == pytest.approx(20.1, abs=0.05)
    assert radar.chirp_interval == pytest.approx(414e-6)
    assert radar.velocity_resolution_mps / 2 < 0.07 / 2 * 1.1
    assert radar.frame_rate_hz == pytest.approx(1 / 0.15)
    # TX2 is raised, so eight channels form a row and four lie above it.
    assert np.count_nonzero(np.abs(radar.virtual_positions[:, 2]) < 1e-9) == 8


@pytest.mark.parametrize(
    ("part", "key", "value"),
    [
        ((), "rfConfig", []),
        ((), "rawDataCaptureConfig", []),
        (("rawDataCaptureConfig",), "rlDevLaneEnable_t", 5),
        (("rawDataCaptureConfig", "rlDevLaneEnable_t"), "laneEn", float("inf")),
        (("rawDataCaptureConfig", "rlDevLaneEnable_t"), "laneEn", "0xF"),
        (("rfConfig",), "rlProfiles", 5),
        (("rfConfig",), "rlChirps", {}),
        (("rfConfig", "rlFrameCfg_t"), "numLoops", None),
        (("rfConfig", "rlFrameCfg_t"), "numLoops", 1.5),
    ],
)
def test_invalid_part_of_a_studio_file_is_named(tmp_path, part, key, value):
    values = json.loads(studio_json())
    section = values["mmWaveDevices"][0]
    for step in part:
        section = section.setdefault(step, {})
    section[key] = value
    refused(["x.mmwave.json", key], Radar.from_file, _write(tmp_path, json.dumps(values), "x.mmwave.json"))


@pytest.mark.parametrize("devices", [[], 5, [5], {}])
def test_studio_file_without_a_device_is_refused(tmp_path, devices):
    refused(["x.mmwave.json"], Radar.from_file, _write(tmp_path, json.dumps({"mmWaveDevices": devices}), "x.mmwave.json"))
