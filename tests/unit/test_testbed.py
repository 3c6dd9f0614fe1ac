"""The testbed differs from what it is given by its gaps alone, and each can be switched off."""

import dataclasses
import subprocess
import sys

import numpy as np
import pytest

import radartwin as rt
from radartwin.materials import Layered
from radartwin.measured.testbed import ROUGHNESS_M, ROUGHNESS_OTHER_M, Gaps, clean, received, record, truth
from radartwin.radar.hardware import Hardware
from radartwin.radar.recording import Recording
from radartwin.scene import objects, rooms, trajectory

OFF = Gaps(0, 0, 0, 0, 0, 0)
RADAR = rt.Radar.iwr1843()
TARGET = rt.Scene([rt.Surface(objects.plate(0.1, 0.1), "metal", "plate")])
TURNING = {"plate": trajectory.turntable(np.array([1.0, 0.0, 0.0]), 3, 10.0)}


def test_without_gaps_the_truth_is_the_scene():
    lab = rooms.lab(detail="cluttered")
    same = truth(lab, OFF, 0, frozenset())
    assert [(s.name, s.material, s.roughness_m) for s in same] == [(s.name, s.material, s.roughness_m) for s in lab]


def test_each_gap_of_the_scene_changes_its_own_property():
    lab = rooms.lab(detail="cluttered")
    bare = truth(lab, OFF, 0, frozenset(rooms.CLUTTER))
    assert set(lab.names) - set(bare.names) == set(rooms.CLUTTER)
    thick = {s.name: s.material for s in truth(lab, Gaps(1, 0, 1, 0, 0, 0), 0, frozenset())}
    wall = thick["wall_front"]
    assert isinstance(wall, Layered)
    assert wall != rooms.STUD_WALL
    assert [name for name, _ in wall.layers] == [name for name, _ in rooms.STUD_WALL.layers]
    rough = {s.name: s.roughness_m for s in truth(lab, Gaps(0, 2, 1, 0, 0, 0), 0, frozenset())}
    assert rough["cabinet"] == pytest.approx(2 * ROUGHNESS_M["metal"])
    assert rough["floor"] == pytest.approx(2 * ROUGHNESS_OTHER_M)


def test_without_gaps_a_recording_is_the_plain_simulation():
    plain = rt.simulate(TARGET, RADAR, np.eye(4)[None], motion=TURNING)
    measured = record(TARGET, RADAR, np.eye(4)[None], TURNING, OFF, seed=5)
    assert np.array_equal(plain.iq, measured.iq)
    assert measured.scale is None


def test_repetitions_differ_and_repeat_themselves():
    first, again, other = (record(TARGET, RADAR, np.eye(4)[None], TURNING, Gaps(solver=0), seed=s).iq for s in (1, 1, 2))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)


def test_a_clean_recording_serves_every_repetition_and_strength():
    """Made once, received often: the same as making it anew, and frames alone are as in the whole."""
    gaps = Gaps(solver=0, trajectory=0)
    ideal = clean(TARGET, RADAR, np.eye(4)[None], TURNING, gaps)
    whole = record(TARGET, RADAR, np.eye(4)[None], TURNING, gaps, seed=7)
    assert np.array_equal(received(ideal, Hardware(), 7).iq, whole.iq)
    last = Recording(ideal.iq[2:], RADAR)
    assert np.array_equal(received(last, Hardware(), 7, first_frame=2).iq, whole.iq[2:])
    assert np.array_equal(received(ideal, Hardware().scaled(0), 7).iq, ideal.iq)
    stronger = clean(TARGET, RADAR, np.eye(4)[None], TURNING, dataclasses.replace(gaps, hardware=2.0))
    assert np.array_equal(stronger.iq, ideal.iq)


def test_testbed_knows_no_scan_and_no_labels():
    forbidden = ("radartwin.label", "radartwin.reconstruct", "radartwin.scene.scan", "radartwin.config")
    code = f"import sys, radartwin.measured.testbed; sys.exit(any(m.startswith({forbidden}) for m in sys.modules))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
