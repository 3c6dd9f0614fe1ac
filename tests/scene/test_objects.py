"""The shapes of the package (sphere, can, plate, reflectors) have the correct size, orientation and normals."""

import numpy as np
import pytest

from radartwin.errors import MeshError
from radartwin.scene import checks, objects

SOLIDS = {
    # name: (mesh, exact volume, exact area)
    "sphere": (objects.sphere(0.05, 5), 4 / 3 * np.pi * 0.05**3, 4 * np.pi * 0.05**2),
    "can": (objects.cylinder(0.033, 0.12, 256), np.pi * 0.033**2 * 0.12, 2 * np.pi * 0.033 * (0.12 + 0.033)),
    "box": (objects.box([0, 0, 0], [0.1, 0.2, 0.3]), 0.006, 2 * (0.02 + 0.03 + 0.06)),
}


@pytest.mark.parametrize("name", SOLIDS)
def test_solids_are_closed_outward_and_of_the_right_size(name):
    mesh, volume, area = SOLIDS[name]
    welded = checks.welded(mesh)
    assert welded.is_watertight
    assert welded.volume == pytest.approx(volume, rel=2e-3)  # inscribed facets lose up to 0.1 %
    assert welded.area == pytest.approx(area, rel=2e-3)
    assert np.abs(welded.bounds.mean(axis=0) - (0 if name != "box" else [0.05, 0.1, 0.15])).max() < 1e-12


def test_sphere_normals_are_radial():
    mesh = SOLIDS["sphere"][0]
    radial = mesh.vertices / 0.05
    assert np.abs(mesh.vertex_normals - radial).max() < 1e-9


def test_cylinder_is_smooth_around_and_sharp_at_the_rim():
    mesh = objects.cylinder(0.033, 0.12, 32)
    side = np.abs(mesh.vertex_normals[:, 2]) < 0.5
    radial = np.column_stack([mesh.vertices[side, :2] / 0.033, np.zeros(side.sum())])
    assert np.abs(mesh.vertex_normals[side] - radial).max() < 1e-9
    assert np.allclose(np.abs(mesh.vertex_normals[~side, 2]), 1)
    # A face is all side or all cap: no vertex is shared across the rim.
    assert (side[mesh.faces].sum(axis=1) % 3 == 0).all()


def test_revolution_shares_normals_only_where_the_profile_is_smooth():
    gentle = objects.revolution([(0.03, 0.0), (0.031, 0.05), (0.03, 0.1)], 32)
    assert len(gentle.vertices) == 3 * 32
    sharp = objects.revolution([(0.03, 0.0), (0.06, 0.05), (0.03, 0.1)], 32)
    assert len(sharp.vertices) == 4 * 32


def test_trihedral_is_three_right_triangles_opening_to_plus_x():
    leg = 0.1
    mesh = objects.trihedral(leg)
    assert np.allclose(mesh.area_faces, leg**2 / 2)
    assert np.allclose(mesh.face_normals @ mesh.face_normals.T, np.eye(3))
    assert np.allclose(mesh.face_normals[:, 0], 1 / np.sqrt(3))  # equally inclined to the boresight, facing it
    depth = leg / np.sqrt(3)
    assert np.allclose(mesh.bounds[:, 0], [0, depth])
    assert np.isclose(mesh.vertices[:, 2].max(), leg * np.sqrt(2 / 3))  # one leg upright


def test_plate_and_dihedral_face_plus_x():
    plate = objects.plate(0.1, 0.2)
    assert np.allclose(plate.face_normals, [1, 0, 0])
    assert np.allclose(plate.extents, [0, 0.1, 0.2])
    dihedral = objects.dihedral(0.1, 0.2)
    assert dihedral.area == pytest.approx(2 * 0.1 * 0.2)
    assert np.allclose(dihedral.face_normals[:, 0], np.sqrt(0.5))
    assert dihedral.face_normals[0] @ dihedral.face_normals[-1] == pytest.approx(0, abs=1e-12)
    # Concave: each face's normal points towards the other face.
    left, right = dihedral.triangles_center[:2].mean(axis=0), dihedral.triangles_center[2:].mean(axis=0)
    assert (right - left) @ dihedral.face_normals[0] > 0 > (right - left) @ dihedral.face_normals[-1]


@pytest.mark.parametrize(
    "build",
    [
        lambda: objects.trihedral(0),
        lambda: objects.plate(0.1, -0.1),
        lambda: objects.sphere(np.nan),
        lambda: objects.revolution([(0.1, 0.0)]),
        lambda: objects.revolution([(-0.1, 0.0), (0.1, 0.1)]),
        lambda: objects.box([0, 0, 0], [1, 0, 1]),
    ],
)
def test_invalid_sizes_are_refused(build):
    with pytest.raises(MeshError):
        build()
