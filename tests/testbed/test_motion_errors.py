"""The simulated motion errors have their documented statistics, and are zero at strength 0."""

from typing import Any

import numpy as np
import pytest

from radartwin.scene.trajectories import trajectory
from radartwin.testbed.motion_errors import (
    PlacementErrors,
    RailErrors,
    RoverErrors,
    TurntableErrors,
    at_times,
    placed,
    rail,
    rover,
    turns,
    turntable,
    turntable_angles,
)

SWEEP = trajectory.depth_sweep(trajectory.pose([1.0, 0.5, 0.4]))
TURN = trajectory.turntable(np.array([2.0, 0.0, 1.0]), 250, 10.0)


def rng(seed):
    return np.random.default_rng(seed)


def rigid(poses):
    return np.allclose(poses[:, :3, :3] @ poses[:, :3, :3].swapaxes(1, 2), np.eye(3), atol=1e-12) and np.allclose(poses[:, 3], [0, 0, 0, 1])


def test_strength_scales_errors_keeps_lengths_and_zero_returns_the_nominal_poses():
    assert np.array_equal(rover(SWEEP, RoverErrors().scaled(0), rng(0)), SWEEP)
    assert np.array_equal(turntable(TURN, TurntableErrors().scaled(0), rng(0)), TURN)
    assert np.array_equal(placed({"a": TURN}, PlacementErrors().scaled(0), rng(0))["a"], TURN)
    assert np.array_equal(rail(SWEEP, RailErrors().scaled(0), rng(0)), SWEEP)
    moved = rover(SWEEP[:1].repeat(20, 0), RoverErrors(), rng(0))
    assert np.array_equal(moved, moved[:1].repeat(20, 0)), "a resting rover does not move"
    twice = RoverErrors().scaled(2)
    assert (twice.slip, twice.start_m) == (2 * RoverErrors().slip, 2 * RoverErrors().start_m)
    assert (twice.wheel_m, twice.slip_length_m) == (RoverErrors().wheel_m, RoverErrors().slip_length_m)
    assert TurntableErrors().scaled(2).ripple_cycles == TurntableErrors().ripple_cycles
    small, large = (rover(SWEEP, RoverErrors().scaled(s), rng(4)) - SWEEP for s in (0.01, 0.02))
    assert np.linalg.norm(large - 2 * small) < 0.01 * np.linalg.norm(large)
    kinds: Any = ((rover, SWEEP, RoverErrors()), (turntable, TURN, TurntableErrors()))
    for move, course, errors in kinds:
        one, same, other = (move(course, errors, rng(seed)) for seed in (3, 3, 4))
        assert np.array_equal(one, same)
        assert not np.array_equal(one, other)
        assert rigid(move(course, errors.scaled(5), rng(3)))


def test_poses_at_other_times_follow_the_nominal_course():
    times = np.arange(len(SWEEP)) / 10
    assert np.array_equal(at_times(SWEEP, 10.0, times), SWEEP)
    np.testing.assert_allclose(at_times(SWEEP, 10.0, times + 0.03)[:, 0, 3], 1.0 + 0.2 * (times + 0.03), atol=1e-12)
    turned = at_times(TURN, 10.0, np.array([0.05]))
    assert np.degrees(np.arctan2(turned[0, 1, 0], turned[0, 0, 0])) == pytest.approx(0.72, abs=1e-6)


@pytest.fixture(scope="module")
def courses():
    return np.stack([rover(SWEEP, RoverErrors(), rng(s)) for s in range(800)])


def test_rover_start_and_path_errors_have_the_described_spread(courses):
    """Half of the variance of a slip of 1.5 % is constant. A path averages the other half, with the correlation length 0.3 m."""
    start = courses[:, 0, :2, 3] - SWEEP[0, :2, 3]
    assert start.std() == pytest.approx(0.01, rel=0.1)
    assert np.abs(start.mean(axis=0)).max() < 1.5e-3
    way = np.linalg.norm(np.diff(SWEEP[:, :3, 3], axis=0), axis=1).sum()
    along = np.linalg.norm(courses[:, -1, :3, 3] - courses[:, 0, :3, 3], axis=1) / way - 1
    share = 0.3 / way
    changing = np.sqrt(2 * share - 2 * share**2 * (1 - np.exp(-1 / share)))
    assert along.std() == pytest.approx(0.015 * np.sqrt((1 + changing**2) / 2), rel=0.1)


def test_rover_heading_and_height_errors_have_the_described_spread(courses):
    heading = np.degrees(np.arctan2(courses[:, :, 1, 0], courses[:, :, 0, 0]))
    way = np.linalg.norm(SWEEP[-1, :3, 3] - SWEEP[0, :3, 3])
    assert heading[:, 0].std() == pytest.approx(0.5, rel=0.1)
    assert heading[:, -1].std() == pytest.approx(np.hypot(0.5, 0.9 * way), rel=0.1)
    height = courses[:, :, 2, 3] - SWEEP[:, 2, 3]
    assert height.std() == pytest.approx(0.5e-3, rel=0.1)
    near, far = (np.mean(height[:, 0] * height[:, k]) / height.var() for k in (1, 40))
    assert near == pytest.approx(np.exp(-0.02 / 0.1), abs=0.1)
    assert abs(far) < 0.15


RIPPLE = RoverErrors(slip=0, start_m=0, heading_deg=0, drift_deg_per_m=0, bob_m=0)
GONE_M = 0.02 * np.minimum(np.arange(49), 48 - np.arange(49))
THERE_AND_BACK = trajectory.at_distances(trajectory.pose([0, 0, 0.4]), [1, 0, 0], GONE_M)


