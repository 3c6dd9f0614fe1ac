"""Read files of the cascade's capture board whose values are written by hand."""

import dataclasses

import numpy as np
import pytest
from made_files import refused

import radartwin as rt
from radartwin.builders.radar import named_radar
from radartwin.errors import MissingError
from radartwin.radar.captures import load_capture
from radartwin.radar.cascade_capture import CHIPS

RADAR = dataclasses.replace(named_radar("awr2243_cascade"), num_chirps=8, num_samples=64, frame_rate_hz=100.0)
SHAPE = (3, 8, 12, 16, 64)  # frame, loop, transmitter, receiver, sample


def counts() -> np.ndarray:
    """Return samples whose real part names loop, transmitter and receiver and whose imaginary part names sample and frame."""
    frame, loop, tx, rx, sample = np.indices(SHAPE)
    return ((loop * 12 + tx) * 16 + rx + 1j * (-1000 * frame - sample)).astype(np.complex64)


def write_by_hand(folder, iq, part=0):
    """Write the four files value by value: frame, loop, transmitter, sample, receiver of the chip, I before Q."""
    folder.mkdir(exist_ok=True)
    for chip, name in enumerate(("master", "slave1", "slave2", "slave3")):
        order = iq[:, :, :, 4 * chip : 4 * chip + 4].transpose(0, 1, 2, 4, 3).reshape(-1)
        values = np.empty(2 * order.size, "<i2")
        values[0::2], values[1::2] = order.real, order.imag
        values.tofile(folder / f"{name}_{part:04d}_data.bin")


def test_capture_is_read_in_the_order_of_chips_and_receivers(tmp_path):
    write_by_hand(tmp_path / "capture", counts()[:2])
    write_by_hand(tmp_path / "capture", counts()[2:], part=1)
    (tmp_path / "capture" / "master_0000_idx.bin").write_bytes(b"index")
    recording = load_capture(tmp_path / "capture", RADAR, iq_swapped=False)
    np.testing.assert_array_equal(recording.iq, counts())
    assert recording.provenance["unit"] == "counts"


@pytest.mark.parametrize(
    "lost", [[f"{chip}_0001_data.bin" for chip in CHIPS], [f"{chip}_0000_data.bin" for chip in CHIPS], ["slave3_0002_data.bin"]]
)
def test_a_lost_part_is_named_in_one_line(tmp_path, lost):
    for part in range(3):
        write_by_hand(tmp_path, counts()[part : part + 1], part)
    for name in lost:
        (tmp_path / name).unlink()
    words = [f"{tmp_path / lost[0]}: no such file; each of the 4 chips needs the parts 0000 to 0002"]
    refused(words, load_capture, tmp_path, RADAR, error=MissingError)


def test_captures_of_another_radar_or_length_are_refused_in_one_line(tmp_path):
    write_by_hand(tmp_path, counts())
    refused(["does not name its radar"], load_capture, tmp_path)
    refused(["4 receivers"], load_capture, tmp_path, rt.Radar.iwr1843())
    (tmp_path / "slave2_0000_data.bin").write_bytes(bytes(100))
    refused(["part 0000", " 100, ", "whole number of frames"], load_capture, tmp_path, RADAR)
