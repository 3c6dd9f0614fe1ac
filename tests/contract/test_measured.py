"""The digest of a measured recording depends on its content only."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from radartwin.radar.chirp import Radar
from radartwin.radar.recording import Recording
from radartwin.recordings.card import Card
from radartwin.recordings.index import Row
from radartwin.recordings.recording_set import RecordingSet

RADAR = dataclasses.replace(Radar.iwr1843(), num_chirps=4)
CARD = Card("noise", "CC0-1.0", "amplitude", "IWR1843", "tests/contract", "2026")


@pytest.fixture
def measured(tmp_path: Path) -> RecordingSet:
    """Return a recording set of two recordings that contain only noise."""
    made = RecordingSet.create(tmp_path / "set", CARD)
    for n in range(2):
        iq = np.random.default_rng(n).normal(size=(2, 4, RADAR.num_tx, RADAR.num_rx, RADAR.num_samples)).astype(np.complex64)
        made.add(Recording(iq, RADAR, np.eye(4)[None]), Row(f"r{n}", "corner_reflector", 1.0, "void", "turntable", n))
    return made


def test_digest_depends_on_the_content_only(measured: RecordingSet, tmp_path: Path) -> None:
    keys = [measured.digest(row) for row in measured]
    assert len(set(keys)) == 2
    assert all(len(key) == 32 for key in keys)
    again = RecordingSet.load(measured.folder)
    assert keys == [again.digest(row) for row in again]
    copy = RecordingSet.create(tmp_path / "copy", CARD)
    row, recording = next(measured.recordings())
    copy.add(recording, dataclasses.replace(row, recording="other"))
    assert copy.digest(copy.rows[0]) == keys[0]
    samples = copy.folder / "recordings" / "other.bin"
    samples.write_bytes(bytes(samples.stat().st_size))
    assert copy.digest(copy.rows[0]) != keys[0]
