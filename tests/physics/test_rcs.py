"""Compare radar cross-sections with closed forms, and check changes that must not affect them. test_validation.py covers more targets."""

import numpy as np
import pytest
import trimesh
from physics_helpers import WAVELENGTH, K, db, mie_backscatter

import radartwin as rt
from radartwin.scene import objects


@pytest.mark.parametrize("density", [1.0, 16.0])
@pytest.mark.parametrize("angle_deg", [0.0, 1.6, 10.0, 40.0])
def test_plate_pattern_matches_its_sinc(angle_deg, density):
    """In the main lobe, in the first sidelobe and at large angles, where only the plate's edges return power."""
    side, theta = 0.1, np.radians(angle_deg)
    x = K * side * np.sin(theta)
    expected = 4 * np.pi * side**4 / WAVELENGTH**2 * np.sinc(x / np.pi) ** 2 * np.cos(theta) ** 2
    direction = [np.cos(theta), np.sin(theta), 0]
    assert db(rt.rcs(objects.plate(side, side), direction, rays_per_wavelength2=density)) == pytest.approx(db(expected), abs=0.1)


@pytest.mark.parametrize(("angle_deg", "co", "cross"), [(0.0, 1.0, 0.0), (22.5, 0.5, 0.5), (45.0, 0.0, 1.0)])
def test_dihedral_turns_polarisation_by_twice_its_own_angle(angle_deg, co, cross):
    mesh = objects.dihedral(0.1, 0.1).apply_transform(trimesh.transformations.rotation_matrix(np.radians(angle_deg), [1, 0, 0]))
    whole = 8 * np.pi * 0.1**4 / WAVELENGTH**2
    levels = {p: rt.rcs(mesh, [1, 0, 0], polarization=p, rays_per_wavelength2=4) / whole for p in ("VV", "VH", "HV", "HH")}
    assert levels["VV"] == pytest.approx(co, abs=0.02)
    assert levels["HH"] == pytest.approx(co, abs=0.02)
    assert levels["VH"] == pytest.approx(cross, abs=0.02)
    assert levels["HV"] == pytest.approx(levels["VH"], rel=1e-3, abs=1e-6)


def test_sphere_matches_mie():
    """At a radius of 33 mm, physical optics itself is within 0.15 dB of the Mie series."""
    radius = 0.033
    mesh = objects.sphere(radius, 4)
    for density in (1.0, 4.0, 16.0):
        measured = db(rt.rcs(mesh, [1, 0.2, 0.1], rays_per_wavelength2=density))
        assert measured == pytest.approx(db(mie_backscatter(radius)), abs=0.25)


def test_no_ray_passes_between_two_facets():
    """A row of rays hits a can exactly along an edge between two of its facets."""
    can = objects.cylinder(0.02, 0.08, 256)
    turn = np.asarray(trimesh.transformations.rotation_matrix(np.pi / 4, [1, 0, 0]))[:3, :3]
    tilted = trimesh.Trimesh(can.vertices @ turn.T, can.faces, vertex_normals=can.vertex_normals @ turn.T, process=False)
    error = db(rt.rcs(tilted, [1, 0, 0], rays_per_wavelength2=4) / (K * 0.02 * 0.08**2))
    assert error == pytest.approx(0, abs=0.15)


def test_level_does_not_depend_on_the_mesh_origin():
    sphere = objects.sphere(0.05)
    centred = rt.rcs(sphere, [1, 0, 0], distance=10.0)
    shifted = rt.rcs(sphere.copy().apply_translation([-9, 0, 0]), [1, 0, 0], distance=1.0) * 10.0**4
    assert db(shifted / centred) == pytest.approx(0, abs=0.05)


def test_doubled_or_flipped_faces_do_not_change_the_level():
    sphere = objects.sphere(0.05)
    faces = np.asarray(sphere.faces)
    doubled = trimesh.Trimesh(sphere.vertices, np.vstack([faces, faces]), process=False)
    flipped = np.where(np.arange(len(faces))[:, None] % 2, faces, faces[:, ::-1])
    expected = rt.rcs(sphere, [1, 0, 0])
    for mesh in (doubled, trimesh.Trimesh(sphere.vertices, flipped, process=False)):
        assert db(rt.rcs(mesh, [1, 0, 0]) / expected) == pytest.approx(0, abs=0.05)


def test_dielectric_plate_has_the_level_of_its_reflection_coefficient():
    plate = objects.plate(0.1, 0.1)
    for material, level, limit in ((rt.Layered([], "glass"), -7.305, 0.02), (rt.Layered([("pet", 0.001)], "water"), -3.61, 0.05)):
        assert db(rt.rcs(plate, [1, 0, 0], material=material) / rt.rcs(plate, [1, 0, 0])) == pytest.approx(level, abs=limit)


@pytest.mark.parametrize(
    "arguments",
    [
        {"direction": [0, 0, 0]}, {"direction": "x"}, {"direction": [1, 0]}, {"direction": [1, 0, np.nan]},
        {"rays_per_wavelength2": 0}, {"rays_per_wavelength2": "4"}, {"rays_per_wavelength2": True}, {"rays_per_wavelength2": np.nan},
        {"rays_per_wavelength2": 1e9}, {"frequency": None}, {"distance": -1.0}, {"distance": np.inf}, {"distance": 0.01},
        {"max_bounces": 0}, {"max_bounces": 2.0}, {"max_bounces": True}, {"seed": -1}, {"seed": 0.5},
        {"polarization": "LR"}, {"polarization": ["V", "V"]}, {"material": "unobtainium"},
    ],
    ids=repr,
)  # fmt: skip
def test_wrong_arguments_are_named(arguments):
    given = {"direction": [1, 0, 0], **arguments}
    with pytest.raises(ValueError, match=next(iter(arguments))):
        rt.rcs(objects.sphere(0.05), given.pop("direction"), **given)


@pytest.mark.parametrize("distance", [10.0, 50.0])
def test_multiple_bounces_do_not_fade_with_distance(distance):
    """The float32 rounding of a distant source position must not put hits behind the facet that the ray hits."""
    for mesh in (objects.dihedral(0.05, 0.1), objects.trihedral(0.1)):
        far = rt.rcs(mesh, [1, 0, 0], rays_per_wavelength2=4)
        assert db(rt.rcs(mesh, [1, 0, 0], distance=distance, rays_per_wavelength2=4) / far) == pytest.approx(0, abs=0.15)
