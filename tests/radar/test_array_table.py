"""Arrays from a user's own table: positions, gains and patterns against values written by hand."""

import dataclasses
import json

import numpy as np
from made_files import refused

import radartwin as rt
from radartwin.builders.radar import build_radar
from radartwin.config.compose import compose
from radartwin.errors import ConfigError
from radartwin.radar.angles import azimuth_spectrum
from radartwin.radar.array_table import read_array
from radartwin.radar.named import NAMED
from radartwin.simulation.paths import Paths
from radartwin.simulation.signal.synthesis import synthesize
from radartwin.store.digest import spec_digest

C = 299_792_458.0
TABLE = """antenna,x_m,y_m,z_m,gain_db,pattern
tx,0,-0.004,0,0,isotropic
tx,0,0.004,0.002,-6,isotropic
rx,0,-0.001,0,0,isotropic
rx,0,0.001,0,3,isotropic
"""
HALF = """
design_frequency_hz: 60e9
pattern: iwr1843
elements:
  - {antenna: tx, y_half_wavelength: 0}
  - {antenna: rx, y_half_wavelength: -0.5}
  - {antenna: rx, y_half_wavelength: 0.5, z_half_wavelength: 1}
"""


def write(folder, text, name="array.csv"):
    (folder / name).write_text(text)
    return folder / name


def test_table_in_metres_is_read_with_gains_and_pattern(tmp_path):
    fields = read_array(write(tmp_path, TABLE))
    assert fields["tx_positions_m"] == ((0.0, -0.004, 0.0), (0.0, 0.004, 0.002))
    assert fields["rx_positions_m"] == ((0.0, -0.001, 0.0), (0.0, 0.001, 0.0))
    assert fields["tx_gains_db"] == (0.0, -6.0)
    assert fields["rx_gains_db"] == (0.0, 3.0)
    assert fields["element"] == "isotropic"


def test_half_wavelengths_are_those_of_the_design_frequency(tmp_path):
    fields = read_array(write(tmp_path, HALF, "array.yaml"))
    half = C / 60e9 / 2
    np.testing.assert_allclose(fields["rx_positions_m"], [(0, -half / 2, 0), (0, half / 2, half)], rtol=1e-12)
    assert fields["element"] == "iwr1843"
    assert "tx_gains_db" not in fields


def test_wrong_table_stops_a_simulation_in_one_line(tmp_path, inside):
    path = write(tmp_path, "antenna,y_m\ntx,0\nrx,0\n")
    done = inside("simulate", "scene=plate", "trajectory=static", f"radar.array={path}", "--out", tmp_path / "out")
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "array.csv" in done.stderr
    assert not (tmp_path / "out.bin").exists()


def test_table_with_a_radar_file_yields_to_the_configured_element_and_drops_the_gains_of_the_file(tmp_path):
    """The file has four receivers with gains, and the table has the pattern iwr1843 and two receivers without gains."""
    table = write(tmp_path, HALF, "a.yaml")
    gained = dataclasses.replace(rt.Radar.iwr1843(), tx_gains_db=(1.0, 2.0), rx_gains_db=(1.0, 2.0, 3.0, 4.0))
    (tmp_path / "r.json").write_text(json.dumps(gained.to_dict()))
    chosen = ["radar=file", f"radar.file={tmp_path / 'r.json'}"]
    radar = build_radar(compose([*chosen, f"radar.array={table}", "radar.element=isotropic"]).radar)
    assert (radar.element, radar.num_tx, radar.num_rx) == ("isotropic", 1, 2)
    assert (radar.tx_gains_db, radar.rx_gains_db) == (None, None)
    assert build_radar(compose([*chosen, f"radar.array={table}"]).radar).element == "iwr1843"
    assert build_radar(compose(chosen).radar) == gained


def test_table_with_a_named_radar_yields_to_the_configured_element_and_drops_the_gains_of_the_board(tmp_path, monkeypatch):
    gained = dataclasses.replace(rt.Radar.iwr1843(), rx_gains_db=(1.0, 2.0, 3.0, 4.0))
    monkeypatch.setitem(NAMED, "iwr1843", lambda: gained)
    radar = build_radar(compose([f"radar.array={write(tmp_path, HALF, 'a.yaml')}", "radar.element=isotropic"]).radar)
    assert (radar.element, radar.num_rx, radar.rx_gains_db) == ("isotropic", 2, None)


