"""Test outline polygons, window panes and completed gaps of rooms that are built triangle by triangle."""

import itertools

import numpy as np
import pytest
import trimesh
from built_rooms import DOOR, EDGE_M, SIZE, WINDOW, H, L, W, X, Y, Z, block, inner_sides, saved, scan, sheet, shell, truth
from shapely import Polygon

from experiments.scans.segment_score import score_scene
from radartwin.benchmark.signal_error import profiles
from radartwin.io.progress import Progress
from radartwin.radar.chirp import Radar
from radartwin.radar.processing import decibels
from radartwin.reconstruct.build import ScanOptions, reconstruct
from radartwin.reconstruct.outlines import meeting_planes
from radartwin.reconstruct.outlines.assembly import ERROR_M, simplified
from radartwin.reconstruct.outlines.complete import complete
from radartwin.reconstruct.outlines.flatten import regular
from radartwin.reconstruct.outlines.seen_points import Cameras
from radartwin.reconstruct.outlines.surfaces import flattened
from radartwin.reconstruct.segmentation.grid import Grid
from radartwin.reconstruct.segmentation.segment import segmented
from radartwin.scene.rooms import rectangle
from radartwin.scene.scene import Scene, Surface
from radartwin.scene.trajectories.trajectory import look_at
from radartwin.simulation.backends.static_scene import static_scene
from radartwin.simulation.simulate import simulate


def test_noisy_room_becomes_six_rectangles_with_shared_corners(tmp_path):
    scene = reconstruct(saved(scan(shell(), 0.006), tmp_path))
    assert sorted(scene.names) == ["ceiling", "floor", "wall_1", "wall_2", "wall_3", "wall_4"]
    assert {len(s.mesh.faces) for s in scene} == {2}
    corners = {tuple(np.round(v, 3)) for s in scene for v in s.mesh.vertices}
    assert len(corners) == 8  # every corner is shared by three surfaces, to the millimetre
    assert np.abs(np.ptp(np.array(sorted(corners)), axis=0) - SIZE).max() < 4e-3
    normals = np.array([s.mesh.face_normals[0] for s in scene])
    assert np.allclose(np.abs(normals).max(axis=1), 1, atol=1e-3)  # all normals are parallel to a world axis
    inside = np.array([L, W, H]) / 2
    assert all((inside - s.mesh.triangles_center[0]) @ s.mesh.face_normals[0] > 0 for s in scene)


def polar(count, radius):
    return [(radius * np.cos(t), radius * np.sin(t)) for t in 2 * np.pi * np.arange(count) / count]


UPRIGHT = trimesh.transformations.euler_matrix(np.pi / 2, 0, np.pi / 2)  # lays a profile of y and z along x
SHAPES = {  # corners of the floor, or of the end wall of a gable
    "box": [(0, 0), (4, 0), (4, 3), (0, 3)],
    "60 degrees": [(0, 0), (4, 0), (2, 12**0.5)],
    "45 degrees": [(0, 0), (4, 0), (2, 2)],
    "30 and 150 degrees": [(0, 0), (5, 0), (5 + 75**0.5 / 2, 2.5), (75**0.5 / 2, 2.5)],
    "120 degrees": polar(6, 2.5),
    "twelve walls": polar(12, 3.0),
    "seven walls": polar(7, 1.9),
    "slanted wall": [(0, 0), (5, 0), (3.5, 2), (1, 2)],
    "89 degrees": [(0, 0), (4, 0.07), (3.9, 3), (0, 3)],
    "roof of 27 degrees": [(0, 0), (4, 0), (4, 2), (2, 3), (0, 2)],
    "roof of 15 degrees": [(0, 0), (4, 0), (4, 2), (2, 2.536), (0, 2)],
    "attic": [(0, 0), (5, 0), (5, 0.6), (2.5, 2.9), (0, 0.6)],
    "one slope": [(0, 0), (4, 0), (4, 4.3), (0, 2)],
}


