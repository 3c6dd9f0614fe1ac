"""Randomised copies: ranges, one quantity at a time, and an exchanged target against a simulation of the whole scene."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
import trimesh

from radartwin.config.compose import compose
from radartwin.features.processed import process
from radartwin.materials import Layered
from radartwin.radar.chirp import Radar
from radartwin.recognize import randomise
from radartwin.recognize.randomise import OFF, Randomisation
from radartwin.scene.objects.catalogue import catalogue
from radartwin.scene.scene import Scene
from radartwin.scene.surface import Surface
from radartwin.scene.trajectories.trajectory import turntable
from radartwin.simulation.simulate import simulate

ON = Randomisation()
AT = np.array([1.0, 0.0, 0.0])
NOMINAL = turntable(AT, 24, 1.0, 24.0, np.pi)


def only(name: str, strength: float = 1.0) -> Randomisation:
    return replace(OFF, **{name: strength})


def tilt_deg(poses: np.ndarray) -> np.ndarray:
    return np.degrees(np.arccos(np.clip(poses[:, 2, 2], -1, 1)))


def angle(poses: np.ndarray) -> np.ndarray:
    return np.unwrap(np.arctan2(poses[:, 1, 0], poses[:, 0, 0]))


def test_strength_zero_changes_nothing() -> None:
    surfaces = catalogue()["mustard"].surfaces()
    assert np.array_equal(randomise.poses(NOMINAL, OFF, 3), NOMINAL)
    assert [(s.material, s.mesh) for s in randomise.target(surfaces, OFF, 3)] == [(s.material, s.mesh) for s in surfaces]
    assert randomise.noise_factor(OFF, 3) == 1.0
    assert not OFF.moves_target
    assert not replace(OFF, level=1.0, if_filter=1.0, channels=1.0, noise=1.0).moves_target


def test_wobble_tilts_within_its_range() -> None:
    tilts = np.array([tilt_deg(randomise.poses(NOMINAL, only("wobble"), seed)).max() for seed in range(200)])
    assert tilts.max() <= 2 * np.sqrt(2) * randomise.WOBBLE_DEG  # two tilts about two directions
    assert tilts.max() > randomise.WOBBLE_DEG
    assert np.allclose(randomise.poses(NOMINAL, only("wobble"), 0)[:, :3, 3], NOMINAL[:, :3, 3])


def test_eccentricity_turns_with_the_object_and_distance_does_not() -> None:
    off_axis = randomise.poses(NOMINAL, only("eccentricity"), 5)[:, :3, 3] - AT
    aside = randomise.poses(NOMINAL, only("distance"), 5)[:, :3, 3] - AT
    radius = np.linalg.norm(off_axis, axis=1)
    assert radius == pytest.approx(radius[0])
    assert 0 < radius[0] <= np.sqrt(2) * randomise.ECCENTRIC_M
    assert off_axis.sum(axis=0) == pytest.approx(0, abs=1e-12)
    assert aside == pytest.approx(np.tile(aside[0], (24, 1)))
    assert 0 < np.abs(aside[0]).max() <= randomise.DISTANCE_M
    assert randomise.poses(NOMINAL, only("distance", 0.5), 5)[0, :3, 3] - AT == pytest.approx(aside[0] / 2)


def test_start_and_speed_change_the_angle_only() -> None:
    late = randomise.poses(NOMINAL, only("start"), 7)
    fast = randomise.poses(NOMINAL, only("speed"), 7)
    assert np.ptp(angle(late) - angle(NOMINAL)) == pytest.approx(0, abs=1e-9)
    gained = (angle(fast) - angle(NOMINAL))[-1] / (angle(NOMINAL)[-1] - angle(NOMINAL)[0])
    assert 0 < abs(gained) <= randomise.RATE
    assert np.allclose(late[:, :3, 3], NOMINAL[:, :3, 3])
    assert np.allclose(fast[:, :3, 3], NOMINAL[:, :3, 3])


def test_walls_of_dielectrics_vary_and_metal_does_not() -> None:
    bottle = catalogue()["mustard"].surfaces()
    drawn = randomise.target(bottle, only("wall"), 2)
    assert drawn[0].material != bottle[0].material
    stacks = (surfaces[0].material for surfaces in (bottle, drawn))
    nominal, varied = (stack.layers[0][1] for stack in stacks if isinstance(stack, Layered))
    assert 0 < abs(varied / nominal - 1) <= randomise.WALL
    can = catalogue()["can_211_400"].surfaces()
    assert [s.material for s in randomise.target(can, only("wall"), 2)] == [s.material for s in can]


@pytest.mark.parametrize("name", ["can_211_400", "mug", "mustard", "corner_reflector"])
def test_mesh_stays_within_the_tolerance(name: str) -> None:
    nominal = catalogue()[name].surfaces()
    moved = []
    for seed in range(20):
        for before, after in zip(nominal, randomise.target(nominal, only("mesh"), seed), strict=True):
            moved.append(np.abs(after.mesh.bounds - before.mesh.bounds).max())
            assert len(after.mesh.faces) == len(before.mesh.faces)
    assert 0.2 * randomise.MESH_M < max(moved) <= 3 * np.sqrt(2) * randomise.MESH_M  # the radius adds three terms


def echo(objects: list[Surface], poses: np.ndarray, room: list[Surface] | None = None):
    radar = replace(Radar.iwr1843(), num_chirps=16)
    made = simulate(Scene([*(room or []), *objects]), radar, np.eye(4)[None], motion={objects[0].name: poses})
    return process(made, doppler=False)


def sphere() -> list[Surface]:
    return [Surface(trimesh.creation.icosphere(5, 0.02), "metal", "ball")]


def test_receiver_changes_stay_within_their_ranges() -> None:
    plain = echo(sphere(), NOMINAL[:2])
    here = int(plain.power[0].argmax())
    for seed in range(20):
        louder = randomise.received(plain, only("level"), seed)
        assert abs(10 * np.log10(louder.power[0, here] / plain.power[0, here])) <= randomise.LEVEL_DB + 1e-3
        gain = np.sqrt(louder.power / plain.power)[0, here]
        assert louder.channels / plain.channels == pytest.approx(np.full(plain.channels.shape, gain))
        unequal = randomise.received(plain, only("channels"), seed)
        ratio = (unequal.channels / plain.channels)[0, :, here]
        assert np.abs(20 * np.log10(np.abs(ratio))).max() <= randomise.CHANNEL_DB + 1e-3
        assert np.abs(np.degrees(np.angle(ratio))).max() <= randomise.CHANNEL_DEG + 1e-3
        assert 10 * abs(np.log10(randomise.noise_factor(ON, seed))) <= randomise.NOISE_DB


def test_if_filter_attenuates_near_echoes_more() -> None:
    plain = echo(sphere(), NOMINAL[:2])
    for seed in range(10):
        filtered = randomise.received(plain, only("if_filter"), seed)
        gain = np.abs(filtered.channels[0, 0]) / np.abs(plain.channels[0, 0])
        assert (np.diff(gain[1:]) > -1e-6).all()
        assert gain[1] < 0.5
        assert gain.max() <= 1 + 1e-6


def test_exchanged_target_before_a_wall_agrees_with_the_whole_scene() -> None:
    """The exchange leaves out the change of echoes over target and wall, which are 20 dB below the direct echo."""
    wall = [Surface(trimesh.creation.box((0.01, 3.0, 3.0)).apply_translation([1.505, 0.0, 0.0]), "plasterboard", "wall")]
    can = [s.replaced(name="can") for s in catalogue()["can_211_400"].surfaces()]
    nominal_poses = NOMINAL[:4] @ np.block([[np.eye(3), np.array([[0], [0], [-0.05]])], [np.zeros((1, 3)), np.ones((1, 1))]])
    strengths = replace(ON, mesh=0.0, wall=0.0)
    moved = randomise.poses(nominal_poses, strengths, 6)
    alone, drawn_alone = echo(can, nominal_poses), echo(can, moved)
    whole, drawn_whole = echo(can, nominal_poses, wall), echo(can, moved, wall)
    exchanged = randomise.exchanged(whole, alone.channels, drawn_alone.channels)
    gate = np.abs(whole.range_m - 1.0) < 0.15
    error = np.linalg.norm((exchanged.channels - drawn_whole.channels)[..., gate]) / np.linalg.norm(drawn_whole.channels[..., gate])
    change = np.linalg.norm((drawn_whole.channels - whole.channels)[..., gate]) / np.linalg.norm(drawn_whole.channels[..., gate])
    assert change > 0.3  # the draw moves the target by a good part of a wavelength
    assert error < 0.1


def test_every_strength_has_a_switch_and_a_source() -> None:
    names = [field.name for field in fields(Randomisation)]
    config = compose(["experiment=labelled_probe", *(f"supervision.randomise.{name}=0" for name in names)]).supervision.randomise
    assert {getattr(config, name) for name in names} == {0.0}
    assert all(config.sources()[name] for name in names)
