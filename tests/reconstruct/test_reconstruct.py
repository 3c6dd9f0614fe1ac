"""Reconstruction of rooms that are built here triangle by triangle: polygons, panes, parts and files."""

import itertools
import json
import warnings

import numpy as np
import pytest
import trimesh
from shapely import Polygon
from trimesh.visual import ColorVisuals, TextureVisuals

from experiments.scans.segment_score import score_scene
from radartwin.errors import MeshError, MissingError, ScanError
from radartwin.io.progress import Progress
from radartwin.reconstruct import scan_folder
from radartwin.reconstruct.build import ScanOptions, reconstruct, summary
from radartwin.reconstruct.mesh_file import load_scan
from radartwin.reconstruct.outlines import outline
from radartwin.reconstruct.outlines.complete import complete
from radartwin.reconstruct.outlines.flatten import regular
from radartwin.reconstruct.outlines.grid import Grid
from radartwin.reconstruct.outlines.parts import ERROR_M, simplified
from radartwin.reconstruct.outlines.surfaces import flattened
from radartwin.reconstruct.outlines.visibility import Cameras, Sight
from radartwin.reconstruct.scan_folder import distinct_views
from radartwin.reconstruct.segmentation import coplanar, masks
from radartwin.reconstruct.segmentation.colour import face_colours
from radartwin.reconstruct.segmentation.faces import Faces, members
from radartwin.reconstruct.segmentation.growing import grow
from radartwin.reconstruct.segmentation.segment import segmented
from radartwin.scene.rooms import rectangle
from radartwin.scene.scene import Scene, Surface
from radartwin.simulation import geometry
from radartwin.simulation.flat import panel_room, panels

EDGE_M = 0.05
SIZE = (5.0, 4.0, 2.4)
WINDOW = (1.0, 0.9, 2.2, 1.9)  # in the wall y = 4, along it and up
DOOR = (1.0, 0.0, 1.9, 2.0)  # in the wall x = 5
WHITE, BROWN, GREY = (220, 220, 215), (120, 80, 50), (150, 150, 155)


def sheet(corner, along, up, size, hole=None):
    """A grid of triangles facing along x up, without those inside the hole (u0, v0, u1, v1)."""
    nu, nv = (round(s / EDGE_M) for s in size)
    u, v = np.meshgrid(np.linspace(0, size[0], nu + 1), np.linspace(0, size[1], nv + 1), indexing="ij")
    points = np.asarray(corner, float) + u[..., None] * np.asarray(along) + v[..., None] * np.asarray(up)
    grid = np.arange(u.size).reshape(u.shape)
    a, b, c, d = grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:]
    faces = np.stack([np.stack([a, b, c], -1), np.stack([a, c, d], -1)], axis=2)
    if hole is not None:
        cu, cv = (u[:-1, :-1] + u[1:, 1:]) / 2, (v[:-1, :-1] + v[1:, 1:]) / 2
        faces = faces[~((cu > hole[0]) & (cu < hole[2]) & (cv > hole[1]) & (cv < hole[3]))]
    return trimesh.Trimesh(points.reshape(-1, 3), faces.reshape(-1, 3), process=False)


def block(size, centre):
    """A box of triangles about as small as those of a sheet."""
    box = trimesh.creation.box(size).subdivide_to_size(EDGE_M)
    assert isinstance(box, trimesh.Trimesh)
    return box.apply_translation(centre)


X, Y, Z = np.eye(3)
L, W, H = SIZE


def shell(window=None):
    return [
        sheet([0, 0, 0], X, Y, (L, W)),
        sheet([0, W, H], X, -Y, (L, W)),
        sheet([0, 0, 0], Y, Z, (W, H)),
        sheet([L, W, 0], -Y, Z, (W, H)),
        sheet([L, 0, 0], -X, Z, (L, H)),
        sheet([0, W, 0], X, Z, (L, H), window),
    ]


