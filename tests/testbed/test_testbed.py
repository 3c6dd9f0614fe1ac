"""The simulated testbed differs from the nominal scene only by documented deviations (gaps), and each deviation can be switched off."""

import dataclasses

import numpy as np
import pytest
from no_gaps import OFF

import radartwin as rt
from radartwin.config.study import GapConfig
from radartwin.materials import Layered
from radartwin.materials.permittivity_by_name import split
from radartwin.radar.hardware import Hardware
from radartwin.radar.recording import Recording
from radartwin.scene import objects, rooms
from radartwin.scene.rooms.parts import STUD_WALL
from radartwin.scene.trajectories import trajectory
from radartwin.testbed.testbed import Gaps, actual, received, truth
from radartwin.testbed.variation import HEADSPACE, ROUGHNESS_M, ROUGHNESS_OTHER_M

RADAR = rt.Radar.iwr1843()
TARGET = rt.Scene([rt.Surface(objects.plate(0.1, 0.1), "metal", "plate")])
TURNING = {"plate": trajectory.turntable(np.array([1.0, 0.0, 0.0]), 3, 10.0)}
LAB = rooms.lab(detail="cluttered")


def only(**strengths):
    return dataclasses.replace(OFF, **strengths)


def materials(scene):
    return {s.name: s.material for s in scene}


def test_without_gaps_truth_and_poses_are_nominal():
    mine = {f.name for f in dataclasses.fields(Gaps)}
    assert {f.name for f in dataclasses.fields(GapConfig)} == mine | {"geometry", "unscanned_echoes"}
    assert all(f.default == 1.0 for f in dataclasses.fields(Gaps))
    sweep = trajectory.depth_sweep(trajectory.pose([0, 0, 0.4]))
    there = actual(sweep, {"plate": np.eye(4)[None]}, 10.0, OFF, 3)
    assert np.array_equal(there.sensor_poses, sweep)
    assert np.array_equal(there.motion["plate"], np.eye(4)[None])
    off = actual(sweep, {"plate": np.eye(4)[None]}, 10.0, Gaps(), 3)
    assert 1e-3 < np.linalg.norm(off.sensor_poses[:, :3, 3] - sweep[:, :3, 3], axis=1).mean() < 0.1
    assert 1e-3 < np.linalg.norm(off.motion["plate"][0, :3, 3]) < 0.03
    same = truth(LAB, dataclasses.replace(OFF, clutter=1.0), 0)
    assert [(s.name, s.material, s.roughness_m) for s in same] == [(s.name, s.material, s.roughness_m) for s in LAB]
    assert all(a.mesh is b.mesh for a, b in zip(same, LAB, strict=True))


def test_clutter_is_present_and_has_moved():
    bare = truth(LAB, OFF, 0, rooms.CLUTTER)
    assert set(LAB.names) - set(bare.names) == set(rooms.CLUTTER)
    moved = truth(LAB, only(clutter=1.0), 0, rooms.CLUTTER)
    assert moved.names == LAB.names
    before = {s.name: s.mesh.bounds[0] for s in LAB}
    off = np.array([s.mesh.bounds[0] - before[s.name] for s in moved if s.name in rooms.CLUTTER])
    assert (np.abs(off[:, :2]) > 1e-4).all()
    assert np.abs(off[:, :2]).max() < 0.1
    assert (off[:, 2] == 0).all()
    assert all(np.array_equal(s.mesh.bounds[0], before[s.name]) for s in moved if s.name not in rooms.CLUTTER)


def test_layer_deviations_have_the_described_spread():
    """5 % of the layer thickness, 10 % of the permittivity, and 0.5 of the logarithm of the loss."""
    wall = rt.Scene([s for s in LAB if s.name == "wall_front"])
    found = []
    for seed in range(400):
        stack = materials(truth(wall, only(materials=1.0), seed))["wall_front"]
        assert isinstance(stack, Layered)
        name, real, loss = split(stack.layers[0][0])
        assert name == STUD_WALL.layers[0][0]
        found.append([stack.layers[0][1] / STUD_WALL.layers[0][1], real, loss])
    np.testing.assert_allclose(np.log(found).std(axis=0), [0.05, 0.10, 0.5], rtol=0.1)
    assert materials(truth(LAB, only(materials=2.0, clutter=1.0), 0))["cabinet"] == "metal"


