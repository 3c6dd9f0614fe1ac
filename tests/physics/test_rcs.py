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
    """The pattern in the horizontal plane is tested in the main lobe, in the first sidelobe and at large angles, where only the plate's
    edges return power.
    """
    side, theta = 0.1, np.radians(angle_deg)
    x = K * side * np.sin(theta)
    expected = 4 * np.pi * side**4 / WAVELENGTH**2 * np.sinc(x / np.pi) ** 2 * np.cos(theta) ** 2
    direction = [np.cos(theta), np.sin(theta), 0]
    assert db(rt.rcs(objects.plate(side, side), direction, rays_per_wavelength2=density)) == pytest.approx(db(expected), abs=0.1)


def test_trihedral_needs_three_bounces():
    two = rt.rcs(objects.trihedral(0.1), [1, 0, 0], max_bounces=2)
    three = rt.rcs(objects.trihedral(0.1), [1, 0, 0], max_bounces=3)
    assert db(three / two) > 15


def test_dihedral_matches_closed_form_and_turns_polarisation():
    """The radar cross-section of an upright dihedral in the transmitted polarisation is 8 pi a^2 b^2 / lambda^2, where a and b are its
    side lengths. A dihedral tilted by 45 degrees returns only cross-polarised power.
    """
    expected = db(8 * np.pi * 0.05**2 * 0.1**2 / WAVELENGTH**2)
    mesh = objects.dihedral(0.05, 0.1)
    assert db(rt.rcs(mesh, [1, 0, 0], rays_per_wavelength2=4)) == pytest.approx(expected, abs=0.25)
    tilted = mesh.copy().apply_transform(trimesh.transformations.rotation_matrix(np.pi / 4, [1, 0, 0]))
    assert db(rt.rcs(tilted, [1, 0, 0], rays_per_wavelength2=4, polarization="VH")) == pytest.approx(expected, abs=1.0)
    assert rt.rcs(tilted, [1, 0, 0], rays_per_wavelength2=4) < 0.02 * 10 ** (expected / 10)


def test_sphere_matches_mie():
    """The radar cross-section of a sphere of 33 mm radius agrees with the Mie series within 0.25 dB, for 1, 4 and 16 ray tubes per square
    wavelength. At this sphere size, physical optics itself is within 0.15 dB of the Mie series.
    """
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


def test_far_field_is_the_limit_of_distance():
    far = rt.rcs(objects.sphere(0.03), [1, 0, 0], rays_per_wavelength2=4)
    for distance in (2.0, 5.0, 10.0):
        assert db(rt.rcs(objects.sphere(0.03), [1, 0, 0], distance=distance, rays_per_wavelength2=4) / far) == pytest.approx(0, abs=0.3)


@pytest.mark.parametrize("distance", [10.0, 50.0])
def test_multiple_bounces_do_not_fade_with_distance(distance):
    """The float32 rounding of a distant source position must not put hits behind the facet that the ray hits."""
    for mesh in (objects.dihedral(0.05, 0.1), objects.trihedral(0.1)):
        far = rt.rcs(mesh, [1, 0, 0], rays_per_wavelength2=4)
        assert db(rt.rcs(mesh, [1, 0, 0], distance=distance, rays_per_wavelength2=4) / far) == pytest.approx(0, abs=0.15)


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
    metal = rt.rcs(objects.plate(0.1, 0.1), [1, 0, 0])
    for name, level in (("plasterboard", -12.168), ("glass", -7.313)):
        returned = rt.rcs(objects.plate(0.1, 0.1), [1, 0, 0], material=rt.Layered([], name))
        assert db(returned / metal) == pytest.approx(level + 0.008, abs=0.02)
    wall = rt.Layered([("pet", 0.001)], "water")
    f77 = db(rt.rcs(objects.plate(0.1, 0.1), [1, 0, 0], material=wall) / metal)
    assert f77 == pytest.approx(-3.61, abs=0.05)


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