def scan(pieces, noise_m=0.0, seed=0):
    """One mesh of the pieces, welded, with noise that is smooth over two edges as depth noise is."""
    mesh = trimesh.util.concatenate(pieces)
    assert isinstance(mesh, trimesh.Trimesh)
    mesh = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    mesh.merge_vertices(digits_vertex=6)
    noise = noise_m * np.random.default_rng(seed).standard_normal(mesh.vertices.shape)
    return trimesh.Trimesh(mesh.vertices + noise, mesh.faces, process=False)


def saved(mesh, tmp_path, name="room.ply"):
    mesh.export(tmp_path / name)
    return tmp_path / name


def truth(window=False):
    inner = [WINDOW] if window else []
    named = [
        ("floor", rectangle([0, 0, 0], X, Y, (L, W))),
        ("ceiling", rectangle([0, W, H], X, -Y, (L, W))),
        ("back", rectangle([0, 0, 0], Y, Z, (W, H))),
        ("front", rectangle([L, W, 0], -Y, Z, (W, H))),
        ("right", rectangle([L, 0, 0], -X, Z, (L, H))),
        ("left", rectangle([0, W, 0], X, Z, (L, H), inner)),
    ]
    surfaces = [Surface(m, "plasterboard", n, role="room", provenance={"source": "true", "minc": "painted"}) for n, m in named]
    if window:
        pane = rectangle([0, W, 0], X, Z, (L, H), inset=WINDOW)
        surfaces.append(Surface(pane, "glass", "window", role="room", provenance={"source": "true", "minc": "glass"}))
    return Scene(surfaces)


# Polygons


def test_noisy_room_becomes_six_rectangles_with_shared_corners(tmp_path):
    scene = reconstruct(saved(scan(shell(), 0.006), tmp_path))
    assert sorted(scene.names) == ["ceiling", "floor", "wall_1", "wall_2", "wall_3", "wall_4"]
    assert {len(s.mesh.faces) for s in scene} == {2}
    corners = {tuple(np.round(v, 3)) for s in scene for v in s.mesh.vertices}
    assert len(corners) == 8  # every corner is shared by three surfaces, to the millimetre
    assert np.abs(np.ptp(np.array(sorted(corners)), axis=0) - SIZE).max() < 4e-3
    normals = np.array([s.mesh.face_normals[0] for s in scene])
    assert np.allclose(np.abs(normals).max(axis=1), 1, atol=1e-3)  # upright, level, square
    inside = np.array([L, W, H]) / 2
    assert all((inside - s.mesh.triangles_center[0]) @ s.mesh.face_normals[0] > 0 for s in scene)


def test_tracer_finds_flat_panels_in_a_reconstructed_room(tmp_path):
    box = block((0.6, 0.5, 0.8), [1.5, 1.2, 0.4])
    scene = reconstruct(saved(scan([*shell(WINDOW), box], 0.004), tmp_path))
    surfaces = list(scene)
    built = geometry.build([s.mesh for s in surfaces])
    found, small = panels.find(built), panel_room.small_faces(surfaces, built)
    edges = built.corners[:, 1:] - built.corners[:, :1]
    area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
    assert area[~small & (found.of_face >= 0)].sum() > panel_room.FLAT_SHARE * area[~small].sum()
    assert len(found) < 150


def test_planes_become_regular_only_within_the_noise():
    mesh = scan(shell(), 0.003)
    turn = trimesh.transformations.rotation_matrix(np.radians(0.8), X)
    tilted = mesh.copy().apply_transform(turn)
    segments = segmented(tilted)
    straight, main = regular(tilted, segments)
    floor = straight[0].normal
    assert floor is not None
    assert abs(main) < np.radians(1)
    # 0.8 degrees over 3 m lifts the edges by 2 cm, which is more than noise.
    assert np.degrees(np.arccos(abs(floor[2]))) == pytest.approx(0.8, abs=0.1)
    slight = mesh.copy().apply_transform(trimesh.transformations.rotation_matrix(np.radians(0.1), X))
    floor = regular(slight, segmented(slight))[0][0].normal
    assert floor is not None
    assert abs(floor[2]) == 1.0