def test_the_walls_of_the_target_have_a_gap_of_their_own() -> None:
    """The stand is an object too, but only the gap of the target's walls changes the target, and it changes nothing else."""
    stand, shell = rooms.support(np.array([2.0, 0.0, 1.0])), rt.Scene([TARGET.surfaces[0].replaced(material=Layered([("hdpe", 1e-3)]))])
    for scene, target, own, other in ((stand, False, "materials", "object_material"), (shell, True, "object_material", "materials")):
        assert materials(truth(scene, only(**{other: 1.0, "clutter": 1.0}), 0, target=target)) == materials(scene)
        assert materials(truth(scene, only(**{own: 1.0, "clutter": 1.0}), 0, target=target)) != materials(scene)


def test_roughness_deviates_and_smooth_surfaces_become_rough():
    rough = rt.Scene([TARGET.surfaces[0].replaced(roughness_m=0.2e-3)])
    heights = [truth(rough, only(roughness=1.0), seed).surfaces[0].roughness_m for seed in range(400)]
    assert np.log(heights).std() == pytest.approx(0.7, rel=0.1)
    assert np.exp(np.log(heights).mean()) == pytest.approx(0.2e-3, rel=0.1)
    assert truth(TARGET, only(roughness=2.0), 0).surfaces[0].roughness_m == pytest.approx(2 * ROUGHNESS_M["metal"])
    glass = rt.Scene([TARGET.surfaces[0].replaced(material="glass")])
    assert truth(glass, only(roughness=1.0), 0).surfaces[0].roughness_m == pytest.approx(2e-6)  # glazed faces are smooth to micrometres
    board = rt.Scene([TARGET.surfaces[0].replaced(material="plasterboard")])
    assert truth(board, only(roughness=1.0), 0).surfaces[0].roughness_m == pytest.approx(ROUGHNESS_OTHER_M)


def test_vessel_has_headspace_and_a_deviating_liquid():
    bottle = rt.Surface(objects.cylinder(0.03, 0.2), Layered([("pet", 0.5e-3)], backing="mustard"), "bottle", role="object")
    levels, factors = [], []
    for seed in range(300):
        filled, empty = truth(rt.Scene([bottle]), only(contents=1.0), seed)
        assert filled.name == empty.name == "bottle"
        assert isinstance(filled.material, Layered)
        assert empty.material == Layered([("pet", 0.5e-3)])
        assert filled.mesh.area + empty.mesh.area == pytest.approx(bottle.mesh.area, rel=1e-6)
        levels.append((bottle.mesh.bounds[1, 2] - filled.mesh.bounds[1, 2]) / 0.2)
        factors.append(split(filled.material.backing)[1])
    assert 0.05 <= min(levels) < max(levels) <= 0.15
    assert np.mean(levels) == pytest.approx(HEADSPACE, rel=0.1)
    assert np.log(factors).std() == pytest.approx(0.10, rel=0.1)


@pytest.mark.parametrize("name", ["lab", "atrium", "squash_court"])
def test_no_room_has_a_vessel_with_contents(name):
    """The campaign shares rooms between recordings that differ in the gap `contents` (experiments.campaign.truth.OF_TARGET)."""
    room = rooms.room(name, detail="cluttered")
    assert len(truth(room, only(contents=2.0, clutter=1.0), 0)) == len(room)


def test_gaps_draw_independently():
    """A further gap does not change the random values of those that were already on with the same seed."""
    one, two = truth(LAB, only(materials=1.0, clutter=1.0), 5), truth(LAB, only(materials=1.0, clutter=1.0, roughness=1.0), 5)
    assert materials(one) == materials(two)
    motion, sweep = {"plate": TURNING["plate"]}, np.eye(4)[None]
    alone, both = (actual(sweep, motion, 10.0, only(placement=1.0, trajectory=t), 3).motion["plate"] for t in (0.0, 1.0))
    assert not np.allclose(alone, both)
    assert np.allclose(alone[:, :2, 3].mean(axis=0), both[:, :2, 3].mean(axis=0), atol=5e-3)


def test_receiver_noise_depends_on_seed_and_frame():
    ideal = Recording(np.full((3, 16, 2, 4, 256), 1e-5, np.complex64), RADAR)
    first, again, other = (received(ideal, Hardware(), seed).iq for seed in (1, 1, 2))
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)
    assert not np.array_equal(first[0], first[1])
    assert np.array_equal(received(Recording(ideal.iq[:2], RADAR), Hardware(), 1).iq, first[:2])
    assert np.array_equal(received(ideal, Hardware().scaled(0), 7).iq, ideal.iq)
