"""Point clouds of made signals: places of detections, sidelobes, noise, and the two measures of agreement on clouds compared by hand."""

from dataclasses import replace

import numpy as np
import pytest

from radartwin.features import cloud
from radartwin.features.processed import Processed
from radartwin.radar.chirp import Radar
from radartwin.radar.processing import azimuth_row, steering

RADAR = Radar.iwr1843()
RANGE_M = np.arange(0, 6, 0.04)


def processed(targets: list[tuple[float, float, float]], noise: float = 1e-3, frames: int = 2, radar: Radar = RADAR) -> Processed:
    """Return a recording of plane waves from (range_m, azimuth_deg, amplitude), each with the main lobe of a Hann window, and noise."""
    rng = np.random.default_rng(1)
    count = len(azimuth_row(radar))
    channels = noise * (rng.normal(size=(frames, count, len(RANGE_M))) + 1j * rng.normal(size=(frames, count, len(RANGE_M))))
    for range_m, azimuth_deg, amplitude in targets:
        wave = np.conj(steering(radar, np.deg2rad([azimuth_deg]))[:, 0]) * count
        apart = (RANGE_M - range_m) / 0.04
        channels += amplitude * wave[:, None] * np.where(np.abs(apart) < 2, np.cos(np.pi * apart / 4) ** 2, 0.0)
    power = np.mean(np.abs(channels) ** 2, axis=1)
    return Processed(radar, RANGE_M, power.astype(np.float32), channels.astype(np.complex64), None, np.zeros(1))


def test_each_target_is_one_detection_at_its_place() -> None:
    clouds = cloud.detections(processed([(1.0, 0.0, 1.0), (2.4, 30.0, 0.5), (4.0, -40.0, 0.2)]))
    assert len(clouds) == 2
    for frame in clouds:
        assert frame[:, 0] == pytest.approx([1.0, 2.4, 4.0], abs=0.021)
        assert np.rad2deg(frame[:, 1]) == pytest.approx([0, 30, -40], abs=1.5)


def test_two_targets_at_one_range_are_two_detections() -> None:
    (frame,) = cloud.detections(processed([(2.0, -35.0, 1.0), (2.0, 25.0, 0.8)], frames=1))
    assert sorted(np.rad2deg(frame[:, 1])) == pytest.approx([-35, 25], abs=4)


@pytest.mark.parametrize("reversed_antennas", ["tx_positions_m", "rx_positions_m"])
def test_order_of_the_antennas_adds_no_detections(reversed_antennas) -> None:
    radar = replace(RADAR, **{reversed_antennas: getattr(RADAR, reversed_antennas)[::-1]})
    (frame,) = cloud.detections(processed([(3.0, -20.0, 1.0)], frames=1, radar=radar))
    assert frame[:, 0] == pytest.approx([3.0], abs=0.021)
    assert np.rad2deg(frame[:, 1]) == pytest.approx([-20.0], abs=1.5)


def test_noise_has_few_detections() -> None:
    clouds = cloud.detections(processed([], frames=50))
    assert np.mean([len(frame) for frame in clouds]) < 0.02 * len(RANGE_M)


def test_agreement_of_clouds_compared_by_hand() -> None:
    first = np.array([[1.0, 0.0], [2.0, np.pi / 2]])  # in front, and to the left
    second = np.array([[1.05, np.deg2rad(10.0)]])
    assert cloud.matched(first, second, 0.1, np.deg2rad(15.0)) == 0.5
    assert cloud.matched(second, first, 0.1, np.deg2rad(15.0)) == 1.0
    assert cloud.matched(first, second, 0.1, np.deg2rad(5.0)) == 0.0
    near = np.hypot(1.05 * np.cos(np.deg2rad(10.0)) - 1, 1.05 * np.sin(np.deg2rad(10.0)))
    far = np.hypot(1.05 * np.cos(np.deg2rad(10.0)), 1.05 * np.sin(np.deg2rad(10.0)) - 2)
    assert cloud.chamfer_m(first, second) == pytest.approx(((near + far) / 2 + near) / 2)
    assert np.isnan(cloud.chamfer_m(first, second[:0]))
    assert np.isnan(cloud.matched(second[:0], first, 0.1, 0.1))