def test_edges_move_onto_intersection_lines_and_ragged_edges_become_straight():
    rng = np.random.default_rng(0)
    grid = Grid(Z, 0.0, np.eye(3)[:2], np.zeros(2), (150, 120), 0.02)
    mask = np.zeros(grid.shape, dtype=bool)
    mask[10:110, 10:90] = True
    for column in range(10, 110):  # one edge frayed by up to two cells
        mask[column, 88 : 88 + rng.integers(0, 4)] = True
    line = outline.meeting_line(grid, X, 0.25)  # the plane x = 0.25, 5 cm from the edge at 0.2
    assert line is not None
    shape = outline.polygon(grid, mask, [line])
    assert isinstance(shape, Polygon)
    corners = np.array(shape.exterior.coords)[:-1]
    assert len(corners) == 4
    assert corners[:, 0].min() == pytest.approx(0.25, abs=1e-9)
    assert corners[:, 1].max() == pytest.approx(1.8, abs=0.04)
    mesh = outline.triangulated(grid, shape)
    assert mesh is not None
    assert len(mesh.faces) == 2
    assert (mesh.face_normals[:, 2] > 0.999).all()


# Gaps


def test_framed_window_without_points_becomes_a_pane(tmp_path):
    scene = reconstruct(saved(scan(shell(WINDOW), 0.005), tmp_path))
    panes = [s for s in scene if s.provenance["completed"]]
    assert [s.name for s in panes] == ["pane_1"]
    assert panes[0].mesh.area == pytest.approx(1.2, rel=0.08)
    score = score_scene(scene, truth(window=True))
    assert score.clear[0].name == "window"
    assert min(score.clear[0].recall, score.clear[0].precision) > 0.9
    assert min(score.precision, score.recall) > 0.97
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


def test_largest_rectangle_matches_exhaustive_search():
    mask = np.random.default_rng(3).random((9, 11)) < 0.7
    best = max(
        (a1 - a0) * (b1 - b0)
        for a0, a1 in itertools.combinations(range(10), 2)
        for b0, b1 in itertools.combinations(range(12), 2)
        if mask[a0:a1, b0:b1].all()
    )
    found = mask[masks.largest_rectangle(mask)]
    assert found.all()
    assert found.size == best
    assert mask[masks.largest_rectangle(np.zeros_like(mask))].size == 0


def test_gaps_of_floors_are_filled_without_panes():
    grid = Grid(Z, 0.0, np.eye(3)[:2], np.zeros(2), (100, 100), 0.02)
    mask = np.ones(grid.shape, dtype=bool)
    mask[30:60, 30:60] = False
    points = np.random.default_rng(0).uniform([0, 0, 0], [2, 2, 0.001], (4000, 3))
    done = complete(grid, mask, points, None, None)
    assert done.mask.all()
    assert not done.panes
    assert done.filled_m2 == pytest.approx(0.36)


def test_screen_blocks_lines_of_sight():
    wall, screen = (sheet([x, 0, 0], Y, Z, (3, 2.5)).triangles_center for x in (0.0, 1.0))
    floor = sheet([0, 0, 0], X, Y, (4, 3)).triangles_center
    place = np.array([[0.0, 1.5, 1.2]])
    assert Sight.of(np.vstack([wall, floor])).seen(place, X)[0] > 5
    hidden = Sight.of(np.vstack([wall, screen, floor]))
    beyond = hidden.viewpoints[:, 0] > 1.1
    assert beyond.any()
    assert hidden.seen(place, X)[0] <= (~beyond).sum()


# One surface, or several


def test_divided_wall_is_one_surface_and_two_tables_are_two():
    strips = [sheet([0, 0, 0], X, Z, (1.2, H)), sheet([2.4, 0, 0], X, Z, (1.6, H))]  # a gap from floor to ceiling
    tables = [sheet([x, 1.0, 0.75], X, Y, (0.8, 0.6)) for x in (0.5, 2.5)]
    mesh = scan([sheet([0, 0, 0], X, Y, (L, W)), *strips, *tables], 0.003)
    segments = segmented(mesh, bodies=False)
    assert sorted(round(s.area_m2, 1) for s in segments if s.normal is not None) == [
        0.5,
        0.5,
        pytest.approx(6.72, abs=0.15),
        pytest.approx(20, abs=0.2),
    ]


