"""An interpolated revolution has the target poses of a fully traced one: the logged poses with the same pose errors."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from experiments.campaign import truth
from experiments.campaign.cases import Case
from radartwin.config.compose import compose
from radartwin.simulation.aspects import BATCH, Aspects

COURSE = ["profile.campaign.frames_per_turn=40", "profile.campaign.turns=30"]


@pytest.fixture
def simulated(monkeypatch):
    """Return a function that simulates a recording whose samples encode yaw, position and tilt of the target."""

    def seen(case, place, root, there, shadow, coupled=True):
        poses = there.motion[case.object]
        assert len(poses) <= BATCH + 1  # the paths of more frames would take gigabytes
        encoded = np.exp(1j * np.arctan2(poses[:, 1, 0], poses[:, 0, 0])) + 1j * (poses[:, 0, 3] - 1.0) + 100 * poses[:, 2, 0]
        return np.tile(encoded[:, None, None, None, None], (1, place.radar.num_chirps, 1, 1, 1)).astype(np.complex64)

    def simulate(case, config, traced=False):
        if traced:
            for few in ("aspects", "shadows"):
                monkeypatch.setattr(truth, few, lambda *_: 10**9)
        made: Any = truth.record(case, config)
        return (made.iq if traced else made.aspects.at(made.angles))[:, :, 0, 0, 0]

    monkeypatch.setattr(truth, "_seen", seen)
    monkeypatch.setattr(truth._Turning, "_target", lambda *_: Aspects(np.zeros((64, 1, 1, 1), np.complex64)))
    for slow in ("_creep", "_person"):
        monkeypatch.setattr(truth, slow, lambda *_: None)
    monkeypatch.setattr(truth, "Recording", lambda iq, *_, **more: SimpleNamespace(iq=iq))
    return simulate


@pytest.mark.parametrize("name", ["mug", "can_211_400"])
@pytest.mark.parametrize("strength", [0.0, 1.0, 2.0])
def test_interpolated_and_traced_revolutions_have_equal_poses(simulated, name, strength):
    gaps = [f"measured.gap.{gap}={strength}" for gap in ("trajectory", "placement")]
    config = compose(["experiment=campaign", *COURSE, *gaps])
    case = Case(name, "lab", "turntable", 1.0)
    interpolated, traced = simulated(case, config), simulated(case, config, traced=True)
    assert interpolated.shape == traced.shape
    assert np.abs(interpolated - traced).max() < 0.02
    assert np.abs(traced + traced.mean()).max() > 0.5  # the target rotates, so that its yaw is not constant


def test_without_errors_the_start_is_the_logged_one(simulated):
    config = compose(["experiment=campaign", *COURSE, "measured.gap.trajectory=0", "measured.gap.placement=0"])
    case = Case("mug", "lab", "turntable", 1.0)
    start = truth.log(case, config.profile.campaign, measured=True).target_poses[0]
    yaw = np.angle(simulated(case, config)[0, 0] - 1j * (start[0, 3] - 1.0))
    assert np.cos(yaw - np.arctan2(start[1, 0], start[0, 0])) > 0.9999


def test_every_frame_knows_the_next_pose_which_gives_its_velocity(simulated, monkeypatch):
    def following(case, place, root, there, shadow):
        yaw = np.unwrap(np.arctan2(*there.motion[case.object][:, 1::-1, 0].T))
        return np.exp(1j * np.append(yaw[1:], yaw[-1]))[:, None, None, None, None]

    monkeypatch.setattr(truth, "_seen", following)
    config = compose(["experiment=campaign", *COURSE, "measured.gap.trajectory=0"])
    steps = np.diff(np.unwrap(np.angle(simulated(Case("mug", "lab", "turntable", 1.0), config, traced=True)[:, 0])))
    assert steps[:-1] == pytest.approx(2 * np.pi / 40)
    assert steps[-1] == pytest.approx(0, abs=1e-9)
