"""Absolute radar cross-sections against closed forms, the Mie series and near-field quadrature."""

import numpy as np
import pytest
import trimesh
from physics_helpers import WAVELENGTH, K, db, mie_backscatter
from scipy.special import fresnel

import radartwin as rt
from radartwin.scene import objects


def near_field_plate(side, distance):
    """Effective cross-section of a square plate on axis: the quadratic-phase integral of the currents is a product of Fresnel integrals,
    with the spherical spreading taken at the centre (0.1 % here)."""
    s, c = fresnel(side / np.sqrt(WAVELENGTH * distance))
    one_side = np.sqrt(WAVELENGTH * distance) * (c - 1j * s)
    return 4 * np.pi * abs(one_side**2) ** 2 / WAVELENGTH**2


def quadrature_plate(side, distance, points=600):
    """The same by summing the exact distances over the plate."""
    x = (np.arange(points) + 0.5) / points * side - side / 2
    r = np.sqrt(distance**2 + x[:, None] ** 2 + x[None] ** 2)
    total = (np.exp(-2j * K * r) / r**2 * distance / r).sum() * (side / points) ** 2
    return 4 * np.pi * abs(total) ** 2 * distance**4 / WAVELENGTH**2


@pytest.mark.parametrize("side", [0.05, 0.1, 0.2])
def test_plate_matches_closed_form(side):
    assert db(rt.rcs(objects.plate(side, side), [1, 0, 0])) == pytest.approx(db(4 * np.pi * side**4 / WAVELENGTH**2), abs=0.1)


@pytest.mark.parametrize("density", [1.0, 4.0, 16.0])
@pytest.mark.parametrize("angle_deg", [1.0, 1.6, 5.0, 10.0, 20.0, 40.0])
def test_plate_pattern_matches_its_sinc(angle_deg, density):
    """Main lobe, first sidelobe and far angles, where only the plate's edges return power, in the horizontal plane."""
    side, theta = 0.1, np.radians(angle_deg)
    x = K * side * np.sin(theta)
    expected = 4 * np.pi * side**4 / WAVELENGTH**2 * (np.sin(x) / x) ** 2 * np.cos(theta) ** 2
    direction = [np.cos(theta), np.sin(theta), 0]
    assert db(rt.rcs(objects.plate(side, side), direction, rays_per_wavelength2=density)) == pytest.approx(db(expected), abs=0.1)


@pytest.mark.parametrize("leg", [0.05, 0.1, 0.15])
@pytest.mark.parametrize("polarization", ["VV", "HH"])
def test_trihedral_peak_matches_closed_form(leg, polarization):
    expected = db(4 * np.pi * leg**4 / (3 * WAVELENGTH**2))
    assert db(rt.rcs(objects.trihedral(leg), [1, 0, 0], polarization=polarization)) == pytest.approx(expected, abs=0.25)
    assert db(rt.rcs(objects.trihedral(leg), [1, 0, 0], polarization=polarization, rays_per_wavelength2=16)) == pytest.approx(
        expected, abs=0.25
    )


def test_trihedral_needs_three_bounces():
    two = rt.rcs(objects.trihedral(0.1), [1, 0, 0], max_bounces=2)
    three = rt.rcs(objects.trihedral(0.1), [1, 0, 0], max_bounces=3)
    assert db(three / two) > 15


def test_dihedral_matches_closed_form_and_turns_polarisation():
    """Vertical fold: 8 pi a^2 b^2 / lambda^2 co-polarised; a fold at 45 degrees returns only cross-polarised power."""
    expected = db(8 * np.pi * 0.05**2 * 0.1**2 / WAVELENGTH**2)
    mesh = objects.dihedral(0.05, 0.1)
    assert db(rt.rcs(mesh, [1, 0, 0], rays_per_wavelength2=4)) == pytest.approx(expected, abs=0.25)
    tilted = mesh.copy().apply_transform(trimesh.transformations.rotation_matrix(np.pi / 4, [1, 0, 0]))
    assert db(rt.rcs(tilted, [1, 0, 0], rays_per_wavelength2=4, polarization="VH")) == pytest.approx(expected, abs=1.0)
    assert rt.rcs(tilted, [1, 0, 0], rays_per_wavelength2=4) < 0.02 * 10 ** (expected / 10)


