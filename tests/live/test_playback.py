"""Playback of a recording on the live page."""

from __future__ import annotations

import numpy as np
import pytest

import radartwin as rt
from radartwin.live.playback import Playback, shifted_db
from radartwin.scene import objects
from radartwin.scene.scene import Scene, Surface
from radartwin.scene.trajectories.trajectory import depth_sweep, pose


def test_a_recording_gives_its_frames_its_poses_and_levels_beside_the_simulation() -> None:
    scene = Scene([Surface(objects.trihedral(0.1).apply_transform(np.diag([-1.0, -1, 1, 1])), "metal", "target", role="object")])
    poses = depth_sweep(pose([-3.0, 0, 0]), 0.5, 0.5)
    recording = rt.simulate(scene, rt.Radar.iwr1843(), poses)
    playback = Playback(recording, "drive")
    assert playback.frames == len(poses)
    for frame in (0, len(poses) - 1):
        recorded = playback.pose(frame)
        assert recorded is not None
        assert np.array_equal(recorded, poses[frame])
        measured = playback.spectra(frame)
        peak = measured.range_m[np.argmax(measured.profile_db)]
        assert peak == pytest.approx(-poses[frame][0, 3], abs=recording.radar.range_resolution_m)
    counts = rt.Recording(1000 * recording.iq, recording.radar, scale=1.0, provenance={"unit": "counts"})
    assert "levels in ADC counts" in Playback(counts, "capture").caption(0)
    assert "no poses" in Playback(counts, "capture").caption(0)
    profile, raised = playback.spectra(0).profile_db, Playback(counts, "capture").spectra(0).profile_db
    assert np.allclose(shifted_db(raised, profile)[profile > -150], profile[profile > -150], atol=1e-3)
