"""The phone-LiDAR mesh of a real room (ARKit, y up, lower metre of the room with a chair) becomes a scene."""

import numpy as np
import pytest

from radartwin.errors import MaterialError
from radartwin.reconstruct.build import reconstruct
from radartwin.scene.scene import Scene
from radartwin.scene.view import view


@pytest.fixture(scope="module")
def scan(shared_data):
    return shared_data / "scans" / "arkit_lidar_chair_scan" / "export.obj"


@pytest.fixture(scope="module")
def chair(scan, tmp_path_factory):
    folder = tmp_path_factory.mktemp("chair")
    return reconstruct(scan, folder, material="concrete"), folder


def test_report_agrees_with_the_file_counted_by_hand(scan, chair):
    report = chair[0].provenance["scan"]
    lines = scan.read_text().splitlines()
    assert report["vertices"] == sum(line.startswith("v ") for line in lines)
    assert report["faces"] == sum(line.startswith("f ") for line in lines)
    assert (report["up"], report["unit"]) == ("y", "m")
    assert np.allclose(report["extents_m"], (6.4, 5.6, 1.0), atol=0.05)  # its README: 6.4 x 1.0 x 5.6 m
    for key in ("degenerate_faces", "duplicate_faces", "non_manifold_edges", "boundary_edges"):
        assert report[key] > 0
    assert report["degenerate_faces"] + report["duplicate_faces"] < 0.01 * report["faces"]


def test_floor_is_the_largest_surface_level_and_of_a_plausible_size(chair):
    scene, _ = chair
    floor = max(scene, key=lambda s: s.mesh.area)
    assert floor.name == "floor"
    assert 10 < floor.mesh.area < 6.4 * 5.6  # within the scan's footprint, less what furniture hides
    assert np.ptp(floor.mesh.vertices @ np.average(floor.mesh.face_normals, axis=0)) < 1e-3  # flattened
    assert np.degrees(np.arccos(floor.mesh.vertex_normals[0, 2])) < 2.0  # ARKit aligns y with gravity
    assert abs(floor.mesh.vertices[:, 2].mean()) < 0.05


def test_chair_seat_is_a_level_surface_at_sitting_height(chair):
    seats = [
        s for s in chair[0]
        if s.name.startswith("level") and 0.3 < s.mesh.vertices[:, 2].mean() < 0.55 and 0.1 < s.mesh.area < 0.4
    ]  # fmt: skip
    assert seats


def test_scene_covers_the_scan_and_survives_the_disk(chair):
    scene, folder = chair
    again = Scene.load(folder)
    assert again.names == scene.names
    assert again.provenance["scan"] == scene.provenance["scan"]
    assert {s.material for s in again} == {"concrete"}
    assert {s.kind for s in again} == {"room"}
    kept = sum(len(s.mesh.faces) for s in scene)
    report = scene.provenance["scan"]
    assert kept >= 0.99 * report["faces"]
    assert sum(s.mesh.area for s in scene) == pytest.approx(report["area_m2"], rel=0.1)
    assert scene.provenance["flattening_rms_m"] < 0.02


def test_a_pose_above_the_floor_is_outside_every_solid(chair):
    chair[0].check_sensor(np.array([[0.0, 0.0, 0.5], [1.0, -1.0, 0.4]]))


def test_page_shows_every_surface_without_a_network(chair, tmp_path):
    page = view(chair[0], tmp_path / "chair.html").read_text()
    assert "concrete" in page
    assert all(f'"name": "{name}"' in page for name in chair[0].names)
    assert 'src="http' not in page


def test_unknown_material_writes_nothing(scan, tmp_path):
    with pytest.raises(MaterialError, match="concrete"):
        reconstruct(scan, tmp_path / "out", material="concret")
    assert not (tmp_path / "out").exists()