def test_table_replaces_the_antennas_of_any_radar(tmp_path):
    path = write(tmp_path, TABLE)
    radar = build_radar(compose(["radar=iwr6843", f"radar.array={path}", "radar.num_chirps=4"]).radar)
    assert radar.tx_positions_m == ((0.0, -0.004, 0.0), (0.0, 0.004, 0.002))
    assert (radar.num_rx, radar.num_chirps, radar.start_frequency_hz) == (2, 4, 60.49e9)
    (tmp_path / "r.json").write_text(json.dumps(rt.Radar.iwr1843().to_dict()))
    beside = build_radar(compose(["radar=file", f"radar.file={tmp_path / 'r.json'}", f"radar.array={path}"]).radar)
    assert beside.rx_gains_db == (0.0, 3.0)
    assert beside.slope_hz_per_s == 70e12
    refused(["radar.array"], compose, [f"radar.array={path}", "radar.tx_positions_m=[[0.0,0.0,0.0]]"], error=ConfigError)


def test_a_changed_table_changes_the_key_of_a_run(tmp_path):
    path = write(tmp_path, TABLE)
    before = spec_digest(compose([f"radar.array={path}"]).radar)
    path.write_text(TABLE.replace("0.004", "0.005"))
    assert spec_digest(compose([f"radar.array={path}"]).radar) != before


def test_gains_scale_the_channels_of_every_path():
    """A gain of g dB multiplies the samples of its channel by 10^(g/20); the reference is the same radar without gains."""
    radar = dataclasses.replace(rt.Radar.iwr1843("isotropic"), num_chirps=2)
    gained = dataclasses.replace(radar, tx_gains_db=(0.0, -6.0), rx_gains_db=(0.0, 3.0, -20.0, 1.5))
    assert rt.Radar.from_dict(json.loads(json.dumps(gained.to_dict()))) == gained
    directions = np.array([[1.0, 0.0, 0.0], [0.8, 0.6, 0.0]])
    lengths = np.array([2.0, 3.5])
    paths = Paths(
        1, np.zeros(2, int), np.ones(2, int), np.array([[1.0 + 0j], [0.3j]]), np.array([radar.center_frequency_hz]), lengths, lengths,
        directions, directions, np.zeros(2),
    )  # fmt: skip
    expected = 10 ** (np.add.outer([0.0, -6.0], [0.0, 3.0, -20.0, 1.5]) / 20)
    plain, out = synthesize(paths, radar), np.ones((1, 2, 2, 4, 256), np.complex64)
    np.testing.assert_allclose(synthesize(paths, gained), plain * expected[:, :, None], rtol=1e-5)
    synthesize(paths, gained, out=out)
    np.testing.assert_allclose(out, 1 + plain * expected[:, :, None], rtol=1e-5, atol=1e-6)


def test_table_with_two_receivers_has_their_beam(tmp_path):
    """Two receivers half a wavelength apart have the power cos^2(pi/2 sin(azimuth)), here in the field of a plane wave from 20 degrees."""
    radar = dataclasses.replace(rt.Radar.iwr1843(), **read_array(write(tmp_path, HALF.replace(", z_half_wavelength: 1", ""), "a.yaml")))
    radar = dataclasses.replace(radar, start_frequency_hz=60e9 - radar.sampled_bandwidth_hz / 2)  # 60 GHz at the middle of the sweep
    from_deg, angles = 20.0, np.radians(np.arange(-60, 61, 5.0))
    # The phase is smaller at an antenna nearer to the target; +y is to the left.
    wave = np.exp(-1j * np.pi * np.sin(np.radians(from_deg)) * np.array([-0.5, 0.5]))[None, None]  # (snapshot, tx, rx)
    expected = np.cos(np.pi / 2 * (np.sin(angles) - np.sin(np.radians(from_deg)))) ** 2
    np.testing.assert_allclose(azimuth_spectrum(wave, radar, angles), expected, atol=1e-9)
