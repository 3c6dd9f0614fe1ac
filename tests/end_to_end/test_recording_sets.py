"""Test `radartwin import` and `radartwin doctor --data` on real radar captures, and process the imported recordings."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from radartwin.features.processed import process
from radartwin.features.profile import multipath_share
from radartwin.radar.captures import load_capture
from radartwin.radar.process_capture import process_capture
from radartwin.recordings.recording_set import RecordingSet

ROOM = "radar/iwr6843_static_room"
WALK = "radar/openradar_77ghz_frame/doppler_example_1.npy"
ABOUT_ROOM = ["object=none", "room=indoor", "motion=static", "licence=MIT", "who=mmwave-eyes", "sensor=IWR6843ISK", "when=2024-11-19"]
ABOUT_WALK = ["object=person", "room=indoor", "motion=other", "licence=Apache-2.0", "who=OpenRadar", "sensor=xWR 77 GHz", "when=2019"]


def test_imported_mmwave_studio_capture_is_valid_and_has_the_same_peaks(shared_data: Path, tmp_path: Path, inside) -> None:
    done = inside("import", shared_data / ROOM, "--out", "room", *ABOUT_ROOM)
    assert done.returncode == 0, done.stderr
    assert "room: 1 recording added, 1 in all" in done.stdout
    # The capture has one of the hundred frames that description and log give: 143473 packets of 1456 bytes.
    assert "frames are missing: the capture holds 1 frame, 100 configured, 100 logged" in done.stderr
    name = "iwr6843_frame_adc_data"
    assert (tmp_path / f"room/recordings/{name}.bin").read_bytes() == (shared_data / ROOM / f"{name}.bin").read_bytes()
    doctor = inside("doctor", "--data", "room")
    assert doctor.returncode == 0, doctor.stdout
    first, *_, last = doctor.stdout.splitlines()
    assert (first, last) == ("room: 1 recording, 1 frame, 2.1 MB; radar iwr6843_mmwaveDevice, MIT", "doctor: the set can be used")
    measured = RecordingSet.load(tmp_path / "room")
    row, recording = next(measured.recordings(object="none"))
    assert row.extra == {"started": "2024-11-19T20:02:23", "lost_packets": "0"}
    assert recording.provenance["log"]["received"] == 143473
    pd.testing.assert_frame_equal(process_capture(tmp_path / "room/recordings" / name), process_capture(shared_data / ROOM / f"{name}.bin"))
    # The strongest echoes are at 1.551, 1.052, 1.718 and 1.370 m; the gate is on the first.
    made = process(recording, doppler=False)
    power, axis = made.power, made.range_m
    near = np.flatnonzero((axis > 0.6) & (axis < 5.5))
    assert axis[near[power[0, near].argmax()]] == pytest.approx(1.551, abs=0.04)
    assert 0.2 < multipath_share(power, axis, 1.551) < 0.9


def test_imported_cube_shows_the_walker(shared_data: Path, tmp_path: Path, inside) -> None:
    arguments = ("import", shared_data / WALK, "--out", "walk", "--radar", "openradar_77ghz", *ABOUT_WALK)
    assert inside(*arguments).stdout == "walk: 1 recording added, 1 in all\n"
    assert inside(*arguments).stdout == "walk: 0 recordings added, 1 in all\n"
    assert inside("doctor", "--data", "walk").returncode == 0
    moving = process_capture(tmp_path / "walk/recordings/doppler_example_1", static_removed=True)
    assert moving.range_m[0] == pytest.approx(2.955, abs=0.075)
    assert 0.5 < abs(moving.doppler_mps[0]) < 0.8


def test_imported_capture_with_q_first_keeps_its_bytes(shared_data: Path, tmp_path: Path, inside) -> None:
    source = shared_data / ROOM / "iwr6843_frame_adc_data.bin"
    (tmp_path / "raw").mkdir()
    (tmp_path / "raw/radar.mmwave.json").write_bytes((shared_data / ROOM / "iwr6843_mmwaveDevice.mmwave.json").read_bytes())
    np.fromfile(source, "<i2").reshape(-1, 2, 2)[:, ::-1].tofile(tmp_path / "raw/swapped.bin")
    assert inside("import", "raw", "--out", "room", *ABOUT_ROOM).returncode == 0
    assert (tmp_path / "room/recordings/swapped.bin").read_bytes() == (tmp_path / "raw/swapped.bin").read_bytes()
    _, recording = next(RecordingSet.load(tmp_path / "room").recordings())
    assert recording.iq_swapped
    np.testing.assert_array_equal(recording.iq, load_capture(source).iq)
    radar = tmp_path / "raw/radar.mmwave.json"
    assert not np.array_equal(load_capture(tmp_path / "raw/swapped.bin", radar, iq_swapped=False).iq, recording.iq)
    assert inside("doctor", "--data", "room").returncode == 0


def test_doctor_lists_every_problem_of_a_damaged_set(shared_data: Path, tmp_path: Path, inside) -> None:
    assert inside("import", shared_data / ROOM, "--out", "room", *ABOUT_ROOM).returncode == 0
    samples = np.fromfile(tmp_path / "room/recordings/iwr6843_frame_adc_data.bin", "<i2")
    samples[50_000:51_000] = 0
    samples = samples.reshape(-1, 2, 2)[:, ::-1]  # one of the planted problems: the file stores Q before I
    samples.tofile(tmp_path / "room/recordings/iwr6843_frame_adc_data.bin")
    card = tmp_path / "room/card.yaml"
    card.write_text(card.read_text().replace("licence: MIT\n", ""))
    done = inside("doctor", "--data", "room")
    assert done.returncode == 2
    problems = [line for line in done.stdout.splitlines() if line.startswith("problem")]
    assert len(problems) == 3
    for line, words in zip(problems, ("licence is missing", "zeros (frame 0)", "I and Q seem exchanged"), strict=True):
        assert words in line
    assert done.stdout.splitlines()[-1] == "doctor: 3 problems; see above"
