"""Test `radartwin import` and `radartwin doctor --data` on real radar captures, and process the imported recordings."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from radartwin.features.processed import process
from radartwin.features.profile import multipath_share
from radartwin.radar.process_capture import process_capture
from radartwin.recordings.recording_set import RecordingSet

ROOM = "radar/iwr6843_static_room"
ABOUT_ROOM = ["object=none", "room=indoor", "motion=static", "licence=MIT", "who=mmwave-eyes", "sensor=IWR6843ISK", "when=2024-11-19"]


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
