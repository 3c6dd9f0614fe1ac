"""A real phone-LiDAR scan on the command line: labelled scene, page, DCA1000 recording, peaks."""

import csv
import json

import numpy as np
import pytest

import radartwin as rt
from radartwin.reconstruct.build import reconstruct
from radartwin.reconstruct.mesh_file import load_scan
from radartwin.scene.trajectories.trajectory import look_at


def test_real_scan_becomes_a_processed_recording(shared_data, radartwin, tmp_path):
    scan = shared_data / "scans" / "arkit_lidar_chair_scan" / "export.obj"
    height = 0.6
    calls = (
        ("reconstruct", scan, "--out", "chair", "--material", "concrete"),
        ("view", "chair"),
        (
            "simulate", "scene=scan", "scene.path=chair", "trajectory=static", "trajectory.frames=2",
            f"trajectory.position_m=[0.0,0.0,{height}]", "simulator.rays=200000", "radar.element=isotropic",
            "--noise", "--out", "outputs/recordings/chair",
        ),
        ("process", "outputs/recordings/chair.bin"),
    )  # fmt: skip
    for call in calls:
        done = radartwin(*call)
        assert done.returncode == 0, (call[0], done.stderr)

    assert (tmp_path / "chair" / "scene.glb").stat().st_size > 10_000
    assert {s["material"] for s in json.loads((tmp_path / "chair" / "manifest.json").read_text())["surfaces"]} == {"concrete"}
    assert (tmp_path / "chair" / "view.html").stat().st_size > 100_000

    recording = rt.Recording.load(tmp_path / "outputs" / "recordings" / "chair")
    assert (tmp_path / "outputs" / "recordings" / "chair.bin").stat().st_size == 2 * recording.iq.size * 2
    again = tmp_path / "again"
    recording.save(again)
    assert again.with_suffix(".bin").read_bytes() == (tmp_path / "outputs" / "recordings" / "chair.bin").read_bytes()

    # The floor is the nearest large mirror. An isotropic radar sees it at the radar's height, at the level of a concrete image.
    spectrum = np.fft.fft(recording.iq[0, 0, 0, 0] * np.hanning(256), 4096) / np.hanning(256).sum()
    ranges = np.arange(4096) * recording.radar.unambiguous_range_m / 4096
    near = np.abs(ranges - height) < 0.1
    index = int(np.argmax(np.where(near, np.abs(spectrum), 0)))
    expected = 20 * np.log10(recording.radar.wavelength_m / (4 * np.pi * 2 * height)) - 8.12
    assert abs(ranges[index] - height) < recording.radar.range_resolution_m
    assert abs(20 * np.log10(abs(spectrum[index])) - expected) < 1.5

    peaks = list(csv.DictReader((tmp_path / "outputs" / "processed" / "chair" / "peaks.csv").read_text().splitlines()))
    assert [*peaks[0]][:4] == ["range_m", "doppler_mps", "azimuth_deg", "power_db"]
    assert abs(float(peaks[0]["range_m"]) - height) < recording.radar.range_resolution_m
    assert all(abs(float(p["doppler_mps"])) < 0.1 for p in peaks)
    assert len(list((tmp_path / "outputs" / "processed" / "chair").glob("*.png"))) >= 3


@pytest.fixture(scope="module")
def chair(shared_data):
    """The scanned mesh and its reconstructed scene."""
    path = shared_data / "scans" / "arkit_lidar_chair_scan" / "export.obj"
    return load_scan(path)[0], reconstruct(path, material="concrete")


@pytest.mark.parametrize(("side", "distance_m"), [("seat", 0.7), ("back", 0.6)])
def test_strongest_return_is_at_the_side_that_faces_the_radar(chair, side, distance_m):
    """The radar is normal to a flat side of the chair. The expected range is the median of the scan's vertices on the boresight."""
    scanned, scene = chair
    body = max((s.mesh for s in scene if s.provenance["planes"] > 1), key=lambda m: m.area)
    level = body.facets_normal[:, 2] > 0.95 if side == "seat" else np.abs(body.facets_normal[:, 2]) < 0.5
    facet = int(np.argmax(np.where(level, body.facets_area, 0)))
    normal, centre = body.facets_normal[facet], body.triangles_center[body.facets[facet]].mean(axis=0)
    pose = look_at(centre + distance_m * normal, centre)

    along = (scanned.vertices - pose[:3, 3]) @ pose[:3, 0]
    beside = np.linalg.norm(scanned.vertices - pose[:3, 3] - along[:, None] * pose[:3, 0], axis=1)
    expected = np.median(along[(beside < 0.06) & (np.abs(along - distance_m) < 0.15)])

    recording = rt.simulate(scene, rt.Radar.iwr1843(), pose[None], rays=200_000)
    spectrum = np.abs(np.fft.fft(recording.iq[0, 0, 0, 0] * np.hanning(256), 4096))
    ranges = np.arange(4096) * recording.radar.unambiguous_range_m / 4096
    assert abs(ranges[int(spectrum.argmax())] - expected) < recording.radar.range_resolution_m
    without = rt.Scene([s for s in scene if not np.array_equal(s.mesh.vertices, body.vertices)])
    other = np.abs(np.fft.fft(rt.simulate(without, rt.Radar.iwr1843(), pose[None], rays=200_000).iq[0, 0, 0, 0] * np.hanning(256), 4096))
    near = np.abs(ranges - expected) < recording.radar.range_resolution_m
    assert spectrum[near].max() > 4 * other[near].max()  # 12 dB: the chair is the source of the return