def test_pieces_with_points_behind_their_gap_are_not_joined():
    strips = [sheet([0, 0, 0], X, Z, (1.2, H)), sheet([2.4, 0, 0], X, Z, (1.6, H))]
    alcove = sheet([1.2, 0.6, 0], X, Z, (1.2, H))  # behind the strips, which face -y
    faces = Faces.of(scan([*strips, alcove], 0.002), 0.08)
    label = coplanar.merge(faces, grow(faces, 25.0, 0.04, 0.06))
    assert len(members(label)) == 3
    open_gap = Faces.of(scan(strips, 0.002), 0.08)
    assert len(members(coplanar.merge(open_gap, grow(open_gap, 25.0, 0.04, 0.06)))) == 1


def coloured(mesh, rule, seed=0):
    """A copy with vertex colours by rule(vertices) -> (V, 3), and some noise."""
    rgb = np.array([rule(v) for v in mesh.vertices], dtype=float)
    rgb += np.random.default_rng(seed).normal(0, 4, rgb.shape)
    rgba = np.column_stack([np.clip(rgb, 0, 255), np.full(len(rgb), 255)]).astype(np.uint8)
    return trimesh.Trimesh(mesh.vertices, mesh.faces, vertex_colors=rgba, process=False)


def with_door(v):
    u = W - v[1]
    light = 1.0 - 0.25 * v[2] / H  # a gradient of light without an edge
    inside = v[0] > L - 0.05 and DOOR[0] < u < DOOR[2] and v[2] < DOOR[3]
    return np.array(BROWN if inside else WHITE) * light


def test_door_in_the_plane_of_its_wall_is_separated_by_colour(tmp_path):
    mesh = coloured(scan(shell(), 0.004), with_door)
    door = [s for s in segmented(mesh) if 1.0 < s.area_m2 < 3.0]
    assert [s.area_m2 for s in door] == [pytest.approx(1.8, rel=0.1)]
    assert len(segmented(trimesh.Trimesh(mesh.vertices, mesh.faces, process=False))) == 6
    assert len(segmented(mesh, colour=False)) == 6
    walls = [s for s in reconstruct(saved(mesh, tmp_path)) if s.mesh.bounds[0, 0] > L - 0.05]
    assert sum(float(s.mesh.area) for s in walls) == pytest.approx(W * H, rel=0.01)  # neither gap nor overlap between them
    leaf = min(walls, key=lambda s: s.mesh.area)
    assert leaf.mesh.area == pytest.approx(1.8, rel=0.05)
    assert len(leaf.mesh.faces) <= 6


def test_reflection_in_a_panel_is_not_separated_and_a_patch_on_the_wall_is():
    def seen(step_on_wall):
        def rule(v):  # a grey panel with a brighter upper half in the brown wall x = 5, and a patch of another brown beside it
            u = W - v[1]
            if v[0] < L - 0.05:
                return WHITE
            if 0.5 < u < 1.6 and v[2] < 2.0:
                return (175, 175, 180) if v[2] > 1.3 else (130, 130, 135)
            return (165, 112, 72) if step_on_wall and 2.4 < u < 3.4 and 0.5 < v[2] < 1.5 else BROWN

        found = segmented(coloured(scan(shell(), 0.003), rule))
        return sorted(round(s.area_m2, 1) for s in found if s.area_m2 < 3)

    assert seen(False) == [pytest.approx(2.2, abs=0.15)]
    assert seen(True) == [pytest.approx(1.0, abs=0.15), pytest.approx(2.2, abs=0.15)]


def test_two_panels_joined_by_bleeding_colour_are_two():
    def rule(v):
        u = W - v[1]
        panel = (0.5 < u < 1.4 or 2.0 < u < 2.9) and v[2] < 2.0
        return GREY if v[0] > L - 0.05 and (panel or (0.5 < u < 2.9 and v[2] < 0.03)) else BROWN if v[0] > L - 0.05 else WHITE

    found = segmented(coloured(scan(shell(), 0.003), rule))
    assert [s.area_m2 for s in found if s.area_m2 < 3] == [pytest.approx(1.8, rel=0.1)] * 2


