"""Reconstruction of a real phone-LiDAR mesh (ARKit, y up, the lower metre of a room with a chair)."""

import numpy as np
import pytest
import trimesh
from scipy.spatial import KDTree

from radartwin.errors import MaterialError
from radartwin.reconstruct.build import reconstruct
from radartwin.reconstruct.mesh_file import load_scan
from radartwin.scene.scene import Scene
from radartwin.scene.viewer.page import view


@pytest.fixture(scope="module")
def scan(shared_data):
    return shared_data / "scans" / "arkit_lidar_chair_scan" / "export.obj"


@pytest.fixture(scope="module")
def chair(scan, tmp_path_factory):
    folder = tmp_path_factory.mktemp("chair")
    return reconstruct(scan, folder, material="concrete"), folder


def test_report_matches_counts_of_the_file(scan, chair):
    report = chair[0].provenance["scan"]
    lines = scan.read_text().splitlines()
    assert report["vertices"] == sum(line.startswith("v ") for line in lines)
    assert report["faces"] == sum(line.startswith("f ") for line in lines)
    assert (report["up"], report["unit"]) == ("y", "m")
    assert np.allclose(report["extents_m"], (6.4, 5.6, 1.0), atol=0.05)  # its README: 6.4 x 1.0 x 5.6 m
    for key in ("degenerate_faces", "duplicate_faces", "non_manifold_edges", "boundary_edges"):
        assert report[key] > 0
    assert report["degenerate_faces"] + report["duplicate_faces"] < 0.01 * report["faces"]


def test_floor_is_the_largest_surface_and_level(chair):
    scene, _ = chair
    floor = max(scene, key=lambda s: s.mesh.area)
    assert floor.name == "floor"
    assert 10 < floor.mesh.area < 6.4 * 5.6  # within the scan's footprint
    assert np.ptp(floor.mesh.vertices @ np.average(floor.mesh.face_normals, axis=0)) < 1e-3  # flattened
    assert np.degrees(np.arccos(floor.mesh.vertex_normals[0, 2])) < 2.0  # ARKit aligns y with gravity
    assert abs(floor.mesh.vertices[:, 2].mean()) < 0.05


def test_chair_has_a_level_seat_at_sitting_height(chair):
    """One body of several planes has a level seat."""

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


def test_pose_above_the_floor_is_outside_every_solid(chair):
    chair[0].check_sensor(np.array([[0.0, 0.0, 0.5], [1.0, -1.0, 0.4]]))


def test_page_shows_every_surface_without_network_access(chair, tmp_path):
    page = view(chair[0], tmp_path / "chair.html").read_text()
    assert "concrete" in page
    assert all(f'"name": "{name}"' in page for name in chair[0].names)
    assert 'src="http' not in page


def test_unknown_material_writes_nothing(scan, tmp_path):
    with pytest.raises(MaterialError, match="concrete"):
        reconstruct(scan, tmp_path / "out", material="concret")
    assert not (tmp_path / "out").exists()
