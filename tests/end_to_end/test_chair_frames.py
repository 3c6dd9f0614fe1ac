"""A real scan from frames to radar data: the chair on a patio is fused, labelled by recorded answers, and simulated."""

from pathlib import Path

import numpy as np
import pytest

import radartwin as rt
from radartwin.features.processed import process
from radartwin.label.sources import Vlm
from radartwin.reconstruct.build import reconstruct

CHAIR = "arkit_lidar_chair_scan"


@pytest.mark.slow
def test_echoes_of_a_labelled_scan_come_from_its_surfaces(shared_data: Path, tmp_path: Path) -> None:
    """The patio has no wall; upright surfaces are furniture, a planter and leaves. The strongest returns must come from surfaces."""
    scene = Vlm(missing="concrete")(reconstruct(shared_data / "scans" / CHAIR, tmp_path / "scene"))
    assert "floor" in scene.names
    assert not any(name.startswith("wall") for name in scene.names), "a patio"
    area = np.array([s.mesh.area for s in scene])
    answered = np.array([s.provenance["source"] == "vlm" for s in scene])
    assert area[answered].sum() > 0.9 * area.sum()
    floor = next(s for s in scene if s.name == "floor")
    assert floor.provenance["minc"] in ("stone", "tile", "polishedstone", "brick"), "paving"

    upright = max((s for s in scene if s.name != "floor"), key=lambda s: s.mesh.area)
    target = np.asarray(upright.mesh.triangles_center).mean(axis=0)
    pose = np.eye(4)
    away = np.array([1.0, 0.0]) if abs(target[0]) > abs(target[1]) else np.array([0.0, 1.0])
    eye = np.array([*(target[:2] - 1.8 * away), 0.6])
    pose[:2, 0], pose[:2, 1], pose[:3, 3] = away, [-away[1], away[0]], eye
    recording = rt.simulate(scene, rt.Radar.iwr1843(), pose[None])
    made = process(recording, doppler=False)
    profile, range_m = made.power.mean(axis=0, dtype=float), made.range_m
    # Distances of surfaces other than the floor within 45 degrees of the boresight, from the geometry.
    offset = np.concatenate([s.mesh.triangles_center for s in scene if s.name != "floor"]) - eye
    distance = np.linalg.norm(offset, axis=1)
    near = np.sort(distance[offset @ pose[:3, 0] > np.cos(np.radians(45.0)) * distance])
    inner = profile[1:-1]
    local = np.flatnonzero((inner > profile[:-2]) & (inner > profile[2:]) & (range_m[1:-1] > 0.3)) + 1
    peaks = range_m[local[np.argsort(-profile[local])[:3]]]
    off = [float(np.abs(near - peak).min()) for peak in peaks]
    print(f"strongest returns at {np.round(peaks, 2)} m; nearest upright surface {near[0]:.2f} m; off by {np.round(off, 3)} m")
    assert max(off) < 0.1
    front = profile[(range_m > 0.3) & (range_m < near[0] - 0.2)]
    assert not front.size or 10 * np.log10(profile[local].max() / front.max()) > 6.0, "no object is nearer than the first one"
