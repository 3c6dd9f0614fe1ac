"""Tests of the collision check: depth of overlaps, contact, crossings of a path with a surface, and heights below a point."""

import numpy as np
import pytest
import trimesh

from radartwin.scene import objects
from radartwin.scene.collision import check_path, overlap_m, top_below
from radartwin.scene.pairs import winding_number
from radartwin.scene.scene import Scene, Surface
from radartwin.scene.trajectories import trajectory

UNIT = objects.box([0, 0, 0], [1, 1, 1])
CAN = objects.cylinder(0.04, 0.1)


def wall(x=1.0):
    corners = np.array([[x, 0, 0], [x, 3, 0], [x, 3, 2.5], [x, 0, 2.5]])
    return trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]], process=False)


OVERLAPS = {
    "a corner": (UNIT, objects.box([0.97, 0.2, 0.2], [2, 0.8, 0.8]), 0.03),
    "one inside the other": (UNIT, objects.box([0.4, 0.4, 0.4], [0.5, 0.5, 0.5]), 0.1),
    "through a board, no vertex inside": (CAN.copy().apply_translation([0.5, 0.5, 1]), objects.box([0, 0, 0.9875], [1, 1, 1.0125]), 0.025),
    "through a wall without thickness": (CAN.copy().apply_translation([1.01, 1, 1]), wall(), 0.03),
    "two spheres": (objects.sphere(0.1, 3), objects.sphere(0.1, 3).apply_translation([0.15, 0, 0]), 0.05),
    "a reflector in a box": (objects.trihedral(0.1).apply_translation([0.97, 0.5, 0.5]), UNIT, 0.03),
    "a reflector's tips in a rug": (objects.trihedral(0.1), objects.box([-1, -1, -0.05], [1, 1, -0.035]), 0.0058),
    "face to face": (UNIT, objects.box([1, 0, 0], [2, 1, 1]), 0.0),
    "a millimetre of contact": (UNIT, objects.box([0.999, 0.2, 0.2], [2, 0.8, 0.8]), 0.0),
    "boxes meet, meshes do not": (objects.sphere(0.1, 3), objects.sphere(0.1, 3).apply_translation([0.15, 0.15, 0.0]), 0.0),
}


@pytest.mark.parametrize(("a", "b", "depth"), OVERLAPS.values(), ids=OVERLAPS)
def test_overlap_is_the_shortest_side_of_the_common_box(a, b, depth):
    tolerance = 0.04 * depth + 1e-6  # the tolerance covers the facets of cans and spheres
    assert overlap_m(a, b) == pytest.approx(depth, abs=tolerance)
    assert overlap_m(b, a) == pytest.approx(depth, abs=tolerance)


def test_a_path_that_ends_before_a_wall_is_accepted():
    scene = Scene([Surface(wall(1.43), "concrete", "front")])
    check_path(scene, trajectory.depth_sweep(trajectory.look_at([0.5, 1, 0.4], [9, 1, 0.4]), 0.9))


def test_winding_number_is_one_inside_and_zero_outside():
    ball = objects.sphere(1.0, 3)
    points = np.random.default_rng(0).normal(size=(200, 3))
    radius = np.linalg.norm(points, axis=1)
    clear = np.abs(radius - 1) > 0.02
    number = winding_number(np.ascontiguousarray(ball.triangles), points)
    assert np.allclose(number[clear], (radius < 1)[clear], atol=1e-9)


def test_top_below_is_the_highest_point_under_the_limit():
    boards = objects.joined([objects.box([0, 0, z], [1, 1, z + 0.02]) for z in (0.0, 0.5, 1.0)])
    points = np.array([[0.5, 0.5], [0.01, 0.99], [1.5, 0.5]])
    assert np.allclose(top_below(boards, points)[:2], 1.02)
    assert np.isneginf(top_below(boards, points)[2])
    assert np.allclose(top_below(boards, points, 0.9)[:2], 0.52)
    assert np.allclose(top_below(boards, points, np.array([0.9, 0.1, 3]))[:2], [0.52, 0.02])
