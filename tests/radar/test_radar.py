"""Tests of the radar: configuration table of the paper, antenna array and timing, description as YAML and JSON, and antenna pattern."""

import dataclasses
import json

import numpy as np
import pytest
from made_files import refused

from radartwin.errors import InputError
from radartwin.radar.antenna import element_gain
from radartwin.radar.chirp import Radar

RADAR = Radar.iwr1843()
TOO_LARGE = int("1" + "0" * 400)  # a JSON number beyond the range of a float


def test_derived_quantities_match_the_papers_table():
    assert RADAR.sampled_bandwidth_hz == pytest.approx(3.44e9, abs=5e6)
    assert RADAR.range_resolution_m == pytest.approx(0.0436, abs=5e-5)
    assert RADAR.unambiguous_range_m == pytest.approx(11.16, abs=5e-3)
    assert RADAR.num_tx * RADAR.num_rx == 8
    assert (RADAR.num_samples, RADAR.num_chirps, RADAR.frame_rate_hz) == (256, 16, 10.0)
    assert dataclasses.replace(RADAR, real_sampling=True).unambiguous_range_m == pytest.approx(5.58, abs=5e-3)


def test_chirps_start_in_tdm_order():
    times = RADAR.chirp_times()
    assert times.shape == (16, 2)
    assert times[0, 0] == 0
    assert times[0, 1] == pytest.approx(64e-6)
    assert times[5, 1] == pytest.approx((2 * 5 + 1) * 64e-6)


def test_description_round_trips_through_json_and_yaml(tmp_path):
    (tmp_path / "r.json").write_text(json.dumps(RADAR.to_dict()))
    lines = [f"{key}: {json.dumps(value)}" for key, value in RADAR.to_dict().items()]
    # YAML 1.1 reads an exponent without a sign as text.
    (tmp_path / "r.yaml").write_text("\n".join(lines).replace("77000000000.0", "77e9"))
    for name in ("r.json", "r.yaml"):
        radar = Radar.from_file(tmp_path / name)
        assert radar == RADAR
        assert hash(radar) == hash(RADAR)


@pytest.mark.parametrize(
    ("change", "field"),
    [
        ({"name": 5}, "name"),
        ({"start_frequency_hz": -1.0}, "start_frequency_hz"),
        ({"slope_hz_per_s": float("nan")}, "slope_hz_per_s"),
        ({"slope_hz_per_s": True}, "slope_hz_per_s"),
        ({"num_samples": 0}, "num_samples"),
        ({"num_samples": TOO_LARGE}, "num_samples"),
        ({"num_chirps": 1.5}, "num_chirps"),
        ({"element": []}, "element"),
        ({"tx_positions_m": [[TOO_LARGE, 0, 0]]}, "tx_positions_m"),
        ({"rx_positions_m": ((0.0, 0.0),)}, "rx_positions_m"),
        ({"chirp_interval": 30e-6}, "chirp_interval"),
        ({"frame_rate_hz": 1000.0}, "frame_rate_hz"),
        ({"real_sampling": "false"}, "real_sampling"),
        ({"transmit_power_dbm": TOO_LARGE}, "transmit_power_dbm"),
        ({"tx_gains_db": (1.0,)}, "tx_gains_db must be 2"),
        ({"rx_gains_db": (1.0, 2.0, 3.0, float("nan"))}, "rx_gains_db must be 4"),
        ({"rx_positions_m": ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))}, "antennas 1 and 2 are at the same position"),
    ],
)
def test_invalid_field_is_named_with_the_file(tmp_path, change, field):
    refused([field], dataclasses.replace, RADAR, error=InputError, **change)
    path = tmp_path / "r.json"
    path.write_text(json.dumps({**RADAR.to_dict(), **change}))
    refused([path.name, field], Radar.from_file, path)


