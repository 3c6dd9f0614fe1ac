"""Targets of real radar captures are within one range bin of their description, and the noise of a real room is that of noise."""

import numpy as np
import pandas as pd
import pytest

from radartwin.builders.radar import named_radar
from radartwin.errors import OutputError
from radartwin.features import doppler
from radartwin.features.processed import process
from radartwin.radar.captures import load_capture
from radartwin.radar.chirp import Radar
from radartwin.radar.process_capture import process_capture
from radartwin.radar.word_order import Layout

ROOM = "radar/iwr6843_static_room/iwr6843_frame_adc_data.bin"
WALK = "radar/openradar_77ghz_frame/doppler_example_1.npy"
OPENRADAR = named_radar("openradar_77ghz")
PICTURES = {"range_time.png", "range_doppler.png", "range_azimuth.png"}
COLUMNS = ["range_m", "doppler_mps", "azimuth_deg", "power_db"]


def _check_folder(folder, table):
    assert {p.name for p in folder.iterdir()} == PICTURES | {"peaks.csv", "points.npz"}
    written = pd.read_csv(folder / "peaks.csv")
    assert list(written.columns) == COLUMNS
    np.testing.assert_allclose(written, table, rtol=1e-5, atol=1e-9)
    assert np.all(np.diff(written.power_db) <= 0)


def test_static_room_has_its_three_peaks_at_rest(shared_data, tmp_path):
    table = process_capture(shared_data / ROOM, tmp_path / "out")
    radar = Radar.from_file(shared_data / "radar/iwr6843_static_room/iwr6843_mmwaveDevice.mmwave.json")
    bin_m = radar.range_resolution_m
    assert bin_m == pytest.approx(0.0392, abs=1e-4)
    for expected in (1.551, 1.052, 8.473):
        nearest = table.iloc[(table.range_m - expected).abs().argmin()]
        assert nearest.range_m == pytest.approx(expected, abs=bin_m)
    # The description gives this order of strength.
    assert table.range_m[0] == pytest.approx(1.551, abs=bin_m)
    assert table.range_m[1] == pytest.approx(1.052, abs=bin_m)
    assert np.any(np.abs(table.range_m[:10] - 8.473) < bin_m)
    assert np.all(table.doppler_mps.abs() <= 0.07)
    _check_folder(tmp_path / "out", table)


def test_walking_target_and_wall_are_at_the_ranges_of_the_description(shared_data, tmp_path):
    table = process_capture(shared_data / WALK, tmp_path / "out", OPENRADAR)
    bin_m = 0.0488
    still, moving = table.query("abs(doppler_mps) < 0.081"), table.query("abs(doppler_mps) >= 0.081")
    assert still.range_m.iloc[0] == pytest.approx(5.208, abs=bin_m)
    strongest = moving.iloc[0]
    assert 2.93 - bin_m < strongest.range_m < 2.98 + bin_m
    assert 0.5 < abs(strongest.doppler_mps) < 0.8
    # The description gives both signs near 3 m: +0.56 and -0.48 to -0.81 m/s.
    body = moving.query(f"abs(range_m - 2.955) < {0.025 + bin_m}")
    assert body.doppler_mps.max() == pytest.approx(0.56, abs=0.081)
    assert body.doppler_mps.min() == pytest.approx(-0.81, abs=0.081)
    _check_folder(tmp_path / "out", table)


def test_single_channel_frame_has_ranges_and_no_azimuth(shared_data, tmp_path):
    table = process_capture(shared_data / "radar/openradar_77ghz_frame/simple_frame_1.npy", tmp_path / "out", OPENRADAR)
    for expected in (5.205, 1.981, 4.054):
        assert (table.range_m - expected).abs().min() < 0.0488
    assert table.azimuth_deg.isna().all()
    assert not (tmp_path / "out" / "range_azimuth.png").exists()


@pytest.mark.parametrize("capture", [ROOM, WALK])
def test_positive_range_is_a_positive_beat_frequency(shared_data, capture):
    recording = load_capture(shared_data / capture, OPENRADAR if capture == WALK else None)
    assert recording.provenance["band_edge_db"] > 2
    assert not recording.iq_swapped


def test_a_file_in_place_of_the_output_folder_is_refused(shared_data, tmp_path):
    (tmp_path / "file").write_text("no folder")
    with pytest.raises(OutputError, match="file"):
        process_capture(shared_data / ROOM, tmp_path / "file")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def test_one_chirp_per_frame_leaves_the_speed_empty(inside, tmp_path):
    """The capture is from an IWR1843 of other authors, with its mmWave SDK .cfg file; its target is at 2 m."""
    (tmp_path / "radar.cfg").write_text(
        "channelCfg 15 1 0\nprofileCfg 0 77 7 0 57 0 0 70 1 256 5210 0 0 30\nchirpCfg 0 0 0 0 0 0 0 1\nframeCfg 0 0 1 0 100 1 0\n"
    )
    radar = Radar.from_file(tmp_path / "radar.cfg")
    beat = np.exp(2j * np.pi * radar.slope_hz_per_s * 4.0 / 299_792_458.0 * np.arange(256) / radar.sample_rate_hz)
    counts = (1000 * beat * np.ones((5, 1, 1, 4, 1))).astype(np.complex64)
    (tmp_path / "capture.bin").write_bytes(Layout().words(counts, 1.0)[0].tobytes())
    done = inside("process", "capture.bin", "--radar", "radar.cfg", "--out", "out")
    assert done.returncode == 0, done.stderr
    assert "no speed can be measured" in done.stderr
    written = pd.read_csv(tmp_path / "out" / "peaks.csv")
    assert written.range_m[0] == pytest.approx(2.0, abs=0.005)
    assert written.doppler_mps.isna().all()
    assert [len(line.split()) for line in done.stdout.splitlines()] == [4] + [3] * len(written)
    assert not (tmp_path / "out" / "range_doppler.png").exists()


def test_noise_and_rest_of_a_real_room(shared_data):
    made = process(load_capture(shared_data / ROOM))
    assert made.doppler is not None
    # The noise bandwidth is 1.5 / chirps with the Hann window and 1 / chirps without. Most Doppler bins of a static room are noise only.
    # The chirps of a transmitter are 1.24 ms apart, so that each block of at most 2.1 ms has one chirp.
    quiet = np.median(made.doppler, axis=1)[0] / 1.5 * made.radar.num_chirps
    level = 10 * np.log10(made.noise_floor.mean() / quiet.mean())
    assert level == pytest.approx(0, abs=0.5)
    # A bin averages one exponential draw of 12 channels.
    assert np.abs(10 * np.log10(made.noise_floor / quiet)).mean() < 2
    strongest = float(made.range_m[made.power[0].argmax()])
    assert np.abs(doppler.radial_velocity(made, strongest)) < 0.01
