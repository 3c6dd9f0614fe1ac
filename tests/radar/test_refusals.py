"""Each reader refuses a malformed text file in one line that names the file. A row is an input, and words of the message."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest
from made_files import CFG, LFS, log_text, refused, studio_json

from radartwin.errors import InputError, MissingError, RecordingError
from radartwin.radar.array_table import read_array
from radartwin.radar.captures import load_capture
from radartwin.radar.chirp import Radar
from radartwin.radar.studio_log import read_log
from radartwin.recordings.camera_pictures import Picture
from radartwin.recordings.mapping import read_mapping
from radartwin.scene.trajectories.file import read_track

ARRAYS = [
    ("a.csv", "antenna,y_m\ntx,0\nrx,0\n", ("no array",)),
    ("a.csv", "antenna,y_m\ntx,0\ntx,0.01\n", ("no receiver",)),
    ("a.csv", "antenna,y_m\ntx,0\nrx,0.01\nrx,0.01\n", ("rx", "1 and 2", "same position")),
    ("a.csv", "antenna,y_m\ntx,nan\nrx,0\nrx,0.01\n", ("antenna 1", "y_m", "finite")),
    ("a.csv", "antenna,y_m\ntx,wide\nrx,0\nrx,0.01\n", ("antenna 1", "wide")),
    ("a.csv", "antenna,y_mm\ntx,0\nrx,0\nrx,2\n", ("unknown column 'y_mm'", "half_wavelength")),
    ("a.csv", "antenna,y_m,z_half_wavelength\ntx,0,0\nrx,0,1\n", ("one unit",)),
    ("a.csv", "antenna,y_half_wavelength\ntx,0\nrx,0\nrx,1\n", ("design_frequency_hz",)),
    ("a.csv", "antenna,y_half_wavelength,design_frequency_hz\ntx,0,77\nrx,0,77\nrx,1,77\n", ("design_frequency_hz", "1e9")),
    ("a.csv", "antenna,y_m\ntx,0\nrx,0\nrx,11\n", ("11 m", "y_half_wavelength")),
    ("a.csv", "antenna,y_m,pattern\ntx,0,dish\nrx,0,dish\nrx,0.002,dish\n", ("dish", "iwr1843")),
    ("a.csv", "antenna,y_m,pattern\ntx,0,isotropic\nrx,0,iwr1843\nrx,0.002,iwr1843\n", ("one pattern", "isotropic")),
    ("a.csv", "antenna,y_m\nboth,0\nrx,0\n", ("antenna 1", "both")),
    ("a.csv", "antenna,y_m\ntx,0,0\n", ("line 2", "cells")),
    ("a.csv", 'antenna,y_m\n"tx,0\n', ("valid CSV",)),
    ("a.csv", "antenna,y_m\n", ("no antenna",)),
    ("a.csv", "", ("no antenna",)),
    ("a.csv", "antenna,y_m, y_m\ntx,0,0\nrx,0,0\nrx,0.002,0.003\n", ("column y_m occurs twice",)),
    ("a.csv", "antenna,y_m,gain_db\ntx,0,1e9\nrx,0,0\nrx,0.002,0\n", ("antenna 1: gain_db", "-100 to 100 dB, not 1e+09")),
    ("a.yaml", "elements: []", (".csv",)),
    ("a.txt", "antenna,y_m", (".csv",)),
]
# Changes of a valid .cfg.
CONFIGURATIONS = [
    ("frameCfg 0 1 16", "frameCfg 0 1 x16", "line 11: frameCfg: 'x16' is not a number"),
    ("profileCfg 0 77", "profileCfg nan 77", "line 8: profileCfg: nan is not a finite number"),
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
    ("dfeDataOutputMode 1", "dfeDataOutputMode 3", "line 4: frame_mode 3 is not supported"),
    ("frameCfg 0 1 16 0 100", "frameCfg 0 1 16 0 0", "frame period"),
    ("70 1 256 5210", "70 1 2048 5210", "chirp_interval"),
]
# Changed parts of the first device of a valid .mmwave.json: the place, its last key and the value.
STUDIO = [
    ("", "rfConfig", []),
    ("rawDataCaptureConfig", "rlDevLaneEnable_t", 5),
    ("rawDataCaptureConfig.rlDevLaneEnable_t", "laneEn", float("inf")),
    ("rawDataCaptureConfig.rlDevLaneEnable_t", "laneEn", "0xF"),
    ("rawDataCaptureConfig.rlDevDataPathCfg_t", "transferFmtPkt1", "0x6"),
    ("rfConfig", "rlDynChirpCfgs", [{"rlDynChirpCfg_t": {"chirpSegSel": 0}}]),
    ("rfConfig", "rlProfiles", 5),
    ("rfConfig", "rlChirps", {}),
    ("rfConfig.rlFrameCfg_t", "numLoops", None),
    ("rfConfig.rlFrameCfg_t", "numLoops", 1.5),
]
RADARS = [
    *(("x.mmwave.json", json.dumps({"mmWaveDevices": devices}), ()) for devices in ([], 5, [5])),
    ("x.mmwave.json", json.dumps({"mmWaveDevices": 4 * json.loads(studio_json())["mmWaveDevices"]}), ("4 devices", "awr2243_cascade")),
    ("r.yaml", "{1: 2, a: 3}", ("radar",)),
    ("r.yaml", "radar: 5", ("radar",)),
    ("r.yaml", "a: [1", ("line 1",)),
    ("r.json", '{"name": 1' + "0" * 5000 + "}", ()),
    ("r.json", "[" * 100_000, ()),
    ("r.json", "{", ("line 1",)),
    ("r.json", "[1]", ()),
    ("r.txt", "channelCfg 15 5 0", (".cfg",)),
    *(("r.json", json.dumps({**Radar.iwr1843().to_dict(), "waveform": name}), (str(name), "FMCW")) for name in ("ofdm", 5)),
]
MAPPINGS = [
    ("m.yaml", "captures: [", ("line 1",)),
    ("m.yaml", "- 1", ("keys card and captures",)),
    ("m.yaml", "files: []", ("keys card and captures",)),
    ("m.yaml", "captures: {a: b}", ("list of mappings",)),
    ("m.yaml", "captures: [{object: mug}]", ("captures[0]: the key 'file' is missing",)),
    ("m.csv", "file,object\na,b\n", ("ends in .yaml",)),
    ("m.txt", "", ("ends in .yaml",)),
]
LOGS = [
    (log_text(9, mode="Multi"), "log mode Multi"),
    (log_text(9, lanes=4), "4 LVDS lanes"),
    ("", "number of received packets is missing"),
    (log_text(9).replace("received packets - 9", "received packets - none"), "'none' is not a number"),
    (log_text(9).replace("Mon Mar  2", "Montag, 2."), "is not a time"),
]


def studio_with(place: str, key: str, value: object) -> str:
    values = json.loads(studio_json())
    section = values["mmWaveDevices"][0]
    for step in filter(None, place.split(".")):
        section = section.setdefault(step, {})
    section[key] = value
    return json.dumps(values)


TABLE = [
    *((read_array, *row) for row in ARRAYS),
    *((Radar.from_file, "r.cfg", CFG.replace(old, new), (words,)) for old, new, words in CONFIGURATIONS),
    *((Radar.from_file, "x.mmwave.json", studio_with(*change), (change[1],)) for change in STUDIO),
    *((Radar.from_file, *row) for row in RADARS),
    *((read_mapping, *row) for row in MAPPINGS),
    *((read_log, "a_LogFile.csv", text, (words,)) for text, words in LOGS),
]


@pytest.mark.parametrize(("read", "name", "text", "words"), TABLE, ids=range(len(TABLE)))
def test_malformed_file_is_refused_in_one_line(tmp_path, read, name, text, words):
    (tmp_path / name).write_text(text)
    refused([name, *words], read, tmp_path / name, error=InputError if read is read_mapping else RecordingError)


READERS: dict[str, Callable[[Path], object]] = {
    **dict.fromkeys(("a.cfg", "a.mmwave.json", "a.yaml"), Radar.from_file), "array.csv": read_array,
    **dict.fromkeys(("a.npy", "a.npz"), lambda path: load_capture(path, Radar.iwr1843())), "a.bin": load_capture, "a_LogFile.csv": read_log,
    "map.yaml": read_mapping, "track.txt": read_track, "track.mcap": read_track,
    "0.1.png": lambda path: Picture(path, 0, "png").read(),
}  # fmt: skip


@pytest.mark.parametrize("name", READERS)
def test_each_reader_names_an_absent_file_and_a_git_lfs_pointer(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    refused([name], READERS[name], Path(name), error=InputError if name.endswith(".png") else MissingError)
    Path(name).write_bytes(LFS)
    refused([f"{name}: it is a Git LFS pointer"], READERS[name], Path(name))