def test_rover_ripple_has_the_period_of_a_wheel_and_repeats_on_the_way_back():
    """The strongest spectral line of the rover's path error has an amplitude of 0.5 mm and the period of a wheel, 251 mm. Without slip, the
    error of a drive there and back depends only on the nominal position, because the wheels turn back.
    """
    long = trajectory.rail(trajectory.pose([0, 0, 0.4]), [1, 0, 0], 10 * np.pi * 0.08, 1001)
    error = (rover(long, RIPPLE, rng(1)) - long)[:-1, 0, 3]
    lines = np.abs(np.fft.rfft(error - error.mean())) / 500
    assert np.argmax(lines) == 10
    assert lines[10] == pytest.approx(0.5e-3, rel=0.01)
    error = (rover(THERE_AND_BACK, RIPPLE, rng(1)) - THERE_AND_BACK)[:, 0, 3]
    assert np.ptp(error) > 0.5e-3
    np.testing.assert_allclose(error, error[::-1], atol=1e-12)
    ends = np.array([(rover(THERE_AND_BACK, RoverErrors(start_m=0), rng(s)) - THERE_AND_BACK)[-1, :3, 3] for s in range(400)])
    # constant slip cancels; changing slip of 1.06 % with a correlation length of 0.3 m leaves some millimetres
    assert 1e-3 < ends[:, 0].std() < 0.0106 * 0.96


def test_turntable_angle_errors_have_the_described_spread():
    """Half of the variance of the speed error of 3.6 degrees per revolution changes within a fifth of a revolution. The ripple repeats."""
    nominal = np.linspace(0, 2 * np.pi, 251)
    off = np.degrees([turntable_angles(nominal, TurntableErrors(), rng(s)) for s in range(800)])
    assert off[:, 0].std() == pytest.approx(5.0, rel=0.1)
    forgotten = 2 * 0.2 * (1 - 0.2 * (1 - np.exp(-5)))  # variance of the changing half's mean over a whole revolution
    assert (off[:, -1] - off[:, 0]).std() == pytest.approx(3.6 * np.sqrt((1 + forgotten) / 2), rel=0.1)
    steady = np.degrees([turntable_angles(nominal, TurntableErrors(rate=0.0), rng(s)) for s in range(800)])
    smooth = steady - steady[:, :1]
    lines = np.abs(np.fft.rfft(smooth[:, :-1], axis=1)) / 125
    assert (np.argmax(lines[:, 1:], axis=1) == 11).all()
    assert lines[:, 12].mean() == pytest.approx(0.5, rel=0.01)


def test_turntable_wobble_tilts_about_its_bearing():
    errors = TurntableErrors(start_deg=0, rate=0, ripple_deg=0)
    tilts = []
    for seed in range(400):
        moved = turntable(TURN, errors, rng(seed))
        tilts.append(np.degrees(np.arccos(np.clip(moved[:, 2, 2], -1, 1))))
        # the disc rotates about its bearing, 0.1 m from the target
        np.testing.assert_allclose(np.linalg.norm(moved[:, :3, 3] - [2.0, 0.0, 0.9], axis=1), 0.1, atol=1e-9)
    # two tilts of 0.2 degrees about two axes each: mean square 4 * 0.2^2
    assert np.mean(np.square(tilts)) == pytest.approx(4 * 0.2**2, rel=0.1)


def test_objects_share_the_placement_offset_and_yaw_and_rotating_ones_are_eccentric():
    motion = {"object": TURN, "stand": np.eye(4)[None]}
    moved = [placed(motion, PlacementErrors(), rng(s)) for s in range(800)]
    stand = np.array([m["stand"][0, :2, 3] for m in moved])
    assert stand.std() == pytest.approx(5e-3, rel=0.1)
    centre = np.array([m["object"][:, :2, 3].mean(axis=0) - [2.0, 0.0] for m in moved])
    np.testing.assert_allclose(centre, stand, atol=1e-9)
    off_axis = np.array([m["object"][0, :2, 3] - [2.0, 0.0] for m in moved]) - stand
    assert off_axis.std() == pytest.approx(2e-3, rel=0.1)
    for name in motion:
        yaw = np.degrees([np.arctan2(m[name][0, 1, 0], m[name][0, 0, 0]) for m in moved])
        assert yaw.std() == pytest.approx(2.0, rel=0.1)
    radius = np.linalg.norm(moved[0]["object"][:, :2, 3] - [2.0, 0.0] - stand[0], axis=1)
    np.testing.assert_allclose(radius, radius[0], atol=1e-9)


def test_rail_errors_have_the_described_spread_along_the_rail():
    """The error is 2 mm at the start and 0.5 % of the path more at the end, along the rail only, without rotation."""
    slide = np.tile(np.eye(4), (61, 1, 1))
    slide[:, :2, 3] = np.linspace(0, 0.6, 61)[:, None] * np.sqrt([0.5, 0.5])
    assert not turns(slide)
    assert turns(TURN)
    there = np.stack([rail(slide, RailErrors(), rng(s)) for s in range(800)])
    off = there[:, :, :3, 3] - slide[:, :3, 3]
    along, across = off @ [np.sqrt(0.5), np.sqrt(0.5), 0], off @ [np.sqrt(0.5), -np.sqrt(0.5), 0]
    assert along[:, 0].std() == pytest.approx(2e-3, rel=0.1)
    assert (along[:, -1] - along[:, 0]).std() == pytest.approx(3e-3, rel=0.1)
    assert np.abs(across).max() < 1e-12
    assert np.array_equal(there[:, :, :3, :3], np.broadcast_to(slide[:, :3, :3], there[:, :, :3, :3].shape))
