"""Point clouds as bytes, which numpy reads by their field table as a subscriber of sensor_msgs/PointCloud2 does."""

from dataclasses import fields

import numpy as np
from made_files import refused

from radartwin.errors import InputError
from radartwin.radar.detection import Peaks
from radartwin.radar.point_messages import POINT, arrays, packed

PEAKS = Peaks(
    range_m=np.array([2.0, 4.0]),
    velocity_mps=np.array([-1.5, 0.25]),
    azimuth_rad=np.radians([90.0, 0.0]),
    elevation_rad=np.radians([0.0, 30.0]),
    power=np.array([1e-6, 1e-8]),
    noise=np.array([1e-9, 1e-9]),
)
ONE = np.ones(1)
EXPECTED = {
    "x": [0.0, 4 * np.sqrt(0.75)], "y": [2.0, 0.0], "z": [0.0, 2.0], "velocity": [-1.5, 0.25], "intensity": [30.0, 10.0],
}  # fmt: skip


def test_bytes_follow_their_field_table():
    assert (POINT.itemsize, POINT.names) == (20, tuple(EXPECTED))
    points = np.frombuffer(packed(PEAKS).tobytes(), [(name, "<f4") for name in EXPECTED])
    for name, values in EXPECTED.items():
        # float32 holds 4 m to 2e-7 m; sin and cos of 90 degrees are zero to rounding.
        np.testing.assert_allclose(points[name], values, rtol=1e-6, atol=1e-6)


def test_points_without_a_speed_or_noise():
    assert np.isnan(packed(Peaks(ONE, np.full(1, np.nan), ONE, ONE, ONE, ONE))["velocity"]).all()
    assert np.isfinite(packed(Peaks(ONE, ONE, ONE, ONE, ONE, np.zeros(1)))["intensity"]).all()


def test_arrays_of_a_recording_give_the_points_of_each_frame():
    none = Peaks(*(np.empty(0) for _ in fields(Peaks)))
    stored = arrays([PEAKS, none, PEAKS], frame_rate_hz=10.0)
    np.testing.assert_array_equal(stored["first"], [0, 2, 2, 4])
    np.testing.assert_allclose(stored["time_s"], [0.0, 0.1, 0.2])
    np.testing.assert_allclose(stored["points"][2:4], np.array(list(EXPECTED.values())).T, rtol=1e-6, atol=1e-6)
    assert arrays([none], 10.0)["points"].shape == (0, 5)
    refused(["no frame"], arrays, [], 10.0, error=InputError)