def test_light_and_painted_lines_separate_nothing():
    def lit(v):
        spot = 90 * np.exp(-((v[0] - 2) ** 2 + (v[1] - 1.5) ** 2) / 0.5)
        line = 80 if abs(v[2] - 1.2) < 0.03 else 0
        return np.array([150 + spot, 150 + spot - line, 150 + spot - line])

    assert len(segmented(coloured(scan(shell(), 0.003), lit))) == 6


def test_sides_of_one_colour_are_one_body_and_of_two_colours_two():
    room = shell()
    box = block((0.6, 0.6, 0.6), [2, 1.5, 0.3])
    mesh = scan([*room, box], 0.002)

    def one(v):
        return WHITE if v[2] > 0.7 or np.abs(v[:2] - [2, 1.5]).max() > 0.32 or v[2] < 0.01 else BROWN

    def two(v):
        return GREY if 0.58 < v[2] < 0.62 and np.abs(v[:2] - [2, 1.5]).max() < 0.28 else one(v)

    def seen(rule):  # not the box's underside, which touches nothing else
        return [s for s in segmented(coloured(mesh, rule)) if s.area_m2 < 0.6 and s.normal is not None and s.normal[2] > -0.5]

    sides = seen(one)
    assert len({s.body for s in sides}) == 1
    assert len({s.body for s in seen(two)}) == 2


# What is not flat


def test_parts_are_simplified_within_the_stated_error():
    ball = trimesh.creation.icosphere(subdivisions=5, radius=0.4)
    noisy = ball.vertices + 0.003 * np.random.default_rng(0).standard_normal(ball.vertices.shape)
    mesh = trimesh.Trimesh(noisy, ball.faces, process=False)
    made = simplified(mesh, np.arange(len(mesh.faces)))
    assert made is not None
    piece, error = made
    assert len(piece.faces) < 0.1 * len(mesh.faces)
    away = np.abs(np.linalg.norm(piece.triangles_center, axis=1) - 0.4)
    assert error <= ERROR_M
    assert np.quantile(away, 0.95) < ERROR_M  # measured against the sphere itself


# Files


def test_scene_folder_holds_the_scan_and_the_surface_of_each_face(tmp_path):
    mesh = coloured(scan(shell(), 0.004), with_door)
    scene = reconstruct(saved(mesh, tmp_path), tmp_path / "out")
    again = trimesh.load(tmp_path / "out" / scan_folder.MESH_FILE, process=False)
    assert isinstance(again, trimesh.Trimesh)
    assert isinstance(again.visual, ColorVisuals)
    assert isinstance(mesh.visual, ColorVisuals)
    surface_of_face = np.load(tmp_path / "out" / scan_folder.FACE_SURFACES_FILE)
    assert len(surface_of_face) == len(again.faces)
    assert np.array_equal(again.visual.vertex_colors[:, :3], mesh.visual.vertex_colors[:, :3])
    for k, surface in enumerate(scene):
        if not surface.provenance["completed"]:
            assert again.area_faces[surface_of_face == k].sum() == pytest.approx(surface.provenance["area_m2"], rel=0.01)
    loaded = Scene.load(tmp_path / "out")
    assert loaded.names == scene.names
    assert [dict(s.provenance) for s in loaded] == [dict(s.provenance) for s in scene]
    manifest = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert {"filled_m2", "flattening_rms_m", "parts_error_m", "scan"} <= set(manifest["provenance"])
    assert all(s.provenance["source"] == "uniform" and s.provenance["stand_in"] is False for s in loaded)
    lines = summary(scene)
    assert any("ceiling" in line for line in lines)
    low, high = scene.bounds
    assert lines[-1].startswith(f"the scene extends over x from {low[0]:.2f} to {high[0]:.2f}, y from {low[1]:.2f} to ")


def test_reconstruction_is_deterministic_to_the_byte(tmp_path):
    path = saved(
        coloured(scan([*shell(WINDOW), trimesh.creation.icosphere(3, 0.3).apply_translation([2, 1, 0.4])], 0.004), with_door), tmp_path
    )
    for name in ("one", "two"):
        reconstruct(path, tmp_path / name)
    for file in ("scene.glb", "manifest.json", scan_folder.MESH_FILE, scan_folder.FACE_SURFACES_FILE):
        assert (tmp_path / "one" / file).read_bytes() == (tmp_path / "two" / file).read_bytes(), file


