"""Tests of simulator=auto: the search for the cheapest model, the repeatability limits of features, and thinned recordings."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from experiments.generators import repeatability
from radartwin.adaptive.choice import Choice, choose
from radartwin.adaptive.limits import PROFILE, SHIPPED, Limits, distances, measured
from radartwin.adaptive.probe import ASPECTS, PLACES, thinned
from radartwin.adaptive.scene_settings import DEFAULT, LADDER, Model, cheaper, reduced
from radartwin.builders.recording import build_setup
from radartwin.builders.simulator import MOTION_FAMILIES
from radartwin.config.compose import compose
from radartwin.errors import ConfigError, InputError
from radartwin.features.envelope import frames_per_revolution
from radartwin.features.log import Nominal
from radartwin.radar.chirp import Radar
from radartwin.scene import objects, rooms
from radartwin.scene.scene import Scene, Surface
from radartwin.scene.trajectories import trajectory

LIMITS = Limits({"level_db": 1.0}, "this test")


@dataclass
class FakeProbe:
    """Stand for a simulated recording with one feature, which each lowered simulation setting changes by a given amount."""

    moves: dict[str, dict[object, float]]

    def features(self, model: Model) -> tuple[list[str], np.ndarray]:
        return ["level_db"], np.array([sum(of.get(getattr(model, name), 0.0) for name, of in self.moves.items())])


def test_everything_without_effect_is_left_out() -> None:
    choice = choose([(FakeProbe({}), LIMITS)])
    assert choice.model == Model("none", 1, True, False, 0.25, "planar")  # coupling has no effect without a room
    assert choice.error == 0
    assert all(step.taken for step in choice.steps)


def test_parts_that_change_a_feature_stay_and_are_reported() -> None:
    needs_room = FakeProbe({"parts": {"none": 3.0}, "max_bounces": {1: 2.0, 2: -1.5}})
    choice = choose([(needs_room, LIMITS)])
    assert (choice.model.parts, choice.model.max_bounces) == ("large", 3)
    refused = [step for step in choice.steps if not step.taken]
    tried = [(step.dimension, step.value, step.error) for step in refused]
    # the second round of the search tries the refused values again
    assert tried == 2 * [("parts", "none", 3.0), ("max_bounces", 1, 2.0), ("max_bounces", 2, 1.5)]
    assert "parts of the room none: level_db changes by 3 times its repeatability limit, rejected" in "\n".join(choice.lines())
    assert Choice.from_dict(choice.to_dict()) == choice


def test_one_dimension_does_not_use_up_the_tolerance_of_others() -> None:
    """The search keeps a room whose removal uses nearly the whole tolerance if three small errors fit instead."""
    small = {"rays_per_wavelength2": {0.25: 0.2}, "elements": {"planar": 0.1}, "coupling": {False: 0.1}}
    assert choose([(FakeProbe({"parts": {"none": 0.9}, **small}), LIMITS)]).model == Model("large", 1, False, False, 0.25, "planar")
    assert choose([(FakeProbe({"parts": {"none": 0.9}}), LIMITS)]).model.parts == "none"


def test_one_setting_for_several_probes_keeps_the_needs_of_each() -> None:
    room, rays = FakeProbe({"parts": {"none": 9.0}}), FakeProbe({"rays_per_wavelength2": {0.25: 9.0}})
    choice = choose([(room, LIMITS), (rays, LIMITS)])
    assert (choice.model.parts, choice.model.rays_per_wavelength2) == ("large", 1.0)


def test_a_pinned_dimension_stays_and_tolerance_scales() -> None:
    probe = FakeProbe({"parts": {"none": 3.0}, "max_bounces": {1: 50.0}})
    # changes are relative to the finest model, which has one bounce here
    assert choose([(probe, LIMITS)], pinned={"max_bounces": 1}).model.parts == "large"
    assert choose([(probe, LIMITS)], tolerance=3.5).model.parts == "none"


def test_greedy_never_exceeds_its_tolerance() -> None:
    rng = np.random.default_rng(0)
    for _ in range(50):
        probe = FakeProbe({name: {value: rng.uniform(-1, 1) for value in values[:-1]} for name, values in LADDER.items()})
        choice = choose([(probe, LIMITS)])
        assert abs(probe.features(choice.model)[1][0]) <= 1.0


def test_limits_are_pooled_by_degrees_of_freedom_and_a_profile_has_one_from_pairs() -> None:
    two, three = np.array([[1.0], [3.0]]), np.array([[10.0], [10.0], [10.0]])
    limit = measured([(["level_db"], two), (["level_db"], three)])["level_db"]
    assert limit == pytest.approx(np.sqrt(2) * 3.182 * np.sqrt(2 / 3), rel=1e-3)  # t of three degrees of freedom
    names = ["profile_0.30m_db", "profile_0.35m_db"]
    assert measured([(names, np.array([[0.0, 0.0], [3.0, 4.0]]))]) == {PROFILE: pytest.approx(np.sqrt(12.5))}


def test_limits_are_at_least_a_tenth_of_the_pooled_limit() -> None:
    stored = json.loads(SHIPPED.read_text())["motions"]["depth"]
    of_object, pooled = stored["objects"]["corner_reflector"]["multipath_share"], stored["pooled"]["multipath_share"]
    assert of_object < 0.1 * pooled
    assert Limits.shipped("depth", "corner_reflector").of["multipath_share"] == pytest.approx(0.1 * pooled)


def test_strong_bins_of_a_profile_count_as_one_feature() -> None:
    names = ["profile_0.30m_db", "profile_0.35m_db", "profile_0.40m_db", "level_db"]
    reference = np.array([0.0, -10.0, -60.0, 5.0])
    moved = distances(names, reference + np.array([3.0, 4.0, 10.0, 0.5]), reference)
    assert moved == {"level_db": pytest.approx(0.5), PROFILE: pytest.approx(np.sqrt(12.5))}
    loud = distances(names, reference + np.array([3.0, 4.0, 40.0, 0.5]), reference)  # an echo that the reference profile does not contain
    assert loud[PROFILE] == pytest.approx(np.sqrt((9 + 16 + 1600) / 3))


def test_shipped_limits_are_per_object_and_pooled() -> None:
    config = compose(["experiment=campaign"])
    for motion in repeatability.FAMILIES:
        cases = repeatability.repeated(config, motion)
        assert {len(repetitions) for repetitions in cases} == {repeatability.REPEATS}
        assert {repetitions[0].object for repetitions in cases} == set(json.loads(SHIPPED.read_text())["motions"][motion]["objects"])
    values = {"depth": {"mug": (["level_db"], np.array([[1.0], [3.0]])), "mustard": (["level_db"], np.array([[5.0], [5.0]]))}}
    limits = repeatability.summary(values)["motions"]["depth"]
    assert limits["objects"] == {"mug": {"level_db": 25.4}, "mustard": {"level_db": 0.0}}  # t of one degree of freedom is 12.7
    assert limits["pooled"] == {"level_db": 6.08}


def _recording(motion: str, frames: int, between: bool = False):
    radar = Radar.iwr1843()
    bench = rooms.lab_bench()
    target = Surface(objects.trihedral(0.1), "metal", "target", role="object")
    at = bench.target_position(2.0)
    angle, away = None, np.full(frames, 2.0)
    poses, sensor = trajectory.pose(at)[None], bench.sensor_pose[None]
    if motion == "turntable":
        poses, angle = trajectory.turntable(at, frames, radar.frame_rate_hz, 25.0, np.pi), 2 * np.pi * np.arange(frames) / 250
    elif motion in ("depth", "lateral"):
        sweep = {"depth": trajectory.depth_sweep, "lateral": trajectory.lateral_sweep}[motion]
        sensor = sweep(bench.sensor_pose)[:frames]
        away = np.linalg.norm(at[:2] - sensor[:, :2, 3], axis=1)
    else:
        poses = trajectory.rail(poses[0], bench.sensor_pose[:3, 0], 0.3, frames)
        away = np.linalg.norm(poses[:, :2, 3] - sensor[:, :2, 3], axis=1)
    log = Nominal(radar.frame_rate_hz, away, angle)
    return thinned(rooms.empty(), Scene([target]), radar, sensor, {"target": poses}, log, MOTION_FAMILIES[motion], between=between)


@pytest.mark.parametrize(("frames", "between"), [(250, False), (500, True)])
def test_a_revolution_is_thinned_to_even_aspects(frames: int, between: bool) -> None:
    probe = _recording("turntable", frames, between)
    assert probe.log.angle_rad is not None
    assert len(probe.log.distance_m) == ASPECTS == len(probe.motion["target"])
    assert np.allclose(np.diff(probe.log.angle_rad), 2 * np.pi / ASPECTS)
    turned = np.unwrap(Rotation.from_matrix(probe.motion["target"][:, :3, :3]).as_euler("zyx")[:, 0])
    assert np.allclose(np.abs(turned - turned[0]), 2 * np.pi / ASPECTS * np.arange(ASPECTS), atol=1e-9)
    assert probe.radar.frame_rate_hz == pytest.approx(10 * ASPECTS / 250)
    usual = _recording("turntable", frames).motion["target"]
    step = np.arccos((np.trace(usual[0, :3, :3].T @ probe.motion["target"][0, :3, :3]) - 1) / 2)
    assert step == pytest.approx(np.pi / ASPECTS if between else 0.0, abs=1e-6)


@pytest.mark.parametrize("frames", [36, 17, 24, 40, 232, 248])
def test_a_thinned_revolution_of_any_length_is_complete(frames: int) -> None:
    log = Nominal(frames / 25.0, np.ones(frames), 2 * np.pi * np.arange(frames) / frames)
    poses = trajectory.turntable([2.0, 0, 0], frames, frames / 25.0, 25.0)
    probe = thinned(rooms.empty(), Scene([]), Radar.iwr1843(), np.eye(4)[None], {"target": poses}, log, ())
    assert frames_per_revolution(np.asarray(probe.log.angle_rad)) == ASPECTS == len(probe.motion["target"])


def test_a_drive_is_thinned_to_places_from_end_to_end() -> None:
    probe = _recording("depth", 36)
    assert len(probe.sensor_poses) == PLACES == len(probe.motion["target"])
    assert np.allclose(probe.sensor_poses[-1], trajectory.depth_sweep(rooms.lab_bench().sensor_pose)[35])
    assert probe.radar.frame_rate_hz == pytest.approx(10 * (PLACES - 1) / 35)
    assert np.allclose(probe.log.distance_m, np.linalg.norm(probe.motion["target"][:, :2, 3] - probe.sensor_poses[:, :2, 3], axis=1))


@pytest.mark.parametrize(("motion", "frames"), [("turntable", 250), ("depth", 36), ("lateral", 36), ("radial", 30), ("diagonal", 30)])
def test_every_feature_has_a_shipped_limit(motion: str, frames: int) -> None:
    names, values = _recording(motion, frames).features(Model("none", 1, True, False, 0.25, "planar"))
    for thing in ("corner_reflector", "mug", "something else"):
        assert Limits.shipped(motion, thing).moved(names, values, values)[0] == 0.0


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: Limits.shipped("static"), "no repeatability limits are known for motion 'static'; choose turntable, radial"),
        (lambda: LIMITS.moved(["other"], np.zeros(1), np.zeros(1)), "no repeatability limit is known for feature other"),
        (lambda: choose([(FakeProbe({}), LIMITS)], tolerance=0), "tolerance must be above zero"),
        (lambda: choose([(FakeProbe({}), LIMITS)], pinned={"rays": 3}), "rays is not a setting that the search changes; choose rays_per"),
        (lambda: Model(parts="half"), "parts must be none, large or whole, not 'half'"),
    ],
)
def test_unknown_names_and_values_are_refused(call: Callable[[], object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        call()


@pytest.mark.parametrize(
    ("overrides", "message"),
    [
        *((overrides, "simulator=auto needs a target, and a motion with known repeatability limits")
          for overrides in (["scene.target=none", "trajectory=static"], ["trajectory=static"], ["trajectory.frames=20"])),
        (["trajectory=depth", "trajectory.distance_m=2", "features=rotation"], "features=rotation do not apply to a depth recording"),
        (["features=depth"], "a turntable recording; choose features=rotation or raw"),
    ],
)  # fmt: skip
def test_unsupported_configurations_of_auto_are_refused(overrides: list[str], message: str) -> None:
    config = compose(["scene=lab", "simulator=auto", *overrides])
    with pytest.raises(ConfigError, match=message):
        build_setup(config).probe(config.features)


def test_models_reduce_the_room() -> None:
    room = rooms.room("lab", detail="cluttered")
    assert len(reduced(room, "none")) == 0
    assert 0 < len(reduced(room, "large")) < len(reduced(room, "whole")) == len(room)
    assert cheaper(replace(DEFAULT, parts="none"), "coupling") == []
    assert [m.max_bounces for m in cheaper(DEFAULT, "max_bounces")] == [1, 2, 3]