@pytest.mark.parametrize("radius", [0.02, 0.033, 0.05])
def test_sphere_matches_mie(radius):
    """From one tube per square wavelength; physical optics itself is within 0.15 dB of Mie at these sizes."""
    mesh = objects.sphere(radius, 4)
    for density in (1.0, 4.0, 16.0):
        measured = db(rt.rcs(mesh, [1, 0.2, 0.1], rays_per_wavelength2=density))
        assert measured == pytest.approx(db(mie_backscatter(radius)), abs=0.25)


def test_coarse_can_matches_a_cylinder():
    """A 16-sided can with smooth normals is within 0.5 dB rms over aspects; flat facets would be off by 6 dB."""
    mesh = objects.cylinder(0.033, 0.12, 16)
    expected = db(K * 0.033 * 0.12**2)
    error = [db(rt.rcs(mesh, [np.cos(a), np.sin(a), 0], rays_per_wavelength2=4)) - expected for a in np.linspace(0, np.pi / 8, 7)]
    assert np.sqrt(np.mean(np.square(error))) < 0.5


def test_no_ray_passes_between_two_facets():
    """A row of rays runs exactly along an edge between facets of a can."""
    can = objects.cylinder(0.02, 0.08, 256)
    turn = np.asarray(trimesh.transformations.rotation_matrix(np.pi / 4, [1, 0, 0]))[:3, :3]
    tilted = trimesh.Trimesh(can.vertices @ turn.T, can.faces, vertex_normals=can.vertex_normals @ turn.T, process=False)
    error = db(rt.rcs(tilted, [1, 0, 0], rays_per_wavelength2=4) / (K * 0.02 * 0.08**2))
    assert error == pytest.approx(0, abs=0.15)


def test_coarse_sphere_matches_mie():
    """1280 facets over twelve aspects: 0.35 dB rms."""
    error = [
        db(rt.rcs(objects.sphere(radius, 3), view, rays_per_wavelength2=4) / mie_backscatter(radius))
        for radius in (0.033, 0.05)
        for view in np.random.default_rng(0).normal(size=(6, 3))
    ]
    assert np.sqrt(np.mean(np.square(error))) < 0.35


def test_trihedral_pattern_matches_its_aperture(shared_data):
    """To +-30 degrees in azimuth against geometric optics: 0.15 dB rms."""
    import csv

    rows = csv.DictReader((shared_data.parent / "reference" / "trihedral_10cm_pattern.csv").read_text().splitlines())
    error = []
    for row in rows:
        azimuth = np.radians(float(row["az_deg"]))
        if abs(azimuth) < np.radians(30.1) and round(float(row["az_deg"]) * 2) % 4 == 0:
            view = [np.cos(azimuth), np.sin(azimuth), 0]
            error.append(db(rt.rcs(objects.trihedral(0.1), view)) - float(row["GO_Aeff_dBsm"]))
    assert len(error) > 20
    assert np.sqrt(np.mean(np.square(error))) < 0.15


@pytest.mark.parametrize("distance", [0.5, 1.0, 2.0])
def test_near_field_plate_matches_quadrature(distance):
    expected = quadrature_plate(0.1, distance)
    assert db(expected) == pytest.approx(db(near_field_plate(0.1, distance)), abs=0.15)  # the oracle agrees with its own closed form
    assert db(rt.rcs(objects.plate(0.1, 0.1), [1, 0, 0], distance=distance)) == pytest.approx(db(expected), abs=0.2)


