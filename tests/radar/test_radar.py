"""The radar description: the paper's configuration table, the array, the timing, and what it refuses."""

import dataclasses
import json

import numpy as np
import pytest

from radartwin.errors import InputError, MissingError
from radartwin.radar.antenna import element_gain
from radartwin.radar.chirp import Radar

C = 299_792_458.0


def test_derived_quantities_match_the_papers_table():
    radar = Radar.iwr1843()
    assert radar.sampled_bandwidth_hz == pytest.approx(3.44e9, abs=5e6)
    assert radar.range_resolution_m == pytest.approx(0.0436, abs=5e-5)
    assert radar.unambiguous_range_m == pytest.approx(11.16, abs=5e-3)
    assert radar.num_tx * radar.num_rx == 8
    assert (radar.num_samples, radar.num_chirps, radar.frame_rate_hz) == (256, 16, 10.0)


def test_velocity_limits_count_the_transmitters_turns():
    radar = Radar.iwr1843()
    wavelength = C / (77e9 + 3.4395e9 / 2)
    # One transmitter fires every 2 x 64 us; half a turn between its chirps is a quarter wavelength of motion.
    assert radar.max_velocity_mps == pytest.approx(wavelength / 4 / 128e-6, rel=1e-4)
    assert radar.velocity_resolution_mps == pytest.approx(wavelength / 2 / (16 * 128e-6), rel=1e-4)


def test_real_sampling_halves_the_unambiguous_range():
    radar = dataclasses.replace(Radar.iwr1843(), real_sampling=True)
    assert radar.unambiguous_range_m == pytest.approx(5.58, abs=5e-3)


def test_transmit_plus_receive_positions_are_a_half_wavelength_line_along_y():
    radar = Radar.iwr1843()
    assert radar.tx_positions.shape == (2, 3)
    assert radar.rx_positions.shape == (4, 3)
    line = np.array([t + r for t in radar.tx_positions for r in radar.rx_positions])
    assert np.all(line[:, [0, 2]] == 0)
    np.testing.assert_allclose(np.diff(np.sort(line[:, 1])), C / 77e9 / 2, rtol=1e-9)
    assert line.mean() == pytest.approx(0, abs=1e-12)
    np.testing.assert_array_equal(radar.virtual_positions, line)
    np.testing.assert_allclose(np.diff(radar.rx_positions[:, 1]), C / 77e9 / 2, rtol=1e-9)
    np.testing.assert_allclose(np.diff(radar.tx_positions[:, 1]), 2 * C / 77e9, rtol=1e-9)


def test_chirps_start_in_tdm_order():
    times = Radar.iwr1843().chirp_times()
    assert times.shape == (16, 2)
    assert times[0, 0] == 0
    assert times[0, 1] == pytest.approx(64e-6)
    assert times[5, 1] == pytest.approx((2 * 5 + 1) * 64e-6)


def test_description_survives_json():
    radar = Radar.iwr1843(element="isotropic")
    again = Radar.from_dict(json.loads(json.dumps(radar.to_dict())))
    assert again == radar
    assert hash(again) == hash(radar)


def test_description_file_is_read_as_yaml_and_json(tmp_path):
    radar = Radar.iwr1843()
    (tmp_path / "r.json").write_text(json.dumps(radar.to_dict()))
    lines = [f"{key}: {json.dumps(value)}" for key, value in radar.to_dict().items()]
    # YAML 1.1 takes an exponent without sign for text.
    text = "\n".join(lines).replace("77000000000.0", "77e9")
    (tmp_path / "r.yaml").write_text(text)
    assert Radar.from_file(tmp_path / "r.json") == radar
    assert Radar.from_file(tmp_path / "r.yaml") == radar


@pytest.mark.parametrize(
    ("change", "named"),
    [
        ({"start_frequency_hz": -1.0}, "start_frequency_hz"),
        ({"slope_hz_per_s": float("nan")}, "slope_hz_per_s"),
        ({"num_samples": 0}, "num_samples"),
        ({"num_chirps": 1.5}, "num_chirps"),
        ({"element": "horn"}, "horn"),
        ({"tx_positions_m": ()}, "tx_positions_m"),
        ({"rx_positions_m": ((0.0, 0.0),)}, "rx_positions_m"),
        ({"chirp_interval": 30e-6}, "chirp_interval"),
        ({"frame_rate_hz": 1000.0}, "frame_rate_hz"),
    ],
)
def test_an_impossible_radar_is_refused_by_name(change, named):
    with pytest.raises(InputError, match=named) as caught:
        dataclasses.replace(Radar.iwr1843(), **change)
    assert "\n" not in str(caught.value)


def test_unknown_and_missing_fields_are_named():
    values = Radar.iwr1843().to_dict()
    with pytest.raises(InputError, match="colour"):
        Radar.from_dict({**values, "colour": "red"})
    values.pop("num_chirps")
    with pytest.raises(InputError, match="num_chirps"):
        Radar.from_dict(values)


def test_a_missing_radar_file_is_named(tmp_path):
    with pytest.raises(MissingError, match=r"nothing\.cfg"):
        Radar.from_file(tmp_path / "nothing.cfg")


def _direction(azimuth_deg: float, elevation_deg: float) -> list[float]:
    a, e = np.radians([azimuth_deg, elevation_deg])
    return [float(np.cos(e) * np.cos(a)), float(np.cos(e) * np.sin(a)), float(np.sin(e))]


@pytest.mark.parametrize(
    ("azimuth", "elevation", "loss"),
    [(28, 0, 3), (-28, 0, 3), (50, 0, 6), (-50, 0, 6), (0, 14, 3), (0, -14, 3), (0, 20, 6), (0, -20, 6)],
)
def test_antenna_has_the_published_beamwidths(azimuth, elevation, loss):
    boresight = 20 * np.log10(element_gain("iwr1843", [1.0, 0.0, 0.0]))
    assert boresight == pytest.approx(10.5)
    gain = 20 * np.log10(element_gain("iwr1843", _direction(azimuth, elevation)))
    assert boresight - gain == pytest.approx(loss, abs=0.01)


def test_antenna_is_dark_behind_the_board_and_smooth_up_to_it():
    angles = np.arange(0, 181, 0.5)
    gain = element_gain("iwr1843", [_direction(a, 0) for a in angles])
    assert np.all(gain[angles > 90] == 0)
    assert np.all(np.diff(gain) <= 1e-12)
    # The steepest flank is the ground plane's, from a sixth of the amplitude to none over five degrees.
    assert np.abs(np.diff(gain)).max() < 0.05 * gain[0]


def test_antenna_cannot_radiate_more_than_it_is_fed():
    rng = np.random.default_rng(1)
    directions = rng.normal(size=(200_000, 3))
    assert np.mean(element_gain("iwr1843", directions) ** 2) < 1.0
    assert np.all(element_gain("isotropic", directions) == 1.0)


def test_antenna_refuses_unknown_elements_and_shapes():
    with pytest.raises(InputError, match="dish"):
        element_gain("dish", [1.0, 0.0, 0.0])
    with pytest.raises(InputError, match="shape"):
        element_gain("iwr1843", [1.0, 0.0])