@pytest.mark.parametrize(("name", "degrees"), [("box", 0), *((name, 17) for name in SHAPES)])
def test_walls_of_a_convex_room_share_the_corners_of_the_room(tmp_path, name, degrees):
    room = trimesh.creation.extrude_polygon(Polygon(SHAPES[name]), 2.5)
    room.apply_transform(UPRIGHT if "roof" in name or name in ("attic", "one slope") else np.eye(4))
    room.apply_transform(trimesh.transformations.rotation_matrix(np.radians(degrees), Z, [0.3, -0.2, 0]))
    room.apply_translation([0.13, -0.27, 1.25]).invert()
    scene = reconstruct(saved(room, tmp_path), options=ScanOptions(up="z"))
    corners, uses = np.unique(np.vstack([s.mesh.vertices for s in scene]), axis=0, return_counts=True)
    assert uses.tolist() == [3] * len(room.vertices)  # each corner is exactly the same point in three surfaces
    assert np.linalg.norm(corners[:, None] - room.vertices, axis=2).min(axis=0).max() < 1e-5
    assert sum(s.mesh.area for s in scene) == pytest.approx(room.area, rel=1e-5)


def test_faces_of_a_narrow_pilaster_end_at_each_other_and_at_the_wall(tmp_path):
    deep, wide, front = 0.08, 0.3, W - 0.08
    sides = [((2, front, 0), X, (wide, H)), ((2, W, 0), -Y, (deep, H)), ((2 + wide, front, 0), Y, (deep, H))]
    pieces = [*(rectangle(*side) for side in inner_sides(SIZE)), *(rectangle(corner, along, Z, size) for corner, along, size in sides)]
    scene = reconstruct(saved(scan(pieces), tmp_path), options=ScanOptions(up="z"))
    corners = np.array(list(itertools.product((2, 2 + wide), (front, W), (0, H))))
    vertices = np.vstack([s.mesh.vertices for s in scene if s.kind != "room" or s.mesh.area < 2])
    assert np.linalg.norm(vertices[:, None] - corners, axis=2).min(axis=1).max() < 1e-5
    assert sum(s.mesh.area for s in scene) == pytest.approx(2 * (L * W + L * H + W * H) + (wide + 2 * deep) * H, abs=1e-3)


@pytest.mark.parametrize("edge_m", [9.0, EDGE_M])
def test_doorway_of_a_mesh_stays_open_and_a_window_closes_with_a_line(tmp_path, capsys, edge_m):
    """The mesh has few large triangles, as from a modelling program, or many small triangles."""
    holes = {3: [DOOR], 5: [WINDOW]}
    pieces = [rectangle(*side, openings=holes.get(k, [])).subdivide_to_size(edge_m) for k, side in enumerate(inner_sides(SIZE))]
    scene = reconstruct(saved(scan(pieces), tmp_path), options=ScanOptions(up="z"), progress=Progress())
    wall = next(s for s in scene if s.mesh.bounds[0, 0] > L - 1e-6)
    assert wall.mesh.area == pytest.approx(W * H - 0.9 * 2.0, abs=1e-3)
    assert sum(s.mesh.area for s in scene) == pytest.approx(2 * (L * W + L * H + W * H) - 0.9 * 2.0, abs=2e-3)
    assert "closed 0.0 m2 of gaps in which the scan shows nothing; 1 framed gap became panes of glass" in capsys.readouterr().err


def test_planes_become_regular_only_within_the_noise():
    mesh = scan(shell(), 0.003)
    for degrees, tilt in ((0.8, pytest.approx(0.8, abs=0.1)), (0.1, 0.0)):  # 0.8 degrees over 3 m are 2 cm, which is more than noise
        tilted = mesh.copy().apply_transform(trimesh.transformations.rotation_matrix(np.radians(degrees), X))
        (floor, *_), main = regular(tilted, segmented(tilted))
        assert floor.normal is not None
        assert np.degrees(np.arccos(abs(floor.normal[2]))) == tilt
        assert abs(main) < np.radians(1)