def test_unknown_and_missing_fields_are_named_and_the_waveform_may_be():
    values = RADAR.to_dict()
    assert Radar.from_dict({**values, "waveform": "fmcw"}) == RADAR
    assert dataclasses.replace(RADAR, slope_hz_per_s=np.float32(70e12), num_chirps=np.int64(8), noise_figure_db=15).num_chirps == 8
    refused(["colour"], Radar.from_dict, {**values, "colour": "red"}, error=InputError)
    values.pop("num_chirps")
    refused(["num_chirps"], Radar.from_dict, values, error=InputError)
    refused(["dish"], element_gain, "dish", [1.0, 0.0, 0.0], error=InputError)
    refused(["shape"], element_gain, "iwr1843", [1.0, 0.0], error=InputError)


def _direction(azimuth_deg: float, elevation_deg: float) -> list[float]:
    a, e = np.radians([azimuth_deg, elevation_deg])
    return [float(np.cos(e) * np.cos(a)), float(np.cos(e) * np.sin(a)), float(np.sin(e))]


@pytest.mark.parametrize(("azimuth", "elevation", "loss"), [(28, 0, 3), (-50, 0, 6), (0, 14, 3), (0, -20, 6)])
def test_antenna_has_the_published_beamwidths(azimuth, elevation, loss):
    boresight = 20 * np.log10(element_gain("iwr1843", [1.0, 0.0, 0.0]))
    assert boresight == pytest.approx(10.5)
    gain = 20 * np.log10(element_gain("iwr1843", _direction(azimuth, elevation)))
    assert boresight - gain == pytest.approx(loss, abs=0.01)


def _elevation_cut(elevations_deg):
    return element_gain("iwr1843", [_direction(0, e) for e in elevations_deg])


def _three_patches(elevations_deg):
    """Return the field of three patches in series as a sum over their six radiating edges, relative to its peak.

    Patches and edges are one and one half wavelength on the board apart, which is 0.6 and 0.3 wavelengths in air.
    """
    edges = np.array([-0.75, -0.45, -0.15, 0.15, 0.45, 0.75])
    return np.exp(2j * np.pi * np.outer(np.sin(np.radians(elevations_deg)), edges)).mean(axis=1)


def test_elevation_side_lobe_is_that_of_three_patches():
    """Three patches have the published beamwidths in elevation within 0.2 dB. Their side lobe is 12 to 18 dB below the peak gain up to 80
    degrees, apart from the ground plane's 0.4 dB at 80 degrees.
    """
    assert 20 * np.log10(np.abs(_three_patches([14, 20]))) == pytest.approx([-3, -6], abs=0.2)
    elevations = np.arange(50, 81)
    level_db = 20 * np.log10(_elevation_cut(elevations) / _elevation_cut([0]))
    np.testing.assert_allclose(level_db, 20 * np.log10(np.abs(_three_patches(elevations))), atol=0.5)
    assert level_db.max() == pytest.approx(-12.4, abs=0.1)
    lowest = 20 * np.log10(_elevation_cut(np.arange(-80, 81)).min() / _elevation_cut([0])[0])
    assert -20 < lowest < -15
    np.testing.assert_allclose(_elevation_cut(-elevations), _elevation_cut(elevations))


def test_antenna_gain_is_smooth_ends_at_the_board_and_radiates_less_power_than_its_input():
    angles = np.arange(0, 181, 0.5)
    gain = element_gain("iwr1843", [_direction(a, 0) for a in angles])
    assert np.all(gain[angles > 90] == 0)
    assert np.all(np.diff(gain) <= 1e-12)
    # The ground plane makes the steepest flank: from a sixth of the amplitude to zero over five degrees.
    assert np.abs(np.diff(gain)).max() < 0.05 * gain[0]
    slope = np.diff(upright := _elevation_cut(np.arange(-90, 90.05, 0.1)))
    assert np.abs(np.diff(slope)).max() < 0.03 * np.abs(slope).max()
    assert upright[[0, -1]] == pytest.approx(0, abs=1e-6)
    assert element_gain("iwr1843", [_direction(a, 89.9) for a in range(0, 360, 5)]).max() < 0.01 * upright.max()
    directions = np.random.default_rng(1).normal(size=(200_000, 3))
    assert np.mean(element_gain("iwr1843", directions) ** 2) < 1.0
    assert np.all(element_gain("isotropic", directions) == 1.0)
