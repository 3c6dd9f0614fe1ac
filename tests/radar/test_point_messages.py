"""Point clouds as bytes, which numpy reads by their field table as a subscriber of sensor_msgs/PointCloud2 does."""

from dataclasses import fields

import numpy as np
from made_files import refused

from radartwin.errors import InputError
from radartwin.radar.detection import Peaks
from radartwin.radar.point_messages import arrays, point_cloud2

# PointField datatype codes of sensor_msgs and the numpy types that they stand for.
DATATYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
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


def read(message) -> dict[str, np.ndarray]:
    """Read the points of any object with the fields of sensor_msgs/PointCloud2, as a subscriber does."""
    order = ">" if message.is_bigendian else "<"
    raw = np.frombuffer(bytes(message.data), np.uint8).reshape(message.height, message.row_step)
    raw = raw[:, : message.width * message.point_step].reshape(-1, message.point_step)
    out = {}
    for field in message.fields:
        kind = np.dtype(order + DATATYPES[field.datatype])
        out[field.name] = raw[:, field.offset : field.offset + kind.itemsize * field.count].copy().view(kind)[:, 0]
    return out


def test_bytes_follow_their_field_table():
    cloud = point_cloud2(PEAKS)
    assert (cloud.height, cloud.width, cloud.point_step, cloud.row_step, cloud.is_dense) == (1, 2, 20, 40, True)
    assert [field.offset for field in cloud.fields] == [0, 4, 8, 12, 16]
    points = read(cloud)
    assert list(points) == list(EXPECTED)
    for name, values in EXPECTED.items():
        # float32 holds 4 m to 2e-7 m; sin and cos of 90 degrees are zero to rounding.
        np.testing.assert_allclose(points[name], values, rtol=1e-6, atol=1e-6)


def test_clouds_of_an_unknown_speed_of_no_noise_and_of_no_points():
    assert not point_cloud2(Peaks(ONE, np.full(1, np.nan), ONE, ONE, ONE, ONE)).is_dense
    assert point_cloud2(Peaks(ONE, ONE, ONE, ONE, ONE, np.zeros(1))).is_dense  # the intensity is finite
    empty = point_cloud2(Peaks(*(np.empty(0) for _ in fields(Peaks))))
    assert (empty.width, empty.row_step, empty.data, empty.is_dense) == (0, 0, b"", True)


def test_arrays_of_a_recording_give_the_points_of_each_frame():
    none = Peaks(*(np.empty(0) for _ in fields(Peaks)))
    stored = arrays([PEAKS, none, PEAKS], frame_rate_hz=10.0)
    np.testing.assert_array_equal(stored["first"], [0, 2, 2, 4])
    np.testing.assert_allclose(stored["time_s"], [0.0, 0.1, 0.2])
    np.testing.assert_allclose(stored["points"][2:4], np.array(list(EXPECTED.values())).T, rtol=1e-6, atol=1e-6)
    assert arrays([none], 10.0)["points"].shape == (0, 5)
    refused(["no frame"], arrays, [], 10.0, error=InputError)
