"""A real phone-LiDAR scan, by the command line alone: labelled scene, page, DCA1000 recording, peaks."""

import csv
import json

import numpy as np

import radartwin as rt


def test_real_scan_becomes_a_processed_recording(shared_data, radartwin, tmp_path):
    scan = shared_data / "scans" / "arkit_lidar_chair_scan" / "export.obj"
    height = 0.6
    calls = (
        ("reconstruct", scan, "--out", "chair", "--material", "concrete"),
        ("view", "chair"),
        (
            "simulate", "scene=scan", "scene.path=chair", "scene.target=none", "materials.material=concrete", "trajectory=static",
            "trajectory.frames=2", f"trajectory.position_m=[0.0,0.0,{height}]", "simulator.rays=200000", "radar.element=isotropic",
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

    # The floor below the sensor is the nearest large mirror: an isotropic radar sees it at its height above the fitted floor,
    # at the level of a concrete image.
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