def test_edges_move_onto_intersection_lines_and_ragged_edges_become_straight():
    """The cells have the shape of an L. They reach 5 and 3 cm beyond two of the lines, and end 3 cm before the third."""
    rng = np.random.default_rng(0)
    grid = Grid(Z, 0.0, np.eye(3)[:2], np.zeros(2), (150, 120), 0.02)
    mask = np.zeros(grid.shape, dtype=bool)
    mask[10:110, 10:50] = mask[10:60, 50:90] = True
    for column in range(10, 60):  # one edge of the grid is irregular by up to two cells
        mask[column, 88 : 88 + rng.integers(0, 4)] = True
    cuts = [meeting_planes.meeting_line(grid, normal, offset) for normal, offset in ((X, 0.25), (X, 1.23), (Y, 0.97))]
    shape = meeting_planes.polygon(grid, mask, [cut for cut in cuts if cut is not None], np.zeros((0, 2)))
    assert isinstance(shape, Polygon)
    corners = np.array(shape.exterior.coords)[:-1]
    assert len(corners) == 6
    assert np.linalg.norm(corners - [1.23, 0.97], axis=1).min() < 1e-9  # the inner corner
    assert corners[:, 0].min() == pytest.approx(0.25, abs=1e-9)
    assert corners[:, 1].max() == pytest.approx(1.8, abs=0.04)
    assert shape.area == pytest.approx(1.94 * 0.76 + 0.98 * (corners[:, 1].max() - 0.97), abs=0.01)
    mesh = meeting_planes.triangulated(grid, shape)
    assert mesh is not None
    assert len(mesh.faces) == 4
    assert (mesh.face_normals[:, 2] > 0.999).all()


def test_framed_window_without_points_becomes_a_pane_and_the_tracer_finds_flat_faces(tmp_path):
    scene = reconstruct(saved(scan(shell(WINDOW), 0.005), tmp_path))
    static = static_scene(list(scene), Radar.iwr1843())
    assert static.is_flat
    assert len(static.room.faces.offset) < 150
    panes = [s for s in scene if s.provenance["completed"]]
    assert [s.name for s in panes] == ["pane_1"]
    assert panes[0].mesh.area == pytest.approx(1.2, rel=0.08)
    score = score_scene(scene, truth())
    assert score.clear[0].name == "window"
    assert min(score.clear[0].recall, score.clear[0].precision) > 0.9
    assert min(np.mean([s.precision for s in score.surfaces]), np.mean([s.recall for s in score.surfaces])) > 0.97
    assert score.boundary_median_m < 0.03


def test_opening_with_points_behind_it_stays_open(tmp_path):
    beyond = sheet([0, W + 1.0, 0], X, Z, (L, H))
    scene = reconstruct(saved(scan([*shell(WINDOW), beyond], 0.004), tmp_path), options=ScanOptions(up="z"))
    assert not any(s.provenance["completed"] for s in scene)
    wall = next(s for s in scene if s.mesh.bounds[0, 1] > W - 0.05 and s.mesh.bounds[1, 1] < W + 0.05)
    assert wall.mesh.area == pytest.approx(L * H - 1.2, rel=0.03)


def test_wall_and_floor_are_completed_behind_and_under_a_cabinet(tmp_path):
    low, high = np.array([1.2, 3.5, 0.0]), np.array([2.2, 4.0, 1.8])
    room = shell((1.2, 0.0, 2.2, 1.8))
    room[0] = sheet([0, 0, 0], X, Y, (L, W), (1.2, 3.5, 2.2, 4.0))
    cabinet = [
        sheet([low[0], low[1], 0], X, Z, (1.0, 1.8)),
        sheet([low[0], high[1], 0], -Y, Z, (0.5, 1.8)),
        sheet([high[0], low[1], 0], Y, Z, (0.5, 1.8)),
        sheet([low[0], low[1], high[2]], X, Y, (1.0, 0.5)),
    ]
    scene = reconstruct(saved(scan([*room, *cabinet], 0.004), tmp_path))
    by_name = {s.name: s for s in scene}
    assert by_name["floor"].mesh.area == pytest.approx(L * W, rel=0.01)
    behind = [s for s in scene if s.provenance["filled_m2"] > 1]
    assert [round(float(s.mesh.area), 1) for s in behind] == [pytest.approx(L * H, rel=0.01)]
    sides = [s for s in scene if s.provenance["planes"] == 4]
    assert len(sides) == 1  # the cabinet is one object
    assert sides[0].mesh.area == pytest.approx(1.8 + 2 * 0.9 + 0.5, rel=0.05)


