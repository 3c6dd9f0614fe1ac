"""The shape of objects as made: sizes, exact normals, parts that stay apart, and flat plates of the corner reflector."""

import numpy as np
import pytest
from scipy.spatial import KDTree

from radartwin.scene.objects.catalogue import catalogue, entry
from radartwin.testbed import object_shape
from radartwin.testbed.object_shape import Form, as_made

ROUND = [name for name, one in catalogue().items() if one.outline_m is not None]


def made(name, strength=1.0, seed=0):
    return as_made(entry(name), strength, np.random.default_rng(seed))


@pytest.mark.parametrize("name", catalogue())
def test_strength_zero_is_the_drawing_and_each_seed_is_millimetres_away_in_its_own_way(name):
    drawing = entry(name).surfaces()
    for drawn, same in zip(drawing, made(name, 0.0), strict=True):
        assert same.mesh.vertices.tobytes() == drawn.mesh.vertices.tobytes()
    for drawn, moved in zip(drawing, made(name), strict=True):
        off = np.abs(moved.mesh.bounds - drawn.mesh.bounds).max()
        assert 1e-5 < off < 3e-3
        assert moved.material == drawn.material
        assert moved.name == drawn.name
    assert made(name)[0].mesh.vertices.tobytes() == made(name)[0].mesh.vertices.tobytes()
    assert np.abs(made(name)[0].mesh.vertices - made(name, seed=1)[0].mesh.vertices).max() > 1e-5


@pytest.mark.parametrize("name", ROUND)
def test_normals_of_an_oval_can_are_those_of_the_ellipse(name, monkeypatch):
    """The oracle is the gradient of the implicit surface r - R - d cos(2 azimuth) on the straight wall, evaluated by hand."""
    oval = 0.5e-3
    monkeypatch.setattr(object_shape, "DRINK_CAN", Form(oval_m=oval))
    monkeypatch.setattr(object_shape, "FOOD_CAN", Form(oval_m=oval))
    monkeypatch.setattr(object_shape, "BEADED", 0.0)
    mesh = made(name, seed=2)[0].mesh
    x, y, z = mesh.vertices.T
    height = entry(name).size_m[2]
    wall = (np.abs(mesh.vertex_normals[:, 2]) < 1e-3) & (z > 0.3 * height) & (z < 0.7 * height)
    assert wall.sum() > 1000
    r, azimuth = np.hypot(x, y)[wall], np.arctan2(y, x)[wall]
    mean, cosine, sine = np.linalg.lstsq(np.stack([np.ones_like(r), np.cos(2 * azimuth), np.sin(2 * azimuth)], axis=1), r, rcond=None)[0]
    slope = 2 * (sine * np.cos(2 * azimuth) - cosine * np.sin(2 * azimuth)) / r  # (1/r) dr/d(azimuth)
    radial, around = np.stack([np.cos(azimuth), np.sin(azimuth)]), np.stack([-np.sin(azimuth), np.cos(azimuth)])
    expected = (radial - slope * around) / np.hypot(1, slope)
    assert np.hypot(cosine, sine) > 1e-5
    assert abs(mean - r.mean()) < 1e-6
    error = np.arccos(np.clip((mesh.vertex_normals[wall, :2].T * expected).sum(axis=0), -1, 1))
    assert error.max() < np.radians(0.1)


@pytest.mark.parametrize("name", ["olive_oil", "mouthwash", "mustard", "dressing", "mug"])
def test_parts_stay_apart(name):
    def closest(parts):
        return KDTree(parts[0].mesh.vertices).query(parts[1].mesh.vertices)[0].min()

    for seed in range(5):
        assert closest(made(name, 2.0, seed)) > 0.5 * closest(entry(name).surfaces())


def test_plates_of_the_corner_reflector_stay_flat_and_joined():
    mesh, drawn = made("corner_reflector")[0].mesh, entry("corner_reflector").surfaces()[0].mesh
    assert len(mesh.faces) == len(drawn.faces) == 3
    assert len(np.unique(np.round(mesh.vertices, 9), axis=0)) == len(np.unique(np.round(drawn.vertices, 9), axis=0)) == 4
    angles = np.degrees(np.arccos(np.clip(mesh.face_normals @ mesh.face_normals.T, -1, 1)))[np.triu_indices(3, 1)]
    assert 0.01 < np.abs(angles - 90).max() < 1.5


def test_half_of_the_food_cans_have_beads():
    def depth(seed):
        mesh = made("can_211_400", seed=seed)[0].mesh
        x, y, z = mesh.vertices.T
        middle = (np.abs(mesh.vertex_normals[:, 2]) < 0.6) & (z > 0.04) & (z < 0.06)
        near = middle & (np.abs(np.arctan2(y, x)) < 0.03)
        return np.ptp(np.hypot(x, y)[near])

    deep = [depth(seed) > 0.4e-3 for seed in range(20)]
    assert 5 <= sum(deep) <= 15
