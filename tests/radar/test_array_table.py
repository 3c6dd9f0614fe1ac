"""Arrays from a user's own table: positions, gains and patterns against values written by hand."""

import dataclasses
import json

import numpy as np
from made_files import refused

import radartwin as rt
from radartwin.builders.radar import build_radar
from radartwin.config.compose import compose
from radartwin.errors import ConfigError
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
HALF = """antenna,y_half_wavelength,z_half_wavelength,design_frequency_hz,pattern
tx,0,,60e9,iwr1843
rx,-0.5,,60e9,iwr1843
rx,0.5,1,60e9,iwr1843
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
    fields = read_array(write(tmp_path, HALF))
    half = C / 60e9 / 2
    np.testing.assert_allclose(fields["rx_positions_m"], [(0, -half / 2, 0), (0, half / 2, half)], rtol=1e-12)
    assert fields["element"] == "iwr1843"
    assert "tx_gains_db" not in fields


def test_table_replaces_the_antennas_of_a_radar_file(tmp_path):
    """The file has four receivers with gains, and the tables have two receivers each: HALF without gains and with the pattern iwr1843."""
    table, other = write(tmp_path, HALF, "half.csv"), write(tmp_path, TABLE)
    gained = dataclasses.replace(rt.Radar.iwr1843(), tx_gains_db=(1.0, 2.0), rx_gains_db=(1.0, 2.0, 3.0, 4.0))
    (tmp_path / "r.json").write_text(json.dumps(gained.to_dict()))

    def built(*words):
        return build_radar(compose(["radar=file", f"radar.file={tmp_path / 'r.json'}", *words]).radar)

    radar = built(f"radar.array={table}", "radar.element=isotropic")
    assert (radar.element, radar.num_tx, radar.num_rx) == ("isotropic", 1, 2)
    assert (radar.tx_gains_db, radar.rx_gains_db) == (None, None)
    assert built(f"radar.array={table}").element == "iwr1843"
    assert built() == gained
    assert (built(f"radar.array={other}").rx_gains_db, built(f"radar.array={other}").slope_hz_per_s) == ((0.0, 3.0), 70e12)


def test_table_replaces_the_antennas_of_a_named_radar(tmp_path, monkeypatch):
    path = write(tmp_path, TABLE)
    radar = build_radar(compose(["radar=iwr6843", f"radar.array={path}", "radar.num_chirps=4"]).radar)
    assert radar.tx_positions_m == ((0.0, -0.004, 0.0), (0.0, 0.004, 0.002))
    assert (radar.num_rx, radar.num_chirps, radar.start_frequency_hz) == (2, 4, 60.49e9)
    refused(["radar.array"], compose, [f"radar.array={path}", "radar.tx_positions_m=[[0.0,0.0,0.0]]"], error=ConfigError)
    gained = dataclasses.replace(rt.Radar.iwr1843(), rx_gains_db=(1.0, 2.0, 3.0, 4.0))
    monkeypatch.setitem(NAMED, "iwr1843", lambda: gained)
    radar = build_radar(compose([f"radar.array={write(tmp_path, HALF, 'half.csv')}", "radar.element=isotropic"]).radar)
    assert (radar.element, radar.num_rx, radar.rx_gains_db) == ("isotropic", 2, None)


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
