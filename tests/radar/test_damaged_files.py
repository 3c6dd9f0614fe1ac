"""Radar files and recordings whose values cannot be: one line that names the file and the value, never a traceback."""

import copy
import dataclasses
import json

import numpy as np
import pytest

from radartwin.errors import InputError, RecordingError
from radartwin.radar.chirp import Radar
from radartwin.radar.description import read_radar
from radartwin.radar.recording import Recording

RADAR = dataclasses.replace(Radar.iwr1843(), num_samples=64, num_chirps=8)
TOO_LARGE = int("1" + "0" * 400)  # a JSON number that no float holds

STUDIO = {"mmWaveDevices": [{"rfConfig": {"rlProfiles": [], "rlChirps": []}, "rawDataCaptureConfig": {"rlDevLaneEnable_t": {"laneEn": 3}}}]}


def refused(path, *words):
    with pytest.raises(RecordingError) as caught:
        read_radar(path)
    said = str(caught.value)
    assert "\n" not in said
    assert len(said) < 400
    for word in (path.name, *words):
        assert word in said


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"real_sampling": "false"}, "real_sampling"),
        ({"slope_hz_per_s": True}, "slope_hz_per_s"),
        ({"start_frequency_hz": TOO_LARGE}, "start_frequency_hz"),
        ({"num_samples": TOO_LARGE}, "num_samples"),
        ({"noise_figure_db": "quiet"}, "noise_figure_db"),
        ({"transmit_power_dbm": TOO_LARGE}, "transmit_power_dbm"),
        ({"tx_positions_m": [[TOO_LARGE, 0, 0]]}, "tx_positions_m"),
        ({"element": []}, "element"),
        ({"name": 5}, "name"),
    ],
)
def test_a_radar_field_of_the_wrong_kind_is_named(tmp_path, change, word):
    with pytest.raises(InputError, match=word):
        dataclasses.replace(RADAR, **change)
    path = tmp_path / "r.json"
    path.write_text(json.dumps({**RADAR.to_dict(), **change}))
    refused(path, word)


def test_numpy_numbers_are_numbers():
    radar = dataclasses.replace(RADAR, slope_hz_per_s=np.float32(70e12), num_chirps=np.int64(8), noise_figure_db=15)
    assert radar.num_chirps == 8


@pytest.mark.parametrize("text", ["{1: 2, a: 3}", "[1, 2]", "radar: 5", "5"])
def test_yaml_that_holds_no_radar_is_refused(tmp_path, text):
    path = tmp_path / "r.yaml"
    path.write_text(text)
    refused(path, "radar")


@pytest.mark.parametrize("text", ['{"name": 1' + "0" * 5000 + "}", "[" * 100_000], ids=["digits", "brackets"])
def test_json_that_python_will_not_read_is_refused(tmp_path, text):
    path = tmp_path / "r.json"
    path.write_text(text)
    refused(path)


@pytest.mark.parametrize(
    ("part", "key", "value"),
    [
        ((), "rfConfig", []),
        ((), "rawDataCaptureConfig", []),
        (("rawDataCaptureConfig",), "rlDevLaneEnable_t", 5),
        (("rawDataCaptureConfig", "rlDevLaneEnable_t"), "laneEn", float("inf")),
        (("rfConfig",), "rlProfiles", 5),
        (("rfConfig",), "rlChirps", {}),
    ],
)
def test_a_studio_section_of_the_wrong_kind_is_named(tmp_path, part, key, value):
    values = copy.deepcopy(STUDIO)
    section = values["mmWaveDevices"][0]
    for step in part:
        section = section[step]
    section[key] = value
    path = tmp_path / "r.mmwave.json"
    path.write_text(json.dumps(values))
    refused(path, key)


@pytest.mark.parametrize("devices", [[], 5, [5], {}])
def test_studio_devices_that_are_none_are_refused(tmp_path, devices):
    path = tmp_path / "r.mmwave.json"
    path.write_text(json.dumps({"mmWaveDevices": devices}))
    refused(path)


@pytest.mark.parametrize("value", ["nan", "inf", "-inf", "1e999"])
def test_a_cfg_number_that_is_not_finite_is_refused_with_its_line(tmp_path, value):
    path = tmp_path / "r.cfg"
    path.write_text(f"channelCfg 15 5 0\nprofileCfg {value} 77 7 6 57 0 0 70 1 256 5210 0 0 30\n")
    refused(path, "line 2", value)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"sensor_poses": np.full((1, 4, 4), np.nan).tolist()}, ("sensor_poses", "frame 0", "rigid")),
        ({"sensor_poses": [np.eye(4).tolist(), (2 * np.eye(4)).tolist()]}, ("sensor_poses", "frame 1", "rigid")),
        ({"sensor_poses": [np.diag([1.0, 1.0, -1.0, 1.0]).tolist()]}, ("sensor_poses", "rigid")),
        ({"sensor_poses": [(np.eye(4) * 1e300).tolist()]}, ("sensor_poses", "rigid")),
        ({"sensor_poses": "x"}, ("sensor_poses",)),
        ({"sensor_poses": [[1, 2], [3]]}, ("sensor_poses",)),
        ({"format": "radartwin recording 9"}, ("format", "recording 9")),
        ({"format": 1}, ("format",)),
        ({"iq_swapped": "false"}, ("iq_swapped",)),
        ({"iq_swapped": 0}, ("iq_swapped",)),
        ({"scale": 1e300}, ("scale",)),
        ({"scale": 1e-300}, ("scale",)),
        ({"scale": TOO_LARGE}, ("scale",)),
        ({"scale": "1"}, ("scale",)),
        ({"radar": 5}, ("radar", "mapping")),
        ({"radar": [1]}, ("radar", "mapping")),
        ({"provenance": 5}, ("a.json",)),
        ({"saturated": float("inf")}, ("a.json",)),
    ],
)
@pytest.mark.filterwarnings("error")
def test_a_recordings_json_with_a_value_that_cannot_be_is_refused(tmp_path, change, words):
    Recording(np.ones((2, 8, 2, 4, 64), np.complex64), RADAR, np.eye(4)[None]).save(tmp_path / "a")
    path = tmp_path / "a.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), **change}))
    with pytest.raises(RecordingError) as caught:
        Recording.load(tmp_path / "a")
    said = str(caught.value)
    assert "\n" not in said
    assert len(said) < 400
    for word in ("a.json", *words):
        assert word in said
