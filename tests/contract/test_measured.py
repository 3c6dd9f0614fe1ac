"""Experiments read a recording set through its interface, and compute features of its recordings. The set is simulated."""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path

import numpy as np
import pytest

from radartwin.config.compose import compose
from radartwin.config.study import RecordingsConfig
from radartwin.errors import ConfigError
from radartwin.features.align import overlap, start_offset
from radartwin.features.processed import process
from radartwin.features.profile import gate_energies, multipath_share
from radartwin.radar.chirp import Radar
from radartwin.radar.recording import Recording
from radartwin.recordings.card import Card
from radartwin.recordings.index import Row
from radartwin.recordings.recording_set import RecordingSet
from radartwin.scene import objects
from radartwin.scene.scene import Scene, Surface
from radartwin.scene.trajectories import trajectory
from radartwin.simulation.simulate import simulate

RADAR = dataclasses.replace(Radar.iwr1843(), num_chirps=4)
CARD = Card("simulated", "CC0-1.0", "amplitude", "simulated IWR1843", "tests/contract", "2026")
FRAMES, LATE = 40, 6
DISTANCES_M = (1.0, 2.0)


def reflector() -> Scene:
    return Scene([Surface(objects.trihedral(0.1), "metal", "target", role="object")])


def record(distance_m: float, late: int) -> np.ndarray:
    """Simulate IQ of a trihedral that rotates once in FRAMES frames and starts `late` frames late."""
    start = np.pi - 2 * np.pi * late / FRAMES
    turning = trajectory.turntable([distance_m, 0.0, 0.0], FRAMES, RADAR.frame_rate_hz, FRAMES / RADAR.frame_rate_hz, start)
    return simulate(reflector(), RADAR, np.eye(4), motion={"target": turning}, noise=True, seed=late).iq


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write a set of a trihedral on a turntable, recorded twice at each of two distances; each second recording starts six frames late."""
    made = RecordingSet.create(tmp_path_factory.mktemp("measured") / "set", CARD)
    for distance in DISTANCES_M:
        for repetition, late in enumerate((0, LATE)):
            row = Row(f"d{distance:g}r{repetition}", "corner_reflector", distance, "void", "turntable", repetition)
            made.add(Recording(record(distance, late), RADAR, np.eye(4)[None]), row)
    return made.folder


@pytest.fixture
def measured(folder: Path) -> RecordingSet:
    return RecordingSet.load(folder)


def test_digest_depends_on_the_content_only(measured: RecordingSet, tmp_path: Path, folder: Path) -> None:
    keys = [measured.digest(row) for row in measured]
    assert len(set(keys)) == 4
    assert all(len(key) == 32 for key in keys)
    again = RecordingSet.load(folder)
    assert keys == [again.digest(row) for row in again]
    copy = RecordingSet.create(tmp_path / "copy", CARD)
    row, recording = next(measured.recordings())
    copy.add(recording, dataclasses.replace(row, recording="other"))
    assert copy.digest(copy.rows[0]) == keys[0]
    (copy.folder / "recordings/other.bin").write_bytes(bytes(os.path.getsize(copy.folder / "recordings/other.bin")))
    assert copy.digest(copy.rows[0]) != keys[0]


@pytest.mark.parametrize("distance", DISTANCES_M)
def test_late_start_is_found_and_removed(measured: RecordingSet, distance: float) -> None:
    first, second = (process(recording, doppler=False) for _, recording in measured.recordings(distance_m=distance))
    gated = [gate_energies(one.power, one.range_m, distance)[0] for one in (first, second)]
    assert start_offset(*gated, max_frames=10) == LATE
    early, late = overlap(*gated, LATE)
    assert np.abs(10 * np.log10(early / late))[early > 1e-2 * early.max()].max() < 0.5
    # In the void there is only noise outside the gate of the reflector.
    assert multipath_share(first.power, first.range_m, distance) < 0.05


def test_configuration_refuses_a_folder_that_is_not_a_set(tmp_path: Path, folder: Path) -> None:
    measured = compose(["measured=recordings", f"measured.folder={folder}"]).measured
    assert isinstance(measured, RecordingsConfig)
    assert measured.folder == str(folder)
    (tmp_path / "file").write_text("x")
    for path, words in (
        (tmp_path / "nowhere", "is no folder"),
        (tmp_path / "file", "is no folder"),
        (tmp_path, r"no card\.yaml.*radartwin import"),
    ):
        with pytest.raises(ConfigError, match=words) as caught:
            compose(["measured=recordings", f"measured.folder={path}"])
        assert "measured.folder" in str(caught.value)
        assert "\n" not in str(caught.value)
