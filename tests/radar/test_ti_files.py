"""TI configuration files: values worked out by hand from their text, and errors that name the line."""

import json

import numpy as np
import pytest

from radartwin.errors import RecordingError
from radartwin.radar.chirp import Radar
from radartwin.radar.description import read_radar

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


def test_sdk_cfg_gives_the_radar_it_describes(tmp_path):
    radar = Radar.from_file(_write(tmp_path, CFG))
    assert radar.name == "radar"
    # The first sample is 5 us into a 70 MHz/us ramp.
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


def test_receiver_mask_and_firing_order_are_followed(tmp_path):
    text = CFG.replace("channelCfg 15 5 0", "channelCfg 6 5 0").replace("0 0 0 0 0 0 0 1", "0 0 0 0 0 0 0 8")
    text = text.replace("0 0 0 0 0 0 0 8", "0 0 0 0 0 0 0 4").replace("1 1 0 0 0 0 0 4", "1 1 0 0 0 0 0 1")
    radar = Radar.from_file(_write(tmp_path, text))
    assert radar.num_rx == 2
    assert radar.tx_positions[0, 1] > radar.tx_positions[1, 1]


def test_power_back_off_and_real_sampling_are_read(tmp_path):
    text = CFG.replace("60 0 0 70", "60 6 0 70").replace("adcCfg 2 1", "adcCfg 2 0")
    radar = Radar.from_file(_write(tmp_path, text))
    assert radar.transmit_power_dbm == pytest.approx(6.0)
    assert radar.real_sampling


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("frameCfg 0 1 16", "frameCfg 0 1 x16", "line 11: frameCfg: 'x16' is not a number"),
        ("0 77 7 5 60 0 0 70 1 256 5210 0 0 30", "0 77 7 5", "line 8: profileCfg needs"),
        ("70 1 256 5210", "70 1 256.5 5210", "line 8: 256.5 must be a whole number"),
        ("frameCfg 0 1 16 0 100 1 0\n", "", "no frameCfg"),
        ("frameCfg 0 1 16", "advFrameCfg 0 1 16", "line 11: advFrameCfg"),
        ("frameCfg 0 1 16", "frameCfg 0 2 16", "chirp 2"),
        ("chirpCfg 1 1 0 0 0 0 0 4", "chirpCfg 1 1 0 0 0 0 0 5", "time division"),
        ("chirpCfg 1 1 0 0 0 0 0 4", "chirpCfg 1 1 0 0 0 0 0 1", "fires twice"),
        ("chirpCfg 1 1 0 0 0 0 0 4", "chirpCfg 1 1 0 0 0 5 0 4", "varies"),
        ("chirpCfg 1 1 0 0 0 0 0 4", "chirpCfg 1 1 3 0 0 0 0 4", "profile"),
        ("frameCfg 0 1 16 0 100", "frameCfg 0 1 16 0 1", "frame_rate_hz"),
        ("70 1 256 5210", "70 1 2048 5210", "chirp_interval"),
    ],
)
def test_malformed_cfg_is_one_line_with_file_and_place(tmp_path, old, new, said):
    assert old in CFG
    path = _write(tmp_path, CFG.replace(old, new))
    with pytest.raises(RecordingError) as caught:
        Radar.from_file(path)
    message = str(caught.value)
    assert said in message
    assert str(path) in message
    assert "\n" not in message


def test_files_of_another_kind_are_refused(tmp_path):
    for name, text in (("a.txt", CFG), ("a.json", "{"), ("b.json", "[1]"), ("a.yaml", "a: [1"), ("c.json", "{}")):
        with pytest.raises(RecordingError, match=name.replace(".", r"\.")) as caught:
            Radar.from_file(_write(tmp_path, text, name))
        assert "\n" not in str(caught.value)


def test_studio_json_gives_the_static_rooms_radar(shared_data):
    radar = Radar.from_file(shared_data / "radar/iwr6843_static_room/iwr6843_mmwaveDevice.mmwave.json")
    assert (radar.num_tx, radar.num_rx, radar.num_chirps, radar.num_samples) == (3, 4, 85, 512)
    assert radar.start_frequency_hz == pytest.approx(60e9 + 6 * 29.837e6, rel=1e-9)
    assert radar.range_resolution_m == pytest.approx(0.0392, abs=1e-4)
    assert radar.unambiguous_range_m == pytest.approx(20.1, abs=0.05)
    assert radar.chirp_interval == pytest.approx(414e-6)
    assert radar.velocity_resolution_mps / 2 < 0.07 / 2 * 1.1
    assert radar.frame_rate_hz == pytest.approx(1 / 0.15)
    # TX2 is the raised one: eight channels in a row, four above.
    assert np.count_nonzero(np.abs(radar.virtual_positions[:, 2]) < 1e-9) == 8


def test_studio_json_without_a_key_names_it(shared_data, tmp_path):
    source = shared_data / "radar/iwr6843_static_room/iwr6843_mmwaveDevice.mmwave.json"
    values = json.loads(source.read_text())
    del values["mmWaveDevices"][0]["rfConfig"]["rlFrameCfg_t"]["numLoops"]
    with pytest.raises(RecordingError, match="numLoops"):
        read_radar(_write(tmp_path, json.dumps(values), "x.mmwave.json"))


def test_studio_json_with_four_lanes_is_refused(shared_data, tmp_path):
    source = shared_data / "radar/iwr6843_static_room/iwr6843_mmwaveDevice.mmwave.json"
    text = source.read_text().replace('"laneEn": "0x3"', '"laneEn": "0xF"')
    with pytest.raises(RecordingError, match="laneEn"):
        read_radar(_write(tmp_path, text, "x.mmwave.json"))
