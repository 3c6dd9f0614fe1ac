"""Objects: canonical shapes, catalogue and assortment (classes, sizes, contents and meshes), and objects from mesh files."""

from collections import Counter

import numpy as np
import pytest

from radartwin.config.compose import compose
from radartwin.errors import ConfigError
from radartwin.materials import Layered
from radartwin.scene import objects
from radartwin.scene.layouts.stock import from_mesh
from radartwin.scene.mesh_checks import welded
from radartwin.scene.mesh_file import MeshWarning, read_meshes
from radartwin.scene.objects import vessels
from radartwin.scene.objects.assortment import assortment, every_object
from radartwin.simulation import geometry

NAMES = list(objects.catalogue())
KNOWN = every_object()
FLAT = [name for name, entry in KNOWN.items() if entry.shape == "faceted"]


def test_classes_have_the_counts_of_the_study():
    twelve = objects.catalogue()
    eleven = {name: entry for name, entry in twelve.items() if entry.rover}
    assert (len(twelve), sum(entry.symmetric for entry in twelve.values())) == (12, 7)
    assert (len(eleven), sum(entry.symmetric for entry in eleven.values())) == (11, 6)
    assert [entry.material_class for entry in twelve.values()].count("metal") == 7
    cans = [entry for entry in twelve.values() if "can" in entry.name]
    assert set(twelve) - set(eleven) < {entry.name for entry in cans}
    assert len({round(entry.size_m[2], 4) for entry in cans}) == 6  # all six cans have different heights
    assert np.ptp([entry.size_m[0] for entry in cans]) < 0.003  # and diameters that differ by less than 3 mm
    bottles = {entry.name for entry in twelve.values() if entry.shape == "asymmetric"}
    assert bottles == {entry.name for entry in twelve.values() if entry.contents} == {"olive_oil", "mouthwash", "mustard", "dressing"}
    for name in bottles:  # none is a body of revolution
        mesh = objects.make(name)[0].mesh
        radius = np.linalg.norm(mesh.vertices[np.abs(mesh.vertices[:, 2] - 0.08) < 0.006, :2], axis=1)
        assert radius.max() / radius.min() > 1.2
    entries = [entry for kind in assortment().values() for entry in kind]
    assert len({entry.description for entry in entries}) == len(entries) >= 48
    assert min(Counter(entry.material_class for entry in entries).values()) >= 6
    assert min(len(kind) for kind in assortment().values()) >= 2  # each object has another object of its kind
    assert not {entry.name for entry in entries} & set(NAMES)


@pytest.mark.parametrize("name", KNOWN)
def test_objects_have_their_stated_size_and_stand_on_their_axis(name):
    entry = KNOWN[name]
    surfaces = entry.surfaces()
    low = np.min([s.mesh.bounds[0] for s in surfaces], axis=0)
    high = np.max([s.mesh.bounds[1] for s in surfaces], axis=0)
    assert np.abs((high - low) - entry.size_m).max() < 2e-4
    assert low[2] == pytest.approx(0, abs=1e-9)
    assert low[1] == pytest.approx(-high[1], abs=1e-6)
    assert 0 < entry.aim_m < high[2]
    assert {s.kind for s in surfaces} == {"object"}
    assert {s.name for s in surfaces} == {name}
    assert all(s.provenance["minc"] == entry.material_class for s in surfaces)
    assert entry.description
    assert entry.source


@pytest.mark.parametrize("name", [name for name in KNOWN if name not in FLAT])
def test_objects_are_closed_outward_and_smooth(name):
    for surface in KNOWN[name].surfaces():
        solid = welded(surface.mesh)
        assert solid.is_watertight
        assert solid.is_winding_consistent
        assert solid.volume > 0
        built = geometry.build([surface.mesh])
        # The tracer computes the same vertex normals: smooth except at edges of 30 degrees or more.
        normals = np.asarray(surface.mesh.vertex_normals)[surface.mesh.faces]
        assert len(built.normals) == len(normals)
        angles = np.degrees(np.arccos(np.clip((normals * built.normals).sum(axis=2), -1, 1)))
        assert np.percentile(angles, 99) < 6
        flat = np.degrees(np.arccos(np.clip((normals * np.asarray(surface.mesh.face_normals)[:, None]).sum(axis=2), -1, 1)))
        assert flat.max() < 35


@pytest.mark.parametrize("name", [n for n in NAMES if objects.entry(n).volume_ml])
def test_inside_volume_matches_the_label(name):
    """The inside of a food can up to its brim has the printed volume within 4 %; that of other vessels is 0 to 12 % larger."""
    entry = objects.entry(name)
    body = entry.surfaces()[0].mesh
    inside = (welded(body).volume - entry.wall_m * body.area) * 1e6
    low, high = (0.98, 1.04) if name.startswith("can_") else (1.0, 1.12)
    assert low < inside / entry.volume_ml < high


def test_contents_are_the_backing_of_the_wall_and_unknown_contents_leave_the_outermost_material():
    known, unknown = (objects.entry("mustard").surfaces(contents=contents) for contents in ("filled", "unknown"))
    assert known[0].material == Layered([("hdpe", 0.0008)], backing="mustard")
    assert unknown[0].material == Layered([], backing="hdpe")
    assert unknown[0].mesh.vertices.tobytes() == known[0].mesh.vertices.tobytes()
    with pytest.raises(ConfigError, match="contents=full is not known; options: filled, unknown"):
        compose(["contents=full"])
    assert objects.make("mug")[0].material == Layered([("glass", 0.004)], backing="air")
    assert objects.make("can_211_400")[0].material == "metal"