def test_near_field_levels_match_the_reference(shared_data):
    """10 cm plate and trihedral at 0.5, 1 and 2 m, relative to the far field, within 0.2 dB at four tubes per square wavelength."""
    import csv

    rows = {
        float(r["R_m"]): r
        for r in csv.DictReader((shared_data.parent / "reference" / "near_over_far_field_dB.csv").read_text().splitlines())
    }
    for mesh, column in ((objects.plate(0.1, 0.1), "plate10cm"), (objects.trihedral(0.1), "tri10")):
        far = 4 * np.pi * 0.1**4 / WAVELENGTH**2 / (1 if column == "plate10cm" else 3)
        for distance in (0.5, 1.0, 2.0):
            relative = db(rt.rcs(mesh, [1, 0, 0], distance=distance, rays_per_wavelength2=4) / far)
            assert relative == pytest.approx(float(rows[distance][column]), abs=0.2), (column, distance)


@pytest.mark.parametrize(
    ("mesh", "distance"),
    [(objects.plate(0.1, 0.1), None), (objects.trihedral(0.1), None), (objects.sphere(0.05), None), (objects.plate(0.1, 0.1), 1.0)],
    ids=["plate", "trihedral", "sphere", "near plate"],
)
def test_power_does_not_depend_on_ray_count(mesh, distance):
    levels = [db(rt.rcs(mesh, [1, 0, 0], distance=distance, rays_per_wavelength2=n)) for n in (1, 2, 4, 8, 16)]
    assert max(levels) - min(levels) < 0.25


def test_seed_hardly_changes_the_result():
    levels = [db(rt.rcs(objects.trihedral(0.1), [1, 0, 0], rays_per_wavelength2=16, seed=seed)) for seed in range(6)]
    assert len(set(levels)) == 6
    assert max(levels) - min(levels) < 0.1


def test_far_field_is_the_limit_of_distance():
    far = rt.rcs(objects.sphere(0.03), [1, 0, 0], rays_per_wavelength2=4)
    for distance in (2.0, 5.0, 10.0):
        assert db(rt.rcs(objects.sphere(0.03), [1, 0, 0], distance=distance, rays_per_wavelength2=4) / far) == pytest.approx(0, abs=0.3)


@pytest.mark.parametrize("distance", [10.0, 50.0])
def test_multiple_bounces_do_not_fade_with_distance(distance):
    """Float32 rounding of a far source must not put hits below their own facets."""
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
        assert db(rt.rcs(objects.plate(0.1, 0.1), [1, 0, 0], material=name) / metal) == pytest.approx(level + 0.008, abs=0.02)
    wall = rt.Layered([("pet", 0.001)], "water")
    f77 = db(rt.rcs(objects.plate(0.1, 0.1), [1, 0, 0], material=wall) / metal)
    assert f77 == pytest.approx(-3.61, abs=0.05)


def test_scan_meshes_of_real_objects_converge(shared_data):
    mesh = trimesh.load_mesh(shared_data / "objects" / "ycb" / "TomatoSoupCan.obj")
    mesh.apply_translation(-mesh.bounds.mean(axis=0))
    levels = [db(rt.rcs(mesh, [1, 0, 0], rays_per_wavelength2=n)) for n in (4, 16, 64)]
    assert abs(levels[2] - levels[1]) < 1.0


@pytest.mark.parametrize(
    ("arguments", "match"),
    [
        ({"direction": [0, 0, 0]}, "direction"),
        ({"rays_per_wavelength2": 0}, "rays_per_wavelength2"),
        ({"distance": -1.0}, "distance"),
        ({"polarization": "LR"}, "polarization"),
        ({"material": "unobtainium"}, "unobtainium"),
        ({"max_bounces": 0}, "max_bounces"),
        ({"rays_per_wavelength2": 1e9}, "tubes"),
    ],
)
def test_wrong_arguments_are_refused(arguments, match):
    direction = arguments.pop("direction", [1, 0, 0])
    with pytest.raises(ValueError, match=match):
        rt.rcs(objects.plate(0.1, 0.1), direction, **arguments)


def test_radar_inside_the_target_is_refused():
    with pytest.raises(ValueError, match="inside"):
        rt.rcs(objects.sphere(0.1), [1, 0, 0], distance=0.05)