def test_interrupted_write_leaves_no_scene(tmp_path, monkeypatch):
    path = saved(scan(shell(), 0.003), tmp_path)
    reconstruct(path, tmp_path / "out")

    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(Scene, "save", interrupted)
    with pytest.raises(KeyboardInterrupt):
        reconstruct(path, tmp_path / "out")
    with pytest.raises(MissingError, match=r"manifest\.json"):
        Scene.load(tmp_path / "out")
    assert not list((tmp_path / "out").glob(".*"))


def test_saved_photographs_are_the_most_distinct_views():
    poses = np.tile(np.eye(4), (20, 1, 1))
    poses[:, 0, 3] = np.r_[np.zeros(17), 1.0, 2.0, 3.0]
    assert distinct_views(poses, 4) == [0, 17, 18, 19]
    assert distinct_views(poses[16:18], 40) == [0, 1]


# Bad input


def test_scan_that_shows_its_outside_is_turned_and_reported(tmp_path):
    mesh = scan(shell(), 0.002)
    mesh.invert()
    loaded, report = load_scan(saved(mesh, tmp_path))
    assert report.turned
    assert any("turned" in line for line in report.lines())
    assert loaded.volume < 0  # the faces of a room look inwards
    mirrored = mesh.copy()
    mirrored.vertices[:, 0] *= -1  # mirroring an axis turns the faces inside out again, so they are right
    assert not load_scan(saved(mirrored, tmp_path, "mirrored.ply"))[1].turned


def test_missing_texture_gives_one_warning_and_no_colours(tmp_path):
    (tmp_path / "room.mtl").write_text("newmtl a\nmap_Kd gone.png\n")
    mesh = scan(shell())
    lines = ["mtllib room.mtl", "usemtl a", *(f"v {x} {y} {z}" for x, y, z in mesh.vertices), "vt 0 0"]
    lines += [f"f {a + 1}/1 {b + 1}/1 {c + 1}/1" for a, b, c in mesh.faces]
    (tmp_path / "room.obj").write_text("\n".join(lines) + "\n")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        loaded, _ = load_scan(tmp_path / "room.obj")
    assert len([w for w in caught if "texture" in str(w.message)]) == 1
    assert len(loaded.faces) == len(mesh.faces)
    assert face_colours(loaded) is None


def test_texture_gives_vertex_colours(tmp_path):
    from PIL import Image

    mesh = scan(shell())
    uv = np.column_stack([mesh.vertices[:, 0] / L, mesh.vertices[:, 2] / H])
    picture = np.zeros((8, 8, 3), np.uint8)
    picture[:, :4], picture[:, 4:] = (200, 0, 0), (0, 0, 200)
    visual = TextureVisuals(uv=uv, image=Image.fromarray(picture))
    trimesh.Trimesh(mesh.vertices, mesh.faces, visual=visual, process=False).export(tmp_path / "room.glb")
    loaded, _ = load_scan(tmp_path / "room.glb", up="z")
    left = loaded.vertices[:, 0] < 0.3 * L
    assert isinstance(loaded.visual, ColorVisuals)
    assert loaded.visual.vertex_colors[left][:, :3].mean(axis=0).round().tolist() == [200, 0, 0]


@pytest.mark.parametrize(
    ("text", "error", "match"),
    [
        ("", MeshError, r"bad\.obj"),
        ("v 1 1 1\nv 1 1 1\nv 1 1 1\nf 1 2 3\n", ScanError, "is degenerate: all its corners coincide"),
        ("v 0 0 0\nv nan 0 1\nv 1 0 0\nf 1 2 3\n", ScanError, "NaN"),
    ],
)
def test_bad_scans_are_refused_in_one_line_and_write_nothing(tmp_path, text, error, match):
    path = tmp_path / "bad.obj"
    path.write_text(text)
    with pytest.raises((error, MeshError), match=match) as caught:
        reconstruct(path, tmp_path / "out", progress=Progress(quiet=True))
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "out").exists()