def test_window_next_to_a_hidden_part_of_the_wall_becomes_a_pane():
    wall = trimesh.util.concatenate(shell(WINDOW))
    assert isinstance(wall, trimesh.Trimesh)
    at = wall.triangles_center
    # A board 0.35 m in front of the wall hides the part from the window's lower corner to the floor.
    wall.update_faces(~((at[:, 1] > W - 0.01) & (at[:, 0] > 0.5) & (at[:, 0] < 1.05) & (at[:, 2] < 1.2)))
    board = block((0.75, 0.05, 1.2), [0.7, W - 0.35, 0.6])
    mesh = scan([wall, board], 0.002)
    poses = np.tile(np.eye(4), (6, 1, 1))
    poses[:, :3, :3] = np.column_stack([X, -Z, Y])  # towards the wall y = 4
    poses[:, :3, 3] = [(x, 0.5, 1.4) for x in np.linspace(0.8, 4.0, 6)]
    cameras = Cameras(poses, np.array([[150.0, 0, 128], [0, 150.0, 96], [0, 0, 1]]), (256, 192))
    panes = [f.mesh for f in flattened(mesh, segmented(mesh), cameras).flats if f.segment < 0]
    assert [float(p.area) for p in panes] == [pytest.approx(1.2, rel=0.1)]


def test_gaps_of_floors_are_filled_without_panes():
    grid = Grid(Z, 0.0, np.eye(3)[:2], np.zeros(2), (100, 100), 0.02)
    mask = np.ones(grid.shape, dtype=bool)
    mask[30:60, 30:60] = False
    points = np.random.default_rng(0).uniform([0, 0, 0], [2, 2, 0.001], (4000, 3))
    completed = complete(grid, mask, points, None, None)
    assert completed.mask.all()
    assert not completed.panes
    assert completed.filled_m2 == pytest.approx(0.36)


def test_parts_are_simplified_within_the_stated_error():
    ball = trimesh.creation.icosphere(subdivisions=5, radius=0.4)
    noisy = ball.vertices + 0.003 * np.random.default_rng(0).standard_normal(ball.vertices.shape)
    mesh = trimesh.Trimesh(noisy, ball.faces, process=False)
    simple = simplified(mesh, np.arange(len(mesh.faces)))
    assert simple is not None
    piece, error = simple
    assert len(piece.faces) < 0.1 * len(mesh.faces)
    away = np.abs(np.linalg.norm(piece.triangles_center, axis=1) - 0.4)
    assert error <= ERROR_M
    assert np.quantile(away, 0.95) < ERROR_M  # measured against the sphere itself


@pytest.mark.slow
def test_box_and_its_reconstruction_have_the_same_range_profiles(tmp_path):
    box = trimesh.creation.box((4, 3, 2.5)).apply_transform(trimesh.transformations.rotation_matrix(np.radians(17), Z))
    box.invert()
    scene = reconstruct(saved(box, tmp_path), options=ScanOptions(up="z"), material="concrete")
    radar, original = Radar.iwr1843(), Scene([Surface(box, "concrete", "box", role="room")])
    for x, y in itertools.product((-0.8, 0.0, 0.9), repeat=2):
        pose = look_at([x, y, 0.1 * x], [2.0, 1.0, 0.2])[None]
        level_db, original_db = (decibels(profiles(simulate(room, radar, pose).iq, radar)) for room in (scene, original))
        error_db = (level_db - original_db)[original_db > original_db.max() - 30]
        assert np.sqrt(np.mean(error_db**2)) < 0.5
        assert np.abs(error_db).max() < 1.5