def test_mustard_matches_its_scanned_model_in_width(shared_data):
    with pytest.warns(MeshWarning):
        (scanned,) = from_mesh(shared_data / "objects" / "ycb" / "MustardBottle.obj", "hdpe")
    body = objects.make("mustard")[0].mesh
    for z in (0.03, 0.06, 0.09, 0.12):
        widths = []
        for mesh in (scanned.mesh, body):
            cut = mesh.section(plane_origin=[0, 0, z], plane_normal=[0, 0, 1])
            assert cut is not None
            points = cut.vertices[:, :2]
            axes = np.linalg.svd(points - points.mean(axis=0), full_matrices=False)[2]
            widths.append(np.ptp(points @ axes.T, axis=0))
        assert np.abs(widths[0] - widths[1]).max() < 0.001


@pytest.mark.parametrize("kind", ["stl", "stl_ascii"])
def test_a_sphere_is_the_same_smooth_solid_from_stl_which_repeats_the_corners_of_every_triangle(kind, tmp_path):
    sphere = objects.sphere(0.05)
    sphere.export(tmp_path / "ball.stl", file_type=kind)
    (mesh,) = read_meshes(tmp_path / "ball.stl").values()
    assert (len(mesh.faces), mesh.is_watertight) == (len(sphere.faces), True)
    assert mesh.volume == pytest.approx(sphere.volume, rel=1e-4)  # the file stores single precision or few digits
    (surface,) = from_mesh(tmp_path / "ball.stl", "metal")
    assert surface.is_curved()
    np.testing.assert_allclose(surface.mesh.bounds, [[-0.05, -0.05, 0], [0.05, 0.05, 0.1]], atol=1e-4)


def test_an_oval_of_equal_axes_is_a_cylinder():
    mesh = vessels.oval([(0, 0.03, 0.03, 2), (0.1, 0.03, 0.03, 2)])
    assert mesh.volume == pytest.approx(np.pi * 0.03**2 * 0.1, rel=2e-3)
    square = vessels.oval([(0, 0.03, 0.02, 40), (0.1, 0.03, 0.02, 40)])
    assert square.volume == pytest.approx(0.06 * 0.04 * 0.1, rel=1e-2)


SOLIDS = {
    # name: (mesh, exact volume, exact area)
    "sphere": (objects.sphere(0.05, 5), 4 / 3 * np.pi * 0.05**3, 4 * np.pi * 0.05**2),
    "can": (objects.cylinder(0.033, 0.12, 256), np.pi * 0.033**2 * 0.12, 2 * np.pi * 0.033 * (0.12 + 0.033)),
    "box": (objects.box([0, 0, 0], [0.1, 0.2, 0.3]), 0.006, 2 * (0.02 + 0.03 + 0.06)),
}


@pytest.mark.parametrize("name", SOLIDS)
def test_solids_are_closed_outward_and_of_the_right_size(name):
    mesh, volume, area = SOLIDS[name]
    solid = welded(mesh)
    assert solid.is_watertight
    assert solid.volume == pytest.approx(volume, rel=2e-3)  # inscribed facets lose up to 0.1 %
    assert solid.area == pytest.approx(area, rel=2e-3)
    assert np.abs(solid.bounds.mean(axis=0) - (0 if name != "box" else [0.05, 0.1, 0.15])).max() < 1e-12


def test_normals_are_smooth_around_spheres_and_cylinders_and_sharp_at_rims():
    ball = SOLIDS["sphere"][0]
    assert np.abs(ball.vertex_normals - ball.vertices / 0.05).max() < 1e-9
    mesh = objects.cylinder(0.033, 0.12, 32)
    side = np.abs(mesh.vertex_normals[:, 2]) < 0.5
    radial = np.column_stack([mesh.vertices[side, :2] / 0.033, np.zeros(side.sum())])
    assert np.abs(mesh.vertex_normals[side] - radial).max() < 1e-9
    assert np.allclose(np.abs(mesh.vertex_normals[~side, 2]), 1)
    assert (side[mesh.faces].sum(axis=1) % 3 == 0).all(), "a face is all side or all cap"
    for radius, corners in ((0.031, 3 * 32), (0.06, 4 * 32)):  # a gentle and a sharp profile
        assert len(objects.revolution([(0.03, 0.0), (radius, 0.05), (0.03, 0.1)], 32).vertices) == corners


def test_reflectors_are_concave_and_open_to_plus_x():
    leg = 0.1
    mesh = objects.trihedral(leg)
    assert np.allclose(mesh.area_faces, leg**2 / 2)
    assert np.allclose(mesh.face_normals @ mesh.face_normals.T, np.eye(3))
    assert np.allclose(mesh.face_normals[:, 0], 1 / np.sqrt(3))  # equally inclined to the boresight, facing it
    assert np.allclose(mesh.bounds[:, 0], [0, leg / np.sqrt(3)])
    assert np.isclose(mesh.vertices[:, 2].max(), leg * np.sqrt(2 / 3))  # one leg upright
    plate, dihedral = objects.plate(0.1, 0.2), objects.dihedral(0.1, 0.2)
    assert np.allclose(plate.face_normals, [1, 0, 0])
    assert np.allclose(plate.extents, [0, 0.1, 0.2])
    assert dihedral.area == pytest.approx(2 * 0.1 * 0.2)
    assert np.allclose(dihedral.face_normals[:, 0], np.sqrt(0.5))
    assert dihedral.face_normals[0] @ dihedral.face_normals[-1] == pytest.approx(0, abs=1e-12)
    left, right = dihedral.triangles_center[:2].mean(axis=0), dihedral.triangles_center[2:].mean(axis=0)
    assert (right - left) @ dihedral.face_normals[0] > 0 > (right - left) @ dihedral.face_normals[-1]
