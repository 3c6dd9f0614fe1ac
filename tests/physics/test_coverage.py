"""For large objects at short range, the tracer skips ray tubes that hit nothing and divides the others into blocks that fit in memory,
without losing a hit.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from radartwin.errors import BackendError
from radartwin.radar.chirp import Radar
from radartwin.scene.objects import shapes
from radartwin.scene.scene import Scene, Surface
from radartwin.simulation import geometry, variant
from radartwin.simulation.backends import tube_paths
from radartwin.simulation.curved import division, tube_grid
from radartwin.simulation.hits import TraceOptions
from radartwin.simulation.simulate import simulate


def slanted_frame() -> Any:
    """Return a bent bar that extends away from the radar, and a ball at the end of the bar."""
    bar = trimesh.creation.box((2.0, 0.03, 0.03))
    bar.apply_transform(trimesh.transformations.rotation_matrix(0.9, [0, 0, 1]))
    post = trimesh.creation.box((0.03, 0.03, 1.2))
    ball = trimesh.creation.icosphere(2, 0.1)
    ball.apply_translation([0.6, 0.9, 0.2])
    return trimesh.util.concatenate([bar, post, ball])


def test_tubes_of_a_hall_keep_the_width_rule_up_to_its_farthest_corner() -> None:
    """The tubes are 0.3 sqrt(wavelength x distance) wide in a hall whose farthest corner is 30 m away."""
    hall = geometry.build([trimesh.creation.box((24.0, 32.0, 0.01))])
    count = tube_paths._room_rays(hall, np.array([[-6.0, 0.0, 10.0]]), 0.0039)
    distance = np.linalg.norm([18.0, 16.0, 10.005])
    assert 2 * distance / np.sqrt(count / 6) == pytest.approx(0.3 * np.sqrt(0.0039 * distance), rel=1e-3)


def test_objects_that_need_more_tubes_than_the_limit_are_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """The radar is between two columns, which no plane grid of tubes covers."""
    monkeypatch.setattr(tube_paths, "MAX_AROUND", 10_000)
    columns: Any = trimesh.util.concatenate([trimesh.creation.cylinder(0.05, 0.2).apply_translation((0.02, y, 0)) for y in (-0.1, 0.1)])
    scene = Scene([Surface(columns, "metal", "columns")])
    with pytest.warns(UserWarning, match=r"tubes, over the limit MAX_AROUND of 10,000.*times too wide; lower rays_per_wavelength2"):
        simulate(scene, Radar.iwr1843(), np.eye(4)[None])


def test_tubes_around_a_radar_leave_out_only_directions_without_the_body() -> None:
    random, left_out = np.random.default_rng(1), 0
    for _ in range(50):
        rotation, source = Rotation.random(rng=random).as_matrix(), random.normal(size=3)
        corners = source + random.normal(size=(4, 3)) + random.normal(size=3)
        inside = (random.dirichlet(np.ones(4), 2000) @ corners - source) @ rotation  # points of the body in the sensor's frame
        axis = np.abs(inside).argmax(axis=1)
        behind = np.array([[0, 5], [1, 2], [3, 4]])[axis, (inside[np.arange(2000), axis] < 0).astype(int)]
        faces = tube_grid.cube_faces(corners, source, rotation)
        assert set(behind) <= set(faces)
        left_out += 6 - len(faces)
    assert left_out > 100


def test_the_points_of_a_flat_mesh_of_many_faces_span_all_of_it() -> None:
    mesh = trimesh.Trimesh(
        Rotation.from_rotvec([0.2, 0.4, 0.6]).apply([[0, 0, 0], [1, 0, 0], [1, 2, 0], [0, 2, 0]]), [[0, 1, 2], [0, 2, 3]]
    )
    for _ in range(8):
        mesh = mesh.subdivide()
    hull = geometry.build([mesh]).hull_points()
    assert len(hull) < len(mesh.vertices)
    assert np.stack([hull.min(axis=0), hull.max(axis=0)]) == pytest.approx(mesh.bounds)


def test_too_many_tubes_for_an_index_are_refused() -> None:
    grid = tube_grid.all_around(np.zeros((200, 3)), np.tile(np.eye(3), (200, 1, 1)), 6 * 8000**2)[0]
    with pytest.raises(BackendError, match="exceed the limit"):
        next(division.blocks(None, grid, geometry.build([]), TraceOptions(1), None, False, 0.004))  # pyright: ignore[reportArgumentType]


def test_poses_with_equal_grids_have_the_tubes_of_each_pose_alone() -> None:
    variant.activate()
    from radartwin.simulation.curved.device import Device
    from radartwin.simulation.curved.flight import WHOLE

    can, options = geometry.build([shapes.cylinder(0.033, 0.12)]), TraceOptions(1)
    places = np.array([[1.0, 0.2, 0.7], [0.8, -0.1, 0.9], [1.0, 0.2, 0.7], [0.9, 0.0, 0.2], [0.8, -0.1, 0.9]])
    grid = tube_grid.towards(can.hull_points(), places, can.centre, 0.004, (0.25, 0.25))
    assert grid is not None

    def tubes(grid: tube_grid.TubeGrid, pose: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the grid cell of each tube of a pose, -1 for a piece of a cell, and the centres of all pieces."""
        (selection,) = division.blocks(Device.of(can, options), grid, can, options, None, False, 0.004)
        assert selection.share is not None
        assert selection.cut is not None
        mine = selection.index // grid.per_pose == pose
        share = selection.share[mine]
        piece = share // (WHOLE + 1) - 1
        return np.where(piece < 0, selection.index[mine] % grid.per_pose, -1), selection.cut.centre[piece[piece >= 0]]

    for pose in range(len(places)):
        for together, alone in zip(tubes(grid, pose), tubes(grid.rows(np.array([pose])), 0), strict=True):
            np.testing.assert_array_equal(together, alone)


@pytest.mark.parametrize("bounces", [1, 3])
def test_signal_does_not_depend_on_the_block_size(monkeypatch: pytest.MonkeyPatch, bounces: int) -> None:
    scene = Scene([Surface(slanted_frame().apply_translation([1.5, 0.0, 0.0]), "metal", "frame", role="object")])
    poses = np.repeat(np.eye(4)[None], 3, axis=0)
    poses[:, 1, 3] = [0.0, 0.1, -0.2]
    per_pose, blocks = [], division.blocks
    monkeypatch.setattr(division, "blocks", lambda device, grid, *rest: per_pose.append(grid.per_pose) or blocks(device, grid, *rest))

    def signal() -> np.ndarray:
        return simulate(scene, Radar.iwr1843(), np.eye(4), motion={"frame": poses}, max_bounces=bounces).iq

    divided = signal()
    monkeypatch.setattr(division, "TUBES_PER_BLOCK", max(per_pose))  # blocks contain whole poses, and tubes are not divided at edges
    whole = signal()
    monkeypatch.setattr(division, "TUBES_PER_BLOCK", max(per_pose) // 7)
    parts = signal()
    assert np.linalg.norm(whole - divided) < 0.1 * np.linalg.norm(divided)
    assert np.linalg.norm(parts - whole) < 1e-4 * np.linalg.norm(whole)
