"""Test echoes through the walls of hollow objects (shells). The level and phase of the echoes agree with transfer matrices, the echoes are
reciprocal, and the tracer detects which meshes are shells.
"""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from panes import C, transmitted
from physics_helpers import FREQUENCY, coherent, tube_hits

import radartwin as rt
from experiments.validation.oracles import stack
from radartwin.scene import objects
from radartwin.simulation import geometry, reflection_table
from radartwin.simulation.curved import shell
from radartwin.simulation.hits import TraceOptions

SENSOR = np.array([[2.0, 0.0, 0.0]])
PET = rt.Layered([("pet", 0.001)])
LAMINATE = rt.Layered([("glass", 0.0007), ("pet", 0.0012)])


def echo(meshes, materials, *, start=SENSOR, end=SENSOR, beyond_m=0.0, within_m=np.inf, through=True):
    """Return the field at `end` from single reflections on meshes, limited to reflections between two distances from the start."""
    table = reflection_table.build([(m, 0.0) for m in materials], FREQUENCY)
    if not through:
        blocked = np.zeros_like(table.through_te)
        table = replace(table, surfaces=(("metal", 0.0),) * len(materials), through_te=blocked, through_tm=blocked)
    hits = tube_hits(meshes, table, start, end)
    return coherent(hits, (hits.length_in_m > beyond_m) & (hits.length_in_m < within_m))


def passed(layers, frequency=FREQUENCY):
    """Return the transmission through a wall and the reflection from inside, at normal incidence under exp(-j w t).

    Their phase is relative to the wall's outer face with air in place of the wall.
    """
    there = np.exp(2j * np.pi * frequency / C * sum(depth for _, depth in layers))
    inside = stack.stack(list(layers)[::-1], "air", 0.0, frequency)[0]
    return np.conj(transmitted(layers, 1.0, frequency)[0]), np.conj(inside * there**2)


@pytest.mark.parametrize("material", [PET, LAMINATE], ids=["PET", "glass and PET"])
def test_far_wall_of_a_box_matches_the_transfer_matrix(material):
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    plate = objects.plate(0.1, 0.1).apply_translation([-0.05, 0, 0])
    through, inside = passed(material.layers)
    ratio = echo([box], [material], beyond_m=2.0) / echo([plate], ["metal"])
    assert ratio == pytest.approx(-inside * through**2, rel=0.01)


def test_metal_in_a_box_matches_the_transfer_matrix():
    box, plate = trimesh.creation.box((0.1, 0.1, 0.1)), objects.plate(0.04, 0.04)
    through, _ = passed(PET.layers)
    seen = echo([box, plate], [PET, "metal"], beyond_m=1.99, within_m=2.01)
    assert seen == pytest.approx(echo([plate], ["metal"]) * through**2, rel=0.03)


def test_empty_bottles_match_the_exact_series():
    """Averaged over the chirp, and with up to three reflections inside the bottle."""
    from experiments.validation.oracles.dielectrics import exact_bottle, our_bottle

    error = [our_bottle(wall, "air") - exact_bottle(wall, "air", 65) for wall in ("pet 0.3", "hdpe 1", "glass 3")]
    assert np.abs(error).max() < 1.0


def test_echo_through_a_can_is_reciprocal():
    can, ends = objects.cylinder(0.033, 0.12, 128), (SENSOR, np.array([[2.02, 0.1, 0.04]]))
    there, back = (
        echo([can], [LAMINATE], start=a, end=b) - echo([can], [LAMINATE], start=a, end=b, through=False) for a, b in (ends, ends[::-1])
    )
    assert abs(20 * np.log10(abs(there / back))) < 0.05
    assert abs(np.degrees(np.angle(there / back))) < 1


@pytest.mark.parametrize(
    ("mesh", "material"),
    [
        (objects.plate(0.1, 0.1), PET),
        (trimesh.creation.box((0.002, 0.3, 0.3)), PET),
        (objects.cylinder(0.033, 0.12), rt.Layered([("pet", 0.001)], "water")),
        (objects.cylinder(0.033, 0.12), rt.Layered([], "pet")),
        (trimesh.Trimesh(objects.cylinder(1, 2).vertices, objects.cylinder(1, 2).faces[:, ::-1], process=False), PET),
    ],
    ids=["open", "board", "filled", "solid", "room"],
)
def test_meshes_that_are_no_shells_transmit_nothing(mesh, material):
    assert shell.find_shells(geometry.build([mesh]), reflection_table.build([(material, 0.0)], FREQUENCY)) is None


def test_bottle_in_a_scene_shows_its_far_wall():
    """The bottle stands in front of a wall, in a room simulated by ray tubes or by images, or moves as an object."""
    from radartwin.simulation.backends.mitsuba import TraceSettings
    from radartwin.simulation.simulate import trace_paths

    wall = objects.plate(3, 3).apply_translation([-1.5, 0, 0])
    bottle = rt.Surface(objects.cylinder(0.033, 0.12), PET, "bottle", role="object")
    pose = np.eye(4)[None].copy()
    pose[0, :3, 3] = [1.5, 0, 0]
    turned = pose @ np.diag([-1.0, -1, 1, 1])
    scene = rt.Scene([rt.Surface(wall, "plasterboard", "wall"), bottle])
    for settings in (TraceSettings(room="tubes", rays=100_000, diffuse=False), TraceSettings(diffuse=False)):
        parts = trace_paths(scene, rt.Radar.iwr1843(element="isotropic"), turned, {"bottle": np.eye(4)[None]}, settings)[0]
        lengths = np.concatenate([part.length_m[part.bounces == 1] for part in parts])
        assert ((lengths > 2 * 1.51) & (lengths < 2 * 1.54)).any()


def test_pruning_does_not_change_the_echo():
    table = reflection_table.build([(PET, 0.0)], FREQUENCY, 80.4e9)
    whole, pruned = (
        coherent(tube_hits([objects.cylinder(0.033, 0.12, 64)], table, SENSOR, options=TraceOptions(1, prune=least)))
        for least in (0.0, 2e-4)
    )
    assert pruned == pytest.approx(whole, rel=0.01)
