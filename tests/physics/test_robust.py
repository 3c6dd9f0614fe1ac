"""Degenerate meshes and extreme poses: every result of the tracer is finite, and levels stay those of the clean mesh."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import trimesh
from physics_helpers import UP, WAVELENGTH, K, coherent, db

import radartwin as rt
from radartwin.scene import objects
from radartwin.simulation import geometry, reflection_table, variant
from radartwin.simulation.curved import tube_grid, tubes
from radartwin.simulation.hits import Antennas, Hits, TraceOptions

FIELDS = ("amplitude", "length_in_m", "length_out_m", "departure", "arrival", "first_m")


def traced(mesh, position, *, rays=None, bounces=4, hats=False, prune=0.0):
    """Return the ray hits of a mesh from a phase centre: over the bounding box of the mesh, or over the full sphere with `rays` tubes."""
    variant.activate()
    built = geometry.build([mesh])
    table = reflection_table.build([("metal", 0.0)], 77e9)
    source = np.asarray(position, float)[None]
    antenna = Antennas(source, UP)
    one = None if rays else tube_grid.towards(built.hull_points(), source, built.centre, WAVELENGTH, (0.3, 0.6))
    grids = [one] if one is not None else tube_grid.all_around(source, np.eye(3)[None], rays or 60_000)
    options = TraceOptions(bounces, hats=hats, prune=prune)
    hits = Hits.concatenate([tubes.trace(built, table, grid, antenna, antenna, options) for grid in grids])
    for name in FIELDS:
        assert np.isfinite(getattr(hits, name)).all(), name
    return hits


@pytest.mark.parametrize("seed", range(4))
def test_random_triangle_soup_is_finite(seed):
    rng = np.random.default_rng(seed)
    count = int(rng.integers(1, 60))
    corners = rng.normal(0, 0.05, (count, 1, 3)) + rng.normal(0, 10 ** rng.uniform(-4, -1), (count, 3, 3))
    corners[::5, 1] = corners[::5, 0]  # triangles without area
    corners[1::5] = corners[0] + [0, 0, 1e-9]  # two corners that are nearly equal
    soup = trimesh.Trimesh(corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3), process=False)
    for distance in (None, 0.7):
        value = rt.rcs(soup, rng.normal(size=3), distance=distance, polarization="VH", max_bounces=6)
        assert np.isfinite(value)
        assert 0 <= value < 10
    traced(soup, [0.7, 0.1, 0.0])
    traced(soup, [0.0, 0.0, 0.0], rays=20_000)


def test_faces_without_area_return_nothing():
    line = trimesh.Trimesh([[0, 0, 0], [0, 0.1, 0], [0, 0.05, 0]], [[0, 1, 2]], process=False)
    assert rt.rcs(line, [1, 0, 0]) == 0


def test_slivers_return_the_power_of_their_area():
    """A plate that is cut into 400 strips, each a sixteenth of a wavelength wide, returns the same power as the whole plate."""
    strips = [objects.plate(0.1 / 400, 0.1).apply_translation([0, (i + 0.5) * 0.1 / 400 - 0.05, 0]) for i in range(400)]
    whole = rt.rcs(objects.plate(0.1, 0.1), [1, 0.02, 0])
    assert db(rt.rcs(objects.joined(strips), [1, 0.02, 0]) / whole) == pytest.approx(0, abs=0.05)


@pytest.mark.parametrize("angle_deg", [85.0, 89.0, 89.99, 90.0])
def test_grazing_incidence_is_finite_and_small(angle_deg):
    angle = np.radians(angle_deg)
    for mesh in (objects.plate(0.1, 0.1), objects.cylinder(0.03, 0.1)):
        value = rt.rcs(mesh, [np.cos(angle), 0, np.sin(angle)], distance=1.0)
        assert np.isfinite(value)
    edge_on = rt.rcs(objects.plate(0.1, 0.1), [np.cos(angle), np.sin(angle), 0])
    assert edge_on < 1e-3 * rt.rcs(objects.plate(0.1, 0.1), [1, 0, 0])


def test_wall_one_centimetre_away_is_an_image():
    hits = traced(objects.plate(2.0, 2.0), [0.01, 0, 0], rays=400_000, hats=True)
    image = -WAVELENGTH / (4 * np.pi * 0.02) * np.exp(1j * K * 0.02)
    value = coherent(hits)
    assert np.isfinite(value)
    assert 20 * np.log10(abs(value / image)) == pytest.approx(0, abs=0.6)


def test_sensor_in_a_closed_room():
    room = trimesh.creation.box((3.0, 2.0, 2.5))
    room.invert()
    hits = traced(room, [0.3, -0.2, 0.1], rays=100_000, bounces=8, hats=True)
    assert set(hits.bounce) == set(range(1, 9))
    for bounce in range(1, 9):
        assert abs(coherent(hits.where(hits.bounce == bounce))) < 1


def test_mesh_far_from_the_origin_keeps_its_level():
    """At 100 m along one axis, float32 mesh corners have steps of 8 micrometres."""
    near, far = objects.trihedral(0.1), objects.trihedral(0.1).apply_translation([0, 100.0, 0])
    levels = [db(abs(coherent(traced(m, [1.5, y, 0]))) ** 2) for m, y in ((near, 0.0), (far, 100.0))]
    assert levels[1] == pytest.approx(levels[0], abs=0.3)


def test_extreme_poses_give_finite_results():
    """The results are finite for a sensor on a surface, inside a corner, and on the line of an edge."""
    corner = objects.trihedral(0.1)
    for position in ([0.0, 0.0, 0.0], [1e-6, 0, 0], [0.01, 0, 0], corner.vertices[1], corner.triangles_center[0]):
        traced(corner, position, rays=20_000)


@pytest.mark.slow
def test_three_million_rays_in_a_room_fit_in_two_gigabytes():
    """The test measures the peak resident memory of a whole process."""
    code = (
        "import sys, trimesh\nsys.path.insert(0, sys.argv[1])\n"
        "from experiments.speed.machine import peak_gib\nfrom test_robust import traced\n"
        "room = trimesh.creation.box((6.0, 4.0, 3.0))\nroom.invert()\n"
        "print(len(traced(room, [0.3, -0.2, 0.1], rays=3_000_000, hats=True, prune=2e-4).pose), peak_gib())"
    )
    command = [sys.executable, "-c", code, str(Path(__file__).parent)]
    out = subprocess.run(command, capture_output=True, text=True, timeout=600, check=True).stdout.split()
    assert int(out[0]) > 10_000
    assert float(out[1]) < 2.0
