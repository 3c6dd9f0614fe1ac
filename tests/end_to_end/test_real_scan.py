"""A real phone-LiDAR mesh (ARKit, the lower metre of a room with a chair) is reconstructed, labelled and simulated."""

import csv

import numpy as np
import pytest
import trimesh
from ray_casting import first_hits
from scipy.spatial import KDTree

import radartwin as rt
from radartwin.errors import MaterialError
from radartwin.reconstruct.build import reconstruct
from radartwin.reconstruct.scan_file import load_scan
from radartwin.scene.scene import Scene
from radartwin.scene.trajectories.trajectory import look_at


@pytest.fixture(scope="module")
def scan(shared_data):
    return shared_data / "scans" / "arkit_lidar_chair_scan" / "export.obj"


@pytest.fixture(scope="module")
def chair(scan, tmp_path_factory):
    folder = tmp_path_factory.mktemp("chair")
    return reconstruct(scan, folder, material="concrete"), folder


def test_floor_is_the_largest_surface_and_level(chair):
    scene, _ = chair
    floor = max(scene, key=lambda s: s.mesh.area)
    assert floor.name == "floor"
    assert 10 < floor.mesh.area < 6.4 * 5.6  # the floor is smaller than the horizontal extent of the scan
    assert np.ptp(floor.mesh.vertices @ np.average(floor.mesh.face_normals, axis=0)) < 1e-3  # all vertices of the floor are in one plane
    assert np.degrees(np.arccos(floor.mesh.vertex_normals[0, 2])) < 2.0  # ARKit aligns y with gravity
    assert abs(floor.mesh.vertices[:, 2].mean()) < 0.05


def test_chair_has_a_level_seat_at_sitting_height(chair):
    """The chair is reconstructed as one object of several planes, one of which is a horizontal seat at the height of a chair."""

    def level_area(surface):
        centre = surface.mesh.triangles_center[:, 2]
        seat = (surface.mesh.face_normals[:, 2] > 0.9) & (centre > 0.3) & (centre < 0.55)
        return float(surface.mesh.area_faces[seat].sum())

    seats = [s for s in chair[0] if s.provenance["planes"] > 1 and 0.1 < level_area(s) < 0.4]
    assert len(seats) == 1
    assert np.ptp(seats[0].mesh.vertices, axis=0).max() < 1.0


def test_saved_scene_covers_the_scan(scan, chair):
    scene, folder = chair
    again = Scene.load(folder)
    assert again.names == scene.names
    assert again.provenance["scan"] == scene.provenance["scan"]
    assert {s.material for s in again} == {"concrete"}
    assert {s.kind for s in again} == {"room", "object"}  # compact surfaces are traced as objects
    scanned = load_scan(scan, "auto", "auto")[0]
    points = np.concatenate([trimesh.sample.sample_surface(s.mesh, 200 + int(40000 * s.mesh.area), seed=0)[0] for s in scene])
    away = KDTree(points).query(scanned.triangles_center)[0]
    assert scanned.area_faces[away < 0.06].sum() > 0.95 * scanned.area  # the rest are fragments and trimmed edges
    left_out = scanned.area_faces[away > 0.05].sum()
    assert left_out < 0.05 * scanned.area
    assert scene.provenance["left_out_m2"] == pytest.approx(left_out, rel=0.2)
    assert scanned.area < sum(s.mesh.area for s in scene) < 1.4 * scanned.area  # the floor is completed under the furniture
    assert scene.provenance["flattening_rms_m"] < 0.02


def test_unknown_material_writes_nothing(scan, tmp_path):
    with pytest.raises(MaterialError, match="concrete"):
        reconstruct(scan, tmp_path / "out", material="concret")
    assert not (tmp_path / "out").exists()


def test_real_scan_becomes_a_processed_recording(chair, inside, tmp_path):
    height = 0.6
    calls = (
        (
            "simulate", "scene=scan", f"scene.path={chair[1]}", "trajectory=static", "trajectory.frames=2",
            f"trajectory.position_m=[0.0,0.0,{height}]", "simulator.rays=200000", "radar.element=isotropic",
            "--noise", "--out", "outputs/recordings/chair",
        ),
        ("process", "outputs/recordings/chair.bin"),
    )  # fmt: skip
    for call in calls:
        done = inside(*call)
        assert done.returncode == 0, (call[0], done.stderr)

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


@pytest.mark.parametrize(("side", "distance_m"), [("seat", 0.7), ("back", 0.6)])
def test_strongest_return_is_at_the_side_that_faces_the_radar(scan, chair, side, distance_m):
    """The radar looks along the normal of a flat side of the chair. The expected range is the median of the first intersections of the scan
    with lines that are parallel to the boresight, within 6 cm of it. The back is two layers of the scan, 5 cm apart.
    """
    scanned, scene = load_scan(scan)[0], chair[0]
    body = max((s.mesh for s in scene if s.provenance["planes"] > 1), key=lambda m: m.area)
    level = body.facets_normal[:, 2] > 0.95 if side == "seat" else np.abs(body.facets_normal[:, 2]) < 0.5
    facet = int(np.argmax(np.where(level, body.facets_area, 0)))
    normal, centre = body.facets_normal[facet], body.triangles_center[body.facets[facet]].mean(axis=0)
    pose = look_at(centre + distance_m * normal, centre)

    aside = np.stack(np.meshgrid(*[np.arange(-0.06, 0.061, 0.01)] * 2), axis=-1).reshape(-1, 2)
    lines = pose[:3, 3] + aside[np.hypot(*aside.T) < 0.061] @ pose[:3, 1:3].T
    corners = scanned.triangles[np.linalg.norm(scanned.triangles_center - centre, axis=1) < 0.4]
    distances = first_hits(lines, pose[:3, 0], corners)
    expected = np.median(distances[np.isfinite(distances)])

    recording = rt.simulate(scene, rt.Radar.iwr1843(), pose[None], rays=200_000)
    spectrum = np.abs(np.fft.fft(recording.iq[0, 0, 0, 0] * np.hanning(256), 4096))
    ranges = np.arange(4096) * recording.radar.unambiguous_range_m / 4096
    assert abs(ranges[int(spectrum.argmax())] - expected) < recording.radar.range_resolution_m / 4
    without = rt.Scene([s for s in scene if not np.array_equal(s.mesh.vertices, body.vertices)])
    other = np.abs(np.fft.fft(rt.simulate(without, rt.Radar.iwr1843(), pose[None], rays=200_000).iq[0, 0, 0, 0] * np.hanning(256), 4096))
    near = np.abs(ranges - expected) < recording.radar.range_resolution_m
    assert spectrum[near].max() > 4 * other[near].max()  # without the chair the peak is 12 dB lower, so the chair is the source of the echo
